// Many cuts in one simulation: no memory leaks, unchanged data are shared, and derived data equal recomputed data. The
// rendered volume equals the volume of a new warp.
#include "../cuts.h"
#include "base/memory.h"
#include "sim/api/data.h"
#include "sim/build/discretization.h"

#include <atomic>
#include <malloc.h>
#include <memory>
#include <thread>

namespace {

const int size[3] = {28, 24, 24};
const double box[3] = {0.14, 0.12, 0.12};

// Cut a slit, 2 cm long and half as deep.
void slit(Body &body, std::mt19937 &random)
{
    std::uniform_real_distribution<double> unit(-1, 1);
    double points[6], depth[3];
    for (int d = 0; d < 3; d++) {
        const double at = 0.5 * box[d] * (1 + 0.8 * unit(random)), half = 0.01 * unit(random);
        points[d] = at - half;
        points[3 + d] = at + half;
        depth[d] = 0.01 * unit(random);
    }
    ASSERT_EQ(pliant_data_cut(body.model, body.data, 2, points, depth, nullptr), PLIANT_OK) << pliant_last_error();
}

struct ManyCuts : testing::Test {
    Body body{size, box, {{4000, 0.4, 1000, false}}, [](int, int, int) { return 0; }};
    std::mt19937 random{7};
    void SetUp() override
    {
        auto *voxels = static_cast<uint8_t *>(body.scan.voxels);
        body.fix_plane(0, 0, 1e-6, 0, 0, 1);
        body.cells(7, 6, 6, 1);
        body.scene.cut.kind = PLIANT_CUT_SEVER;
        body.scene.solver.iterations = 2;
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        // distinguishable values
        for (size_t v = 0; v < pliant_geometry_voxels(&body.scan.geometry); v++)
            voxels[v] = static_cast<uint8_t>(random() % 200);
        ASSERT_EQ(pliant_data_set_warp(body.model, body.data, &body.scan.geometry), PLIANT_OK) << pliant_last_error();
        ASSERT_GE(pliant_step(body.model, body.data), 0);
    }
    void slit() { ::slit(body, random); }
    void cuts(int count)
    {
        for (int c = 0; c < count; c++) {
            slit();
            if (c % 5 == 4 && body.data->undo.count > 0) {
                ASSERT_EQ(pliant_data_undo_cut(body.model, body.data), PLIANT_OK);
            }
            if (c % 25 == 24) {
                ASSERT_GE(pliant_step(body.model, body.data), 0);
            }
        }
    }
};

TEST_F(ManyCuts, LeaveNothingBehind)
{
    ASSERT_EQ(pliant_data_reset(body.model, body.data), PLIANT_OK);
    const size_t before = pliant_memory_in_use();
    size_t held[3];
    for (size_t &bytes : held) { // the same hundred cuts each time
        random.seed(3);
        cuts(100);
        EXPECT_GT(body.data->body->cuts->num_links, 300);
        // enough steps for all background results on a busy machine
        for (int step = 0; step < 20; step++) ASSERT_GE(pliant_step(body.model, body.data), 0);
        bytes = pliant_memory_in_use();
        ASSERT_EQ(pliant_data_reset(body.model, body.data), PLIANT_OK);
        EXPECT_LT(pliant_memory_in_use(), before + (before >> 4)); // lists of the warp keep their capacity
    }
    EXPECT_LT(held[2], held[0] + (held[0] >> 4));
}

TEST_F(ManyCuts, ShareUnchangedArrays)
{
    cuts(60);
    const pliant_body *last = pliant_body_retain(body.data->body);
    int shared = 0;
    for (int c = 0; c < 40; c++) {
        slit();
        const pliant_cuts *was = last->cuts, *is = body.data->body->cuts;
        for (int32_t o = 0, n = 0; was != is && o < was->num_tets && n < is->num_tets;
             o += was->tet[o] <= is->tet[n], n++)
            if (was->tet[o] == is->tet[n])
                shared += was->voxel_fragment + was->voxel_start[o] == is->voxel_fragment + is->voxel_start[n];
        pliant_body_release(last);
        last = pliant_body_retain(body.data->body);
    }
    EXPECT_GT(shared, 40 * 100);
    pliant_body_release(last);
}

template <class T> void expect_same(const T *a, const T *b, size_t count, const char *what)
{
    EXPECT_EQ(std::memcmp(a, b, count * sizeof *a), 0) << what;
}

// Compare incrementally updated lists with lists of all nodes and elements.
void expect_like_fresh_build(const pliant_scene &scene, const pliant_data &data)
{
    const pliant_discretization *rebuilt = nullptr;
    ASSERT_EQ(pliant_discretization_create(&scene, data.body, &rebuilt), PLIANT_OK) << pliant_last_error();
    const pliant_system &is = *data.discretization->system, &other = *rebuilt->system;
    const size_t nodes = static_cast<size_t>(data.body->fine.num_nodes), unknowns = static_cast<size_t>(other.num_free);
    ASSERT_EQ(is.num_free, other.num_free);
    expect_same(is.free_of_node, other.free_of_node, nodes, "unknowns of nodes");
    expect_same(is.node_of_free, other.node_of_free, unknowns, "nodes of unknowns");
    expect_same(is.gravity_mass, other.gravity_mass, 9 * unknowns, "masses");
    expect_same(is.gradients, other.gradients, static_cast<size_t>(other.num_blocks), "gradients");
    expect_same(is.lame, other.lame, static_cast<size_t>(other.num_blocks), "moduli");
    EXPECT_EQ(is.mean_diagonal, other.mean_diagonal);
    for (size_t f = 0; f < unknowns; f++) {
        const std::vector<int32_t> listed(is.corner + is.corner_start[f], is.corner + is.corner_end[f]);
        ASSERT_EQ(listed,
                  std::vector<int32_t>(other.corner + other.corner_start[f], other.corner + other.corner_end[f]))
            << "corners of unknown " << f;
    }
    const pliant_solver &solver = *data.solver;
    for (size_t i = 0; solver.loaded && i < 3 * unknowns; i++) {
        const double *mass = other.gravity_mass + 3 * i, *gravity = solver.gravity;
        ASSERT_EQ(solver.load[i], mass[0] * gravity[0] + mass[1] * gravity[1] + mass[2] * gravity[2])
            << "load of unknown " << i / 3;
    }
    pliant_discretization_release(rebuilt);
}

// Positions of the next body: existing nodes keep theirs, and copies are at their source.
void expect_carried(const pliant_body &was, const std::vector<double> &x, const pliant_data &data)
{
    const pliant_body &is = *data.body;
    if (is.revision == was.revision) return;
    ASSERT_EQ(is.changes.since, was.revision);
    for (int32_t n = 0; n < is.fine.num_nodes; n++) {
        const int32_t source = n < was.fine.num_nodes ? n : is.changes.node_source[n - was.fine.num_nodes];
        for (int d = 0; d < 3; d++)
            ASSERT_EQ(data.positions[3 * n + d], x[3 * static_cast<size_t>(source) + static_cast<size_t>(d)])
                << "node " << n;
    }
    if (!data.rigid_pieces)
        expect_same(data.solver->now.x, data.positions, 3 * static_cast<size_t>(is.fine.num_nodes),
                    "state of the solver");
}

// Random strokes, some of which cut off a corner, with steps, undo and an independent copy.
TEST_F(ManyCuts, UpdateEqualsRebuild)
{
    body.cells(14, 12, 12, 1); // arrays of many pieces
    std::memset(body.scan.voxels, 0, pliant_geometry_voxels(&body.scan.geometry));
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    pliant_data *copy = nullptr, *first = body.data;
    for (int c = 0; c < 32; c++) {
        if (c == 20) {
            ASSERT_EQ(pliant_data_copy(body.model, first, &copy), PLIANT_OK) << pliant_last_error();
        }
        body.data = c >= 20 && c % 2 == 1 ? copy : first;
        const pliant_body *was = pliant_body_retain(body.data->body);
        const std::vector<double> x(body.data->positions,
                                    body.data->positions + 3 * static_cast<size_t>(was->fine.num_nodes));
        if (c % 15 == 11) {
            const double at = 0.12 - 0.0004 * c, line[6] = {at, -0.01, 0.13, at, 0.13, 0.13},
                         depth[3] = {0.05, 0, -0.05};
            ASSERT_EQ(pliant_data_cut(body.model, body.data, 2, line, depth, nullptr), PLIANT_OK)
                << pliant_last_error();
        } else {
            slit();
        }
        if (!body.data->rigid_pieces) expect_carried(*was, x, *body.data);
        expect_like_fresh_build(body.scene, *body.data);
        pliant_body_release(was);
        if (c % 7 == 6 && body.data->undo.count > 0) {
            ASSERT_EQ(pliant_data_undo_cut(body.model, body.data), PLIANT_OK);
            expect_like_fresh_build(body.scene, *body.data);
        }
        const double gravity[3] = {0, 0.05 * (c / 9), -0.5};
        ASSERT_EQ(pliant_data_set_gravity(body.data, gravity), PLIANT_OK);
        ASSERT_GE(pliant_step(body.model, body.data), 0);
        if (HasFatalFailure()) break;
    }
    EXPECT_TRUE(first->rigid_pieces && copy->rigid_pieces);
    body.data = first;
    pliant_data_free(copy);
}

TEST_F(ManyCuts, AreDrawnAsByANewWarp)
{
    for (int round = 0; round < 3; round++) {
        cuts(30);
        ASSERT_GE(pliant_step(body.model, body.data), 0);
        pliant_warp *rebuilt = nullptr;
        ASSERT_EQ(pliant_warp_create(&body.scan, &body.model->body->fine, &body.scan.geometry, 2, &rebuilt), PLIANT_OK);
        ASSERT_EQ(pliant_warp_set_body(rebuilt, body.model->body), PLIANT_OK);
        ASSERT_EQ(pliant_warp_set_body(rebuilt, body.data->body), PLIANT_OK);
        ASSERT_EQ(pliant_warp_update(rebuilt, body.data->positions), PLIANT_OK);
        const pliant_volume *one = pliant_warp_volume(body.data->warp), *other = pliant_warp_volume(rebuilt);
        EXPECT_EQ(std::memcmp(one->voxels, other->voxels, pliant_geometry_voxels(&one->geometry)), 0)
            << "round " << round;
        pliant_warp_free(rebuilt);
    }
}

struct Held {
    const char *name;
    std::function<void(pliant_scene &)> set;
};
struct EveryHolder : testing::TestWithParam<Held> {
    Body body{size, box, {{4000, 0.4, 1000, false}}};
    // Build the model only, because the test counts its own allocations.
    void build(int threads)
    {
        body.fix_plane(0, 0, 1e-6, 0, 0, 1);
        body.cells(7, 6, 6, 1);
        body.scene.cut.kind = PLIANT_CUT_SEVER;
        body.scene.solver.iterations = 2;
        body.scene.solver.threads = threads;
        body.scene.solver.backend = PLIANT_CPU;
        GetParam().set(body.scene);
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        pliant_data_free(body.data);
        body.data = nullptr;
    }
    // Cut and undo a slit twenty times, while another simulation holds the body and runs in parallel.
    static void slits(Body &body, pliant_data *data, int count)
    {
        for (int c = 0; c < count; c++) {
            const double x = 0.02 + 0.005 * c, points[6] = {x, -0.01, 0.13, x, 0.13, 0.13}, depth[3] = {0, 0, -0.06};
            ASSERT_EQ(pliant_data_cut(body.model, data, 2, points, depth, nullptr), PLIANT_OK) << pliant_last_error();
            ASSERT_GE(pliant_step(body.model, data), 0) << pliant_last_error();
            if (c % 3 == 2) continue;
            ASSERT_EQ(pliant_data_undo_cut(body.model, data), PLIANT_OK);
            ASSERT_GE(pliant_step(body.model, data), 0) << pliant_last_error();
        }
    }
};

// The memory in the statistics equals the library's memory beyond the model, to the byte, also with parallel background
// work.
TEST_P(EveryHolder, ReportsItsBytes)
{
    build(2);
    if (HasFatalFailure()) return;
    const size_t before = pliant_memory_in_use();
    const auto held = [&] { // the background continues after a step
        size_t bytes = pliant_memory_in_use() - before;
        for (int tries = 0; tries < 500 && body.data->statistics.bytes != bytes; tries++) {
            std::this_thread::sleep_for(std::chrono::milliseconds(2));
            EXPECT_GE(pliant_step(body.model, body.data), 0);
            bytes = pliant_memory_in_use() - before;
        }
        return bytes;
    };
    ASSERT_EQ(pliant_data_create(body.model, &body.data), PLIANT_OK);
    EXPECT_EQ(body.data->statistics.bytes, held());
    ASSERT_EQ(pliant_data_set_warp(body.model, body.data, &body.scan.geometry), PLIANT_OK);
    EXPECT_EQ(body.data->statistics.bytes, held());
    int tool;
    const double at[3] = {0.05, 0.06, 0.115};
    ASSERT_EQ(pliant_tool_add(body.model, body.data, "tool", &tool), PLIANT_OK);
    ASSERT_EQ(pliant_tool_set_pose(body.data, tool, at, nullptr), PLIANT_OK);
    ASSERT_EQ(pliant_tool_grasp(body.model, body.data, tool, at), PLIANT_OK) << pliant_last_error();
    pliant_data *other = nullptr;
    ASSERT_EQ(pliant_data_create(body.model, &other), PLIANT_OK);
    std::atomic<bool> done{false};
    std::thread background([&] {
        for (int n = 0; n < 3 || !done; n++) {
            slits(body, other, 3);
            EXPECT_EQ(pliant_data_reset(body.model, other), PLIANT_OK);
        }
    });
    slits(body, body.data, 20);
    done = true;
    background.join();
    pliant_data_free(other);
    EXPECT_EQ(body.data->statistics.bytes, held());
    while (body.data->undo.count > 0) ASSERT_EQ(pliant_data_undo_cut(body.model, body.data), PLIANT_OK);
    EXPECT_EQ(body.data->statistics.bytes, held());
    ASSERT_EQ(pliant_data_copy(body.model, body.data, &other), PLIANT_OK);
    EXPECT_EQ(pliant_data_move(body.model, body.data, other), PLIANT_OK);
    pliant_data_free(other);
    ASSERT_EQ(pliant_data_reset(body.model, body.data), PLIANT_OK);
    EXPECT_EQ(body.data->statistics.bytes, held());
    pliant_data_free(body.data);
    body.data = nullptr;
    EXPECT_EQ(pliant_memory_in_use(), before);
}

// Return the memory from malloc that was not freed [bytes]; unknown with a sanitizer. Freed blocks in this thread's
// cache (glibc's tcache, 7 blocks of each size up to 1032 bytes) count as allocated. Filling the cache makes their
// amount constant.
double given_by_malloc()
{
    std::vector<std::unique_ptr<char[]>> freed;
    for (size_t bytes = 24; bytes <= 1032; bytes += 16)
        for (int n = 0; n < 16; n++) freed.emplace_back(new char[bytes]);
    freed.clear();
    freed.shrink_to_fit();
#if __GLIBC_PREREQ(2, 33)
    const struct mallinfo2 now = mallinfo2();
#else
    const struct mallinfo now = mallinfo();
#endif
    return static_cast<double>(now.uordblks) + static_cast<double>(now.hblkhd);
}

// Random slits, each one undone. After every hundred, which are the same, the memory equals that after the first
// hundred, to the byte. After the simulation ends nothing is allocated, neither by the library's count nor by malloc's.
// 400 slits, or PLIANT_CUTS.
TEST_P(EveryHolder, HoldsNothingOfCutsThatAreTakenBack)
{
    const char *const asked = std::getenv("PLIANT_CUTS");
    const int rounds = std::max((asked ? std::atoi(asked) : 400) / 100, 2);
    build(1); // no other threads that keep memory
    if (HasFatalFailure()) return;
    const size_t before = pliant_memory_in_use();
    double left[2];
    int taken[2] = {0, 0};
    for (int life = 0; life < 2; life++) { // allocations that occur once per process happen in the first round
        ASSERT_EQ(pliant_data_create(body.model, &body.data), PLIANT_OK);
        ASSERT_EQ(pliant_data_set_warp(body.model, body.data, &body.scan.geometry), PLIANT_OK) << pliant_last_error();
        size_t held = 0;
        for (int round = 0; round < (life == 0 ? 1 : rounds); round++) {
            std::mt19937 random{11};
            for (int c = 0; c < 100; c++) {
                const pliant_body *const whole = body.data->body;
                slit(body, random);
                if (HasFatalFailure()) return;
                if (body.data->body == whole) continue; // the slit missed the tissue
                taken[life]++;
                if (c % 10 == 0) ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
                ASSERT_EQ(pliant_data_undo_cut(body.model, body.data), PLIANT_OK) << pliant_last_error();
                if (c % 10 == 0) ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
            }
            ASSERT_EQ(pliant_data_reset(body.model, body.data), PLIANT_OK);
            if (round == 0) held = body.data->statistics.bytes;
            EXPECT_EQ(body.data->statistics.bytes, held) << "round " << round;
        }
        EXPECT_GT(taken[life], life == 0 ? 80 : 80 * rounds);
        pliant_data_free(body.data);
        body.data = nullptr;
        EXPECT_EQ(pliant_memory_in_use(), before);
        left[life] = given_by_malloc();
    }
    RecordProperty("more", std::to_string(left[1] - left[0]));
    EXPECT_LT(left[1] - left[0], 32 * (taken[1] - taken[0])); // less than the smallest block per cut
}

const Held holders[] = {
    {"direct", [](pliant_scene &scene) {
         scene.solver.preconditioner = PLIANT_DIRECT;
         scene.solver.refresh_interval = 1;
     }},
    {"multigrid", [](pliant_scene &scene) {
         scene.element.kind = PLIANT_HEXAHEDRA;
         scene.solver.preconditioner = PLIANT_MULTIGRID;
     }},
    {"patched", [](pliant_scene &scene) {
         scene.model.method = PLIANT_AVERAGED;
         scene.mesh.ratio = 2;
         for (int d = 0; d < 3; d++) scene.mesh.coarse_cells[d] = 4;
         scene.model.patch = 0.02;
         scene.model.patch_delay = 1;
     }},
    {"tled", [](pliant_scene &scene) { scene.solver.kind = PLIANT_TLED; }},
};
INSTANTIATE_TEST_SUITE_P(Kinds, EveryHolder, testing::ValuesIn(holders),
                         [](const auto &info) { return std::string(info.param.name); });

} // namespace
