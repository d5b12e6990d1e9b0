#include "confine.h"

#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>

namespace {

/* base/inside is the root; base/secret lies beside it */
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

TEST_F(Confine, RefusesASeriesWithALinkToOutside)
{
    ASSERT_EQ(mkdir((root + "/series").c_str(), 0755), 0);
    write(root + "/series/1.dcm", "");
    EXPECT_TRUE(may_read("series")) << why;
    ASSERT_EQ(symlink((base + "/secret.nii").c_str(), (root + "/series/2.dcm").c_str()), 0);
    EXPECT_FALSE(may_read("series"));
}

TEST_F(Confine, RefusesHeadersThatPointOutside)
{
    write(root + "/a.mhd", "NDims = 3\nElementDataFile = ../secret.nii\n");
    EXPECT_FALSE(may_read("a.mhd"));
    write(root + "/b.mhd", "NDims = 3\nElementDataFile = scan.nii\n");
    EXPECT_TRUE(may_read("b.mhd")) << why;
    write(root + "/c.mhd", "NDims = 3\nElementDataFile = LIST\nscan.nii\n" + base + "/secret.nii\n");
    EXPECT_FALSE(may_read("c.mhd"));
    write(root + "/d.nhdr", "NRRD0004\ntype: short\ndata file: ../secret.nii\n");
    EXPECT_FALSE(may_read("d.nhdr"));
    write(root + "/e.nrrd", "NRRD0004\ntype: short\n\ndata file: ../secret.nii\n");
    EXPECT_TRUE(may_read("e.nrrd")) << "the line belongs to the data";
    write(root + "/f.mha", "NDims = 3\nElementDataFile = LOCAL\nElementDataFile = ../secret.nii\n");
    EXPECT_TRUE(may_read("f.mha")) << "the line belongs to the data";
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
