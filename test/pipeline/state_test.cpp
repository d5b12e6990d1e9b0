// The simulation state: restore gives the saved bits, the same steps follow each time, and a failed step changes
// nothing.
#include "body.h"
#include "cut/cut.h"
#include "fem/dynamics/tled.h"
#include "pliant/contact.h"
#include "base/memory.h"
#include "sim/step/state.h"

#include <memory>

namespace {

struct Case {
    const char *name;
    bool is_explicit, cuts;
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

const Case all[] = {
    {"direct", false, false, [](pliant_scene &scene) { scene.solver.preconditioner = PLIANT_DIRECT; }},
    {"multigrid", false, false, [](pliant_scene &scene) { scene.solver.preconditioner = PLIANT_MULTIGRID; }},
    {"pieces", false, true, [](pliant_scene &scene) { scene.solver.preconditioner = PLIANT_DIRECT; }},
    {"averaged", false, true, [](pliant_scene &scene) { coarse(scene, 0); }},
    {"patch", false, false, [](pliant_scene &scene) { coarse(scene, 0.02); }},
    {"relaxation", false, true, [](pliant_scene &scene) { dynamics(scene, true); }},
    {"explicit", true, false, [](pliant_scene &scene) { dynamics(scene, false); }},
    {"explicit_pieces", true, true, [](pliant_scene &scene) { dynamics(scene, false); }}};

const int size[3] = {8, 8, 32};
const double box[3] = {0.04, 0.04, 0.16};

// A bar that hangs from its top at z = 0.16.
struct Bar : Body {
    explicit Bar(const Case &of, pliant_backend_choice backend = PLIANT_CPU)
        : Body(size, box, {{20000, 0.4, 1000, false}})
    {
        fix_plane(0, 0, 0.16 - 1e-6, 0, 0, -1);
        cells(4, 4, 16, 1);
        scene.model.gravity[2] = -9.81;
        scene.solver.step = 0.005;
        scene.solver.threads = 1;
        scene.grasp.radius = 0.005;
        scene.grasp.slip = 0.5;
        scene.cut.kind = PLIANT_CUT_SEVER;
        scene.warp.margin = 2;
        scene.solver.backend = backend;
        of.set(scene);
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
    }
};

class State : public testing::TestWithParam<Case> {
public:
    explicit State(pliant_backend_choice backend = PLIANT_CPU) : body_(GetParam(), backend)
    {
        EXPECT_EQ(pliant_state_create(&saved_), PLIANT_OK);
        EXPECT_EQ(pliant_state_create(&other_), PLIANT_OK);
    }
    ~State() override
    {
        pliant_state_free(saved_);
        pliant_state_free(other_);
    }

    void move(pliant_data *data, int step) const
    {
        const double grasped[3] = {0.02 + 0.0005 * step, 0.02, 0.1}, pressed[3] = {0.0465 - 0.0003 * step, 0.02, 0.07};
        ASSERT_EQ(pliant_tool_set_pose(data, 0, grasped, nullptr), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_pose(data, 1, pressed, nullptr), PLIANT_OK);
    }
    static void add_tools(const pliant_model *model, pliant_data *data)
    {
        pliant_tool_shape ball{};
        ball.num_parts = 1;
        ball.part[0] = {PLIANT_PART_SPHERE, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0}, 0.008, false, nullptr};
        int tool = -1;
        ASSERT_EQ(pliant_tool_add(model, data, "forceps", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_add(model, data, "probe", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_shape(data, tool, &ball), PLIANT_OK) << pliant_last_error();
    }
    // A grasp pulls and a ball presses. After the cuts one piece falls and another hangs by the grasp.
    void begin(pliant_data *data) const
    {
        const double held[3] = {0.02, 0.02, 0.1};
        add_tools(body_.model, data);
        ASSERT_EQ(pliant_tool_set_pose(data, 0, held, nullptr), PLIANT_OK);
        ASSERT_EQ(pliant_tool_grasp(body_.model, data, 0, held), PLIANT_OK) << pliant_last_error();
        for (int s = 0; s < 6; s++) {
            move(data, s);
            if (s == 2 && GetParam().cuts) cut(data, 0.0523);
            if (s == 4 && GetParam().cuts) cut(data, 0.1223);
            ASSERT_GE(pliant_step(body_.model, data), 0) << pliant_last_error();
        }
        EXPECT_GT(data->contacts.count, 0);
    }
    void cut(pliant_data *data, double z) const
    {
        const double line[6] = {-0.01, -0.01, z, 0.05, -0.01, z}, depth[3] = {0, 0.06, 0};
        ASSERT_EQ(pliant_data_cut(body_.model, data, 2, line, depth, nullptr), PLIANT_OK) << pliant_last_error();
    }
    std::vector<double> go_on(pliant_data *data) const
    {
        std::vector<double> seen;
        for (int s = 6; s < 12; s++) {
            move(data, s);
            EXPECT_GE(pliant_step(body_.model, data), 0) << pliant_last_error();
            const double *x = pliant_data_get_positions(data, nullptr);
            seen.insert(seen.end(), x, x + 3 * pliant_data_get_body(data)->fine.num_nodes);
            for (int t = 0; t < 2; t++) {
                pliant_tool_state tool;
                EXPECT_EQ(pliant_tool_get(data, t, &tool), PLIANT_OK);
                seen.insert(seen.end(), tool.force, tool.force + 3);
                seen.insert(seen.end(), tool.contact_force, tool.contact_force + 3);
            }
        }
        return seen;
    }

    Bar body_;
    pliant_state *saved_ = nullptr, *other_ = nullptr;
};

// on a GPU if there is one
class AnyState : public State {
public:
    AnyState() : State(PLIANT_AUTO) {}
};

// Return the names of the differences.
std::string difference(const pliant_state &a, const pliant_state &b)
{
    std::string names;
    const auto add = [&names](bool same, const char *name) { names += same ? "" : std::string(" ") + name; };
#define COMPARE(type, name) \
    add(a.name.count == b.name.count && \
            (a.name.count == 0 || std::memcmp(a.name.at, b.name.at, a.name.count * sizeof *a.name.at) == 0), \
        #name);
    PLIANT_STATE_ARRAYS(COMPARE)
#undef COMPARE
    add(std::memcmp(&a.dynamics, &b.dynamics, sizeof a.dynamics) == 0, "dynamics");
    add(std::memcmp(a.gravity, b.gravity, sizeof a.gravity) == 0 && a.iterations == b.iterations &&
            a.tolerance == b.tolerance,
        "input");
    add(std::memcmp(a.grasp_force, b.grasp_force, sizeof a.grasp_force) == 0, "grasp_force");
    const pliant_contacts &x = a.contact[0].points, &y = b.contact[0].points;
    add(x.count == y.count &&
            (x.count == 0 || std::memcmp(x.point, y.point, static_cast<size_t>(x.count) * sizeof *x.point) == 0),
        "contacts");
    add(a.num_tools == b.num_tools, "num_tools");
    for (int t = 0; t < std::min(a.num_tools, b.num_tools); t++) {
        pliant_tool s = a.tools[t], u = b.tools[t];
        s.attached = u.attached = false; // the solver may attach it again
        add(std::memcmp(&s, &u, sizeof s) == 0, s.name);
    }
    pliant_statistics p = a.statistics, q = b.statistics;
    p.bytes = q.bytes = p.failed = q.failed = 0; // not part of the simulation
    std::fill(p.seconds, p.seconds + PLIANT_NUM_STEP_STAGES, 0.0);
    std::fill(q.seconds, q.seconds + PLIANT_NUM_STEP_STAGES, 0.0);
    add(std::memcmp(&p, &q, sizeof p) == 0, "statistics");
    add(a.body == b.body, "body");
    return names;
}

TEST_P(AnyState, IsRestoredToTheBitAndTheSameStepsFollow)
{
    pliant_data *data = body_.data;
    begin(data);
    ASSERT_EQ(pliant_state_save(body_.model, data, saved_), PLIANT_OK) << pliant_last_error();
    const std::vector<double> straight = go_on(data);
    std::vector<double> first;
    for (int again = 0; again < 2; again++) {
        ASSERT_EQ(pliant_state_restore(body_.model, data, saved_), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_state_save(body_.model, data, other_), PLIANT_OK);
        EXPECT_EQ(difference(*saved_, *other_), "");
        const std::vector<double> next = go_on(data);
        if (again == 0) first = next;
        EXPECT_EQ(next, first);
    }
    if (GetParam().is_explicit) EXPECT_EQ(first, straight); // it has no history that accelerates its steps
    ASSERT_EQ(first.size(), straight.size());
}

TEST_P(State, WithoutMemoryNothingChanges)
{
    pliant_data *data = body_.data;
    begin(data);
    ASSERT_EQ(pliant_state_save(body_.model, data, saved_), PLIANT_OK);
    ASSERT_EQ(pliant_state_restore(body_.model, data, saved_), PLIANT_OK);
    for (int buffer = 0; buffer < 2; buffer++) ASSERT_EQ(pliant_state_save(body_.model, data, other_), PLIANT_OK);
    int failed[2] = {0, 0};
    for (int64_t n = 0;; n++) {
        pliant_state *state = nullptr;
        ASSERT_EQ(pliant_state_create(&state), PLIANT_OK);
        pliant_memory_fail_after(n);
        const pliant_status status = pliant_state_save(body_.model, data, state);
        pliant_memory_fail_after(-1);
        const bool is_empty = state->body == nullptr;
        pliant_state_free(state);
        if (status == PLIANT_OK) break;
        ASSERT_EQ(status, PLIANT_ERROR_MEMORY) << n << ": " << pliant_last_error();
        EXPECT_TRUE(is_empty);
        failed[0]++;
    }
    const size_t before = pliant_memory_in_use();
    for (int64_t n = 0;; n += 1 + n / 4) {
        pliant_memory_fail_after(n);
        const pliant_status status = pliant_state_restore(body_.model, data, saved_);
        pliant_memory_fail_after(-1);
        if (status == PLIANT_OK) break;
        ASSERT_EQ(status, PLIANT_ERROR_MEMORY) << n << ": " << pliant_last_error();
        ASSERT_EQ(pliant_memory_in_use(), before) << "allocation " << n;
        ASSERT_EQ(pliant_state_save(body_.model, data, other_), PLIANT_OK);
        EXPECT_EQ(difference(*saved_, *other_), "") << n;
        failed[1]++;
    }
    EXPECT_GT(failed[0], 3);
    EXPECT_GT(failed[1], 5);
}

// Each allocation of a step fails, also in a step in which tissue slips out of the grasp.
TEST_P(State, AStepThatFailsLeavesIt)
{
    pliant_data *data = body_.data;
    begin(data);
    const double far[3] = {0.06, 0.02, 0.1};
    ASSERT_EQ(pliant_tool_set_pose(data, 0, far, nullptr), PLIANT_OK);
    ASSERT_EQ(pliant_state_save(body_.model, data, saved_), PLIANT_OK);
    int failed = 0;
    for (int64_t n = 0;; n++) {
        ASSERT_EQ(pliant_state_restore(body_.model, data, saved_), PLIANT_OK);
        pliant_memory_fail_after(n);
        const pliant_status status = pliant_step(body_.model, data);
        pliant_memory_fail_after(-1);
        if (status >= 0) {
            if (n > 200) break;
            continue; // it did not need that memory
        }
        ASSERT_EQ(status, PLIANT_ERROR_MEMORY) << n << ": " << pliant_last_error();
        ASSERT_EQ(pliant_state_save(body_.model, data, other_), PLIANT_OK);
        EXPECT_EQ(difference(*saved_, *other_), "") << n;
        EXPECT_EQ(data->statistics.failed, saved_->statistics.failed + 1);
        failed++;
        ASSERT_GE(pliant_step(body_.model, data), 0) << n << ": " << pliant_last_error();
    }
    EXPECT_GT(failed, 3);
    EXPECT_FALSE(data->tools[0].holding);
}

// Positions, velocities and the number of sub-steps are restored, however often sub-steps were halved.
class ExplicitState : public State {};
TEST_P(ExplicitState, AStepThatDivergesLeavesIt)
{
    pliant_data *data = body_.data;
    begin(data);
    const double violent[3] = {1e9, 0, 0}, still[3] = {0, 0, -9.81};
    ASSERT_EQ(pliant_data_set_gravity(data, violent), PLIANT_OK);
    ASSERT_EQ(pliant_state_save(body_.model, data, saved_), PLIANT_OK);
    ASSERT_EQ(pliant_step(body_.model, data), PLIANT_ERROR_NUMERIC);
    EXPECT_EQ(data->statistics.failed, 1u);
    ASSERT_EQ(pliant_state_save(body_.model, data, other_), PLIANT_OK);
    EXPECT_EQ(difference(*saved_, *other_), "");
    ASSERT_EQ(pliant_data_set_gravity(data, still), PLIANT_OK);
    const std::vector<double> after = go_on(data);
    ASSERT_EQ(pliant_state_restore(body_.model, data, saved_), PLIANT_OK);
    ASSERT_EQ(pliant_data_set_gravity(data, still), PLIANT_OK);
    EXPECT_EQ(go_on(data), after);
}
INSTANTIATE_TEST_SUITE_P(Explicit, ExplicitState, testing::Values(all[6], all[7]),
                         [](const testing::TestParamInfo<Case> &each) { return std::string(each.param.name); });

std::vector<char> bytes_of(const pliant_state *state)
{
    std::vector<char> bytes(pliant_state_write(state, 0, nullptr));
    EXPECT_EQ(pliant_state_write(state, bytes.size(), bytes.data()), bytes.size());
    return bytes;
}

// Restore in another process: build the model again, and cut its body again.
TEST_P(AnyState, IsReadFromBytes)
{
    Bar later(GetParam(), PLIANT_AUTO);
    pliant_data *data = body_.data;
    begin(data);
    ASSERT_EQ(pliant_state_save(body_.model, data, saved_), PLIANT_OK);
    const std::vector<char> bytes = bytes_of(saved_);
    const std::vector<double> straight = go_on(data);
    pliant_contact_search *search = nullptr; // the search state is not part of the bytes
    std::swap(search, saved_->contact[0].search);
    ASSERT_EQ(pliant_state_restore(body_.model, data, saved_), PLIANT_OK);
    std::swap(search, saved_->contact[0].search);
    const std::vector<double> restored = go_on(data);

    const pliant_body *body = pliant_body_retain(later.model->body);
    const pliant_cuts *cuts = saved_->body->cuts;
    for (int32_t c = 0; cuts && c < cuts->num_cuts; c++) {
        pliant_body *next = nullptr;
        const int32_t first = c > 0 ? cuts->cut_end[c - 1] : 0;
        ASSERT_EQ(pliant_body_sever(body, body->revision + 1, cuts->cut_end[c] - first, cuts->severed + first, &next),
                  PLIANT_OK)
            << pliant_last_error();
        pliant_body_release(body);
        body = next;
    }
    add_tools(later.model, later.data);
    ASSERT_EQ(pliant_state_read(later.model, later.data, body, bytes.size(), bytes.data(), other_), PLIANT_OK)
        << pliant_last_error();
    EXPECT_EQ(difference(*saved_, *other_), GetParam().cuts ? " undo body" : " body");
    ASSERT_EQ(pliant_state_restore(later.model, later.data, other_), PLIANT_OK) << pliant_last_error();
    pliant_body_release(body);
    std::swap(body_.model, later.model);
    const std::vector<double> read = go_on(later.data);
    std::swap(body_.model, later.model);
    EXPECT_EQ(read, restored);
    if (GetParam().is_explicit) {
        EXPECT_EQ(read, straight);
    }
}

TEST_P(State, OfOtherBytesIsRefused)
{
    begin(body_.data);
    ASSERT_EQ(pliant_state_save(body_.model, body_.data, saved_), PLIANT_OK);
    ASSERT_EQ(pliant_state_save(body_.model, body_.data, other_), PLIANT_OK);
    const std::vector<char> good = bytes_of(saved_);
    const auto refused = [&](std::vector<char> bytes, const char *why) {
        EXPECT_EQ(pliant_state_read(body_.model, body_.data, body_.data->body, bytes.size(), bytes.data(), other_),
                  PLIANT_ERROR_FORMAT);
        EXPECT_NE(std::string(pliant_last_error()).find(why), std::string::npos) << pliant_last_error();
    };
    refused({good.begin(), good.begin() + 7}, "are not a simulation state");
    refused({good.begin(), good.end() - 1}, "damaged");
    std::vector<char> bad = good;
    bad[good.size() / 2] ^= 1;
    refused(bad, "damaged");
    bad = good;
    bad[8] ^= 2; // of its format
    refused(bad, "read it with the version that wrote it");
    bad = good;
    bad[32] ^= 2; // of its mesh
    refused(bad, "another mesh");
    EXPECT_EQ(difference(*saved_, *other_), "");
    EXPECT_EQ(pliant_state_read(body_.model, body_.data, body_.data->body, good.size(), good.data(), other_),
              PLIANT_OK);
}

// Halved sub-steps, grasps, contacts and cuts leave nothing behind.
TEST_P(AnyState, ResetStartsAsALoad)
{
    Bar loaded(GetParam(), PLIANT_AUTO);
    pliant_data *data = body_.data;
    begin(data);
    const double swift[3] = {3e3, 0, 0};
    ASSERT_EQ(pliant_data_set_gravity(data, swift), PLIANT_OK);
    for (int s = 0; GetParam().is_explicit && s < 20 && data->tled->halvings == 0; s++) pliant_step(body_.model, data);
    if (GetParam().is_explicit) EXPECT_GT(data->tled->halvings, 0);
    ASSERT_EQ(pliant_data_reset(body_.model, data), PLIANT_OK);
    if (data->tled) EXPECT_EQ(data->tled->substeps, loaded.data->tled->substeps);
    begin(data);
    const std::vector<double> reset = go_on(data);
    std::swap(body_.model, loaded.model);
    begin(loaded.data);
    EXPECT_EQ(go_on(loaded.data), reset);
    std::swap(body_.model, loaded.model);
}

INSTANTIATE_TEST_SUITE_P(Every, AnyState, testing::ValuesIn(all),
                         [](const testing::TestParamInfo<Case> &each) { return std::string(each.param.name); });
INSTANTIATE_TEST_SUITE_P(Every, State, testing::ValuesIn(all),
                         [](const testing::TestParamInfo<Case> &each) { return std::string(each.param.name); });

} // namespace
