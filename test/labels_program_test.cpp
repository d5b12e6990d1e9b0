// Segmentations in pliant_deform: the phantom with its segmentation in cropped layers, and materials by name.
#include "program.h"
#include "scan_files.h"

namespace {

const char MATERIALS[] =
    "materials:\n"
    "  - {name: air, young_modulus: 10, poisson_ratio: 0, density: 1.2, empty: true, range: [-1.0e+9, -500]}\n"
    "  - {name: flesh, young_modulus: 10000, poisson_ratio: 0.45, density: 1050, range: [-500, 1.0e+9]}\n"
    "  - {name: Liver, young_modulus: 5500, poisson_ratio: 0.45, density: 1060}\n"
    "  - {name: tumour, young_modulus: 30000, poisson_ratio: 0.45, density: 1060, segments: [lesion]}\n"
    "  - {name: bone, young_modulus: 1.0e+7, poisson_ratio: 0.3, density: 1330, fixed: true}\n";

class LabelsProgram : public Program {
protected:
    LabelsProgram() : Program(PLIANT_DEFORM) {}
    void SetUp() override
    {
        Program::SetUp();
        const int32_t size[3] = {60, 44, 46};
        ASSERT_EQ(pliant_phantom(size, 1, &scan_, &labels_), PLIANT_OK);
        ASSERT_EQ(pliant_volume_write(in("ct.nii.gz").c_str(), &scan_), PLIANT_OK) << pliant_last_error();
        save(in("materials.yaml"), MATERIALS);
        save(in("scene.yaml"),
             "material: {file: materials.yaml}\nmesh: {coarse_cells: [6, 5, 5], ratio: 2}\nmodel: {method: fine}\n"
             "solver: {threads: 1}\n");
    }
    void TearDown() override
    {
        pliant_volume_free(&scan_);
        pliant_labels_free(&labels_);
        Program::TearDown();
    }

    // Return whether a layer of the segmentation contains a label of the phantom.
    static bool is_in(int layer, int label)
    {
        const bool tumour = label == 5, liver = label == 4 || tumour, bone = label >= 11 && label <= 13;
        return layer == 0 ? liver : layer == 1 ? tumour : bone;
    }
    // Write three layers, cropped by a few voxels on all sides, with the layer as the fastest axis.
    std::string segmentation(const std::string &second_name) const
    {
        const pliant_geometry &grid = labels_.geometry;
        const int crop = 2;
        std::string voxels,
            header = "NRRD0004\ntype: unsigned char\ndimension: 4\nspace: left-posterior-superior\nsizes: 3";
        for (int d = 0; d < 3; d++) header += " " + std::to_string(grid.size[d] - 2 * crop);
        header += "\nspace directions: none";
        for (int d = 0; d < 3; d++) {
            std::ostringstream axis;
            axis.precision(17);
            for (int row = 0; row < 3; row++)
                axis << (row ? "," : " (") << 1e3 * grid.spacing[d] * grid.direction[3 * row + d];
            header += axis.str() + ")";
        }
        const double first[3] = {crop, crop, crop};
        double origin[3];
        pliant_geometry_to_world(&grid, first, origin);
        std::ostringstream place;
        place.precision(17);
        place << "\nspace origin: (" << 1e3 * origin[0] << "," << 1e3 * origin[1] << "," << 1e3 * origin[2] << ")\n";
        header += "\nkinds: list domain domain domain\nencoding: raw" + place.str();
        const std::string names[3] = {"liver", second_name, "BONE"};
        for (int n = 0; n < 3; n++) {
            const std::string start = "Segment" + std::to_string(n) + "_";
            header += start + "ID:=Segment_" + std::to_string(n + 1) + "\n" + start + "LabelValue:=1\n" + start +
                      "Layer:=" + std::to_string(n) + "\n" + start + "Name:=" + names[n] + "\n";
        }
        for (int k = crop; k < grid.size[2] - crop; k++)
            for (int j = crop; j < grid.size[1] - crop; j++)
                for (int i = crop; i < grid.size[0] - crop; i++)
                    for (int layer = 0; layer < 3; layer++)
                        voxels += is_in(layer, labels_.voxels[i + grid.size[0] * (j + grid.size[1] * k)]) ? '\1' : '\0';
        return header + "\n" + voxels;
    }
    // Count voxels of a layer in the cropped segmentation that no later layer overwrites.
    size_t voxels_of(int layer) const
    {
        const int32_t *size = labels_.geometry.size;
        size_t count = 0;
        for (int k = 2; k < size[2] - 2; k++)
            for (int j = 2; j < size[1] - 2; j++)
                for (int i = 2; i < size[0] - 2; i++) {
                    const int label = labels_.voxels[i + size[0] * (j + size[1] * k)];
                    bool later = false;
                    for (int other = layer + 1; other < 3; other++) later = later || is_in(other, label);
                    count += is_in(layer, label) && !later;
                }
        return count;
    }
    std::string common() const
    {
        return in("scene.yaml") + " --scan " + in("ct.nii.gz") + " --no-volume --steps 1 --out " + in("result") +
               " --labels ";
    }

    pliant_volume scan_ = {};
    pliant_labels labels_ = {};
};

} // namespace

TEST_F(LabelsProgram, SegmentsNameMaterials)
{
    save(in("a.seg.nrrd"), segmentation("Lesion "));
    ASSERT_EQ(run(common() + in("a.seg.nrrd")), 0) << err_;
    const size_t liver = voxels_of(0), tumour = voxels_of(1), bone = voxels_of(2);
    ASSERT_GT(tumour, 20u);
    expect_words(
        err_, {"material Liver: " + std::to_string(liver) + " voxels", "segment \"liver\" " + std::to_string(liver),
               "material tumour: " + std::to_string(tumour) + " voxels", "segment \"Lesion\" " + std::to_string(tumour),
               "material bone: " + std::to_string(bone) + " voxels", "segment \"BONE\" " + std::to_string(bone),
               "segments overlap; the later one wins in " + std::to_string(tumour) + " voxels: Lesion over liver",
               "its voxel (0, 0, 0) is voxel (2, 2, 2) of the scan"});
}

TEST_F(LabelsProgram, UnknownSegmentsAreRefusedWithTheNearestNames)
{
    save(in("a.seg.nrrd"), segmentation("lessions"));
    EXPECT_EQ(run(common() + in("a.seg.nrrd")), 1);
    expect_words(err_, {"no material for segments \"lessions\" (nearest names: lesion", "rename the segments"});
    EXPECT_EQ(err_.find("\"liver\" ("), std::string::npos) << err_;
    EXPECT_EQ(run(common() + in("missing.seg.nrrd")), 1);
    expect_words(err_, {"missing.seg.nrrd", "No such file"});
}
