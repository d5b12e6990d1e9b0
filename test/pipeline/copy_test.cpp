// Copy and restore a simulation: the same steps give bitwise identical results, with grasps, cuts, detached pieces and
// relaxed tissue.
#include "body.h"
#include "base/memory.h"
#include "sim/api/data.h"
#include "model_data/data.h"

#include <memory>

namespace {

struct Case {
    const char *name;
    std::function<void(pliant_scene &)> set;
};
void PrintTo(const Case &of, std::ostream *out) { *out << of.name; }

void coarse(pliant_scene &scene, double patch)
{
    scene.model.method = PLIANT_AVERAGED;
    scene.element.kind = PLIANT_LINEAR;
    scene.mesh.ratio = 2;
    for (int32_t &cells : scene.mesh.coarse_cells) cells /= 2;
    scene.model.patch = patch;
    scene.model.patch_delay = 2;
}
void dynamics(pliant_scene &scene, bool quasi_static)
{
    scene.solver.kind = PLIANT_TLED;
    scene.tled.quasi_static = quasi_static;
    scene.tled.relaxation_steps = 50;
    scene.tled.prony_share[0] = quasi_static ? 0 : 0.3;
    scene.tled.prony_time[0] = 0.05;
}

// Create a bar that hangs from its top at z = 0.16.
std::unique_ptr<Body> hang(const Case &of)
{
    const int size[3] = {8, 8, 32};
    const double box[3] = {0.04, 0.04, 0.16};
    std::unique_ptr<Body> body(new Body(size, box, {{20000, 0.4, 1000, false}}));
    body->fix_plane(0, 0, 0.16 - 1e-6, 0, 0, -1);
    body->cells(4, 4, 16, 1);
    body->scene.model.gravity[2] = -9.81;
    body->scene.solver.step = 0.005;
    body->scene.solver.threads = 1;
    body->scene.grasp.radius = 0.005;
    body->scene.cut.kind = PLIANT_CUT_SEVER;
    body->scene.warp.margin = 2;
    of.set(body->scene);
    EXPECT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
    return body;
}

void step(const Body &body, pliant_data *data, int count)
{
    for (int s = 0; s < count; s++) ASSERT_GE(pliant_step(body.model, data), 0) << pliant_last_error();
}

void cut_at(const Body &body, pliant_data *data, double z)
{
    const double line[6] = {-0.01, -0.01, z, 0.05, -0.01, z}, depth[3] = {0, 0.06, 0};
    ASSERT_EQ(pliant_data_cut(body.model, data, 2, line, depth, nullptr), PLIANT_OK) << pliant_last_error();
}

// Pull and cut: one piece falls, and the tool holds another piece.
void begin(const Body &body, pliant_data *data)
{
    int tool = -1;
    const double held[3] = {0.02, 0.02, 0.1};
    ASSERT_EQ(pliant_tool_add(body.model, data, "forceps", &tool), PLIANT_OK);
    ASSERT_EQ(pliant_tool_set_pose(data, tool, held, nullptr), PLIANT_OK);
    ASSERT_EQ(pliant_tool_grasp(body.model, data, tool, held), PLIANT_OK) << pliant_last_error();
    step(body, data, 2);
    cut_at(body, data, 0.0523);
    step(body, data, 2);
}

// Continue: move the tool, cut again, and undo that cut.
std::vector<double> go_on(const Body &body, pliant_data *data)
{
    std::vector<double> seen;
    for (int s = 0; s < 3; s++) {
        const double tip[3] = {0.02 + 0.001 * s, 0.02, 0.1};
        EXPECT_EQ(pliant_tool_set_pose(data, 0, tip, nullptr), PLIANT_OK);
        step(body, data, 1);
        if (s == 0) cut_at(body, data, 0.1223);
        if (s == 1) EXPECT_EQ(pliant_data_undo_cut(body.model, data), PLIANT_OK);
        const double *x = pliant_data_get_positions(data, nullptr);
        seen.insert(seen.end(), x, x + 3 * pliant_data_get_body(data)->fine.num_nodes);
        pliant_tool_state tool;
        EXPECT_EQ(pliant_tool_get(data, 0, &tool), PLIANT_OK);
        seen.insert(seen.end(), tool.force, tool.force + 3);
        seen.push_back(pliant_data_get_statistics(data)->iterations);
    }
    return seen;
}

class Copies : public testing::TestWithParam<Case> {};

TEST_P(Copies, ContinueIdenticallyAndCanBeRestored)
{
    std::unique_ptr<Body> body = hang(GetParam());
    pliant_data *data = body->data, *saved = nullptr;
    begin(*body, data);
    const std::vector<double> was(data->positions, data->positions + 3 * data->body->fine.num_nodes);
    ASSERT_EQ(pliant_data_copy(body->model, data, &saved), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(saved->body, data->body);
    EXPECT_EQ(std::vector<double>(saved->positions, saved->positions + was.size()), was);
    EXPECT_EQ(saved->statistics.rigid_pieces, data->statistics.rigid_pieces);

    pliant_data *other = nullptr;
    ASSERT_EQ(pliant_data_copy(body->model, saved, &other), PLIANT_OK);
    const std::vector<double> once = go_on(*body, other);
    for (int again = 0; again < 2; again++) {
        ASSERT_EQ(pliant_data_move(body->model, data, saved), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(std::vector<double>(data->positions, data->positions + was.size()), was);
        EXPECT_EQ(go_on(*body, data), once);
    }
    // a simulation that is never copied gives nearly the same result; only the solver's history restarts in a copy
    std::unique_ptr<Body> straight = hang(GetParam());
    begin(*straight, straight->data);
    go_on(*straight, straight->data);
    ASSERT_EQ(straight->data->body->fine.num_nodes, data->body->fine.num_nodes);
    double farthest = 0;
    for (int32_t i = 0; i < 3 * data->body->fine.num_nodes; i++)
        farthest = std::max(farthest, std::fabs(straight->data->positions[i] - data->positions[i]));
    EXPECT_LT(farthest, GetParam().name == std::string("tled") ? 1e-9 : 0.002);
    pliant_data_free(saved);
    pliant_data_free(other);
}

const Case direct{"direct", [](pliant_scene &scene) { scene.solver.preconditioner = PLIANT_DIRECT; }};
const Case all[] = {direct,
                    {"multigrid", [](pliant_scene &scene) { scene.solver.preconditioner = PLIANT_MULTIGRID; }},
                    {"averaged", [](pliant_scene &scene) { coarse(scene, 0); }},
                    {"patch", [](pliant_scene &scene) { coarse(scene, 0.02); }},
                    {"relaxation", [](pliant_scene &scene) { dynamics(scene, true); }},
                    {"tled", [](pliant_scene &scene) { dynamics(scene, false); }}};
INSTANTIATE_TEST_SUITE_P(Every, Copies, testing::ValuesIn(all),
                         [](const testing::TestParamInfo<Case> &each) { return each.param.name; });

TEST(Copy, AStateOfAnotherModelIsRefused)
{
    std::unique_ptr<Body> body = hang(direct);
    begin(*body, body->data);
    const std::vector<double> was(body->data->positions, body->data->positions + 3 * body->data->body->fine.num_nodes);
    const std::pair<Case, std::string> others[] = {
        {{"cut/kind", [](pliant_scene &scene) { scene.cut.kind = PLIANT_CUT_NONE; }}, "cut/kind differs"},
        {{"tled", [](pliant_scene &scene) { dynamics(scene, false); }}, "solver/kind differs"},
        {{"averaged", [](pliant_scene &scene) { coarse(scene, 0); }}, "model/method differs"},
        {{"same", [](pliant_scene &scene) { scene.solver.preconditioner = PLIANT_DIRECT; }}, "of the same options"}};
    for (const auto &each : others) {
        std::unique_ptr<Body> other = hang(each.first);
        step(*other, other->data, 1);
        pliant_data *copy = nullptr;
        EXPECT_EQ(pliant_data_move(body->model, body->data, other->data), PLIANT_ERROR_ARGUMENT);
        EXPECT_NE(std::string(pliant_last_error()).find(each.second), std::string::npos) << pliant_last_error();
        EXPECT_EQ(pliant_data_move(other->model, body->data, other->data), PLIANT_ERROR_ARGUMENT);
        EXPECT_EQ(pliant_data_copy(other->model, body->data, &copy), PLIANT_ERROR_ARGUMENT);
        EXPECT_EQ(copy, nullptr);
        step(*other, other->data, 1);
    }
    EXPECT_EQ(std::vector<double>(body->data->positions, body->data->positions + was.size()), was);
    step(*body, body->data, 1);
}

TEST(Copy, WithoutMemoryNothingChanges)
{
    std::unique_ptr<Body> body = hang(direct);
    pliant_data *data = body->data, *saved = nullptr;
    begin(*body, data);
    ASSERT_EQ(pliant_data_copy(body->model, data, &saved), PLIANT_OK);
    ASSERT_EQ(pliant_data_move(body->model, data, saved), PLIANT_OK);
    const std::vector<double> once = go_on(*body, data);
    ASSERT_EQ(pliant_data_move(body->model, data, saved), PLIANT_OK);
    const size_t before = pliant_memory_in_use();
    int failed = 0;
    for (int64_t n = 0;; n += 1 + n / 4) {
        pliant_memory_fail_after(n);
        const pliant_status status = pliant_data_move(body->model, data, saved);
        pliant_memory_fail_after(-1);
        if (status == PLIANT_OK) break;
        ASSERT_EQ(status, PLIANT_ERROR_MEMORY) << n << ": " << pliant_last_error();
        ASSERT_EQ(pliant_memory_in_use(), before) << "allocation " << n;
        failed++;
    }
    EXPECT_GT(failed, 10);
    EXPECT_EQ(go_on(*body, data), once);
    pliant_data_free(saved);
}

} // namespace
