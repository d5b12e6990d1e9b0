// Strong pulls by a grasp, without contact. The volume bound (contact/volume) keeps elements from inverting.
#include "pipeline/body.h"

#include "backend/backend.h"
#include "model_data/data.h"

#include <string>

namespace {

// A grasp at the top of a block of 12 cm jumps by 7 or 12 cm in one step. No step ends with an inverted element, and
// the held tissue reaches the tool.
void expect_jump(pliant_solver_kind solver, pliant_elasticity law = PLIANT_ELASTICITY_COROTATIONAL,
                 double poisson = 0.45)
{
    const int size[3] = {6, 6, 6};
    const double box[3] = {0.12, 0.12, 0.12}, top[3] = {0.06, 0.06, 0.1};
    for (const pliant_element_kind kind : {PLIANT_LINEAR, PLIANT_HEXAHEDRA})
        for (const double jump : {0.07, 0.12}) {
            Body body(size, box, {{4000, poisson, 1000, false}});
            body.cells(6, 6, 6, 1);
            body.fix_plane(0, 0, 0.001, 0, 0, 1);
            body.scene.element.kind = kind;
            body.scene.element.law = law;
            body.scene.solver.kind = solver;
            ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
            int tool = -1;
            ASSERT_EQ(pliant_tool_add(body.model, body.data, "hook", &tool), PLIANT_OK);
            ASSERT_EQ(pliant_tool_grasp(body.model, body.data, tool, top), PLIANT_OK) << pliant_last_error();
            ASSERT_EQ(pliant_tool_set_drive(body.data, tool, PLIANT_DRIVE_RIGID, nullptr), PLIANT_OK);
            const double target[3] = {top[0], top[1], top[2] + jump};
            ASSERT_EQ(pliant_tool_set_pose(body.data, tool, target, nullptr), PLIANT_OK);
            for (int step = 0; step < 20; step++) {
                ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
                ASSERT_EQ(pliant_data_get_inverted(body.data), 0) << step;
            }
            pliant_tool_state state;
            ASSERT_EQ(pliant_tool_get(body.data, tool, &state), PLIANT_OK);
            EXPECT_NEAR(state.held_point[2], target[2], 1e-3);
        }
}

TEST(StrongPull, OfOneStepInvertsNoElement) { expect_jump(PLIANT_COROTATIONAL); }
TEST(StrongPull, OfOneStepInvertsNoNeoHookeanElement)
{
    expect_jump(PLIANT_COROTATIONAL, PLIANT_ELASTICITY_NEO_HOOKEAN);
    expect_jump(PLIANT_COROTATIONAL, PLIANT_ELASTICITY_NEO_HOOKEAN, 0.4999);
}
TEST(StrongPull, OfOneStepInvertsNoElementInExplicitDynamics) { expect_jump(PLIANT_TLED); }

void use_patch(pliant_scene &scene)
{
    scene.model.method = PLIANT_AVERAGED;
    scene.model.patch = 0.05;
}
void use_lod(pliant_scene &scene) { scene.model.method = PLIANT_LOD; }
void use_schur(pliant_scene &scene) { scene.model.method = PLIANT_SCHUR; }
void keep_air(pliant_scene &scene) { scene.mesh.keep_air = true; }
void use_dynamics(pliant_scene &scene) { scene.solver.kind = PLIANT_TLED; }
void use_saint_venant_kirchhoff(pliant_scene &scene)
{
    use_dynamics(scene);
    scene.tled.law = PLIANT_LAW_SAINT_VENANT_KIRCHHOFF;
}

struct Pull {
    const char *name;
    pliant_element_kind kind;
    int ratio;
    void (*set)(pliant_scene &scene);
    double x = -0.054; // of the grasped point [m]
    int steps = 50;    // of the pull
};

// Released tissue returns to its rest state.
void expect_return(const pliant_model *model, pliant_data *data, int tool)
{
    const pliant_mesh &mesh = pliant_data_get_body(data)->fine;
    double farthest = 0;
    int converged = 0;
    pliant_tool_release(data, tool);
    for (int s = 0; s < 40 && converged < 2; s++) {
        const pliant_status status = pliant_step(model, data);
        EXPECT_GE(status, 0) << pliant_last_error();
        converged = status == PLIANT_OK ? converged + 1 : 0;
    }
    const double *x = pliant_data_get_positions(data, nullptr);
    for (int32_t i = 0; i < 3 * mesh.num_nodes; i++) farthest = std::max(farthest, std::fabs(x[i] - mesh.rest[i]));
    EXPECT_EQ(converged, 2);
    EXPECT_LT(farthest, 1e-4);
}

// The pull of launch/scenes/demo_pull.yaml: 3 cm at the phantom's liver, within a second. The tissue then follows.
void expect_none_inverted(const Pull &pull, pliant_backend_choice backend)
{
    pliant_scene scene;
    pliant_volume scan{};
    pliant_labels labels{};
    pliant_material_table table{};
    pliant_model *model = nullptr;
    pliant_data *data = nullptr;
    ASSERT_EQ(pliant_scene_read(PLIANT_SOURCE_DIR "/launch/scenes/demo.yaml", &scene), PLIANT_OK);
    ASSERT_EQ(pliant_inputs_read(&scene, "phantom", &scan, &labels, &table), PLIANT_OK) << pliant_last_error();
    scene.element.kind = pull.kind;
    scene.mesh.ratio = pull.ratio;
    scene.solver.backend = backend;
    if (pull.set) pull.set(scene);
    ASSERT_EQ(pliant_model_build(&scene, &scan, &labels, &table, {nullptr, nullptr}, &model), PLIANT_OK)
        << pliant_last_error();
    ASSERT_EQ(pliant_data_create(model, &data), PLIANT_OK) << pliant_last_error();
    const double liver[3] = {pull.x, -0.063, 0.063};
    int tool = -1, converged = 0;
    EXPECT_EQ(pliant_tool_add(model, data, "grasper", &tool), PLIANT_OK);
    EXPECT_EQ(pliant_tool_grasp(model, data, tool, liver), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(pliant_tool_set_drive(data, tool, PLIANT_DRIVE_RIGID, nullptr), PLIANT_OK);
    for (int s = 1; s <= pull.steps + 20 && converged < 2; s++) {
        const double target[3] = {liver[0], liver[1] - 0.03 * std::min(s, pull.steps) / pull.steps, liver[2]};
        EXPECT_EQ(pliant_tool_set_pose(data, tool, target, nullptr), PLIANT_OK);
        const pliant_status status = pliant_step(model, data);
        EXPECT_GE(status, 0) << pliant_last_error();
        EXPECT_EQ(pliant_data_get_inverted(data), 0) << s;
        converged = s > pull.steps && status == PLIANT_OK ? converged + 1 : 0;
    }
    pliant_tool_state state;
    EXPECT_EQ(pliant_tool_get(data, tool, &state), PLIANT_OK);
    EXPECT_EQ(converged, 2);
    EXPECT_NEAR(state.held_point[1], liver[1] - 0.03, 1e-4);
    if (scene.solver.kind != PLIANT_TLED) expect_return(model, data, tool);
    pliant_data_free(data);
    pliant_model_free(model);
    pliant_material_table_free(&table);
    pliant_volume_free(&scan);
    pliant_labels_free(&labels);
}

bool there_is_a_gpu()
{
    const pliant_backend *cuda = pliant_corotational.cuda;
    char text[PLIANT_BACKEND_TEXT];
    bool use = false;
    return pliant_gpu_choose(PLIANT_AUTO, cuda ? cuda->probe : nullptr, text, &use) == PLIANT_OK && use;
}

class PullOfThreeCentimetres : public testing::TestWithParam<Pull> {};

TEST_P(PullOfThreeCentimetres, InvertsNoElement)
{
    expect_none_inverted(GetParam(), PLIANT_CPU);
}

TEST_P(PullOfThreeCentimetres, InvertsNoElementOnAGpu)
{
    if (!there_is_a_gpu()) GTEST_SKIP() << "no GPU can be used";
    expect_none_inverted(GetParam(), PLIANT_CUDA);
}

INSTANTIATE_TEST_SUITE_P(Cells, PullOfThreeCentimetres,
                         testing::Values(Pull{"Hexahedra21Millimetres", PLIANT_HEXAHEDRA, 2, nullptr},
                                         Pull{"Hexahedra10Millimetres", PLIANT_HEXAHEDRA, 4, nullptr},
                                         Pull{"Tetrahedra14Millimetres", PLIANT_LINEAR, 3, nullptr},
                                         Pull{"WithAir", PLIANT_HEXAHEDRA, 2, keep_air},
                                         Pull{"Patch", PLIANT_HEXAHEDRA, 2, use_patch},
                                         Pull{"Lod", PLIANT_HEXAHEDRA, 2, use_lod},
                                         Pull{"LodInOneStep", PLIANT_HEXAHEDRA, 2, use_lod, -0.1, 1},
                                         Pull{"LodWithCubesOfLittleTissue", PLIANT_HEXAHEDRA, 3, use_lod, -0.054, 10},
                                         Pull{"Schur", PLIANT_LINEAR, 3, use_schur},
                                         Pull{"Dynamics", PLIANT_HEXAHEDRA, 2, use_dynamics},
                                         Pull{"DynamicsOfTetrahedra", PLIANT_LINEAR, 2, use_saint_venant_kirchhoff}),
                         [](const testing::TestParamInfo<Pull> &info) { return info.param.name; });

} // namespace
