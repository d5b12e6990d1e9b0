// Pressures of nearly incompressible tissue in explicit dynamics (fem/dynamics/tled_pressure.h).
#include "../cuts.h"
#include "../thrown.h"
#include "backend/explicit_statistics.h"
#include "base/clock.h"
#include "base/memory.h"
#include "fem/dynamics/tled_pressure.h"
#include "mesh/mesh.h"
#include "sim/api/data.h"

#include <string>

namespace
{

struct Kind {
    pliant_element_kind element;
    pliant_law law;
};
const Kind kinds[] = {{PLIANT_HEXAHEDRA, PLIANT_LAW_NEO_HOOKEAN},
                      {PLIANT_HEXAHEDRA, PLIANT_LAW_COMPRESSIBLE},
                      {PLIANT_LINEAR, PLIANT_LAW_NEO_HOOKEAN},
                      {PLIANT_LINEAR, PLIANT_LAW_COMPRESSIBLE}};

std::string name_of(const Kind &kind)
{
    return std::string(kind.element == PLIANT_LINEAR ? "tetrahedra" : "hexahedra") +
           (kind.law == PLIANT_LAW_COMPRESSIBLE ? ", compressible" : ", neo_hookean");
}

// A block of 40 mm and 5 kPa. Its lower face is fixed. Gravity acts along x.
struct Block : Body {
    static constexpr double edge = 0.04;
    Block(double poisson, const Kind &kind, int across = 4)
        : Body(std::vector<int>{8, 8, 8}.data(), std::vector<double>{edge, edge, edge}.data(),
               {{5000, poisson, 1000, false}})
    {
        cells(across, across, across, 1);
        fix_plane(0, 0, 1e-4, 0, 0, 1);
        scene.element.kind = kind.element;
        scene.tled.law = kind.law;
        scene.solver.kind = PLIANT_TLED;
        scene.solver.threads = 1;
        scene.tled.damping = 20;
        scene.model.gravity[0] = 9.81;
        scene.model.gravity[1] = scene.model.gravity[2] = 0;
    }
    // Solve for the equilibrium without pressures, with dynamic relaxation.
    void relax()
    {
        scene.tled.quasi_static = true;
        scene.tled.relaxation_steps = 40000;
        scene.solver.tolerance = 2e-5;
    }
    void run(double time)
    {
        for (double t = 0; t < time - 1e-9; t += scene.solver.step)
            ASSERT_GE(pliant_step(model, data), 0) << pliant_last_error();
    }
    void move(int tool, double x, double y, double z)
    {
        const double tip[3] = {x, y, z};
        ASSERT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
    }
    // Return the mean displacement of the upper face.
    double lean() const
    {
        double sum = 0;
        int count = 0;
        const pliant_mesh &fine = model->body->fine;
        for (int32_t n = 0; n < fine.num_nodes; n++)
            if (fine.rest[3 * n + 2] > edge - 1e-9) sum += data->positions[3 * n] - fine.rest[3 * n], count++;
        return sum / count;
    }
    pliant_dynamics dynamics() const
    {
        pliant_dynamics out{};
        EXPECT_EQ(pliant_data_get_dynamics(model, data, &out), PLIANT_OK) << pliant_last_error();
        return out;
    }
    std::vector<double> positions() const
    {
        return {data->positions, data->positions + 3 * data->body->fine.num_nodes};
    }
    // Return the change of the whole volume, divided by the volume at rest.
    double swelling() const
    {
        double rest = 0, now = 0, gradients[12];
        const pliant_mesh &fine = data->body->fine;
        for (int32_t t = 0; t < fine.num_tets; t++) {
            double edges[9];
            for (int m = 0; m < 9; m++)
                edges[m] = data->positions[3 * fine.tets[4 * t + 1 + m / 3] + m % 3] -
                           data->positions[3 * fine.tets[4 * t] + m % 3];
            now += (edges[0] * (edges[4] * edges[8] - edges[5] * edges[7]) -
                    edges[1] * (edges[3] * edges[8] - edges[5] * edges[6]) +
                    edges[2] * (edges[3] * edges[7] - edges[4] * edges[6])) /
                   6;
            rest += pliant_mesh_gradients(&fine, t, gradients);
        }
        return std::fabs(now) / rest - 1;
    }
};
constexpr double Block::edge;

// Dynamic relaxation finds the same equilibrium of hexahedra without pressures. The quasi-static solver finds the same
// equilibrium of tetrahedra, which share a change of volume per cube. At these strains, both laws differ by 0.1 %.
TEST(TledPressure, SettlesAsTheOtherSolversInAsManySubSteps)
{
    for (const Kind &kind : kinds) {
        double lean[2], seconds[2];
        int substeps[2];
        const double poisson[2] = {0.45, 0.4999};
        for (int n = 0; n < 2; n++) {
            Block block(poisson[n], kind);
            ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
            const double start = pliant_seconds();
            block.run(2);
            seconds[n] = pliant_seconds() - start;
            lean[n] = block.lean();
            substeps[n] = block.dynamics().substeps;
        }
        Block exact(0.4999, {kind.element, PLIANT_LAW_NEO_HOOKEAN});
        if (kind.element == PLIANT_LINEAR) {
            exact.scene.solver.kind = PLIANT_COROTATIONAL;
            exact.scene.element.law = PLIANT_ELASTICITY_NEO_HOOKEAN;
        } else
            exact.relax();
        ASSERT_EQ(exact.build(), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(exact.settle(), PLIANT_OK) << exact.data->statistics.residual;
        std::printf("%s: upper face moves by %.3f and %.3f mm at nu 0.45 and 0.4999, exactly %.3f mm; %d and %d "
                    "sub-steps; time of a frame times %.1f\n",
                    name_of(kind).c_str(), 1e3 * lean[0], 1e3 * lean[1], 1e3 * exact.lean(), substeps[0], substeps[1],
                    seconds[1] / seconds[0]);
        EXPECT_NEAR(lean[1], exact.lean(), 0.002 * exact.lean());
        EXPECT_LE(substeps[1], 1.1 * substeps[0]);
    }
}

// Without damping, the implicit pressures take little energy from seven periods, and never add any.
TEST(TledPressure, AFreeVibrationKeepsItsEnergy)
{
    for (const Kind &kind : kinds) {
        Block block(0.4999, kind);
        block.scene.model.gravity[0] = 3;
        block.scene.tled.damping = 0;
        ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
        block.run(0.2);
        const double none[3] = {0, 0, 0};
        ASSERT_EQ(pliant_data_set_gravity(block.data, none), PLIANT_OK);
        block.run(0.02);
        const double first = block.dynamics().kept_energy;
        double before = first;
        for (int i = 0; i < 30; i++) {
            block.run(0.1);
            const double now = block.dynamics().kept_energy;
            EXPECT_LT(now, before * (1 + 2e-5));
            before = now;
        }
        std::printf("%s: energy %+.4f %% after 3 s\n", name_of(kind).c_str(), 100 * (before / first - 1));
        EXPECT_NEAR(before, first, 1e-3 * first);
    }
}

// A ball presses the block without friction, and another tool holds it. The damping lets both come to rest. The
// pressures are then lambda' times the changes of volume. Forces are nearly the forces at nu 0.45.
TEST(TledPressure, ToolsAndContactAtRest)
{
    for (const Kind &kind : kinds) {
        double pressed[2], held[2];
        for (int n = 0; n < 2; n++) {
            Block block(n == 0 ? 0.45 : 0.4999, kind);
            block.scene.tled.stiffness_damping = 0.002;
            block.scene.contact.friction = 0;
            block.scene.model.gravity[0] = 0;
            ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
            const int ball = block.add_ball(0.02), frames = 25;
            int hold = -1;
            ASSERT_EQ(pliant_tool_add(block.model, block.data, "hold", &hold), PLIANT_OK);
            const double at[3] = {0.035, 0.02, 0.02};
            ASSERT_EQ(pliant_tool_grasp(block.model, block.data, hold, at), PLIANT_OK) << pliant_last_error();
            for (int i = 0; i < 80; i++) {
                const double part = std::fmin(1, i / 40.0);
                block.move(ball, 0.012, 0.02, 0.06 - 0.005 * part);
                block.move(hold, 0.035 + 0.005 * part, 0.02, 0.02);
                ASSERT_GE(pliant_step(block.model, block.data), 0) << pliant_last_error();
            }
            pressed[n] = held[n] = 0;
            double least = INFINITY, most = 0;
            for (int i = 0; i < frames; i++) {
                double now = 0;
                ASSERT_GE(pliant_step(block.model, block.data), 0) << pliant_last_error();
                for (int32_t p = 0; p < block.data->contacts.count; p++) now -= block.data->contacts.point[p].force[2];
                least = std::fmin(least, now);
                most = std::fmax(most, now);
                pressed[n] += now / frames;
                held[n] += block.data->tools[hold].force[0] / frames;
            }
            EXPECT_LT(most - least, 0.03 * pressed[n]);
            std::printf("%s, nu %.4f: the ball presses with %.3f to %.3f N, the other tool pulls with %.3f N\n",
                        name_of(kind).c_str(), n == 0 ? 0.45 : 0.4999, least, most, held[n]);
            if (n == 0 || kind.element == PLIANT_HEXAHEDRA) continue; /* these still tremble */
            const pliant_tled_pressure *pressure = block.data->tled->pressure_of_groups;
            double missing = 0, whole = 0;
            pliant_tled_pressure_find(block.data->tled);
            for (int32_t g = 0; g < pressure->groups->count; g++) {
                const double change = pressure->groups->compliance[g] * pressure->state[g];
                missing += std::pow(pressure->change[g] - change, 2);
                whole += change * change;
            }
            EXPECT_LT(std::sqrt(missing), 1e-3 * std::sqrt(whole));
        }
        EXPECT_NEAR(pressed[1], pressed[0], 0.15 * pressed[0]);
        EXPECT_NEAR(held[1], held[0], 0.1 * held[0]);
    }
}

// Walls, tools and other tissue stop thrown cubes. Large pressures of an impact add no energy.
TEST(TledPressure, ThrownCubesGainNoEnergy)
{
    for (Throw with : all_throws(3, {3e3})) {
        with.poisson = 0.4999;
        EXPECT_LT(energy_ratio(with), 1.001) << name_of(with) << ", seed " << with.seed;
    }
}

// A cut through the middle of a leaning block: it adds no energy, and the cut block settles with its volume.
TEST(TledPressure, ACutAddsNoEnergy)
{
    for (const Kind &kind : {kinds[0], kinds[2]}) {
        Block block(0.4999, kind);
        block.scene.cut.kind = PLIANT_CUT_SEVER;
        block.scene.tled.damping = 5;
        ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
        block.run(0.3);
        const double point[3] = {0.017, 0.02, 0.03}, normal[3] = {1, 0.1, 0};
        std::vector<double> from, to;
        CutState::plane(point, normal, 0.025, from, to);
        const pliant_cut_sweep sweep{2, from.data(), to.data(), nullptr};
        pliant_body *next = nullptr;
        ASSERT_EQ(pliant_body_cut(block.data->body, block.data->last_revision + 1, block.data->positions, &sweep, &next,
                                  nullptr),
                  PLIANT_OK);
        ASSERT_NE(next, nullptr);
        const pliant_dynamics before = block.dynamics();
        ASSERT_EQ(pliant_data_set_body(block.model, block.data, next), PLIANT_OK) << pliant_last_error();
        pliant_body_release(next);
        const pliant_dynamics after = block.dynamics();
        EXPECT_LT(after.kept_energy, before.kept_energy * (1 + 1e-4));
        const double none[3] = {0, 0, 0};
        ASSERT_EQ(pliant_data_set_gravity(block.data, none), PLIANT_OK);
        double energy = after.kept_energy;
        for (int i = 0; i < 20; i++) {
            block.run(0.04);
            const double now = block.dynamics().kept_energy;
            EXPECT_LT(now, energy);
            energy = now;
            if (kind.element == PLIANT_LINEAR) { EXPECT_NEAR(block.swelling(), 0, 1e-4); }
        }
        EXPECT_LT(energy, 0.05 * before.kept_energy);
    }
}

// Each allocation fails once.
TEST(TledPressure, SurvivesFailedAllocations)
{
    Block block(0.4999, kinds[2], 2);
    pliant_status status = PLIANT_ERROR_MEMORY;
    int64_t calls = 0;
    for (; status == PLIANT_ERROR_MEMORY && calls < 5000; calls++) {
        pliant_memory_fail_after(calls);
        status = block.build();
        pliant_memory_fail_after(-1);
    }
    EXPECT_EQ(status, PLIANT_OK) << pliant_last_error();
    EXPECT_GT(calls, 50);
    block.run(0.02);
}

// A saved state contains the pressures, and threads change nothing.
TEST(TledPressure, ReplaysAreBitwiseIdentical)
{
    for (const Kind &kind : {kinds[0], kinds[2]}) {
        std::vector<double> one;
        for (int threads = 1; threads < 3; threads++) {
            Block block(0.4999, kind);
            block.scene.solver.threads = threads;
            ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
            block.run(0.2);
            pliant_state *state = nullptr;
            ASSERT_EQ(pliant_state_create(&state), PLIANT_OK);
            ASSERT_EQ(pliant_state_save(block.model, block.data, state), PLIANT_OK) << pliant_last_error();
            block.run(0.2);
            const std::vector<double> first = block.positions();
            ASSERT_EQ(pliant_data_reset(block.model, block.data), PLIANT_OK);
            ASSERT_EQ(pliant_state_restore(block.model, block.data, state), PLIANT_OK) << pliant_last_error();
            pliant_state_free(state);
            block.run(0.2);
            EXPECT_EQ(block.positions(), first) << name_of(kind);
            if (threads == 1) one = first;
            EXPECT_EQ(first, one) << name_of(kind);
        }
    }
}

} // namespace
