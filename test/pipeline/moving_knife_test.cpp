// Blades through tissue that moves at 0.2 m/s during the stroke. The tissue on both sides of the cut must be completely
// separated.
#include "cuts.h"

#include <cstdlib>
#include <string>

namespace {

const int size[3] = {40, 12, 16};
const double box[3] = {0.08, 0.024, 0.032}, middle[3] = {0.04, 0.012, 0.016}, max_speed = 0.2;

int number_from(const char *name, int otherwise)
{
    const char *const asked = std::getenv(name);
    return asked ? std::atoi(asked) : otherwise;
}

// A plane through the bar, and the motion of a blade along it.
struct KnifePath {
    double at, lean, tilt;  // intersection with the bar's axis [m]; slope of the edge and of the motion, along the axis
    int across;             // axis of the motion
    double sign, speed;     // [m/s]
    explicit KnifePath(std::mt19937 &random)
    {
        std::uniform_real_distribution<double> unit(-1, 1);
        at = 0.03 + 0.01 * unit(random);
        lean = 0.5 * unit(random);
        tilt = 0.3 * unit(random);
        across = unit(random) < 0 ? 1 : 2;
        sign = unit(random) < 0 ? -1 : 1;
        speed = 0.125 + 0.075 * unit(random);
    }
};

// A bar with its left end fixed, moved by its weight, or by forceps at its other end.
struct Bar : Body {
    int knife = -1, forceps = -1;
    std::vector<double> last;
    double fastest = 0; // maximum node speed [m/s]
    double phase;

    Bar(int run, double resistance) : Body(size, box, {{5500, 0.45, 1060, false}}), phase(run)
    {
        table.materials[0].toughness = 200;
        cells(10, 3, 4, 1);
        if (run & 1) scene.element.kind = PLIANT_HEXAHEDRA;
        if (run & 2) {
            scene.solver.kind = PLIANT_TLED;
            scene.tled.damping = 1;
        }
        scene.solver.iterations = 10;
        scene.solver.tolerance = 1e-3;
        scene.solver.threads = 1;
        scene.cut.kind = PLIANT_CUT_SEVER;
        scene.cut.resistance = resistance;
        fix_plane(1e-6, 0, 0, 1, 0, 0);
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_tool_add(model, data, "knife", &knife), PLIANT_OK);
        if (run & 2) return;
        const double end[3] = {0.075, 0.012, 0.016};
        EXPECT_EQ(pliant_tool_add(model, data, "forceps", &forceps), PLIANT_OK);
        EXPECT_EQ(pliant_tool_set_radius(data, forceps, 0.008), PLIANT_OK);
        EXPECT_EQ(pliant_tool_grasp(model, data, forceps, end), PLIANT_OK) << pliant_last_error();
    }
    void shake(double time)
    {
        if (forceps < 0) {
            const double gravity[3] = {0, 0.8 * std::sin(45 * time + phase), 0.8 * std::cos(40 * time + phase)};
            ASSERT_EQ(pliant_data_set_gravity(data, gravity), PLIANT_OK);
            return;
        }
        const double reach = 0.012, turn = max_speed / reach; // in a circle, and back and forth
        const double tip[3] = {0.075 + 0.3 * reach * std::sin(0.7 * turn * time),
                               0.012 + reach * (std::cos(turn * time) - 1), 0.016 + reach * std::sin(turn * time)};
        ASSERT_EQ(pliant_tool_set_pose(data, forceps, tip, nullptr), PLIANT_OK);
    }
    void step()
    {
        const size_t load = 3 * static_cast<size_t>(model->body->fine.num_nodes);
        last.assign(data->positions, data->positions + load);
        ASSERT_GE(pliant_step(model, data), 0) << pliant_last_error();
        for (size_t n = 0; n < load; n++)
            fastest = std::max(fastest, std::fabs(data->positions[n] - last[n]) / scene.solver.step);
    }
    // Move the blade along a fraction of its path.
    void stroke(const KnifePath &path, double fraction = 1)
    {
        const double reach = 0.06, step_way = path.speed * scene.solver.step;
        const int along = 3 - path.across, steps = static_cast<int>(std::ceil(fraction * 2 * reach / step_way));
        double from[3] = {-path.lean * reach, 0, 0}, to[3] = {path.lean * reach, 0, 0};
        from[along] = -reach;
        to[along] = reach;
        ASSERT_EQ(pliant_tool_set_blade(data, knife, from, to), PLIANT_OK);
        for (int s = 0; s <= steps; s++) {
            const double gone = -reach + s * step_way;
            double tip[3] = {path.at + path.tilt * gone, middle[1], middle[2]};
            tip[path.across] += path.sign * gone;
            ASSERT_EQ(pliant_tool_set_pose(data, knife, tip, nullptr), PLIANT_OK);
            ASSERT_EQ(pliant_tool_set_cutting(data, knife, true), PLIANT_OK) << pliant_last_error();
            shake(s * scene.solver.step);
            step();
        }
    }
    // Return whether both ends are connected.
    bool is_whole() const
    {
        const pliant_mesh &mesh = data->body->fine;
        const std::vector<int32_t> piece = mesh_pieces(*data->body);
        std::set<int32_t> left, right;
        for (int32_t t = 0; t < mesh.num_tets; t++) {
            double x = 0;
            for (int v = 0; v < 4; v++) x += mesh.rest[3 * mesh.tets[4 * t + v]] / 4;
            if (x < 0.004) left.insert(piece[t]);
            if (x > box[0] - 0.004) right.insert(piece[t]);
        }
        for (int32_t p : left)
            if (right.count(p)) return true;
        return false;
    }
};

// With resistance, the blade drags the tissue until it slips.
struct EveryResistance : testing::TestWithParam<int> {};

TEST_P(EveryResistance, BothSidesOfTheCutAreSeparate)
{
    const int first = number_from("PLIANT_FIRST_RUN", 0), runs = number_from("PLIANT_RUNS", 32);
    int whole = 0, more = 0;
    double slowest = INFINITY, fastest = 0;
    for (int run = first; run < first + runs; run++) {
        std::mt19937 random(static_cast<unsigned>(run));
        const KnifePath path(random);
        Bar bar(run, GetParam());
        bar.stroke(path);
        EXPECT_FALSE(bar.is_whole()) << "run " << run;
        EXPECT_EQ(mismatches(*bar.data->body), 0) << "run " << run;
        whole += bar.is_whole();
        more += num_pieces(*bar.data->body) > 2;
        slowest = std::min(slowest, bar.fastest);
        fastest = std::max(fastest, bar.fastest);
    }
    if (std::getenv("PLIANT_FIGURES"))
        std::printf("%d of %d in one piece, %d in more than two; nodes at %.2f to %.2f m/s\n", whole, runs, more,
                    slowest, fastest);
}

INSTANTIATE_TEST_SUITE_P(MovingKnife, EveryResistance, testing::Values(0, 1));

// ---- sweeps of a stroke through tissue at rest

std::unique_ptr<CutState> bar_at_rest()
{
    auto body = std::make_unique<Body>(size, box, std::vector<Material>{{5500, 0.45, 1060, false}});
    body->cells(10, 3, 4, 1);
    body->scene.cut.kind = PLIANT_CUT_SEVER;
    body->fix_plane(1e-6, 0, 0, 1, 0, 0);
    EXPECT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
    return std::make_unique<CutState>(std::move(body));
}

int num_cuts(const CutState &bar) { return bar.now->cuts ? bar.now->cuts->num_cuts : 0; }

// Sweep along y, from one height to another at a position along x.
void sweep(CutState &bar, const double x[2], const double z[2], double lean, uint32_t stroke, uint32_t blade = 0)
{
    const double from[6] = {x[0] - lean, -0.01, z[0], x[0] + lean, 0.034, z[0]},
                 to[6] = {x[1] - lean, -0.01, z[1], x[1] + lean, 0.034, z[1]};
    const pliant_cut_sweep one{2, from, to, nullptr, blade, stroke};
    pliant_body *next = nullptr;
    ASSERT_EQ(pliant_body_cut(bar.now, bar.now->revision + 1, bar.positions.data(), &one, &next, nullptr), PLIANT_OK)
        << pliant_last_error();
    if (next) bar.take(next);
}

std::vector<uint32_t> links(const CutState &bar)
{
    return bar.now->cuts ? std::vector<uint32_t>(bar.now->cuts->link, bar.now->cuts->link + bar.now->cuts->num_links)
                         : std::vector<uint32_t>();
}

TEST(MovingKnife, CrossingSweepsSeverNoMoreThanEachAlone)
{
    for (int run = 0; run < 20; run++) {
        const auto stroke = bar_at_rest(), alone = bar_at_rest();
        for (const auto &bar : {stroke.get(), alone.get()}) {
            std::mt19937 random(static_cast<unsigned>(run));
            std::uniform_real_distribution<double> unit(-1, 1);
            const double lean = 0.006 * unit(random);
            double x = 0.04 + 0.01 * unit(random), z = 0.036;
            for (double &p : bar->positions) p += 2e-4 * unit(random);
            while (z > 0.012) { // and end within the bar
                const double ways[2] = {x, x + 0.003 * unit(random)},
                             heights[2] = {z, z - 0.002 - 0.0015 * unit(random)};
                sweep(*bar, ways, heights, lean, bar == stroke.get());
                x = ways[1];
                z = heights[1];
            }
        }
        EXPECT_GT(links(*stroke).size(), 80u) << run;
        EXPECT_EQ(links(*stroke), links(*alone)) << run;
    }
}

TEST(MovingKnife, AStrokeThatEndsWhereAnotherBeginsIsNotJoinedToIt)
{
    const double upper[2] = {0.0411, 0.0411}, lower[2] = {0.0391, 0.0391}, down[2] = {0.036, 0.0159},
                 on[2] = {0.0159, -0.004};
    const auto next = bar_at_rest(), other = bar_at_rest(), alone = bar_at_rest(), one = bar_at_rest();
    for (const auto &bar : {next.get(), other.get(), alone.get(), one.get()}) {
        const uint32_t strokes = bar != alone.get();
        sweep(*bar, upper, down, 0, strokes);
        ASSERT_EQ(num_cuts(*bar), 1);
        sweep(*bar, lower, on, 0, bar == next.get() ? 2 : strokes, bar == other.get() ? 1 : 0);
    }
    for (const auto &bar : {next.get(), other.get()}) {
        EXPECT_EQ(links(*bar), links(*alone)) << "a voxel lies between them";
        EXPECT_EQ(num_pieces(*bar->now), 1);
    }
    EXPECT_EQ(links(*one).size(), links(*alone).size() + size[1]) << "what moves by a voxel between two sweeps";
    EXPECT_EQ(num_pieces(*one->now), 2);
}

// A blade's stroke continues after another blade has cut next to it.
TEST(MovingKnife, AStrokeIsJoinedToItselfPastAnotherBladesCut)
{
    const double upper[2] = {0.0411, 0.0411}, lower[2] = {0.0391, 0.0391}, far[2] = {0.0611, 0.0611},
                 down[2] = {0.036, 0.0159}, on[2] = {0.0159, -0.004};
    const auto one = bar_at_rest(), both = bar_at_rest();
    for (const auto &bar : {one.get(), both.get()}) {
        sweep(*bar, upper, down, 0, 1);
        if (bar == both.get()) sweep(*bar, far, down, 0, 1, 1);
        sweep(*bar, lower, on, 0, 1);
        EXPECT_EQ(num_pieces(*bar->now), 2);
    }
    EXPECT_GT(links(*both).size(), links(*one).size());
}

} // namespace
