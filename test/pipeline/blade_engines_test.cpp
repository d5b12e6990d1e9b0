// A blade cuts through a slab that is fixed at one end, with every engine. The tool receives a force, the slab
// separates, the detached piece falls, no step fails, and all cuts can be undone.
#include "../cuts.h"
#include <cstdio>
#include <cstdlib>

namespace {

const int size[3] = {40, 12, 16};
const double box[3] = {0.08, 0.024, 0.032}, toughness = 20, gravity = 3;

struct Engine {
    const char *name;
    std::function<void(pliant_scene &)> set;
};
void PrintTo(const Engine &engine, std::ostream *out) { *out << engine.name; }

Engine coarse(const char *name, pliant_method method, double patch = 0, bool bone_surface = false)
{
    return {name, [=](pliant_scene &scene) {
                scene.model.method = method;
                for (int32_t &cells : scene.mesh.coarse_cells) cells /= 2;
                scene.mesh.ratio = 2;
                scene.mesh.bone_surface = bone_surface;
                scene.model.patch = patch;
                scene.model.patch_delay = 1;
            }};
}
Engine dynamic(const char *name, pliant_law law, pliant_element_kind element, bool quasi_static = false,
               pliant_mesh_kind mesh = PLIANT_LATTICE)
{
    return {name, [=](pliant_scene &scene) {
                scene.solver.kind = PLIANT_TLED;
                scene.element.kind = element;
                scene.tled.law = law;
                scene.tled.damping = 20;
                scene.tled.prony_share[0] = 0.2;
                scene.tled.prony_time[0] = 0.05;
                scene.tled.quasi_static = quasi_static;
                scene.mesh.kind = mesh;
                if (mesh == PLIANT_OCTREE) scene.mesh.depth = 1;
                for (int32_t &cells : scene.mesh.coarse_cells) cells /= mesh == PLIANT_OCTREE ? 2 : 1;
            }};
}

struct EveryEngine : testing::TestWithParam<Engine> {
    Body body{size, box, {{40000, 0.45, 1060, false}, {1e6, 0.3, 1500, false}}, [](int i, int j, int) {
                  return i + j / 4 < 5;
              }};
    int knife = -1, patched = 0;
    void SetUp() override
    {
        body.table.materials[0].toughness = toughness;
        body.table.materials[1].fixed = true;
        body.cells(10, 4, 4, 1);
        body.scene.element.kind = PLIANT_HEXAHEDRA;
        body.scene.solver.backend = PLIANT_CPU;
        body.scene.solver.iterations = 30;
        body.scene.solver.tolerance = 1e-4;
        body.scene.cut.kind = PLIANT_CUT_SEVER;
        body.scene.model.gravity[2] = -gravity;
        GetParam().set(body.scene);
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        const double from[3] = {0, -0.02, 0}, to[3] = {0, 0.02, 0};
        ASSERT_EQ(pliant_tool_add(body.model, body.data, "knife", &knife), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_blade(body.data, knife, from, to), PLIANT_OK);
        if (body.scene.model.patch > 0) hold();
    }
    // Grasp next to the blade's path, so that there is a patch.
    void hold()
    {
        const double at[3] = {0.03, 0.012, 0.024};
        int forceps;
        ASSERT_EQ(pliant_tool_add(body.model, body.data, "forceps", &forceps), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_radius(body.data, forceps, 0.006), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_pose(body.data, forceps, at, nullptr), PLIANT_OK);
        ASSERT_EQ(pliant_tool_grasp(body.model, body.data, forceps, nullptr), PLIANT_OK) << pliant_last_error();
    }
    void steps(int count)
    {
        for (int s = 0; s < count; s++) {
            ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
            patched = std::max(patched, body.data->statistics.patched);
        }
    }
    pliant_tool_state state() const
    {
        pliant_tool_state tool_state{};
        EXPECT_EQ(pliant_tool_get(body.data, knife, &tool_state), PLIANT_OK);
        return tool_state;
    }
    // Move the blade down by 1 mm per step.
    // work: input and output; work of the blade [J]
    void stroke(double x, double *work)
    {
        double force = 0;
        for (double z = 0.036; z > -0.024; z -= 0.001) {
            const double tip[3] = {x, 0.012, z};
            ASSERT_EQ(pliant_tool_set_pose(body.data, knife, tip, nullptr), PLIANT_OK);
            if (z == 0.036)
                ASSERT_EQ(pliant_tool_set_cutting(body.data, knife, true), PLIANT_OK) << pliant_last_error();
            steps(1);
            if (HasFatalFailure()) return;
            const double now = -state().force[2];
            *work += 0.5 * (force + now) * 0.001;
            force = now;
        }
        ASSERT_EQ(pliant_tool_set_cutting(body.data, knife, false), PLIANT_OK);
    }
    // Return the mean height of the tissue on one side of a plane x.
    double height(double low, double high) const
    {
        const pliant_mesh &mesh = body.data->body->fine;
        double sum = 0, mass = 0;
        for (int32_t n = 0; n < mesh.num_nodes; n++) {
            if (mesh.rest[3 * n] < low || mesh.rest[3 * n] > high) continue;
            sum += body.data->body->node_mass[n] * body.data->positions[3 * n + 2];
            mass += body.data->body->node_mass[n];
        }
        return sum / mass;
    }
};

TEST_P(EveryEngine, ABladeSeparatesTheTissue)
{
    steps(40);
    const double start = height(0.06, 1), held = height(0.015, 0.03);
    double work = 0;
    stroke(0.0405, &work);
    if (HasFatalFailure()) return;
    const pliant_tool_state tool_state = state();
    EXPECT_EQ(patched > 0, body.scene.model.patch > 0);
    // oscillating tissue, or a last element that bends, may meet the blade again and lose a sliver
    const bool swings = body.scene.solver.kind == PLIANT_TLED && !body.scene.tled.quasi_static,
               meets = swings || body.scene.mesh.kind == PLIANT_OCTREE;
    if (meets) EXPECT_GE(tool_state.pieces, 2);
    else EXPECT_EQ(tool_state.pieces, 2);
    EXPECT_NEAR(tool_state.severed_area, 0.024 * 0.032, (meets ? 0.2 : 0.05) * 0.024 * 0.032);
    if (std::getenv("PLIANT_FIGURES"))
        std::printf("work %.4f of toughness times area%s\n", work / (toughness * tool_state.severed_area),
                    meets ? ", tissue meets the blade" : "");
    // tissue that moves over the blade itself needs no work of the tool
    EXPECT_GT(work, (meets ? 0.86 : 0.9) * toughness * tool_state.severed_area);
    EXPECT_LT(work, 1.1 * toughness * tool_state.severed_area);
    EXPECT_EQ(mismatches(*body.data->body), 0);
    patched = 0;
    steps(20);
    EXPECT_EQ(patched > 0, body.scene.model.patch > 0) << "after the cut, too";
    EXPECT_LT(height(0.06, 1), start - 0.05) << "what it cut off falls";
    EXPECT_NEAR(height(0.015, 0.03), held, 0.002) << "and what is held stays";
    while (body.data->undo.count > 0)
        ASSERT_EQ(pliant_data_undo_cut(body.model, body.data), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(body.data->body, body.model->body);
    steps(60);
    EXPECT_NEAR(height(0.06, 1), start, 0.001) << "and all of it can be taken back";
}

INSTANTIATE_TEST_SUITE_P(
    Engines, EveryEngine,
    testing::Values(Engine{"fine", [](pliant_scene &) {}},
                    Engine{"tetrahedra", [](pliant_scene &scene) { scene.element.kind = PLIANT_LINEAR; }},
                    Engine{"bone_surface", [](pliant_scene &scene) { scene.mesh.bone_surface = true; }},
                    Engine{"octree",
                           [](pliant_scene &scene) {
                               scene.mesh.kind = PLIANT_OCTREE;
                               scene.mesh.depth = 1;
                               for (int32_t &cells : scene.mesh.coarse_cells) cells /= 2;
                           }},
                    coarse("coarse", PLIANT_COARSE), coarse("averaged", PLIANT_AVERAGED), coarse("schur", PLIANT_SCHUR),
                    coarse("patched", PLIANT_AVERAGED, 0.012), coarse("patched_coarse", PLIANT_COARSE, 0.012),
                    coarse("patched_bone_surface", PLIANT_AVERAGED, 0.012, true),
                    dynamic("neo_hookean", PLIANT_LAW_NEO_HOOKEAN, PLIANT_HEXAHEDRA),
                    dynamic("compressible", PLIANT_LAW_COMPRESSIBLE, PLIANT_HEXAHEDRA),
                    dynamic("saint_venant_kirchhoff", PLIANT_LAW_SAINT_VENANT_KIRCHHOFF, PLIANT_HEXAHEDRA),
                    dynamic("tled_tetrahedra", PLIANT_LAW_NEO_HOOKEAN, PLIANT_LINEAR),
                    dynamic("relaxation", PLIANT_LAW_NEO_HOOKEAN, PLIANT_HEXAHEDRA, true),
                    dynamic("tled_octree", PLIANT_LAW_NEO_HOOKEAN, PLIANT_HEXAHEDRA, false, PLIANT_OCTREE)),
    [](const auto &info) { return std::string(info.param.name); });

} // namespace
