// Demonstration scenes with cuts, with the paths in the README: coarse meshes, large steps, and the tool motion of
// pliant_deform.
#include "programs/deform_tools.h"
#include "model_data/data.h"
#include "pliant/pliant.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>
#include <string>
#include <sys/stat.h>
#include <unistd.h>
#include <vector>

namespace {

struct Demonstration {
    const char *scene, *path, *scan;
    int cells[3];
    double step, until; // [s]
    double minimum, maximum; // bounds of the cut area [cm^2], from the scene's own mesh and steps
    int pieces;         // final number
    double opens;       // minimum final distance of nodes that were one before the cut [m]
    double weak, strong; // bounds of the maximum tool force [N]
    void (*set)(pliant_scene &) = nullptr;
};
void PrintTo(const Demonstration &one, std::ostream *out) { *out << one.path; }

bool is_there(const std::string &file)
{
    struct stat told;
    return stat(file.c_str(), &told) == 0;
}

struct CutScenes : testing::TestWithParam<Demonstration> {
    pliant_scene scene;
    pliant_volume scan{};
    pliant_labels labels{};
    pliant_material_table table{};
    pliant_model *model = nullptr;
    pliant_data *data = nullptr;
    pliant_path path{};
    char folder[32] = "/tmp/pliant_scenes_XXXXXX";
    double felt = 0; // maximum tool force [N]

    static std::string file(const char *name)
    {
        return std::string(PLIANT_SOURCE_DIR "/launch/scenes/") + name + ".yaml";
    }
    static bool of_ct() { return GetParam().scan[0] == '/'; }
    void SetUp() override
    {
        const Demonstration &one = GetParam();
        if (of_ct() && !is_there(one.scan)) GTEST_SKIP() << "the shared test data is not at " PLIANT_TEST_DATA;
        ASSERT_NE(mkdtemp(folder), nullptr);
        ASSERT_EQ(pliant_scene_read(file(one.scene).c_str(), &scene), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_path_read(file(one.path).c_str(), &path), PLIANT_OK) << pliant_last_error();
        if (of_ct())
            ASSERT_EQ(
                pliant_scene_set(&scene, "material/labels", PLIANT_TEST_DATA "/abdomen/labels_totalseg_fast.nii.gz"),
                PLIANT_OK);
        std::copy(one.cells, one.cells + 3, scene.mesh.coarse_cells);
        scene.mesh.ratio = 1;
        scene.solver.step = one.step;
        scene.solver.threads = 1;
        if (one.set) one.set(scene);
        ASSERT_EQ(pliant_inputs_read(&scene, one.scan, &scan, &labels, &table), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(
            pliant_model_build(&scene, &scan, labels.voxels ? &labels : nullptr, &table, {nullptr, nullptr}, &model),
            PLIANT_OK)
            << pliant_last_error();
        ASSERT_EQ(pliant_data_create(model, &data), PLIANT_OK) << pliant_last_error();
    }
    void TearDown() override
    {
        unlink((std::string(folder) + "/cuts.csv").c_str());
        rmdir(folder);
        pliant_data_free(data);
        pliant_model_free(model);
        pliant_path_free(&path);
        pliant_material_table_free(&table);
        pliant_labels_free(&labels);
        pliant_volume_free(&scan);
    }
    void run()
    {
        deform_tools tools{};
        ASSERT_EQ(deform_tools_begin(&path, folder, model, data, &tools), PLIANT_OK) << pliant_last_error();
        const long last = std::lround(GetParam().until / scene.solver.step);
        for (long step = 1; step <= last; step++) {
            const double time = static_cast<double>(step) * scene.solver.step;
            double gravity[3];
            ASSERT_EQ(deform_tools_move(&tools, model, data, step, time), PLIANT_OK) << pliant_last_error();
            if (pliant_path_gravity(&path, time, gravity)) ASSERT_EQ(pliant_data_set_gravity(data, gravity), PLIANT_OK);
            ASSERT_GE(pliant_step(model, data), 0) << time << " s: " << pliant_last_error();
            deform_tools_report(&tools, data, step, time);
            for (int32_t n = 0; n < 3 * data->body->fine.num_nodes; n++)
                ASSERT_TRUE(std::isfinite(data->positions[n])) << time << " s";
            for (int t = 0; t < data->num_tools; t++) {
                const double *force = data->tools[t].force;
                felt = std::max(felt, std::hypot(std::hypot(force[0], force[1]), force[2]));
            }
        }
        ASSERT_EQ(deform_tools_end(&tools, data, GetParam().until), PLIANT_OK) << pliant_last_error();
    }
    // Read cuts.csv: the total cut area [cm^2], and the number of pieces in its last row.
    void told(double *area, int *pieces) const
    {
        std::ifstream rows(std::string(folder) + "/cuts.csv");
        std::string row, word;
        std::getline(rows, row);
        ASSERT_EQ(row.find("step,time_s,tool,stroke,area_m2,severed_area_m2,pieces,"), 0u);
        while (std::getline(rows, row)) {
            std::istringstream words(row);
            for (int column = 0; std::getline(words, word, ','); column++) {
                if (column == 4) *area += 1e4 * std::stod(word);
                if (column == 6) *pieces = std::stoi(word);
            }
        }
    }
    // Return the maximum distance between tissue nodes that were one before the cut [m]. Fragments of air are excluded
    // because they fall.
    double opening() const
    {
        const pliant_body &body = *data->body;
        std::vector<uint8_t> tissue(static_cast<size_t>(body.fine.num_nodes));
        for (int32_t v = 0; v < 4 * body.fine.num_tets; v++)
            tissue[body.fine.tets[v]] |= body.fine_material[v / 4].tissue > 0;
        double maximum = 0;
        for (int32_t n = 0; n < body.fine.num_nodes && body.node_parent; n++) {
            const double *x = data->positions + 3 * n, *y = data->positions + 3 * body.node_parent[n];
            if (tissue[n] && tissue[body.node_parent[n]])
                maximum = std::max(maximum, std::hypot(std::hypot(x[0] - y[0], x[1] - y[1]), x[2] - y[2]));
        }
        return maximum;
    }
};

TEST_P(CutScenes, SeparateTissueAlongTheirPaths)
{
    run();
    if (HasFatalFailure()) return;
    double area = 0;
    int pieces = 0;
    told(&area, &pieces);
    std::printf("%s: %d tetrahedra, %g cm^2, %d pieces, open by %g m, felt %g N\n", GetParam().path,
                model->body->fine.num_tets, area, pieces, opening(), felt);
    EXPECT_GE(area, GetParam().minimum);
    EXPECT_LE(area, GetParam().maximum);
    EXPECT_EQ(pieces, GetParam().pieces);
    EXPECT_GE(opening(), GetParam().opens);
    EXPECT_LT(opening(), 0.2);
    EXPECT_GE(felt, GetParam().weak);
    EXPECT_LE(felt, GetParam().strong);
}

const char phantom[] = "phantom:64x48x48", ct[] = PLIANT_TEST_DATA "/abdomen/ct.nii.gz";
const Demonstration demonstrations[] = {
    {"cut_hang", "cut_hang_path", phantom, {10, 8, 8}, 0.02, 1.2, 155, 200, 1, 0.02, 0, 0},
    {"cut_hang_ct", "cut_hang_ct_path", ct, {10, 8, 8}, 0.02, 1.2, 65, 90, 1, 0.02, 0, 0},
    {"resect", "resect_path", phantom, {12, 9, 9}, 0.1, 1, 50, 65, 2, 0.03, 0, 0.5},
    {"resect_ct", "resect_ct_path", ct, {18, 15, 17}, 0.1, 1, 30, 34, 2, 0.03, 0, 0.5},
    {"biopsy", "biopsy_path", phantom, {12, 9, 9}, 0.1, 1, 60, 90, 2, 0.03, 0, 0.2},
    {"biopsy", "incise_path", phantom, {12, 9, 9}, 0.1, 3, 4, 8, 1, 0, 2, 20},
    {"demo",
     "open_path",
     phantom,
     {14, 10, 11},
     0.1,
     0.8,
     130,
     170,
     1,
     0.005,
     3,
     50,
     [](pliant_scene &scene) { scene.cut.kind = PLIANT_CUT_SEVER; }},
    {"demo_cut", "demo_cut_path", phantom, {9, 7, 8}, 0.1, 3, 120, 155, 1, 0.001, 100, 5000},
};
INSTANTIATE_TEST_SUITE_P(Paths, CutScenes, testing::ValuesIn(demonstrations),
                         [](const auto &info) { return std::string(info.param.path); });

} // namespace
