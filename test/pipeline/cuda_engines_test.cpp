// Every engine cut by a blade within steps, on a GPU and on the CPU: bitwise identical topology, equal positions, also
// after undoing the cuts. Repeated GPU runs are bitwise identical, planned or live, as a replay requires. Skipped
// without a GPU.
#include "adapt_cases.h"
#include "cuda_warps.h"
#include "pliant/cut.h"

#include <cstdio>

namespace {

const Case bone{"bone", [](pliant_scene &scene) { scene.mesh.bone_surface = true; }};
// next to fixed voxels within a coarse cube, fine elements keep their axes
const Case hexahedra_on_bone{"coarse_hexahedra_on_bone", [](pliant_scene &scene) {
                                 coarse_hexahedra.set(scene);
                                 scene.mesh.bone_surface = true;
                             }};
const Case tough{"tough", [](pliant_scene &scene) { scene.cut.resistance = 1; }};
const Case subdivided{"subdivide", [](pliant_scene &scene) { scene.cut.kind = PLIANT_CUT_SUBDIVIDE; }};
const Case subdivided_dynamic{"subdivide_tled", [](pliant_scene &scene) {
                                  dynamic.set(scene);
                                  scene.cut.kind = PLIANT_CUT_SUBDIVIDE;
                              }};
const Case octree_dynamic{"tled_octree", [](pliant_scene &scene) {
                              dynamic.set(scene);
                              octree.set(scene);
                          }};

const Case incompressible{"incompressible", direct.set, 0.4999};
const Case incompressible_hexahedra{"incompressible_hexahedra",
                                    [](pliant_scene &scene) {
                                        hexahedra.set(scene);
                                        scene.element.law = PLIANT_ELASTICITY_NEO_HOOKEAN;
                                    },
                                    0.4999};
const Case incompressible_octree{"incompressible_octree", octree.set, 0.499};
const Case incompressible_octree_hexahedra{"incompressible_octree_hexahedra", octree_hexahedra.set, 0.4999};
const Case incompressible_subdivided{"incompressible_subdivide", subdivided.set, 0.499};

std::string name_of(const testing::TestParamInfo<Case> &info) { return info.param.name; }

// A block hangs from its floor and is pulled at two points; a blade cuts down through it twice. CPU and GPU share its
// model.
struct Runs {
    std::unique_ptr<Body> body;
    std::vector<pliant_data *> data;

    Runs(const Case &each, const std::vector<pliant_backend_choice> &backends)
    {
        pliant_scene scene{};
        each.set(scene);
        const bool on_bone = scene.mesh.bone_surface;
        body.reset(new Body(size, box,
                            {{4000, each.poisson, 1000, false}, {20000, 0.4, 1200, false}, {4000, 0.4, 1000, false}},
                            [on_bone](int i, int j, int k) {
                                const double x[3] = {i - 9.3, j - 7.6, k - 6.2};
                                return on_bone && x[0] * x[0] + x[1] * x[1] + x[2] * x[2] < 22
                                           ? 2
                                           : (i < 6 || i > 9) && k > 9;
                            }));
        for (int m = 0; m < 3; m++) body->table.materials[m].toughness = 100;
        body->table.materials[2].fixed = true;
        body->fix_plane(0, 0, 1e-6, 0, 0, 1);
        body->cells(8, 8, 8, 1);
        body->scene.solver.refresh_interval = 2;
        body->scene.solver.refresh_delay = 2;
        body->scene.model.gravity[0] = 1;
        body->scene.grasp.radius = 0.02;
        body->scene.cut.kind = PLIANT_CUT_SEVER;
        body->scene.cut.resistance = 0;
        body->scene.solver.preconditioner = PLIANT_DIRECT;
        each.set(body->scene);
        body->scene.solver.iterations = 300;
        body->scene.solver.tolerance = 1e-9;
        EXPECT_EQ(
            pliant_model_build(&body->scene, &body->scan, nullptr, &body->table, {nullptr, nullptr}, &body->model),
            PLIANT_OK)
            << pliant_last_error();
        for (pliant_backend_choice backend : backends) {
            data.push_back(nullptr);
            body->model->scene.solver.backend = backend;
            EXPECT_EQ(pliant_data_create(body->model, &data.back()), PLIANT_OK) << pliant_last_error();
            if (data.back()) begin(of(data.size() - 1));
        }
    }
    Runs(const Runs &) = delete;
    Runs &operator=(const Runs &) = delete;
    ~Runs()
    {
        body->data = nullptr;
        for (pliant_data *each : data) pliant_data_free(each);
    }
    Body &of(size_t run)
    {
        body->data = data[run];
        return *body;
    }
    static void begin(Body &run)
    {
        int knife;
        const double from[3] = {0, -0.12, 0}, to[3] = {0, 0.12, 0};
        grasp_at_two_points(run);
        ASSERT_EQ(pliant_tool_add(run.model, run.data, "knife", &knife), PLIANT_OK);
        ASSERT_EQ(knife, 2);
        ASSERT_EQ(pliant_tool_set_blade(run.data, knife, from, to), PLIANT_OK);
    }
};

enum { FIRST = 2, SECOND = 8, UNDO = 14, STEPS = 18 };

void step_of(Body &run, int s)
{
    const int stroke = s < SECOND ? s - FIRST : s - SECOND;
    const double down = 0.016 * std::max(0, std::min(stroke, 4)),
                 knife[3] = {s < SECOND ? 0.081 : 0.043 + 0.1 * down, 0.08, 0.172 - down};
    for (int t = 0; t < 2; t++) {
        const pliant_tool &tool = run.data->tools[t];
        const double tip[3] = {tool.tip[0], tool.tip[1] + (t ? 4e-4 : -4e-4), tool.tip[2] + 2e-4};
        ASSERT_EQ(pliant_tool_set_pose(run.data, t, tip, nullptr), PLIANT_OK);
    }
    if (s < UNDO) ASSERT_EQ(pliant_tool_set_pose(run.data, 2, knife, nullptr), PLIANT_OK);
    if (s < UNDO && (stroke == 0 || stroke == 5))
        ASSERT_EQ(pliant_tool_set_cutting(run.data, 2, stroke == 0), PLIANT_OK) << pliant_last_error();
    if (s == UNDO || s == UNDO + 2)
        ASSERT_EQ(pliant_data_undo_cut(run.model, run.data), PLIANT_OK) << pliant_last_error();
    ASSERT_GE(pliant_step(run.model, run.data), 0) << pliant_last_error();
}

// Return the maximum distance between nodes of two runs along an axis [m].
double max_distance(const pliant_data *a, const pliant_data *b)
{
    double maximum = 0;
    for (int32_t i = 0; i < 3 * a->body->fine.num_nodes; i++)
        maximum = std::fmax(maximum, std::fabs(a->positions[i] - b->positions[i]));
    return maximum;
}
double moved(const pliant_data *a)
{
    double maximum = 0;
    for (int32_t i = 0; i < 3 * a->body->fine.num_nodes; i++)
        maximum = std::fmax(maximum, std::fabs(a->positions[i] - a->body->fine.rest[i]));
    return maximum;
}

// in a subdividing cut, new nodes lie where the blade intersects edges, which depends on rounding
bool same_topology(const pliant_body *a, const pliant_body *b, pliant_cut_kind kind)
{
    if (kind == PLIANT_CUT_SEVER) return pliant_body_same(a, b);
    return a->fine.num_nodes == b->fine.num_nodes && a->fine.num_tets == b->fine.num_tets &&
           a->num_triangles == b->num_triangles &&
           std::memcmp(a->fine.tets, b->fine.tets, 4 * sizeof *a->fine.tets * static_cast<size_t>(a->fine.num_tets)) ==
               0 &&
           std::memcmp(a->triangles, b->triangles, 3 * sizeof *a->triangles * static_cast<size_t>(a->num_triangles)) ==
               0;
}

/* Bounds relative to the maximum displacement and force. Solved to 1e-9, runs on the CPU alone differ from runs to
 * 1e-10 by up to 1.2e-9. In explicit dynamics, stresses on a GPU are in single precision. On the CPU, a relative change
 * of 6e-8 in the weight moves nodes by 4e-8 and changes forces by 2e-7. */
struct Bounds { double positions, forces; };
Bounds bounds_of(const pliant_scene &scene)
{
    if (scene.solver.kind != PLIANT_TLED) return {1e-7, 1e-7};
    return scene.tled.quasi_static ? Bounds{1e-5, 1e-5} : Bounds{1e-6, 1e-5};
}

struct EveryEngine : testing::TestWithParam<Case> {};
TEST_P(EveryEngine, IsCutAsOnTheCpu)
{
    NEEDS_GPU();
    Runs runs(GetParam(), {PLIANT_CPU, PLIANT_CUDA, PLIANT_CUDA});
    const pliant_data *cpu = runs.data[0], *gpu = runs.data[1];
    const pliant_body *load = runs.body->model->body;
    const pliant_scene &scene = runs.body->scene;
    double worst = 0, far = 0, force = 0, forces = 0;
    // with cuts, and while they are undone; on CPU and GPU
    int32_t maximum = 0, patched = 0, evaluations[2][2] = {{0, 0}, {0, 0}};
    uint32_t taken = 0;
    for (int s = 0; s < STEPS; s++) {
        SCOPED_TRACE(s);
        for (size_t run = 0; run < 3; run++) step_of(runs.of(run), s);
        ASSERT_STREQ(pliant_data_get_backend(gpu), "cuda") << pliant_last_error();
        ASSERT_TRUE(same_topology(cpu->body, gpu->body, scene.cut.kind))
            << cpu->body->fine.num_nodes << " and " << gpu->body->fine.num_nodes << " nodes";
        ASSERT_EQ(state(runs.of(1)), state(runs.of(2))) << "not the same bits again";
        maximum = std::max(maximum, cpu->body->fine.num_nodes);
        patched = std::max(patched, gpu->statistics.patched);
        for (size_t run = 0; run < 2; run++)
            evaluations[s >= UNDO][run] = std::max(evaluations[s >= UNDO][run], runs.data[run]->statistics.iterations);
        taken |= pliant_data_get_background_taken(gpu);
        worst = std::fmax(worst, max_distance(cpu, gpu));
        far = std::fmax(far, moved(cpu));
        for (int t = 0; t < 2; t++)
            for (int d = 0; d < 3; d++) {
                force = std::fmax(force, std::fabs(cpu->tools[t].force[d]));
                forces = std::fmax(forces, std::fabs(cpu->tools[t].force[d] - gpu->tools[t].force[d]));
            }
    }
    std::printf("%-26s %4d nodes, %4d at most; positions %.1e of %4.1f mm, forces %.1e of %.2g N apart; "
                "up to %d and %d evaluations, as cuts are undone %d and %d\n",
                GetParam().name, load->fine.num_nodes, maximum, worst / far, 1e3 * far, forces / force, force,
                evaluations[0][0], evaluations[0][1], evaluations[1][0], evaluations[1][1]);
    EXPECT_GT(maximum, load->fine.num_nodes + 20);
    EXPECT_TRUE(pliant_body_same(gpu->body, load));
    EXPECT_LT(worst, bounds_of(scene).positions * far);
    EXPECT_LT(forces, bounds_of(scene).forces * force);
    if (scene.solver.kind == PLIANT_COROTATIONAL)
        EXPECT_TRUE(taken & PLIANT_RESULT_FACTOR) << "the inverse was not carried over";
    if (scene.model.patch > 0) EXPECT_GT(patched, 0);
}
INSTANTIATE_TEST_SUITE_P(Cuda, EveryEngine,
                         testing::Values(direct, multigrid, hexahedra, averaged, averaged_hexahedra, plain,
                                         coarse_hexahedra, schur, schur_hexahedra, patch, patch_hexahedra,
                                         octree, octree_hexahedra, bone, hexahedra_on_bone, tough, subdivided, dynamic,
                                         cubes, octree_dynamic, subdivided_dynamic, relaxed, incompressible,
                                         incompressible_hexahedra, incompressible_octree,
                                         incompressible_octree_hexahedra, incompressible_subdivided),
                         name_of);

// Compute a step of two runs. The first one does not wait; the second one uses the same background results.
template <class Step> void live_and_again(Runs &runs, const Step &step, uint32_t *taken)
{
    for (size_t run = 0; run < 2; run++) {
        const uint32_t now = run == 0 ? 0 : pliant_data_get_background_taken(runs.data[0]);
        ASSERT_EQ(pliant_data_set_background(runs.data[run],
                                             run == 0 ? PLIANT_BACKGROUND_LIVE : PLIANT_BACKGROUND_PRESCRIBED, now),
                  PLIANT_OK);
        step(runs.of(run));
        *taken |= now;
    }
    ASSERT_EQ(pliant_data_get_background_taken(runs.data[0]), pliant_data_get_background_taken(runs.data[1]));
    ASSERT_EQ(state(runs.of(0)), state(runs.of(1)));
}

// The background results of a run without waiting give bitwise identical results in a replay.
struct EveryRecording : testing::TestWithParam<Case> {};
TEST_P(EveryRecording, IsPlayedBackToTheBit)
{
    NEEDS_GPU();
    Runs runs(GetParam(), {PLIANT_CUDA, PLIANT_CUDA});
    uint32_t taken = 0;
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(30);
    for (int s = 0; s < STEPS; s++) {
        SCOPED_TRACE(s);
        live_and_again(runs, [s](Body &run) { step_of(run, s); }, &taken);
        // between two strokes, wait until the inverse is ready
        while (s == SECOND - 1 && !(taken & PLIANT_RESULT_FACTOR) && !HasFatalFailure() &&
               std::chrono::steady_clock::now() < until) {
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
            live_and_again(
                runs, [](Body &run) { ASSERT_GE(pliant_step(run.model, run.data), 0) << pliant_last_error(); }, &taken);
        }
        if (HasFatalFailure()) return;
    }
    EXPECT_STREQ(pliant_data_get_backend(runs.data[0]), "cuda") << pliant_last_error();
    EXPECT_TRUE(taken & PLIANT_RESULT_FACTOR);
}
INSTANTIATE_TEST_SUITE_P(Cuda, EveryRecording,
                         testing::Values(direct, multigrid, hexahedra, averaged, patch, octree, subdivided,
                                         incompressible, incompressible_octree_hexahedra),
                         name_of);

} // namespace
