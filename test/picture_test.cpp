// Tests of pictures: each part of the patient has the right position and shade, and differences have the right colour.
#include "programs/picture.h"
#include "programs/picture_scalar.h"
#include "programs/picture_section.h"

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <gtest/gtest.h>
#include <itkImage.h>
#include <itkImageFileReader.h>
#include <itkPNGImageIO.h>
#include <itkRGBPixel.h>
#include <string>
#include <unistd.h>
#include <vector>

namespace {

using Image = itk::Image<itk::RGBPixel<unsigned char>, 2>;
enum { PANEL = 480, GAP = 4 };

// A cube of 48 mm around the origin, 24 voxels a side, -1000 except for one bright octant.
class Picture : public testing::Test {
protected:
    void SetUp() override
    {
        ASSERT_NE(mkdtemp(folder_), nullptr);
        pliant_geometry geometry = {{24, 24, 24}, {0.023, 0.023, -0.023}, {0.002, 0.002, 0.002},
                                    {-1, 0, 0, 0, -1, 0, 0, 0, 1}}; // i to the right, j to the front, as in NIfTI files
        for (pliant_volume *volume : {&before_, &after_}) {
            ASSERT_EQ(pliant_volume_create(&geometry, PLIANT_INT16, volume), PLIANT_OK);
            volume->slope = 1;
            volume->background = -1000;
            for (int n = 0; n < 24 * 24 * 24; ++n) static_cast<int16_t *>(volume->voxels)[n] = -1000;
        }
    }
    void TearDown() override
    {
        for (const char *name : {"axial", "coronal", "sagittal"})
            std::remove((folder_ + ("/" + std::string(name) + ".png")).c_str());
        rmdir(folder_);
        pliant_volume_free(&before_);
        pliant_volume_free(&after_);
    }
    // Brighten the left (x > 0), anterior (y < 0), superior (z > 0) octant.
    static void brighten(pliant_volume *volume)
    {
        for (int k = 12; k < 24; ++k)
            for (int j = 12; j < 24; ++j)
                for (int i = 0; i < 12; ++i) static_cast<int16_t *>(volume->voxels)[i + 24 * (j + 24 * k)] = 240;
    }
    void write()
    {
        picture_view view = {{0.011, -0.011, 0.011}, {0.011, -0.011, 0.011}, -1000, 240};
        ASSERT_EQ(picture_write(folder_, "", &before_, &after_, &view), PLIANT_OK) << pliant_last_error();
    }
    // Return the colour at fractions right and down of a panel, at least an eighth away from edges and cross.
    std::string colour(const std::string &plane, int panel, double right, double down,
                       unsigned wide = 3u * PANEL + 2 * GAP)
    {
        auto reader = itk::ImageFileReader<Image>::New();
        reader->SetImageIO(itk::PNGImageIO::New());
        reader->SetFileName(std::string(folder_) + "/" + plane + ".png");
        reader->Update();
        auto size = reader->GetOutput()->GetLargestPossibleRegion().GetSize();
        EXPECT_EQ(size[0], wide);
        EXPECT_EQ(size[1], static_cast<unsigned>(PANEL));
        auto pixel = reader->GetOutput()->GetPixel(
            {{static_cast<long>(panel * (PANEL + GAP) + right * PANEL), static_cast<long>(down * PANEL)}});
        char text[16];
        std::snprintf(text, sizeof text, "%02x%02x%02x", pixel[0], pixel[1], pixel[2]);
        return text;
    }
    char folder_[32] = "/tmp/pliant_picture_XXXXXX";
    pliant_volume before_{}, after_{};
};

TEST_F(Picture, ShowsTheLeftFrontUpperOctantWhereRadiologistsExpectIt)
{
    brighten(&before_);
    brighten(&after_);
    write();
    for (int panel = 0; panel < 2; ++panel) {
        EXPECT_EQ(colour("axial", panel, 0.85, 0.15), "ffffff");    // right: left of the patient, up: the front
        EXPECT_EQ(colour("axial", panel, 0.15, 0.15), "000000");
        EXPECT_EQ(colour("axial", panel, 0.85, 0.85), "000000");
        EXPECT_EQ(colour("coronal", panel, 0.85, 0.15), "ffffff");  // up: the head
        EXPECT_EQ(colour("coronal", panel, 0.15, 0.15), "000000");
        EXPECT_EQ(colour("coronal", panel, 0.85, 0.85), "000000");
        EXPECT_EQ(colour("sagittal", panel, 0.15, 0.15), "ffffff"); // left: the front
        EXPECT_EQ(colour("sagittal", panel, 0.85, 0.15), "000000");
        EXPECT_EQ(colour("sagittal", panel, 0.15, 0.85), "000000");
    }
    EXPECT_EQ(colour("axial", 2, 0.85, 0.15), "000000"); // no difference
}

TEST_F(Picture, DifferencesAreRedWhereBrighterAndBlueWhereDarker)
{
    brighten(&after_);
    write();
    EXPECT_EQ(colour("coronal", 2, 0.85, 0.15), "ff0000");
    std::swap(before_, after_);
    write();
    EXPECT_EQ(colour("coronal", 2, 0.85, 0.15), "0000ff");
    EXPECT_EQ(colour("coronal", 2, 0.15, 0.85), "000000");
}

TEST_F(Picture, MarksTheHeldPoint)
{
    write();
    EXPECT_EQ(colour("axial", 0, (0.024 + 0.011) / 0.048, (0.024 - 0.011) / 0.048), "ffc800");
    EXPECT_EQ(colour("axial", 1, (0.024 + 0.011) / 0.048, (0.024 - 0.011) / 0.048), "ffc800");
}

TEST_F(Picture, WindowIsSoftTissueForCtAndPercentilesForOthers)
{
    double low, high;
    int16_t *voxels = static_cast<int16_t *>(before_.voxels);
    ASSERT_EQ(picture_window(&before_, &low, &high), PLIANT_OK);
    EXPECT_EQ(low, -160);
    EXPECT_EQ(high, 240);
    for (int n = 0; n < 24 * 24 * 24; ++n) voxels[n] = static_cast<int16_t>(n % 700);
    for (int n = 0; n < 60; ++n) voxels[n] = 30000; // a few bright vessels
    before_.modality = PLIANT_MODALITY_MR;
    ASSERT_EQ(picture_window(&before_, &low, &high), PLIANT_OK);
    EXPECT_NEAR(low, 7, 1);
    EXPECT_NEAR(high, 697, 3);
    voxels[0] = -2000; // phase and filtered images have negative values too
    ASSERT_EQ(picture_window(&before_, &low, &high), PLIANT_OK);
    EXPECT_NEAR(high, 697, 3);
    before_.modality = PLIANT_MODALITY_CT;
    ASSERT_EQ(picture_window(&before_, &low, &high), PLIANT_OK);
    EXPECT_EQ(high, 240);
}

TEST_F(Picture, WindowShowsAFewVoxelsThatDiffer)
{
    double low, high;
    int16_t *voxels = static_cast<int16_t *>(before_.voxels);
    for (int n = 0; n < 24 * 24 * 24; ++n) voxels[n] = 5;
    ASSERT_EQ(picture_window(&before_, &low, &high), PLIANT_OK);
    EXPECT_GT(high, low);
    voxels[77] = 9;
    ASSERT_EQ(picture_window(&before_, &low, &high), PLIANT_OK);
    EXPECT_EQ(low, 5);
    EXPECT_EQ(high, 9);
}

TEST_F(Picture, NamesAFolderThatIsNotThere)
{
    picture_view view = {{0, 0, 0}, {0, 0, 0}, -1000, 240};
    const std::string absent = std::string(folder_) + "/absent";
    EXPECT_EQ(picture_write(absent.c_str(), "", &before_, &after_, &view), PLIANT_ERROR_FILE);
    EXPECT_NE(std::string(pliant_last_error()).find(absent + "/axial.png"), std::string::npos) << pliant_last_error();
}

// Each tetrahedron that a plane cuts has the colour of its scalar: red on the left of the patient, blue on the right.
TEST_F(Picture, ScalarsAreColoursOfTheTetrahedraThatThePlanesCut)
{
    const double nodes[] = {-0.02, 0, -0.02, -0.02, 0.02, 0.02, -0.02, -0.02, 0.02, 0, 0, 0, // right
                            0.02, 0, -0.02, 0.02, 0.02, 0.02, 0.02, -0.02, 0.02, 0, 0, 0};   // left
    int32_t tets[] = {0, 1, 2, 3, 4, 5, 6, 7};
    pliant_mesh mesh{};
    mesh.num_nodes = 8;
    mesh.num_tets = 2;
    mesh.tets = tets;
    const float values[] = {1, 2};
    const double point[3] = {0, 0, 0.012};
    const picture_scalars scalars = {&mesh, nodes, values};
    ASSERT_EQ(picture_scalar(folder_, "stress", &scalars, &before_.geometry, point), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(colour("stress_axial", 0, 0.1, 0.5, PANEL + 24), "000080"); // x < 0: the value 1
    EXPECT_EQ(colour("stress_axial", 0, 0.9, 0.5, PANEL + 24), "800000");
    EXPECT_EQ(colour("stress_axial", 0, 0.5, 0.1, PANEL + 24), "000000"); // no tissue
    for (const picture_plane &plane : picture_planes)
        std::remove((folder_ + ("/stress_" + std::string(plane.name) + ".png")).c_str());
}

TEST_F(Picture, LabelsAreColoursOnTheSameSideAsTheScan)
{
    brighten(&before_);
    std::vector<uint16_t> voxels(24 * 24 * 24, 2);
    for (int k = 12; k < 24; ++k)
        for (int j = 12; j < 24; ++j)
            for (int i = 0; i < 12; ++i) voxels[i + 24 * (j + 24 * k)] = 7;
    pliant_labels labels{};
    labels.geometry = before_.geometry;
    labels.voxels = voxels.data();
    const double point[3] = {0.011, -0.011, 0.011};
    ASSERT_EQ(picture_write_labels(folder_, &before_, &labels, point), PLIANT_OK) << pliant_last_error();
    const unsigned wide = 2u * PANEL + GAP;
    uint8_t rgb[2][3];
    char shown[2][16];
    for (int n = 0; n < 2; ++n) {
        picture_label_colour(n ? 7 : 2, rgb[n]);
        std::snprintf(shown[n], sizeof shown[n], "%02x%02x%02x", rgb[n][0], rgb[n][1], rgb[n][2]);
    }
    EXPECT_EQ(colour("axial", 0, 0.85, 0.15, wide), "ffffff"); // left of the patient, front
    EXPECT_EQ(colour("axial", 1, 0.85, 0.15, wide), shown[1]);
    EXPECT_EQ(colour("axial", 1, 0.15, 0.15, wide), shown[0]);
    EXPECT_EQ(colour("axial", 1, 0.85, 0.85, wide), shown[0]);
    EXPECT_EQ(colour("coronal", 1, 0.85, 0.15, wide), shown[1]); // head
    EXPECT_EQ(colour("coronal", 1, 0.85, 0.85, wide), shown[0]);
    EXPECT_EQ(colour("sagittal", 1, 0.15, 0.15, wide), shown[1]);
}

// The material's colour is on the right of the patient, red on the left, and white in the region that a blade sweeps.
TEST_F(Picture, AMeshShowsMaterialsCollisionsAndWhatABladeSweeps)
{
    const double nodes[] = {-0.02, 0, -0.02, -0.02, 0.02, 0.02, -0.02, -0.02, 0.02, 0, 0, 0, // right
                            0.02, 0, -0.02, 0.02, 0.02, 0.02, 0.02, -0.02, 0.02, 0, 0, 0};   // left
    int32_t tets[] = {0, 1, 2, 3, 4, 5, 6, 7};
    pliant_mesh mesh{};
    mesh.num_nodes = 8;
    mesh.num_tets = 2;
    mesh.tets = tets;
    const uint8_t material[] = {3, 3}, collided[] = {0, 1};
    // Two parallelograms in the sagittal planes x = 12 mm and x = -12 mm. The axial plane of the picture misses the
    // second.
    const double strips[] = {0.012, -0.024, -0.02, 0.012, 0.024, -0.02, 0.012, 0.024, 0.02, 0.012, -0.024, 0.02,
                             -0.012, -0.024, -0.02, -0.012, 0.024, -0.02, -0.012, 0.024, 0, -0.012, -0.024, 0};
    const double point[3] = {0, 0, 0.012};
    picture_mesh shown = {&mesh, nodes, material, collided, strips, 2, nullptr};
    ASSERT_EQ(picture_mesh_write(folder_, "", &shown, point), PLIANT_OK) << pliant_last_error();
    uint8_t rgb[3];
    char of_material[16];
    picture_label_colour(4, rgb);
    std::snprintf(of_material, sizeof of_material, "%02x%02x%02x", rgb[0], rgb[1], rgb[2]);
    EXPECT_EQ(colour("mesh_axial", 0, 0.1, 0.5, PANEL), of_material);
    EXPECT_EQ(colour("mesh_axial", 0, 0.9, 0.5, PANEL), "e61919");
    EXPECT_EQ(colour("mesh_axial", 0, 0.5, 0.1, PANEL), "000000") << "no tissue";
    const double swept = (0.021 + 0.012) / 0.042; // the picture shows the nodes' box, enlarged by a twentieth
    EXPECT_EQ(colour("mesh_axial", 0, swept, 0.02, PANEL), "ffffff");
    EXPECT_EQ(colour("mesh_axial", 0, swept, 0.98, PANEL), "ffffff");
    EXPECT_EQ(colour("mesh_axial", 0, 1 - swept, 0.98, PANEL), "000000")
        << "the other parallelogram lies below the plane";
    const uint8_t colors[] = {1, 2, 3, 1, 2, 3, 1, 2, 3, 17, 34, 51}; // of segments
    shown.colors = colors;
    ASSERT_EQ(picture_mesh_write(folder_, "", &shown, point), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(colour("mesh_axial", 0, 0.1, 0.5, PANEL), "112233");
    const std::string absent = std::string(folder_) + "/absent";
    EXPECT_EQ(picture_mesh_write(absent.c_str(), "", &shown, point), PLIANT_ERROR_FILE);
    for (const picture_plane &plane : picture_planes)
        std::remove((folder_ + ("/mesh_" + std::string(plane.name) + ".png")).c_str());
}

// Count the pixels of a colour in a picture.
int count(const std::string &path, int red, int green, int blue)
{
    auto reader = itk::ImageFileReader<Image>::New();
    reader->SetImageIO(itk::PNGImageIO::New());
    reader->SetFileName(path);
    reader->Update();
    const auto size = reader->GetOutput()->GetLargestPossibleRegion().GetSize();
    int found = 0;
    for (size_t n = 0; n < size[0] * size[1]; ++n) {
        const auto &pixel = reader->GetOutput()->GetBufferPointer()[n];
        found += pixel[0] == red && pixel[1] == green && pixel[2] == blue;
    }
    return found;
}

// [C] figure 4: only the picture of a cut's step shows its parallelogram. The mesh is red where a tool presses.
TEST_F(Picture, AMeshShowsTheCutsOfItsStepAndWhereAToolPresses)
{
    const std::string out = std::string(folder_) + "/cut", path = std::string(folder_) + "/path.yaml";
    std::ofstream(path)
        << "tools:\n  - name: ball\n    shape: {parts: [{kind: sphere, from: [0, 0, 0], radius: 0.03}]}\n"
           "    poses: [{time: 0, position: [0, -0.25, 0]}, {time: 0.04, position: [0, -0.15, 0]}]\n"
           "cuts: [{time: 0.04, points: [[-0.3, -0.3, 0.01], [-0.1, -0.3, 0.01]], depth: [0, 0.5, 0]}]\n";
    const std::string command =
        PLIANT_DEFORM
        " --scan phantom:48x40x40 --set 'mesh/coarse_cells=5 4 4' --set cut/kind=sever --steps 3 --every 1 --pictures "
        "--quiet --tools " +
        path + " --out " + out + " 2> " + out + ".log";
    ASSERT_EQ(std::system(command.c_str()), 0);
    EXPECT_EQ(count(out + "/mesh_000001_coronal.png", 255, 255, 255), 0);
    EXPECT_GT(count(out + "/mesh_000002_coronal.png", 255, 255, 255), 50);
    EXPECT_EQ(count(out + "/mesh_000003_coronal.png", 255, 255, 255), 0);
    EXPECT_EQ(count(out + "/mesh_000001_sagittal.png", 230, 25, 25), 0) << "the ball is still in air";
    EXPECT_GT(count(out + "/mesh_000003_sagittal.png", 230, 25, 25), 20);
    EXPECT_EQ(std::system(("rm -r " + out + " " + out + ".log " + path).c_str()), 0);
}

} // namespace
