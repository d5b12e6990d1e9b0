#include "ros/node/confine.h"

#include "pliant/pliant.h"

#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstring>
#include <fstream>
#include <set>

namespace {

/* base/inside is the root; base/secret is next to it */
class Confine : public ::testing::Test {
protected:
    void SetUp() override
    {
        char pattern[] = "/tmp/confine_testXXXXXX";
        ASSERT_TRUE(mkdtemp(pattern));
        char *real = realpath(pattern, nullptr);
        base = real;
        free(real);
        root = base + "/inside";
        ASSERT_EQ(mkdir(root.c_str(), 0755), 0);
        write(base + "/secret.nii", "secret");
        write(root + "/scan.nii", "scan");
    }
    void TearDown() override { EXPECT_EQ(system(("rm -rf '" + base + "'").c_str()), 0); }

    static void write(const std::string &path, const std::string &text) { std::ofstream(path) << text; }
    bool may_read(const std::string &path) { return pliant_ros::confine_existing(root, path, &resolved, &why); }
    bool may_write(const std::string &path) { return pliant_ros::confine_new(root, path, &resolved, &why); }

    std::string base, root, resolved, why;
};

TEST_F(Confine, ReadsWhatIsInside)
{
    EXPECT_TRUE(may_read("scan.nii")) << why;
    EXPECT_EQ(resolved, root + "/scan.nii");
    EXPECT_TRUE(may_read(root + "/scan.nii")) << why;
    EXPECT_TRUE(may_read("../inside/scan.nii")) << why;
}

TEST_F(Confine, RefusesWithoutARoot)
{
    EXPECT_FALSE(pliant_ros::confine_existing("", "/etc/passwd", &resolved, &why));
    EXPECT_FALSE(why.empty());
    EXPECT_FALSE(pliant_ros::confine_new("", "/tmp/x.nii", &resolved, &why));
}

TEST_F(Confine, RefusesDotsAndAbsolutePathsOutside)
{
    EXPECT_FALSE(may_read("../secret.nii"));
    EXPECT_NE(why.find("outside"), std::string::npos) << why;
    EXPECT_FALSE(may_read(base + "/secret.nii"));
    EXPECT_FALSE(may_read("/etc/passwd"));
}

// Error messages do not reveal whether a file outside exists.
TEST_F(Confine, MissingFilesOutsideAreRefusedLikeExistingOnes)
{
    for (const char *name : {"../secret.nii", "../nothing.nii", "../nothing/of/that.nii", "/nothing/at/all.nii"}) {
        EXPECT_FALSE(may_read(name));
        EXPECT_EQ(why, std::string(name) + " is outside " + root +
                           "; move it there, or start the node with another ~scan_root");
    }
    EXPECT_FALSE(may_write("../nothing/of/that.nii"));
    EXPECT_NE(why.find("is outside"), std::string::npos) << why;
    EXPECT_FALSE(may_read("nothing.nii"));
    EXPECT_NE(why.find("No such file"), std::string::npos) << why;
    EXPECT_FALSE(may_write("nothing/scan.nii"));
    EXPECT_NE(why.find("No such file"), std::string::npos) << why;
}

TEST_F(Confine, ANameThatBeginsLikeTheRootIsOutside)
{
    ASSERT_EQ(mkdir((root + "2").c_str(), 0755), 0);
    write(root + "2/scan.nii", "scan");
    EXPECT_FALSE(may_read(root + "2/scan.nii"));
}

TEST_F(Confine, RefusesLinksToOutside)
{
    ASSERT_EQ(symlink((base + "/secret.nii").c_str(), (root + "/link.nii").c_str()), 0);
    EXPECT_FALSE(may_read("link.nii"));
    ASSERT_EQ(symlink(base.c_str(), (root + "/folder").c_str()), 0);
    EXPECT_FALSE(may_read("folder/secret.nii"));
    ASSERT_EQ(symlink((root + "/scan.nii").c_str(), (root + "/good.nii").c_str()), 0);
    EXPECT_TRUE(may_read("good.nii")) << why;
    EXPECT_EQ(resolved, root + "/scan.nii");
}

/* Scans that are readable except for the location of their data. */
class ConfinedReadsTest : public Confine {
protected:
    void SetUp() override
    {
        Confine::SetUp();
        const std::string voxels(2 * 4 * 4 * 4, '\1');
        write(base + "/secret.raw", voxels);
        write(root + "/scan.raw", voxels);
    }
    /* Read with and without the confinement, because a case that is unreadable anyway would test nothing. */
    bool reads(const std::string &name)
    {
        pliant_volume volume{};
        pliant_status status;
        {
            pliant_ros::ConfinedReads confined(root, {});
            status = pliant_volume_read((root + "/" + name).c_str(), nullptr, 0, &volume);
            why = status == PLIANT_OK ? "" : pliant_last_error();
        }
        pliant_volume_free(&volume);
        return status == PLIANT_OK;
    }
    bool reads_freely(const std::string &name)
    {
        pliant_volume volume{};
        bool good = pliant_volume_read((root + "/" + name).c_str(), nullptr, 0, &volume) == PLIANT_OK;
        pliant_volume_free(&volume);
        return good;
    }
    void expect_refused(const std::string &name)
    {
        EXPECT_TRUE(reads_freely(name)) << name << ": " << pliant_last_error();
        EXPECT_FALSE(reads(name)) << name;
        EXPECT_NE(why.find("outside"), std::string::npos) << why;
    }
    std::string secret() const { return base + "/secret.raw"; }

    const std::string nrrd = "NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 4 4 4\n"
                             "space directions: (5,0,0) (0,5,0) (0,0,5)\nencoding: raw\nendian: little\n"
                             "space origin: (0,0,0)\n";
    const std::string meta = "ObjectType = Image\nNDims = 3\nDimSize = 4 4 4\nElementSpacing = 5 5 5\n"
                             "ElementType = MET_SHORT\n";
};

TEST_F(ConfinedReadsTest, DataFilesOfNrrdHeaders)
{
    write(root + "/good.nhdr", nrrd + "data file: scan.raw\n\n");
    EXPECT_TRUE(reads("good.nhdr")) << why;
    write(root + "/whole.nhdr", nrrd + "data file: " + secret() + "\n\n");
    write(root + "/dots.nhdr", nrrd + "data file: ../secret.raw\n\n");
    write(root + "/by_content.dat", nrrd + "data file: " + secret() + "\n\n");
    write(root + "/blanks.nhdr", nrrd + "da tafile: " + secret() + "\n\n");
    write(root + "/long_line.nhdr", nrrd + "#" + std::string(5000, 'x') + "\ndata file: " + secret() + "\n\n");
    for (const char *name : {"whole.nhdr", "dots.nhdr", "by_content.dat", "blanks.nhdr", "long_line.nhdr"})
        expect_refused(name);
    /* no file of a list is read, and the list's line is not part of the data */
    write(root + "/list.nhdr", nrrd + "data file: LIST\n" + secret() + "\n");
    write(root + "/pattern.nhdr", nrrd + "data file: " + base + "/secret%d.raw 1 2 1\n\n");
    EXPECT_FALSE(reads("list.nhdr"));
    EXPECT_FALSE(reads("pattern.nhdr"));
}

TEST_F(ConfinedReadsTest, DataFilesOfMetaImageHeaders)
{
    write(root + "/good.mhd", meta + "ElementDataFile = scan.raw\n");
    EXPECT_TRUE(reads("good.mhd")) << why;
    std::string lines;
    for (int line = 0; line < 5000; ++line) lines += "C" + std::to_string(line) + " = 1\n";
    const std::string data = "ElementDataFile = " + secret() + "\n";
    write(root + "/whole.mhd", meta + data);
    write(root + "/long_line.mhd", "Comment = " + std::string(5000, 'x') + "\n" + meta + data);
    write(root + "/many_lines.mhd", lines + meta + data);
    for (const char *name : {"whole.mhd", "long_line.mhd", "many_lines.mhd"}) expect_refused(name);
    write(root + "/list.mhd", meta + "ElementDataFile = LIST\n" + secret() + "\n");
    EXPECT_FALSE(reads("list.mhd"));
}

TEST_F(ConfinedReadsTest, LinksThatAHeaderNames)
{
    ASSERT_EQ(symlink(secret().c_str(), (root + "/link.raw").c_str()), 0);
    ASSERT_EQ(symlink(base.c_str(), (root + "/up").c_str()), 0);
    write(root + "/file.mhd", meta + "ElementDataFile = link.raw\n");
    write(root + "/folder.mhd", meta + "ElementDataFile = up/secret.raw\n");
    expect_refused("file.mhd");
    expect_refused("folder.mhd");
}

TEST_F(ConfinedReadsTest, TheImageOfANiftiPair)
{
    /* NIfTI-1 (nifti1.h): 348 bytes, sizeof_hdr, dim, datatype and bitpix (16-bit integers), pixdim, magic of a pair */
    std::string header(348, '\0');
    auto put = [&](size_t at, auto value) { std::memcpy(&header[at], &value, sizeof value); };
    put(0, int32_t(348));
    const int16_t dim[8] = {3, 4, 4, 4, 1, 1, 1, 1};
    std::memcpy(&header[40], dim, sizeof dim);
    put(70, int16_t(4));
    put(72, int16_t(16));
    for (size_t n = 0; n < 8; ++n) put(76 + 4 * n, 1.0f);
    std::memcpy(&header[344], "ni1", 4);
    write(root + "/pair.hdr", header);
    ASSERT_EQ(symlink(secret().c_str(), (root + "/pair.img").c_str()), 0);
    expect_refused("pair.hdr");
    ASSERT_EQ(unlink((root + "/pair.img").c_str()), 0);
    ASSERT_EQ(rename((root + "/scan.raw").c_str(), (root + "/pair.img").c_str()), 0);
    EXPECT_TRUE(reads("pair.hdr")) << why;
}

TEST_F(ConfinedReadsTest, LinksInAFolderOfImages)
{
    ASSERT_EQ(mkdir((root + "/series").c_str(), 0755), 0);
    write(root + "/series/1.dcm", "no DICOM");
    EXPECT_FALSE(reads("series"));
    EXPECT_EQ(why.find("outside"), std::string::npos) << why;
    ASSERT_EQ(symlink(secret().c_str(), (root + "/series/2.dcm").c_str()), 0);
    EXPECT_FALSE(reads("series"));
    EXPECT_NE(why.find("outside"), std::string::npos) << why;
    EXPECT_FALSE(reads(".."));
    EXPECT_NE(why.find("outside"), std::string::npos) << why;
}

TEST_F(ConfinedReadsTest, MissingFilesOutsideAreRefusedLikeExistingOnes)
{
    write(root + "/there.mhd", meta + "ElementDataFile = " + secret() + "\n");
    write(root + "/not_there.mhd", meta + "ElementDataFile = " + base + "/nothing/of/that.raw\n");
    write(root + "/folder.mhd", meta + "ElementDataFile = " + base + "\n");
    for (const char *name : {"there.mhd", "not_there.mhd", "folder.mhd"}) {
        EXPECT_FALSE(reads(name));
        EXPECT_NE(why.find("outside"), std::string::npos) << why;
    }
    write(root + "/missing.mhd", meta + "ElementDataFile = missing.raw\n");
    EXPECT_FALSE(reads("missing.mhd"));
    EXPECT_NE(why.find("No such file"), std::string::npos) << why;
}

TEST_F(ConfinedReadsTest, TablesAndScenesToo)
{
    const std::string table = base + "/table.yaml";
    write(table,
          "materials:\n  - {name: a, young_modulus: 1000.0, poisson_ratio: 0.4, density: 1000.0, labels: [1]}\n");
    pliant_material_table read{};
    ASSERT_EQ(pliant_material_table_read(table.c_str(), &read), PLIANT_OK) << pliant_last_error();
    pliant_material_table_free(&read);
    {
        pliant_ros::ConfinedReads confined(root, {});
        EXPECT_EQ(pliant_material_table_read(table.c_str(), &read), PLIANT_ERROR_FILE);
        pliant_scene scene;
        EXPECT_EQ(pliant_scene_read(table.c_str(), &scene), PLIANT_ERROR_FILE);
        {
            pliant_ros::ConfinedReads with_one_more(root, {table});
            EXPECT_EQ(pliant_material_table_read(table.c_str(), &read), PLIANT_OK) << pliant_last_error();
            pliant_material_table_free(&read);
        }
        EXPECT_EQ(pliant_material_table_read(table.c_str(), &read), PLIANT_ERROR_FILE) << "the check before is back";
    }
    EXPECT_EQ(pliant_material_table_read(table.c_str(), &read), PLIANT_OK) << "and no check at last";
    pliant_material_table_free(&read);
}

// The operator's scene may be anywhere: its table, mesh, obstacles and their STL files are read, and nothing else
// outside.
TEST_F(ConfinedReadsTest, FilesOfTheOwnScene)
{
    write(base + "/table.yaml", "materials: []\n");
    write(base + "/mesh.vtu", "no mesh");
    write(base + "/solid.stl",
          "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 0 1 0\nvertex 1 0 0\nendloop\nendfacet\n"
          "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 0 1\nendloop\nendfacet\n"
          "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 0 0 1\nvertex 0 1 0\nendloop\nendfacet\n"
          "facet normal 0 0 1\nouter loop\nvertex 1 0 0\nvertex 0 1 0\nvertex 0 0 1\nendloop\nendfacet\nendsolid a\n");
    write(base + "/obstacles.yaml", "parts: [{kind: convex, file: solid.stl}]\n");
    pliant_scene scene;
    pliant_scene_defaults(&scene);
    EXPECT_TRUE(pliant_ros::files_of(scene).empty());
    for (const char *option : {"material/file=table.yaml", "mesh/file=mesh.vtu", "contact/obstacles=obstacles.yaml"}) {
        const std::string text = option;
        const size_t sign = text.find('=');
        ASSERT_EQ(pliant_scene_set(&scene, text.substr(0, sign).c_str(), (base + "/" + text.substr(sign + 1)).c_str()),
                  PLIANT_OK);
    }
    const std::vector<std::string> files = pliant_ros::files_of(scene);
    EXPECT_EQ(std::set<std::string>(files.begin(), files.end()),
              (std::set<std::string>{base + "/table.yaml", base + "/mesh.vtu", base + "/obstacles.yaml",
                                     base + "/solid.stl"}));
    pliant_ros::ConfinedReads confined(root, files);
    pliant_tool_shape shape{};
    ASSERT_EQ(pliant_tool_shape_read((base + "/obstacles.yaml").c_str(), &shape), PLIANT_OK) << pliant_last_error();
    pliant_tool_shape_free(&shape);
    write(base + "/others.yaml", "parts: [{kind: convex, file: solid.stl}]\n");
    EXPECT_EQ(pliant_tool_shape_read((base + "/others.yaml").c_str(), &shape), PLIANT_ERROR_FILE);
    EXPECT_NE(std::string(pliant_last_error()).find("~scan_root"), std::string::npos) << pliant_last_error();
}

TEST_F(ConfinedReadsTest, WithoutARootNothingIsRead)
{
    write(root + "/good.mhd", meta + "ElementDataFile = scan.raw\n");
    pliant_volume volume{};
    pliant_ros::ConfinedReads confined("", {});
    EXPECT_EQ(pliant_volume_read((root + "/good.mhd").c_str(), nullptr, 0, &volume), PLIANT_ERROR_FILE);
}

TEST_F(Confine, MissingFilesAreNamed)
{
    EXPECT_FALSE(may_read("none.nii"));
    EXPECT_NE(why.find("none.nii"), std::string::npos);
    EXPECT_FALSE(may_read(""));
}

TEST_F(Confine, WritesInsideOnly)
{
    EXPECT_TRUE(may_write("out.nii.gz")) << why;
    EXPECT_EQ(resolved, root + "/out.nii.gz");
    EXPECT_TRUE(may_write("scan.nii")) << why;
    EXPECT_FALSE(may_write("../out.nii.gz"));
    EXPECT_FALSE(may_write("/tmp/out.nii.gz"));
    EXPECT_FALSE(may_write("none/out.nii.gz"));
    EXPECT_FALSE(may_write(".."));
    EXPECT_FALSE(may_write(""));
    ASSERT_EQ(symlink((base + "/secret.nii").c_str(), (root + "/link.nii").c_str()), 0);
    EXPECT_FALSE(may_write("link.nii"));
}

} // namespace
