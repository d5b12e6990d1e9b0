// Every method on bodies like those from scans: speckled, with loose fragments and scattered bone.
#include "body.h"

#include <sys/stat.h>

namespace {

const pliant_method methods[] = {PLIANT_FINE, PLIANT_COARSE, PLIANT_SCHUR, PLIANT_AVERAGED, PLIANT_LOD};

// Return the material 0: air, 1: tissue, 2: bone; random patches of 3^3 voxels from a hash, the lower third solid.
int speckle(int i, int j, int k, unsigned seed)
{
    unsigned h = seed + 73856093u * unsigned(i / 3) ^ 19349663u * unsigned(j / 3) ^ 83492791u * unsigned(k / 3);
    h = (h ^ h >> 13) * 0x5bd1e995u;
    unsigned draw = (h ^ h >> 15) % 100;
    if (k < 16) return draw < 12 ? 2 : 1;
    return draw < 55 ? 0 : draw < 60 ? 2 : 1;
}

void step_under_gravity(Body &body)
{
    for (pliant_method method : methods) {
        if (method == PLIANT_LOD && body.scene.mesh.ratio > 2) continue; // takes seconds
        body.scene.model.method = method;
        ASSERT_EQ(body.build(), PLIANT_OK) << "method " << method << ": " << pliant_last_error();
        pliant_status status = pliant_step(body.model, body.data);
        EXPECT_TRUE(status == PLIANT_OK || status == PLIANT_NOT_CONVERGED)
            << "method " << method << ": " << pliant_last_error();
        for (int32_t n = 0; n < 3 * body.model->body->fine.num_nodes; n++)
            ASSERT_TRUE(std::isfinite(body.data->positions[n])) << "method " << method;
    }
}

TEST(Methods, SpeckledBodies)
{
    for (unsigned seed = 1; seed <= 4; seed++) {
        const int size[3] = {48, 48, 48};
        const double box[3] = {0.24, 0.24, 0.24};
        Body body(size, box, {{10, 0, 1.2, true}, {8000, 0.45, 1000, false}, {1e7, 0.3, 1600, false}},
                  [&](int i, int j, int k) { return speckle(i, j, k, seed); });
        body.table.materials[2].fixed = true;
        body.cells(6, 6, 6, seed % 2 ? 2 : 3);
        body.scene.model.gravity[1] = 9.81;
        body.scene.solver.iterations = 6;
        SCOPED_TRACE(seed);
        step_under_gravity(body);
    }
}

TEST(Methods, RealScansAsTheyAreLoaded)
{
    const std::string folder = PLIANT_TEST_DATA;
    struct stat status;
    if (stat((folder + "/abdomen/ct.nii.gz").c_str(), &status) != 0)
        GTEST_SKIP() << "the shared test data is not at " PLIANT_TEST_DATA;
    for (const auto &scanned : {std::make_pair("/abdomen/ct.nii.gz", 7), std::make_pair("/thorax/ct.mha", 8)}) {
        const char *name = scanned.first;
        const int cells = scanned.second;
        pliant_scene scene;
        pliant_scene_defaults(&scene);
        for (int &n : scene.mesh.coarse_cells) n = cells;
        pliant_volume scan{};
        pliant_labels labels{};
        pliant_material_table table{};
        ASSERT_EQ(pliant_inputs_read(&scene, (folder + name).c_str(), &scan, &labels, &table), PLIANT_OK)
            << pliant_last_error();
        for (pliant_method method : methods) {
            if (method == PLIANT_LOD && cells > 7) continue; // takes seconds
            scene.model.method = method;
            pliant_model *model = nullptr;
            EXPECT_EQ(pliant_model_build(&scene, &scan, nullptr, &table, {nullptr, nullptr}, &model), PLIANT_OK)
                << name << " method " << method << " cells " << cells << ": " << pliant_last_error();
            pliant_model_free(model);
        }
        pliant_volume_free(&scan);
        pliant_material_table_free(&table);
    }
}

} // namespace
