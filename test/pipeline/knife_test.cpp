// Blades through tissue, step by step: the cut, its work, and the unchanged rest.
#include "cuts.h"
#include "fem/element/scalar.h"
#include "mesh/mesh.h"
#include "sim/build/model.h"
#include "sim/step/cut.h"
#include "base/memory.h"

#include <algorithm>
#include <memory>
#include <string>

namespace {

const int size[3] = {40, 12, 16};
const double box[3] = {0.08, 0.024, 0.032}, width = 0.024, height = 0.032, toughness = 200;

struct Kind {
    const char *name;
    std::function<void(pliant_scene &)> set;
};
const Kind fine{"fine", [](pliant_scene &) {}};
const Kind averaged{"averaged", [](pliant_scene &scene) {
                        scene.model.method = PLIANT_AVERAGED;
                        scene.mesh.coarse_cells[0] = 5;
                        scene.mesh.coarse_cells[1] = scene.mesh.coarse_cells[2] = 2;
                        scene.mesh.ratio = 2;
                    }};
const Kind dynamic{"tled", [](pliant_scene &scene) {
                       scene.solver.kind = PLIANT_TLED;
                       scene.tled.damping = 20;
                   }};

const Kind subdivided{"subdivide", [](pliant_scene &scene) { scene.cut.kind = PLIANT_CUT_SUBDIVIDE; }};

// A slab of liver on a fixed base, with a blade across it.
struct Slab : Body {
    int tool = -1;
    std::string logged;
    explicit Slab(const Kind &kind = fine, double resistance = 1) : Body(size, box, {{5500, 0.45, 1060, false}})
    {
        table.materials[0].toughness = toughness;
        cells(10, 3, 4, 1);
        scene.solver.iterations = 30;
        scene.solver.tolerance = 1e-4;
        scene.cut.kind = PLIANT_CUT_SEVER;
        scene.cut.resistance = resistance;
        fix_plane(0, 0, 1e-6, 0, 0, 1);
        kind.set(scene);
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
        const double from[3] = {0, -0.02, 0}, to[3] = {0, 0.02, 0};
        EXPECT_EQ(pliant_tool_add(model, data, "knife", &tool), PLIANT_OK);
        EXPECT_EQ(pliant_tool_set_blade(data, tool, from, to), PLIANT_OK);
        pliant_set_log([](pliant_log_level level, const char *message, void *user) {
            if (level == PLIANT_LOG_WARNING) static_cast<Slab *>(user)->logged += std::string(message) + "\n";
        }, this);
    }
    ~Slab() { pliant_set_log(nullptr, nullptr); }
    void place(double x, double z, const double *rotation = nullptr)
    {
        const double tip[3] = {x, 0.012, z};
        ASSERT_EQ(pliant_tool_set_pose(data, tool, tip, rotation), PLIANT_OK);
    }
    void cutting(bool on) { ASSERT_EQ(pliant_tool_set_cutting(data, tool, on), PLIANT_OK) << pliant_last_error(); }
    pliant_tool_state state() const
    {
        pliant_tool_state tool_state{};
        EXPECT_EQ(pliant_tool_get(data, tool, &tool_state), PLIANT_OK);
        return tool_state;
    }
    void step() { ASSERT_GE(pliant_step(model, data), 0) << pliant_last_error(); }
    // Move down at a speed; return forces and heights of every step.
    void stroke(double x, double from, double to, double speed, std::vector<double> *forces = nullptr,
                double *work = nullptr)
    {
        const double way = speed * scene.solver.step;
        double force = 0;
        place(x, from);
        cutting(true);
        step();
        for (double z = from - way; z > to; z -= way) {
            place(x, z);
            step();
            const double now = -state().force[2];
            if (work) *work += 0.5 * (force + now) * way;
            force = now;
            if (forces) forces->push_back(now);
        }
    }
    // Return the strain energy [J], with each element's own stiffness.
    double strain_energy() const
    {
        std::vector<float> density(static_cast<size_t>(data->body->fine.num_tets));
        pliant_data_tet_scalar(model, data->body, data->positions, PLIANT_SCALAR_STRAIN_ENERGY, density.data());
        double sum = 0, gradients[12];
        for (int32_t t = 0; t < data->body->fine.num_tets; t++)
            sum += density[t] * pliant_mesh_gradients(&data->body->fine, t, gradients);
        return sum;
    }
    double height_energy() const // gravitational energy [J]
    {
        double sum = 0;
        for (int32_t n = 0; n < data->body->fine.num_nodes; n++)
            for (int d = 0; d < 3; d++)
                sum -= data->body->node_mass[n] * data->gravity[d] *
                       (data->positions[3 * n + d] - data->body->fine.rest[3 * n + d]);
        return sum;
    }
};

struct EveryKind : testing::TestWithParam<Kind> {};

TEST_P(EveryKind, AStrokeTakesToughnessTimesItsArea)
{
    Slab slab(GetParam());
    std::vector<double> forces;
    double work = 0;
    slab.stroke(0.0405, 0.034, -0.003, 0.02, &forces, &work);
    const pliant_tool_state tool_state = slab.state();
    if (std::getenv("PLIANT_FIGURES"))
        std::printf("area %.4f of the section's, work %.4f of toughness times area, mean force %.3f N, peak %.3f N\n",
                    tool_state.severed_area / (width * height), work / (toughness * tool_state.severed_area),
                    work / height, *std::max_element(forces.begin(), forces.end()));
    EXPECT_EQ(tool_state.pieces, 2);
    EXPECT_NEAR(tool_state.severed_area, width * height, 0.05 * width * height);
    EXPECT_NEAR(work, toughness * tool_state.severed_area, 0.05 * toughness * tool_state.severed_area);
    EXPECT_NEAR(work / height, toughness * width, 0.12 * toughness * width)
        << "mean force on its way through the tissue";
    const double peak = *std::max_element(forces.begin(), forces.end());
    EXPECT_GT(peak, 1.5 * toughness * width);
    EXPECT_LT(peak, 3.5 * toughness * width);
    int drops = 0; // number of sudden drops
    for (size_t n = 1; n < forces.size(); n++)
        drops += forces[n - 1] > toughness * width && forces[n] < 0.3 * toughness * width;
    // subdivided elements separate by rows of triangles
    EXPECT_GE(drops, GetParam().name == subdivided.name ? 4 : 5) << "a saw-tooth";
    EXPECT_FALSE(tool_state.holding);
    EXPECT_EQ(slab.logged, "");
}

// Blades that end in the tissue, at their tip and at the end of their stroke. The last drag has cut nothing yet: the
// tissue takes its elastic energy. Rows of voxels are severed as a whole, so ends are spread over a voxel.
TEST_P(EveryKind, AStrokeThatEndsInTheTissueTakesTheWorkOfItsAreaOnce)
{
    for (double speed : {0.01, 0.02, 0.03, 0.044, 0.06, 0.088, 0.2}) {
        double work = 0, area = 0, swept = 0, dragged = 0, account = 0, minimum = 9, maximum = 0;
        for (int n = 0; n < 8; n++) {
            Slab slab(GetParam());
            const double reach = 0.011 + 0.001 * n, end = 0.0103 - 0.00025 * (5 * n % 8),
                         way = speed * slab.scene.solver.step, start = end + way * std::ceil((0.034 - end) / way);
            const double from[3] = {0, -0.02, 0}, to[3] = {0, reach - 0.012, 0};
            ASSERT_EQ(pliant_tool_set_blade(slab.data, slab.tool, from, to), PLIANT_OK);
            double once = 0, square = 0;
            slab.stroke(0.0385 + 0.0005 * n, start, end - 0.5 * way, speed, nullptr, &once);
            const pliant_blade &blade = slab.data->tools[slab.tool].blade;
            const bool was_dragging = blade.is_dragging;
            const double cut_end = blade.cut_end[2];
            for (int s = 0; s < 10; s++) slab.step(); // at rest: tissue that has slipped is cut
            if (GetParam().name != dynamic.name) // without inertia
                EXPECT_TRUE(blade.is_dragging || !was_dragging || blade.cut_end[2] < cut_end)
                    << speed << ": no slip that cuts nothing";
            for (double along : blade.drag_displacement) square += along * along;
            const double energy = blade.is_dragging ? 0.5 * blade.stiffness * square : 0;
            account += blade.work;
            slab.cutting(false);
            slab.step();
            const double severed = slab.state().severed_area, ratio = (once - energy) / (toughness * severed);
            minimum = std::min(minimum, ratio);
            maximum = std::max(maximum, ratio);
            work += once;
            dragged += energy;
            area += severed;
            swept += reach * (height - end);
        }
        if (std::getenv("PLIANT_FIGURES"))
            std::printf("%.3f m/s: area %.3f of the swept area; work %.3f of toughness times area, without the last "
                        "drags %.3f (%.3f to %.3f), without the account %.4f\n",
                        speed, area / swept, work / (toughness * area), (work - dragged) / (toughness * area), minimum,
                        maximum, (work - account) / (toughness * area));
        EXPECT_NEAR(work, toughness * area + dragged, 0.05 * toughness * area) << speed;
        // the end of a subdivided cut separates other faces than its trial
        const double tolerance = GetParam().name == subdivided.name ? 0.05 : 0.001;
        EXPECT_NEAR(work, toughness * area + account, tolerance * toughness * area) << speed << ": all counts";
    }
}

// Steps move the blade by a third of `cut/drag` and more: strokes from several heights through undamaged tissue.
TEST_P(EveryKind, AStepThatGoesFarTakesToughnessTimesItsAreaToo)
{
    for (double way : {0.001, 0.0015, 0.002, 0.003, 0.0045, 0.006}) {
        double work = 0, area = 0, maximum = 0;
        for (int n = 0; n < 4; n++) {
            Slab slab(GetParam());
            std::vector<double> forces;
            slab.stroke(0.0405, 0.034 + 0.25 * n * way, -0.012, way / slab.scene.solver.step, &forces, &work);
            area += slab.state().severed_area;
            maximum = std::max(maximum, *std::max_element(forces.begin(), forces.end()));
            EXPECT_EQ(slab.state().pieces, 2) << way;
            EXPECT_EQ(slab.logged, "");
        }
        if (std::getenv("PLIANT_FIGURES"))
            std::printf(
                "%.1f mm a step: area %.4f of the section's, work %.4f of toughness times area, "
                "peak %.3f of toughness times width\n",
                1e3 * way, area / (4 * width * height), work / (toughness * area), maximum / (toughness * width));
        EXPECT_NEAR(area, 4 * width * height, 0.01 * 4 * width * height) << way;
        EXPECT_NEAR(work, toughness * area, 0.05 * toughness * area) << way;
        // subdivided elements separate by rows of triangles
        EXPECT_LT(maximum, (GetParam().name == subdivided.name ? 2.1 : 2.01) * toughness * width) << way;
    }
}

// Steps just below the limit of dragging: a drag has few steps.
TEST_P(EveryKind, DragsOfFewStepsTakeToughnessTimesTheirAreaToo)
{
    if (GetParam().name == averaged.name) return; // takes longer
    const double way = 0.00088;
    double work = 0;
    Slab slab(GetParam());
    slab.stroke(0.0405, 0.034, -0.012, way / slab.scene.solver.step, nullptr, &work);
    const double area = slab.state().severed_area;
    if (std::getenv("PLIANT_FIGURES")) std::printf("work %.4f of toughness times area\n", work / (toughness * area));
    EXPECT_NEAR(area, width * height, 0.01 * width * height);
    EXPECT_NEAR(work, toughness * area, 0.05 * toughness * area);
}

// Slow, fast, slow, fast through a slab: no cut is paid twice, and no force acts along a path that is already cut.
TEST_P(EveryKind, ABladeThatChangesItsSpeedTakesNoMore)
{
    double work = 0, area = 0, maximum = 0;
    for (int n = 0; n < 4; n++) {
        Slab slab(GetParam());
        double force = 0, z = 0.034 + 0.0002 * n;
        slab.place(0.0405, z);
        slab.cutting(true);
        slab.step();
        for (int s = 0; z > -0.012; s++) {
            const double way = s / 6 % 2 ? 0.003 : 0.0004;
            slab.place(0.0405, z -= way);
            slab.step();
            const double now = -slab.state().force[2];
            work += 0.5 * (force + now) * way;
            maximum = std::max(maximum, now);
            force = now;
        }
        area += slab.state().severed_area;
        EXPECT_EQ(slab.state().pieces, 2);
    }
    if (std::getenv("PLIANT_FIGURES"))
        std::printf("area %.4f, work %.4f of toughness times area, peak %.3f\n", area / (4 * width * height),
                    work / (toughness * area), maximum / (toughness * width));
    EXPECT_NEAR(area, 4 * width * height, 0.01 * 4 * width * height);
    EXPECT_NEAR(work, toughness * area, 0.05 * toughness * area);
    EXPECT_LT(maximum, 2.5 * toughness * width);
}

TEST_P(EveryKind, NothingIsCutThatABladeDoesNotSweep)
{
    Slab slab(GetParam());
    slab.stroke(0.0405, 0.05, 0.036, 0.05); // in the air
    EXPECT_FALSE(slab.state().engaged);
    slab.cutting(false);
    slab.place(0.0405, 0.02); // into the tissue, switched off
    slab.step();
    slab.cutting(true);
    for (int s = 0; s < 10; s++) slab.step(); // switched on, at rest
    EXPECT_TRUE(slab.state().engaged);
    EXPECT_NEAR(slab.state().engaged_length, width, 0.1 * width);
    EXPECT_EQ(slab.state().severed_area, 0);
    EXPECT_EQ(slab.data->body, slab.model->body);
    EXPECT_EQ(slab.state().stroke, 2u);
}

TEST_P(EveryKind, TheSameStrokeTwiceCutsNothingMoreAndIsNotFelt)
{
    Slab slab(GetParam());
    slab.stroke(0.0401, 0.034, -0.003, 0.05);
    const double area = slab.state().severed_area;
    const uint64_t revision = slab.data->body->revision;
    const int32_t nodes = slab.data->body->fine.num_nodes;
    slab.cutting(false);
    for (int s = 0; s < 50; s++) slab.step(); // until nothing oscillates
    std::vector<double> forces;
    slab.stroke(0.0401, 0.034, -0.003, 0.05, &forces);
    EXPECT_EQ(slab.state().severed_area, area);
    EXPECT_EQ(slab.data->body->fine.num_nodes, nodes);
    // a subdivided mesh stores where strokes passed
    if (slab.data->body->voxels) EXPECT_EQ(slab.data->body->revision, revision);
    EXPECT_LT(*std::max_element(forces.begin(), forces.end()), 0.01 * toughness * width);
}

// Into the tissue, back along the same path while cutting, and forward to the same depth.
TEST_P(EveryKind, ABladeThatIsPulledBackCutsNothingMoreAndIsNotFelt)
{
    const double reach = 0.0145, end = 0.0103, way = 0.0004;
    Slab slab(GetParam());
    const double from[3] = {0, -0.02, 0}, to[3] = {0, reach - 0.012, 0};
    ASSERT_EQ(pliant_tool_set_blade(slab.data, slab.tool, from, to), PLIANT_OK);
    slab.stroke(0.0405, 0.034, end, 0.02);
    double z = end, area = 0;
    for (int s = 0; s < 50; s++) {
        slab.place(0.0405, z += way);
        slab.step();
        if (s == 3) area = slab.state().severed_area; // the last drag has ended
        if (s >= 3) EXPECT_LT(std::fabs(slab.state().force[2]), 0.01 * toughness * reach) << z;
    }
    EXPECT_NEAR(area, reach * (height - end), 0.1 * reach * (height - end));
    EXPECT_EQ(slab.state().severed_area, area);
    while (z > end) {
        slab.place(0.0405, z -= way);
        slab.step();
    }
    slab.cutting(false);
    slab.step();
    if (std::getenv("PLIANT_FIGURES"))
        std::printf("area %.4f of the swept area, %.4f of it severed later\n", area / (reach * (height - end)),
                    slab.state().severed_area / area - 1);
    EXPECT_NEAR(slab.state().severed_area, area, 0.01 * area);
    EXPECT_EQ(slab.state().pieces, 1);
}

TEST_P(EveryKind, TheSamePosesGiveTheSameBitsAndUndoAndResetHeal)
{
    Slab one(GetParam()), other(GetParam());
    for (Slab *slab : {&one, &other}) slab->stroke(0.0405, 0.034, 0.012, 0.05);
    const int32_t nodes = one.data->body->fine.num_nodes;
    ASSERT_EQ(nodes, other.data->body->fine.num_nodes);
    EXPECT_EQ(std::memcmp(one.data->positions, other.data->positions, 3 * sizeof(double) * static_cast<size_t>(nodes)),
              0);
    const pliant_cuts *cuts = one.data->body->cuts, *others = other.data->body->cuts;
    ASSERT_EQ(cuts ? cuts->num_links : 0, others ? others->num_links : 0);
    if (cuts)
        EXPECT_EQ(std::memcmp(cuts->link, others->link, sizeof(uint32_t) * static_cast<size_t>(cuts->num_links)), 0);
    const pliant_body *half = pliant_body_retain(one.data->body);
    ASSERT_FALSE(pliant_body_same(half, one.model->body));

    one.cutting(false);
    const double points[6] = {0.0605, -0.01, 0.04, 0.0605, 0.05, 0.04}, depth[3] = {0, 0, -0.03};
    pliant_cut_report report;
    ASSERT_EQ(pliant_data_cut(one.model, one.data, 2, points, depth, &report), PLIANT_OK) << pliant_last_error();
    EXPECT_NEAR(report.area, width * 0.022, 0.1 * width * 0.022);
    ASSERT_EQ(pliant_data_undo_cut(one.model, one.data), PLIANT_OK);
    EXPECT_EQ(one.data->body, half) << "the very one";
    ASSERT_EQ(pliant_data_undo_cut(one.model, one.data), PLIANT_OK);
    EXPECT_EQ(one.data->body, one.model->body);
    EXPECT_EQ(pliant_data_undo_cut(one.model, one.data), PLIANT_ERROR_ARGUMENT);
    pliant_body_release(half);

    ASSERT_EQ(pliant_data_reset(other.model, other.data), PLIANT_OK);
    EXPECT_EQ(other.data->body, other.model->body);
    EXPECT_EQ(other.state().severed_area, 0);
    EXPECT_EQ(pliant_data_undo_cut(other.model, other.data), PLIANT_ERROR_ARGUMENT);
}

TEST_P(EveryKind, ASavedStrokeContinuesWithTheSameBits)
{
    Slab slab(GetParam());
    const double end = 0.0173;
    slab.stroke(0.0405, 0.034, end, 0.02);
    pliant_state *state = nullptr;
    ASSERT_EQ(pliant_state_create(&state), PLIANT_OK);
    ASSERT_EQ(pliant_state_save(slab.model, slab.data, state), PLIANT_OK);
    std::vector<double> forces[2];
    for (auto &each : forces) {
        ASSERT_EQ(pliant_state_restore(slab.model, slab.data, state), PLIANT_OK) << pliant_last_error();
        for (double z = end; z > -0.003; z -= 0.0004) {
            slab.place(0.0405, z);
            slab.step();
            each.push_back(slab.state().force[2]);
        }
        EXPECT_EQ(slab.state().pieces, 2);
    }
    EXPECT_EQ(forces[0], forces[1]);
    pliant_state_free(state);
}

std::string name_of(const testing::TestParamInfo<Kind> &info) { return info.param.name; }
INSTANTIATE_TEST_SUITE_P(Engines, EveryKind, testing::Values(fine, averaged, dynamic, subdivided), name_of);

TEST(Knife, WithoutResistanceNothingIsFelt)
{
    Slab slab(fine, 0);
    std::vector<double> forces;
    slab.stroke(0.0405, 0.034, -0.003, 0.1, &forces);
    EXPECT_EQ(*std::max_element(forces.begin(), forces.end()), 0);
    EXPECT_NEAR(slab.state().severed_area, width * height, 0.05 * width * height);
    EXPECT_EQ(slab.state().pieces, 2);
}

TEST(Knife, ABladeThatTurnsSweepsAnArc)
{
    Slab slab(fine, 0);
    const double from[3] = {0, 0, 0}, to[3] = {0.012, 0, 0}, quarter[4] = {0, std::sqrt(0.5), 0, std::sqrt(0.5)};
    ASSERT_EQ(pliant_tool_set_blade(slab.data, slab.tool, from, to), PLIANT_OK);
    slab.place(0.04, 0.024);
    slab.cutting(true);
    slab.step();
    slab.place(0.04, 0.024, quarter); // about y: from x to -z, in one step
    slab.step();
    EXPECT_NEAR(slab.state().severed_area, M_PI / 4 * 0.012 * 0.012, 0.1 * M_PI / 4 * 0.012 * 0.012)
        << "the chord alone: 36 % less";
}

TEST(Knife, JumpingOrMissingBladesCutNothing)
{
    Slab slab(fine, 0);
    slab.place(0.0405, 0.05);
    slab.cutting(true);
    slab.step();
    slab.place(0.0405, -0.01);
    slab.step();
    EXPECT_NE(slab.logged.find("tool knife is too fast to cut: its blade moves 0.06 m in a step of 0.02 s (3 m/s)"),
              std::string::npos)
        << slab.logged;
    pliant_tool_remove_pose(slab.data, slab.tool);
    slab.step();
    slab.place(0.0405, 0.03);
    slab.step();
    EXPECT_EQ(slab.data->body, slab.model->body);
    EXPECT_EQ(slab.state().stroke, 3u);
    EXPECT_TRUE(slab.state().cutting);
}

// Also in the step after it was switched on; reported once for each time that it is on.
TEST(Knife, ABladeThatIsTooFastIsLoggedOnce)
{
    Slab slab(fine, 0);
    const auto warnings = [&] {
        int count = 0;
        for (size_t at = 0; (at = slab.logged.find("too fast to cut", at)) != std::string::npos; ++at) count++;
        return count;
    };
    slab.place(0.0405, 0.05);
    slab.cutting(true);
    slab.place(0.0405, -0.01);
    slab.step();
    EXPECT_EQ(warnings(), 1) << slab.logged;
    for (int n = 0; n < 4; n++) {
        slab.place(0.0405, n % 2 ? -0.01 : 0.05);
        slab.step();
    }
    EXPECT_EQ(warnings(), 1) << slab.logged;
    EXPECT_EQ(slab.data->body, slab.model->body) << "nothing is cut";
    slab.cutting(false);
    slab.place(0.0405, 0.05); // it starts at the position where it is switched on
    slab.cutting(true);
    slab.step();
    EXPECT_EQ(warnings(), 1) << slab.logged;
    slab.place(0.0405, -0.01);
    slab.step();
    EXPECT_EQ(warnings(), 2) << slab.logged;
}

TEST(Knife, TheNumberOfUndoableStrokesIsTheOption)
{
    Slab slab(fine, 0);
    const double points[6] = {0, -0.01, 0.04, 0, 0.05, 0.04}, depth[3] = {0, 0, -0.03};
    for (int n = 0; n < slab.scene.cut.undo + 2; n++) {
        double at[6];
        for (int d = 0; d < 6; d++) at[d] = points[d] + (d % 3 == 0 ? 0.0065 * (n + 1) : 0);
        ASSERT_EQ(pliant_data_cut(slab.model, slab.data, 2, at, depth, nullptr), PLIANT_OK) << pliant_last_error();
        slab.step();
    }
    for (int n = 0; n < slab.scene.cut.undo; n++)
        ASSERT_EQ(pliant_data_undo_cut(slab.model, slab.data), PLIANT_OK) << n;
    EXPECT_EQ(pliant_data_undo_cut(slab.model, slab.data), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(slab.data->body->revision, 3u) << "two cuts are left";
}

TEST(Knife, ImmediatelyUndoneCutsContinueIdentically)
{
    Slab slab(Kind{"direct", [](pliant_scene &scene) {
        scene.solver.preconditioner = PLIANT_DIRECT;
        scene.solver.refresh_interval = 1;
        scene.solver.refresh_delay = 2;
    }});
    const double points[6] = {0.0405, -0.01, 0.05, 0.0405, 0.05, 0.05}, depth[3] = {0, 0, -0.035},
                 rest[3] = {0.02, 0.012, 0.03};
    ASSERT_EQ(pliant_data_cut(slab.model, slab.data, 2, points, depth, nullptr), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_data_undo_cut(slab.model, slab.data), PLIANT_OK);
    ASSERT_EQ(pliant_tool_grasp(slab.model, slab.data, slab.tool, rest), PLIANT_OK);
    for (int s = 0; s < 40; s++) { // factors are recomputed continually
        slab.place(0.02 + 5e-4 * s, 0.03 + 5e-4 * s);
        slab.step();
    }
    EXPECT_GE(slab.data->statistics.factors, 3u);
}

// Next to a cut, within divided elements: the tool grasps the tissue on its own side.
TEST(Knife, AToolGraspsTheSideThatItIsOn)
{
    Slab slab(fine, 0);
    slab.stroke(0.0445, 0.034, -0.003, 0.1);
    slab.cutting(false);
    ASSERT_EQ(slab.state().pieces, 2);
    for (double side : {-1.0, 1.0}) {
        const double rest[3] = {0.0445 + 0.002 * side, 0.012, 0.029};
        ASSERT_EQ(pliant_tool_set_radius(slab.data, slab.tool, 0.0015), PLIANT_OK);
        ASSERT_EQ(pliant_tool_grasp(slab.model, slab.data, slab.tool, rest), PLIANT_OK) << pliant_last_error();
        const int32_t nodes = slab.data->body->fine.num_nodes;
        const std::vector<double> before(slab.data->positions, slab.data->positions + 3 * nodes);
        slab.place(rest[0] + 0.004 * side, rest[2]); // away from the cut
        for (int s = 0; s < 5; s++) slab.step();
        double moved[2] = {0, 0};
        for (int32_t n = 0; n < nodes; n++) {
            const double x = slab.data->body->fine.rest[3 * n];
            if (x > 0.035 && x < 0.055) continue;
            double &maximum = moved[x > 0.0445];
            maximum = std::max(maximum, std::fabs(slab.data->positions[3 * n] - before[3 * n]));
        }
        EXPECT_GT(moved[side > 0], 1e-4);
        EXPECT_LT(moved[side < 0], 1e-6);
        pliant_tool_release(slab.data, slab.tool);
        for (int s = 0; s < 20; s++) slab.step();
    }
}

// Slanted blades through a bar that bends by half its length during the cut. Ends attached to one or two nodes rotate
// by large angles in a step.
TEST(Knife, WhatHangsByLittleStaysWhereItHangs)
{
    std::mt19937 random(11);
    std::uniform_real_distribution<double> unit(-1, 1);
    double draws[6];
    for (int run = 0; run < 7; run++) {
        for (double &draw : draws) draw = unit(random);
        if (run != 3 && run != 6) continue;
        const int voxels[3] = {40, 20, 20};
        const double sides[3] = {0.2, 0.1, 0.1};
        Body bar(voxels, sides, {{4000, 0.4, 1000, false}});
        bar.fix_plane(1e-6, 0, 0, 1, 0, 0);
        bar.cells(16, 8, 8, 1);
        bar.scene.cut.kind = PLIANT_CUT_SEVER;
        bar.scene.solver.iterations = 6;
        bar.scene.solver.tolerance = 1e-3;
        bar.scene.model.gravity[2] = -0.5;
        bar.scene.solver.threads = 1;
        ASSERT_EQ(bar.build(), PLIANT_OK) << pliant_last_error();
        const double from[3] = {0.02 * draws[0], -0.07, 0.02 * draws[1]},
                     to[3] = {0.02 * draws[2], 0.07, 0.02 * draws[3]};
        int tool = -1, step = 0;
        ASSERT_EQ(pliant_tool_add(bar.model, bar.data, "knife", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_blade(bar.data, tool, from, to), PLIANT_OK);
        double at[3] = {0.13 + 0.03 * draws[4], 0.05, 0.15}, farthest = 0;
        for (; at[2] > -0.045; step++, at[2] -= 0.003, at[0] += 0.0009 * draws[5]) {
            const double place[3] = {at[0] + 0.002 * (run % 3) * std::sin(0.7 * step), at[1], at[2]};
            ASSERT_EQ(pliant_tool_set_pose(bar.data, tool, place, nullptr), PLIANT_OK);
            ASSERT_EQ(pliant_tool_set_cutting(bar.data, tool, true), PLIANT_OK);
            ASSERT_GE(pliant_step(bar.model, bar.data), 0) << pliant_last_error();
            const pliant_mesh &mesh = bar.data->body->fine;
            for (int32_t i = 0; i < 3 * mesh.num_nodes; i++)
                farthest = std::fmax(farthest, std::fabs(bar.data->positions[i] - mesh.rest[i]));
        }
        EXPECT_LT(farthest, 0.35) << run;
        EXPECT_EQ(mismatches(*bar.data->body), 0) << run;
        if (run == 6)
            EXPECT_GE(num_pieces(*bar.data->body), 2) << "nothing slips through on the surface, beside the tissue";
    }
}

TEST(Knife, EnergyNeverRisesByACut)
{
    Slab slab;
    const double gravity[3] = {6, 0, 3};
    ASSERT_EQ(pliant_data_set_gravity(slab.data, gravity), PLIANT_OK);
    for (int s = 0; s < 40; s++) slab.step();
    const double points[6] = {0.0405, -0.01, 0.05, 0.0405, 0.05, 0.05}, depth[3] = {0, 0, -0.035};
    const double before = slab.strain_energy(), whole = before + slab.height_energy();
    ASSERT_GT(before, 0);
    ASSERT_EQ(pliant_data_cut(slab.model, slab.data, 2, points, depth, nullptr), PLIANT_OK) << pliant_last_error();
    ASSERT_NE(slab.data->body, slab.model->body);
    EXPECT_NEAR(slab.strain_energy(), before, 1e-4 * before) << "the parts of an element carry what it did";
    for (int s = 0; s < 40; s++) slab.step();
    EXPECT_LT(slab.strain_energy() + slab.height_energy(), whole) << "and come to rest at less";
}

TEST(Knife, AnUncutBodyCostsNothingAndChangesNothing)
{
    Slab none(Kind{"none", [](pliant_scene &scene) { scene.cut.kind = PLIANT_CUT_NONE; }}), may;
    EXPECT_EQ(pliant_tool_set_cutting(none.data, none.tool, true), PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::string(pliant_last_error()).find("cut/kind"), std::string::npos) << pliant_last_error();
    EXPECT_EQ(pliant_data_cut(none.model, none.data, 0, nullptr, nullptr, nullptr), PLIANT_ERROR_SCENE);
    const double line[6] = {0, 0, 0, 0.1, 0, 0}, no_depth[3] = {0, 0, 0}, along[3] = {0.2, 0, 0}, point[6] = {0};
    for (const auto &each :
         {std::make_pair(line, no_depth), std::make_pair(line, along), std::make_pair(point, along)}) {
        EXPECT_EQ(pliant_data_cut(may.model, may.data, 2, each.first, each.second, nullptr), PLIANT_ERROR_ARGUMENT);
        EXPECT_NE(std::string(pliant_last_error()).find("no area"), std::string::npos) << pliant_last_error();
    }
    EXPECT_EQ(none.model->body->voxels, nullptr);
    EXPECT_EQ(none.data->statistics.bytes, may.data->statistics.bytes)
        << "a simulation keeps nothing until something is cut";
    for (Slab *slab : {&none, &may}) {
        const double rest[3] = {0.04, 0.012, 0.03};
        ASSERT_EQ(pliant_tool_grasp(slab->model, slab->data, slab->tool, rest), PLIANT_OK);
        for (int s = 0; s < 5; s++) {
            slab->place(0.04, 0.03 + 1e-3 * s);
            slab->step();
        }
    }
    EXPECT_EQ(std::memcmp(none.data->positions, may.data->positions,
                          3 * sizeof(double) * static_cast<size_t>(none.data->body->fine.num_nodes)),
              0);
    EXPECT_EQ(std::memcmp(none.state().force, may.state().force, sizeof none.state().force), 0);
}

TEST(Knife, ABladeOfAToolThatHasNoneIsRefused)
{
    Slab slab;
    int other;
    ASSERT_EQ(pliant_tool_add(slab.model, slab.data, "forceps", &other), PLIANT_OK);
    EXPECT_EQ(pliant_tool_set_cutting(slab.data, other, true), PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::string(pliant_last_error()).find("forceps has no blade"), std::string::npos) << pliant_last_error();
    const double from[3] = {0, 0, 0}, far[3] = {0, 0, 3}, none[3] = {0, NAN, 0};
    EXPECT_EQ(pliant_tool_set_blade(slab.data, other, from, far), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_tool_set_blade(slab.data, other, from, none), PLIANT_ERROR_ARGUMENT);
    double a[3], b[3];
    EXPECT_EQ(pliant_blade_find("hook", a, b), PLIANT_OK);
    EXPECT_EQ(pliant_blade_find("axe", a, b), PLIANT_ERROR_ARGUMENT);
}

// Named blades as in contact.h and data.h: along the instrument or across it, with the far end at the tip. One stroke
// severs half of a bar twice as wide as the edge; an adjacent one separates it.
TEST(Knife, EveryNamedBladeHasItsEdge)
{
    const struct {
        const char *name;
        int along;
        double length, way;
    } blades[] = {{"scalpel", 2, 0.02, -1}, {"scissors", 2, 0.01, -1}, {"hook", 1, 0.004, 1}};
    double none[3];
    ASSERT_EQ(pliant_blade_find("", none, none), PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::string(pliant_last_error()).find("scalpel, scissors and hook are known"), std::string::npos)
        << "another blade: " << pliant_last_error();
    for (const auto &blade : blades) {
        double from[3], to[3];
        ASSERT_EQ(pliant_blade_find(blade.name, from, to), PLIANT_OK);
        for (int d = 0; d < 3; d++) {
            EXPECT_EQ(from[d], d == blade.along ? blade.way * blade.length : 0) << blade.name;
            EXPECT_EQ(to[d], 0) << blade.name;
        }
        const int across = 3 - blade.along;
        const double voxel = blade.length / 10, section = 2 * blade.length * 4 * voxel;
        int voxels[3] = {16, 4, 4};
        voxels[blade.along] = 20;
        const double extent[3] = {voxel * voxels[0], voxel * voxels[1], voxel * voxels[2]};
        Body block(voxels, extent, {{5500, 0.45, 1060, false}});
        block.cells(8, voxels[1] / 2, voxels[2] / 2, 1);
        block.scene.cut.kind = PLIANT_CUT_SEVER;
        block.scene.cut.resistance = 0;
        block.fix_plane(1e-6, 0, 0, 1, 0, 0);
        block.fix_plane(extent[0] - 1e-6, 0, 0, -1, 0, 0);
        ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
        int tool;
        ASSERT_EQ(pliant_tool_add(block.model, block.data, blade.name, &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_blade(block.data, tool, from, to), PLIANT_OK);
        for (int stroke = 0; stroke < 2; stroke++) {
            double tip[3] = {0.51 * extent[0], 0, 0};
            tip[blade.along] = (0.5 + stroke) * blade.length - 0.5 * from[blade.along];
            for (int s = 0; s < 7; s++) {
                tip[across] = extent[across] + (1.2 - s) * voxel;
                ASSERT_EQ(pliant_tool_set_pose(block.data, tool, tip, nullptr), PLIANT_OK);
                ASSERT_EQ(pliant_tool_set_cutting(block.data, tool, true), PLIANT_OK) << pliant_last_error();
                ASSERT_GE(pliant_step(block.model, block.data), 0) << pliant_last_error();
            }
            ASSERT_EQ(pliant_tool_set_cutting(block.data, tool, false), PLIANT_OK);
            pliant_tool_state tool_state{};
            ASSERT_EQ(pliant_tool_get(block.data, tool, &tool_state), PLIANT_OK);
            EXPECT_NEAR(tool_state.severed_area, 0.5 * (1 + stroke) * section, 0.01 * section) << blade.name;
            EXPECT_EQ(tool_state.pieces, 1 + stroke) << blade.name;
        }
    }
}

// Two threads give bitwise identical cuts to one: the same fragments, nodes and positions.
TEST(Knife, OneThreadOrTwoCutTheSame)
{
    const Kind hexahedra{"hexahedra", [](pliant_scene &scene) { scene.element.kind = PLIANT_HEXAHEDRA; }};
    for (const Kind *kind : {&fine, &hexahedra, &averaged, &dynamic, &subdivided}) {
        std::unique_ptr<Slab> slabs[2];
        for (int threads = 1; threads <= 2; threads++)
            slabs[threads - 1].reset(new Slab({kind->name, [=](pliant_scene &scene) {
                                                   kind->set(scene);
                                                   scene.solver.threads = threads;
                                                   scene.solver.preconditioner = PLIANT_DIRECT;
                                                   scene.model.gravity[0] = 3;
                                               }}));
        for (auto &slab : slabs) {
            slab->stroke(0.0405, 0.034, 0.012, 0.1);
            slab->cutting(false);
            slab->step();
            slab->stroke(0.0243, 0.034, 0.004, 0.15);
        }
        const pliant_body &one = *slabs[0]->data->body, &two = *slabs[1]->data->body;
        EXPECT_GT(one.fine.num_nodes, slabs[0]->model->body->fine.num_nodes + 10) << kind->name;
        const size_t tets = static_cast<size_t>(one.fine.num_tets), nodes = static_cast<size_t>(one.fine.num_nodes);
        ASSERT_TRUE(one.fine.num_nodes == two.fine.num_nodes && one.fine.num_tets == two.fine.num_tets) << kind->name;
        EXPECT_TRUE(std::equal(one.fine.tets, one.fine.tets + 4 * tets, two.fine.tets)) << kind->name;
        EXPECT_TRUE(std::equal(one.node_parent, one.node_parent + nodes, two.node_parent)) << kind->name;
        EXPECT_EQ(std::memcmp(one.fine_material, two.fine_material, tets * sizeof *one.fine_material), 0) << kind->name;
        EXPECT_EQ(std::memcmp(one.fine.rest, two.fine.rest, 3 * nodes * sizeof(double)), 0) << kind->name;
        ASSERT_TRUE(!one.cuts || one.cuts->num_links == two.cuts->num_links) << kind->name;
        if (one.cuts)
            EXPECT_TRUE(std::equal(one.cuts->link, one.cuts->link + one.cuts->num_links, two.cuts->link)) << kind->name;
        EXPECT_EQ(std::memcmp(slabs[0]->data->positions, slabs[1]->data->positions, 3 * nodes * sizeof(double)), 0)
            << kind->name;
        EXPECT_EQ(slabs[0]->state().severed_area, slabs[1]->state().severed_area) << kind->name;
    }
}

// Without memory at any point, the tissue stays undamaged; this is logged once, and the next attempt succeeds.
TEST(Knife, OutOfMemoryLeavesTheTissueUncut)
{
    Slab slab(fine, 0);
    slab.place(0.0405, 0.034);
    slab.cutting(true);
    slab.step();
    slab.place(0.0405, 0.0175);
    const size_t before = pliant_memory_in_use();
    int failed = 0;
    for (int64_t n = 0; slab.data->body == slab.model->body; n += n < 60 ? 1 : 1 + n / 8) {
        pliant_memory_fail_after(n);
        EXPECT_EQ(pliant_cut_stage(slab.model, slab.data), PLIANT_OK);
        pliant_memory_fail_after(-1);
        if (slab.data->body != slab.model->body) break;
        ASSERT_EQ(pliant_memory_in_use(), before) << "allocation " << n;
        ASSERT_EQ(slab.state().severed_area, 0);
        slab.data->tools[slab.tool].blade.tip[2] = 0.034; // the step that was not done
        failed++;
    }
    EXPECT_GT(failed, 20);
    EXPECT_GT(slab.state().severed_area, 0.4 * width * height);
    const std::string once = "tool knife does not cut: ";
    ASSERT_NE(slab.logged.find(once), std::string::npos) << slab.logged;
    EXPECT_EQ(slab.logged.find(once, slab.logged.find(once) + 1), std::string::npos) << slab.logged;
    slab.step();
}

} // namespace
