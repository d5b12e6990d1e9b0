// Contact on the GPU against the CPU: tools that press and slide, contact between tissue surfaces, falling blocks.
// Skipped without a GPU.
#include "cuda_contacts.h"
#include "sheet.h"
#include "fem/dynamics/tled.h"
#include "fem/rigid/rigid_pieces_data.h"
#include "contact/solve/cone_rules.h"
#include "sim/step/contact.h"
#include "sim/step/legs.h"

#include <algorithm>
#include <cstdio>
#include <random>
#include <string>

#ifndef PLIANT_WITH_CUDA
const pliant_tissue_searcher pliant_cuda_tissue_searcher = {nullptr, nullptr, nullptr};
#endif

namespace
{

using namespace cuda_contacts;

// Compute a step of each from the CPU's state with the CPU's contact points. The contact topology is sensitive: on the
// CPU alone, a change of 1e-9 m in a tool's pose changes the result by 3 % after ten steps. Only steps with a unique
// solution are compared.
TEST(CudaContact, MeetsTheCpu)
{
    NEEDS_GPU();
    for (const Case &c : cases) {
        SCOPED_TRACE(c.name);
        Block cpu(c, PLIANT_CPU), gpu(c, PLIANT_CUDA), again(c, PLIANT_CPU);
        for (Block *body : {&cpu, &gpu, &again}) ASSERT_EQ(body->begin(), PLIANT_OK) << pliant_last_error();
        double force = 0, difference = 0, worst = 0, deep = 0, pulls = 0;
        int32_t maximum = 0, unlike = 0, compared = 0;
        for (int s = 1; s <= 11; s++) {
            for (Block *body : {&cpu, &gpu, &again}) {
                body->move(s);
                ASSERT_EQ(body->data->backend->interact(body->model, body->data), PLIANT_OK);
            }
            for (auto *body : {&again, &gpu, &cpu})
                ASSERT_EQ(pliant_legs_find(body->model, body->data, false), PLIANT_OK) << pliant_last_error();
            copy_contacts(cpu.data, gpu.model, gpu.data);
            copy_contact_places(cpu.data, again.model, again.data);
            const bool settles = solve(cpu.model, cpu.data) == PLIANT_OK,
                       there_too = solve(gpu.model, gpu.data) == PLIANT_OK;
            const bool settles_again = solve(again.model, again.data) == PLIANT_OK;
            for (auto *body : {&again, &gpu, &cpu}) pliant_legs_set_goals_reached(body->data);
            ASSERT_STREQ(pliant_data_get_backend(gpu.data), "cuda") << pliant_last_error();
            const pliant_statistics &a = cpu.data->statistics, &b = gpu.data->statistics;
            if (!settles || !there_too || !settles_again) continue; // skip steps with alternating contact states
            const std::vector<double> here = forces_on_nodes(cpu.data), there = forces_on_nodes(gpu.data);
            if (max_difference(here, forces_on_nodes(again.data)) > one_end * max_distance_of(here)) continue;
            compared += a.contacts > 0;
            maximum = std::max(maximum, b.contacts);
            unlike += a.contacts != b.contacts;
            deep = std::fmax(deep, std::fabs(a.penetration - b.penetration));
            worst =
                std::fmax(worst, farthest(cpu.data->positions, gpu.data->positions, cpu.model->body->fine.num_nodes));
            force = std::fmax(force, max_distance_of(here));
            difference = std::fmax(difference, max_difference(here, there));
            for (int t = 0; t < cpu.data->num_tools; t++)
                for (int d = 0; d < 3; d++)
                    pulls = std::fmax(pulls, std::fabs(cpu.data->tools[t].force[d] - gpu.data->tools[t].force[d]));
        }
        std::printf(
            "%-36s %2d steps, %3d contacts, a node's force %.1e of %.2g N apart, springs %.1e N, positions %.1e m, "
            "depths %.1e m\n",
            c.name, compared, maximum, difference / force, force, pulls, worst, deep);
        EXPECT_GE(compared, 2);
        EXPECT_GT(maximum, 3);
        EXPECT_GT(force, 0.002);
        EXPECT_LT(difference, c.bound * force);
        EXPECT_LT(worst, 1e-8);
        EXPECT_LE(unlike, 2); // of equivalent points, one may have no force
    }
}

// All blocks compute the forces. Then the plate is pressed beyond its force limit. With friction, the forces of single
// nodes depend on the path. The last case has more points than the GPU computes forces for.
TEST(CudaContact, ManyPointsMeetTheCpu)
{
    NEEDS_GPU();
    struct {
        int cells[2];
        double friction, limit;
        bool exceeds_gpu;
    } many[] = {
        {{20, 14}, 0, 20, false}, {{20, 14}, 0, 0.3, false}, {{14, 10}, 0.3, 0.3, false}, {{24, 16}, 0.3, 0.3, true}};
    for (const auto &of : many) {
        std::vector<double> forces[2], positions[2];
        double load[2];
        for (int k = 0; k < 3; k++) { // the GPU runs twice
            Block flat(cases[0], k ? PLIANT_CUDA : PLIANT_CPU);
            flat.cells(of.cells[0], of.cells[1], 2, 1);
            flat.scene.solver.iterations = 40;
            flat.scene.solver.tolerance = 1e-8;
            flat.scene.contact.max_force = of.limit;
            flat.scene.contact.friction = of.friction;
            ASSERT_EQ(flat.build(), PLIANT_OK) << pliant_last_error();
            flat.add("plate", PLIANT_PART_BOX, 0.03, 0.03, 0.02);
            for (int s = 1; s <= 4; s++) ASSERT_GE(flat.step(s), 0) << pliant_last_error();
            EXPECT_STREQ(pliant_data_get_backend(flat.data), k ? "cuda" : "cpu") << pliant_last_error();
            EXPECT_GT(flat.data->statistics.contacts, of.exceeds_gpu ? PLIANT_CONE_MAX_ROWS / 3 : 128);
            std::vector<double> now[2] = {
                forces_on_nodes(flat.data),
                {flat.data->positions, flat.data->positions + 3 * flat.model->body->fine.num_nodes}};
            if (k == 2) {
                EXPECT_EQ(now[0], forces[1]);
                EXPECT_EQ(now[1], positions[1]);
                continue;
            }
            forces[k] = now[0];
            positions[k] = now[1];
            load[k] = pliant_length3(flat.data->tools[0].proxy.load.wrench);
        }
        const double apart = max_difference(forces[0], forces[1]) / max_distance_of(forces[0]),
                     moved = max_difference(positions[0], positions[1]);
        std::printf("%d x %d cells, friction %.1f, limit %4.1f N: %.3f and %.3f N, a node's force %.1e of it apart, "
                    "positions %.1e m\n",
                    of.cells[0], of.cells[1], of.friction, of.limit, load[0], load[1], apart, moved);
        EXPECT_LT(apart, of.friction > 0 ? 0.01 : 1e-9);
        EXPECT_LT(moved, of.friction > 0 ? 1e-6 : 1e-11);
        EXPECT_NEAR(load[0], load[1], (of.friction > 0 ? 1e-3 : 1e-9) * load[0]);
        if (of.limit < 1) EXPECT_NEAR(load[1], of.limit, 0.03 * of.limit);
    }
}

TEST(CudaContact, SameInputSameBits)
{
    NEEDS_GPU();
    for (int number : {1, 2, 6, 7, 8}) {
        SCOPED_TRACE(cases[number].name);
        std::vector<double> results[2];
        for (std::vector<double> &result : results) {
            Block body(cases[number], PLIANT_CUDA);
            body.scene.solver.iterations = 6;
            ASSERT_EQ(body.begin(), PLIANT_OK) << pliant_last_error();
            for (int s = 1; s <= 9; s++) ASSERT_GE(body.step(s), 0) << pliant_last_error();
            EXPECT_STREQ(pliant_data_get_backend(body.data), "cuda") << pliant_last_error();
            result.assign(body.data->positions, body.data->positions + 3 * body.model->body->fine.num_nodes);
        }
        EXPECT_EQ(results[0], results[1]);
    }
}

// After contact the GPU run continues like the CPU run, and a failure during contact leaves no trace.
TEST(CudaContact, AfterReleaseTheCpuContinues)
{
    NEEDS_GPU();
    Block cpu(cases[0], PLIANT_CPU), gpu(cases[0], PLIANT_CUDA);
    ASSERT_EQ(cpu.begin(), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(gpu.begin(), PLIANT_OK) << pliant_last_error();
    for (Block *body : {&cpu, &gpu}) {
        for (int s = 1; s <= 4; s++) ASSERT_GE(body->step(s), 0) << pliant_last_error();
        const double away[3] = {0, 0, 1};
        for (int t = 0; t < 3; t++) ASSERT_EQ(pliant_tool_set_pose(body->data, t, away, nullptr), PLIANT_OK);
        for (int s = 0; s < 3; s++) ASSERT_GE(pliant_step(body->model, body->data), 0) << pliant_last_error();
        EXPECT_EQ(body->data->statistics.contacts, 0);
    }
    EXPECT_LT(farthest(cpu.data->positions, gpu.data->positions, cpu.model->body->fine.num_nodes), 1e-8);
    EXPECT_STREQ(pliant_data_get_backend(gpu.data), "cuda") << pliant_last_error();
    for (int64_t calls : {0, 7, 20, 33}) {
        Block body(cases[0], PLIANT_AUTO);
        ASSERT_EQ(body.begin(), PLIANT_OK) << pliant_last_error();
        for (int s = 1; s <= 3; s++) ASSERT_GE(body.step(s), 0) << pliant_last_error();
        pliant_cuda_fail_after(calls);
        for (int s = 4; s <= 5; s++) ASSERT_GE(body.step(s), 0) << pliant_last_error();
        pliant_cuda_fail_after(-1);
        EXPECT_STREQ(pliant_data_get_backend(body.data), "cpu") << calls;
        EXPECT_GT(body.data->statistics.contacts, 3);
    }
}

// Stresses are in single precision on a GPU. On the CPU, a relative change of 6e-8 in the weight changes forces by
// 1.5e-7 and displacements by 7e-8, and less in a relaxation. It changes forces in the stack of blocks by 1.7e-5.
TEST(CudaContact, ExplicitDynamicsMeetTheCpu)
{
    NEEDS_GPU();
    struct {
        const char *name;
        int blocks;
        bool self, still, strikes;
        double of_forces, of_positions;
    } runs[] = {{"a block falls and is pressed", 1, false, false, false, 1e-6, 1e-6},
                {"blocks on each other", 2, true, false, false, 2e-5, 1e-6},
                {"relaxation", 1, false, true, false, 1e-5, 1e-5},
                {"a block is struck", 1, false, false, true, 1e-5, 1e-5}};
    for (const auto &run : runs) {
        SCOPED_TRACE(run.name);
        Fall cpu(run.blocks, run.self, run.still, PLIANT_CPU), gpu(run.blocks, run.self, run.still, PLIANT_CUDA),
            again(run.blocks, run.self, run.still, PLIANT_CUDA);
        double force = 0, difference = 0, worst = 0, first = 0;
        int32_t maximum = 0;
        for (Fall *body : {&cpu, &gpu, &again}) {
            body->strikes = run.strikes;
            ASSERT_EQ(body->begin(), PLIANT_OK) << pliant_last_error();
        }
        int32_t parts = 1;
        for (int s = 1; s <= 14; s++) {
            for (Fall *body : {&cpu, &gpu, &again}) ASSERT_GE(body->step(s), 0) << pliant_last_error();
            ASSERT_STREQ(pliant_data_get_backend(gpu.data), "cuda") << pliant_last_error();
            double here[3], there[3];
            forces_of(cpu.data, here);
            forces_of(gpu.data, there);
            maximum = std::max(maximum, gpu.data->statistics.contacts);
            ASSERT_EQ(gpu.data->statistics.legs, cpu.data->statistics.legs) << s;
            parts = std::max(parts, gpu.data->statistics.legs);
            for (int d = 0; d < 3; d++) {
                force = std::fmax(force, std::fabs(here[d]));
                difference = std::fmax(difference, std::fabs(here[d] - there[d]));
            }
            if (s <= 7) first = force > 0 ? difference / force : 0;
            worst =
                std::fmax(worst, farthest(cpu.data->positions, gpu.data->positions, cpu.model->body->fine.num_nodes));
        }
        const double moved = farthest(cpu.data->positions, cpu.model->body->fine.rest, cpu.model->body->fine.num_nodes);
        std::printf(
            "%-30s %3d contacts, forces %.1e of %.2g N apart (%.1e in the first half), positions %.1e of %.1f mm\n",
            run.name, maximum, difference / force, force, first, worst / moved, 1e3 * moved);
        EXPECT_GT(maximum, 3);
        EXPECT_EQ(parts > 1, run.strikes);
        EXPECT_LT(difference, run.of_forces * force);
        EXPECT_LT(worst, run.of_positions * moved);
        EXPECT_EQ(std::memcmp(gpu.data->positions, again.data->positions,
                              3 * sizeof(double) * static_cast<size_t>(gpu.model->body->fine.num_nodes)),
                  0);
    }
}

TEST(CudaContact, FindsTheContactsOfTheCpu)
{
    NEEDS_GPU();
    Fall blocks(3, true, true, PLIANT_CPU);
    ASSERT_EQ(blocks.build(), PLIANT_OK) << pliant_last_error();
    const pliant_body *body = blocks.model->body;
    std::mt19937 random(4);
    std::normal_distribution<double> normal;
    Searches searches;
    int32_t maximum = 0, pairs = 0;
    // blocks move onto and through each other and rotate; some nodes have invalid positions
    for (int s = 0; s < 40; s++) {
        std::vector<double> positions(body->fine.rest, body->fine.rest + 3 * body->fine.num_nodes);
        const double turn = 0.02 * s, noise = s % 4 == 3 ? 1e-3 : 0;
        for (int32_t n = 0; n < body->fine.num_nodes; n++) {
            double *x = &positions[3 * n];
            const int block = static_cast<int>(x[2] / 0.03 + 1e-9);
            const double from[2] = {x[0] - 0.014, x[1] - 0.016};
            x[0] += block == 1 ? from[0] * (std::cos(turn) - 1) - from[1] * std::sin(turn) : 0;
            x[1] += block == 1 ? from[1] * (std::cos(turn) - 1) + from[0] * std::sin(turn) : 0;
            x[2] -= 0.0007 * s * block;
            for (int d = 0; d < 3; d++) x[d] += noise * normal(random);
        }
        if (s == 21) positions[30] = NAN;
        SCOPED_TRACE(s);
        pliant_tissue_rule rule = {0.0025, 1e-3, 0.3, 0};
        rule.thickness = s % 2 == 0 ? 1e-4 : 0;
        maximum = std::max(maximum, searches.compare(body, positions.data(), rule));
        pairs = std::max(pairs, rule.thickness > 0 ? searches.compare_pairs() : 0);
    }
    EXPECT_GT(maximum, 50);
    EXPECT_GT(pairs, 100);
}

// The approximate inverse is carried over a cut made while tools press. Then the new body's own inverse is installed,
// and the cut is undone.
TEST(CudaContact, MeetsTheCpuAfterACut)
{
    NEEDS_GPU();
    for (int number : {0, 1, 2}) {
        SCOPED_TRACE(cases[number].name);
        Block cpu(cases[number], PLIANT_CPU), gpu(cases[number], PLIANT_CUDA), again(cases[number], PLIANT_CPU);
        for (Block *body : {&cpu, &gpu, &again}) {
            body->scene.cut.kind = PLIANT_CUT_SEVER;
            body->scene.solver.refresh_delay = 2;
            ASSERT_EQ(body->begin(), PLIANT_OK) << pliant_last_error();
        }
        Searches searches;
        double force = 0, difference = 0;
        int32_t compared = 0, carried = 0;
        const uint64_t factors = gpu.data->statistics.factors;
        for (int s = 1; s <= 12; s++) {
            if (s == 4) {
                const double points[6] = {0.031, -0.01, 0.03, 0.033, 0.05, 0.03}, depth[3] = {0.001, 0, -0.019};
                for (Block *body : {&cpu, &gpu, &again})
                    ASSERT_EQ(pliant_data_cut(body->model, body->data, 2, points, depth, nullptr), PLIANT_OK)
                        << pliant_last_error();
                ASSERT_GT(gpu.data->body->fine.num_nodes, gpu.model->body->fine.num_nodes);
            }
            if (s == 11)
                for (Block *body : {&cpu, &gpu, &again})
                    ASSERT_EQ(pliant_data_undo_cut(body->model, body->data), PLIANT_OK) << pliant_last_error();
            for (Block *body : {&cpu, &gpu, &again}) {
                body->move(std::min(s, 7));
                ASSERT_EQ(body->data->backend->interact(body->model, body->data), PLIANT_OK);
            }
            for (auto *body : {&again, &gpu, &cpu})
                ASSERT_EQ(pliant_legs_find(body->model, body->data, false), PLIANT_OK) << pliant_last_error();
            copy_contacts(cpu.data, gpu.model, gpu.data);
            copy_contact_places(cpu.data, again.model, again.data);
            if (s > 3 && s < 11) searches.compare(cpu.data->body, cpu.data->positions, {0.001, 1e-3, 0.3, 0});
            const bool settles = solve(cpu.model, cpu.data) == PLIANT_OK,
                       there_too = solve(gpu.model, gpu.data) == PLIANT_OK;
            const bool settles_again = solve(again.model, again.data) == PLIANT_OK;
            for (auto *body : {&again, &gpu, &cpu}) pliant_legs_set_goals_reached(body->data);
            ASSERT_STREQ(pliant_data_get_backend(gpu.data), "cuda") << pliant_last_error();
            if (!settles || !there_too || !settles_again) continue;
            const std::vector<double> here = forces_on_nodes(cpu.data), there = forces_on_nodes(gpu.data);
            if (max_difference(here, forces_on_nodes(again.data)) > one_end * max_distance_of(here)) continue;
            compared++;
            carried += s >= 4 && gpu.data->statistics.factors == factors;
            force = std::fmax(force, max_distance_of(here));
            difference = std::fmax(difference, max_difference(here, there));
        }
        std::printf("cut: %-32s %2d steps, %d of them carried over, a node's force %.1e of %.2g N apart\n",
                    cases[number].name, compared, carried, difference / force, force);
        EXPECT_GE(compared, 5);
        EXPECT_GE(carried, 1);
        EXPECT_GT(gpu.data->statistics.factors, factors); // the new body's own factor was installed
        EXPECT_GT(force, 0.002);
        EXPECT_LT(difference, 1e-6 * force);
    }
}

// Copy the motion of pieces, which the host computes.
void copy_piece_contacts(const pliant_rigid_pieces *from, pliant_rigid_pieces *to)
{
    const size_t count = static_cast<size_t>(from->body->pieces->count),
                 nodes = static_cast<size_t>(from->body->pieces->start[count]);
    std::copy(from->pieces, from->pieces + count, to->pieces);
    std::copy(from->contact_body, from->contact_body + count, to->contact_body);
    std::copy(from->x, from->x + 3 * nodes, to->x);
}

TEST(CudaContact, PiecesThatTouchMeetTheCpu)
{
    NEEDS_GPU();
    for (bool pressed : {false, true}) {
        SCOPED_TRACE(pressed ? "between the ground and a ball" : "on tissue");
        Drop cpu(pressed, PLIANT_CPU), gpu(pressed, PLIANT_CUDA), alone(pressed, PLIANT_CUDA);
        for (Drop *body : {&cpu, &gpu, &alone}) ASSERT_EQ(body->begin(), PLIANT_OK) << pliant_last_error();
        // it amplifies rounding where the piece is jammed
        cpu.model->without_missing_compliance = gpu.model->without_missing_compliance = true;
        ASSERT_EQ(cpu.data->body->pieces->count, 1);
        const int32_t nodes = cpu.data->body->fine.num_nodes;
        double force = 0, difference = 0, worst = 0;
        int32_t compared = 0;
        for (int s = 0; s < 40; s++) {
            for (Drop *body : {&cpu, &gpu, &alone}) body->move(s);
            ASSERT_GE(pliant_step(alone.model, alone.data), 0) << pliant_last_error();
            ASSERT_STREQ(pliant_data_get_backend(alone.data), "cuda") << s;
            for (Drop *body : {&cpu, &gpu})
                ASSERT_EQ(body->data->backend->interact(body->model, body->data), PLIANT_OK);
            for (auto *body : {&gpu, &cpu})
                ASSERT_EQ(pliant_legs_find(body->model, body->data, false), PLIANT_OK) << pliant_last_error();
            copy_contacts(cpu.data, gpu.model, gpu.data);
            copy_piece_contacts(cpu.data->rigid_pieces, gpu.data->rigid_pieces);
            const bool settles = solve(cpu.model, cpu.data) == PLIANT_OK,
                       there_too = solve(gpu.model, gpu.data) == PLIANT_OK;
            for (Drop *body : {&cpu, &gpu}) pliant_rigid_pieces_step(body->data);
            for (auto *body : {&gpu, &cpu}) pliant_legs_set_goals_reached(body->data);
            ASSERT_STREQ(pliant_data_get_backend(gpu.data), "cuda") << pliant_last_error();
            if (!settles || !there_too) continue;
            std::vector<double> here(3 * static_cast<size_t>(nodes)), there(here.size());
            pliant_data_get_contact_forces(cpu.data, here.data());
            pliant_data_get_contact_forces(gpu.data, there.data());
            for (int32_t n = 0; n < nodes; n++)
                if (!pliant_rigid_pieces_contain(cpu.data->rigid_pieces, n))
                    worst = std::fmax(worst, farthest(cpu.data->positions + 3 * n, gpu.data->positions + 3 * n, 1));
            // Forces and position of a piece that jams between ball and ground are not determined. On the CPU alone, a
            // relative change of positions by 1e-13 moves the piece by 7e-6 m. Its weight is 0.03 N.
            if (max_distance_of(here) > 1) continue;
            worst = std::fmax(worst, farthest(cpu.data->positions, gpu.data->positions, nodes));
            compared += cpu.data->statistics.contacts > 0;
            force = std::fmax(force, max_distance_of(here));
            difference = std::fmax(difference, max_difference(here, there));
        }
        double bears = 0, weight = 0, presses = 0; // quantities of the independent run
        const pliant_pieces *pieces = alone.data->body->pieces;
        for (int32_t i = 0; i < pieces->start[1]; i++) weight += 9.81 * alone.data->body->node_mass[pieces->node[i]];
        for (int32_t c = 0; c < alone.data->contacts.count; c++) {
            const pliant_contact_point &point = alone.data->contacts.point[c];
            // without the force on the remaining block above the ball
            if (point.kind == PLIANT_OBSTACLE_TOOL)
                presses -= point.normal[2] < 0 ? point.force[2] : 0;
            else
                bears += std::fabs(point.force[2]);
        }
        std::printf("a piece %-32s %2d steps, a node's force %.1e of %.2g N apart, positions %.1e m; %.4f N is borne, "
                    "its weight %.4f, pressed with %.4f\n",
                    pressed ? "between the ground and a ball:" : "on tissue:", compared, difference / force, force,
                    worst, bears, weight, presses);
        EXPECT_GE(compared, 10);
        EXPECT_GT(force, 0.001);
        EXPECT_LT(difference, 1e-6 * force);
        EXPECT_LT(worst, 1e-8);
        EXPECT_NEAR(bears, weight + presses, 0.01 * bears);
        EXPECT_EQ(pressed, presses > 0.05);
    }
}

// Eight tools press at once. One jumps, one spins, and one gets an invalid pose, which is rejected.
TEST(CudaContact, EightToolsOfWhichOneJumpsOneSpinsAndOneHasNoPose)
{
    NEEDS_GPU();
    Block cpu(cases[0], PLIANT_CPU), gpu(cases[0], PLIANT_CUDA);
    Differences difference;
    for (int s = 0; s <= 9; s++)
        for (Block *body : {&cpu, &gpu}) {
            if (s == 0) ASSERT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
            body->model->without_missing_compliance = true;
            for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
                // from 1 mm above to 2 mm inside
                const double x = 0.0083 + 0.0137 * (t % 4), y = 0.0112 + 0.0171 * (t / 4), half = t == 5 ? 0.4 * s : 0;
                const double tip[3] = {t == 3 && s > 0 && s < 5 ? x + 0.3 : x, y, 5 * h + 0.005 - 3e-4 * (s + 1)},
                             none[3] = {x, NAN, 0}, turn[4] = {0, 0, std::sin(half), std::cos(half)};
                if (s == 0)
                    body->add(("tool" + std::to_string(t)).c_str(), t == 5 ? PLIANT_PART_CAPSULE : PLIANT_PART_SPHERE,
                              0.004, x, y);
                if (t == 6 && s == 4)
                    EXPECT_EQ(pliant_tool_set_pose(body->data, t, none, nullptr), PLIANT_ERROR_ARGUMENT);
                else
                    ASSERT_EQ(pliant_tool_set_pose(body->data, t, tip, turn), PLIANT_OK);
            }
            ASSERT_GE(pliant_step(body->model, body->data), 0) << pliant_last_error();
            if (body == &gpu) difference.take(cpu, gpu);
        }
    std::printf("eight tools: %d contacts, a node's force %.1e of %.2g N apart, positions %.1e of %.2g m\n",
                gpu.data->statistics.contacts, difference.forces / difference.force, difference.force,
                difference.positions, difference.moved);
    EXPECT_STREQ(pliant_data_get_backend(gpu.data), "cuda") << pliant_last_error();
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        pliant_tool_state here, there;
        ASSERT_EQ(pliant_tool_get(cpu.data, t, &here), PLIANT_OK);
        ASSERT_EQ(pliant_tool_get(gpu.data, t, &there), PLIANT_OK);
        EXPECT_LT(there.contact_force[2], -0.01) << t;
        EXPECT_NEAR(there.contact_force[2], here.contact_force[2], 0.01 * std::fabs(here.contact_force[2])) << t;
    }
    EXPECT_GT(difference.moved, 1e-3);
    EXPECT_LT(difference.positions, 1e-3 * difference.moved);
}

// A ball on coarse cells, with the compliance that they lack. Contact points that alternate amplify rounding errors, so
// the mean forces of the last steps are compared.
TEST(CudaContact, MissingComplianceIsThatOfTheCpu)
{
    NEEDS_GPU();
    const int size[3] = {12, 12, 8};
    const double box[3] = {0.12, 0.12, 0.08};
    double force[2] = {0, 0}, missing[2] = {0, 0};
    for (int k = 0; k < 2; k++) {
        Body block(size, box, {{5e3, 0.45, 1000, false}});
        block.cells(12, 12, 8, 1);
        block.fix_plane(0, 0, 1e-3, 0, 0, 1);
        block.scene.solver.backend = k ? PLIANT_CUDA : PLIANT_CPU;
        block.scene.solver.iterations = 60;
        block.scene.contact.friction = 0;
        ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
        const int tool = block.add_ball(0.02);
        for (int s = 0; s < 24; s++) {
            const double tip[3] = {0.063, 0.058, 0.1 - 2.5e-4 * std::min(s, 16)};
            ASSERT_EQ(pliant_tool_set_pose(block.data, tool, tip, nullptr), PLIANT_OK);
            ASSERT_GE(pliant_step(block.model, block.data), 0) << pliant_last_error();
            pliant_tool_state state;
            ASSERT_EQ(pliant_tool_get(block.data, tool, &state), PLIANT_OK);
            if (s >= 20) force[k] -= state.contact_force[2] / 4;
        }
        missing[k] = block.data->tools[tool].proxy.missing.compliance * force[k];
        EXPECT_STREQ(pliant_data_get_backend(block.data), k ? "cuda" : "cpu");
    }
    EXPECT_GT(missing[0], 1e-4);
    EXPECT_NEAR(force[1], force[0], 0.02 * force[0]);
    EXPECT_NEAR(missing[1], missing[0], 0.05 * missing[0]);
}

// Jaws close on tissue and pull it up by 4 mm (grasp_test).
TEST(CudaContact, JawsHoldAsOnTheCpu)
{
    NEEDS_GPU();
    const auto on = [](pliant_backend_choice backend) {
        return [backend](pliant_scene &scene) { scene.solver.backend = backend; };
    };
    Tongue cpu(0.5, on(PLIANT_CPU)), gpu(0.5, on(PLIANT_CUDA));
    cpu.model->without_missing_compliance = gpu.model->without_missing_compliance = true;
    Differences difference;
    for (int s = 0; s < 24; s++) {
        const double up = s < 5    ? 0.03 - 0.0075 * s
                          : s < 20 ? 0
                                   : 0.001 * (s - 19),
                     jaw = 0.7 - 0.5 * std::min(std::max(s - 4, 0), 12) / 12;
        for (Tongue *body : {&cpu, &gpu}) body->go(up, jaw);
        difference.take(cpu, gpu);
    }
    std::printf("jaws: %d contacts, lifted %.3f and %.3f mm with %.4f and %.4f N, positions %.1e of %.2g m apart\n",
                gpu.data->statistics.contacts, 1e3 * cpu.lifted(), 1e3 * gpu.lifted(), cpu.force(), gpu.force(),
                difference.positions, difference.moved);
    EXPECT_STREQ(pliant_data_get_backend(gpu.data), "cuda") << pliant_last_error();
    EXPECT_GT(gpu.min_volume(), 0);
    EXPECT_LT(gpu.deepest(), 2e-4);
    EXPECT_GT(gpu.lifted(), 0.001);
    EXPECT_NEAR(gpu.lifted(), cpu.lifted(), 0.05 * cpu.lifted());
    EXPECT_NEAR(gpu.force(), cpu.force(), 0.05 * std::fabs(cpu.force()));
}

// Jaws crush tissue, so trials of the preconditioner of the rest state are refused. One of the deformed state replaces
// it. A reset and a cut return to the rest state.
TEST(CudaContact, RenewsThePreconditionerUnderTools)
{
    NEEDS_GPU();
    Tongue gpu(0.5, [](pliant_scene &scene) {
        scene.solver.backend = PLIANT_CUDA;
        scene.solver.refresh_delay = 2;
        scene.cut.kind = PLIANT_CUT_SEVER;
    });
    const auto close = [&](int s) {
        gpu.go(std::fmax(0.03 - 0.01 * s, 0), std::fmax(0.7 - 0.1 * std::max(s - 3, 0), 0));
    };
    std::vector<double> results[2];
    const size_t count = 3 * static_cast<size_t>(gpu.data->body->fine.num_nodes);
    for (std::vector<double> &result : results) {
        int s = 0;
        for (; s < 40 && gpu.data->statistics.factors == 0; s++) close(s);
        ASSERT_GT(gpu.data->statistics.factors, 0u);
        for (const int end = s + 6; s < end; s++) close(s);
        result.assign(gpu.data->positions, gpu.data->positions + count);
        if (&result == results) ASSERT_EQ(pliant_data_reset(gpu.model, gpu.data), PLIANT_OK) << pliant_last_error();
    }
    EXPECT_EQ(results[0], results[1]);
    const double points[6] = {0.024, -0.01, 0.012, 0.024, 0.02, 0.012}, depth[3] = {0, 0, 0.004};
    ASSERT_EQ(pliant_data_cut(gpu.model, gpu.data, 2, points, depth, nullptr), PLIANT_OK) << pliant_last_error();
    const uint64_t factors = gpu.data->statistics.factors;
    for (int s = 40; s < 60; s++) close(s);
    EXPECT_GT(gpu.data->statistics.factors, factors);
    EXPECT_GT(gpu.min_volume(), 0);
    EXPECT_STREQ(pliant_data_get_backend(gpu.data), "cuda") << pliant_last_error();
}

// Tools keep their force limits, and jaws their grip torque (swept_test, grasp_test).
TEST(CudaContact, KeepsForceLimits)
{
    NEEDS_GPU();
    for (const bool is_wide : {false, true}) {
        EXPECT_LT(press_beyond_limit({"fine", false, false, is_wide}, PLIANT_CUDA).largest, 1.021);
        EXPECT_LT(press_beyond_limit({"patch", false, true, is_wide}, PLIANT_CUDA).largest, 1.021);
        EXPECT_LT(press_beyond_limit({"explicit", true, false, is_wide}, PLIANT_CUDA).largest, 1.15);
    }
    close_with_grip_torque(false, 0.021, 0.005, PLIANT_CUDA);
    close_with_grip_torque(true, 0.12, 0.03, PLIANT_CUDA);
}

// The response of [C] 5.2 for blocks that overlap after a fall. With its delay it runs on the GPU; without it, overlaps
// are detected in every sub-step, on the CPU.
TEST(CudaContact, ThePapersResponseMeetsTheCpu)
{
    NEEDS_GPU();
    for (const bool delay : {true, false}) {
        SCOPED_TRACE(delay);
        Fall cpu(2, true, false, PLIANT_CPU), gpu(2, true, false, PLIANT_CUDA), free(2, true, false, PLIANT_CPU);
        for (Fall *body : {&cpu, &gpu, &free}) {
            body->scene.contact.response = PLIANT_RESPONSE_PAPER;
            body->scene.contact.delay = delay;
            body->scene.contact.overlap_damping = body == &free ? 0 : 0.5;
            ASSERT_EQ(body->begin(), PLIANT_OK) << pliant_last_error();
            std::vector<double> positions(body->data->positions,
                                          body->data->positions + 3 * body->data->body->fine.num_nodes);
            for (size_t n = 2; n < positions.size(); n += 3) positions[n] -= positions[n] > 0.025 ? 0.011 : 0;
            ASSERT_EQ(pliant_data_set_positions(body->model, body->data, positions.data()), PLIANT_OK);
            ASSERT_GE(pliant_step(body->model, body->data), 0) << pliant_last_error();
        }
        Differences difference, slowed;
        difference.take(cpu, gpu);
        slowed.take(cpu, free);
        std::printf("the paper's response %s delay: %d nodes, positions %.1e m apart, slowed by %.1e m\n",
                    delay ? "with" : "without", gpu.data->statistics.contacts, difference.positions, slowed.positions);
        EXPECT_STREQ(pliant_data_get_backend(gpu.data), delay ? "cuda" : "cpu") << pliant_last_error();
        EXPECT_GT(gpu.data->statistics.contacts, 5);
        EXPECT_EQ(gpu.data->statistics.contacts, cpu.data->statistics.contacts);
        EXPECT_GT(slowed.positions, 1e-6);
        EXPECT_LT(difference.positions, 1e-3 * slowed.positions);
    }
}

// Tetrahedra whose corners are at few positions (overlap_test): corners, edges and faces coincide, and many are flat.
// The pairs must be equal.
TEST(CudaContact, FindsTheSameOverlapsOfTouchingAndFlatOnes)
{
    NEEDS_GPU();
    Fall blocks(3, true, true, PLIANT_CPU);
    ASSERT_EQ(blocks.build(), PLIANT_OK) << pliant_last_error();
    const pliant_body *body = blocks.model->body;
    std::mt19937 random(6);
    int32_t pairs = 0;
    for (int size : {1, 2, 3, 3, 12}) {
        SCOPED_TRACE(size);
        Searches searches;
        std::vector<double> positions(3 * static_cast<size_t>(body->fine.num_nodes));
        for (double &x : positions) x = std::uniform_int_distribution<int>(0, size)(random) / 256.0;
        std::vector<uint8_t> overlaps[2];
        std::vector<std::pair<int32_t, int32_t>> found[2];
        for (int k = 0; k < 2; k++) {
            overlaps[k].resize(static_cast<size_t>(body->fine.num_nodes));
            ASSERT_EQ(pliant_tissue_set_body(searches.of + k, body, nullptr, 1), PLIANT_OK) << pliant_last_error();
            ASSERT_EQ(pliant_tissue_overlapping(searches.of + k, positions.data(), overlaps[k].data()), PLIANT_OK)
                << pliant_last_error();
            for (const pliant_grid_pairs &of : searches.of[k].grid.found)
                for (int32_t p = 0; p < of.count; p++) found[k].emplace_back(of.pair[2 * p], of.pair[2 * p + 1]);
            std::sort(found[k].begin(), found[k].end());
        }
        EXPECT_NE(searches.of[1].searcher_state, nullptr) << "the GPU has not searched";
        EXPECT_EQ(found[0], found[1]);
        EXPECT_EQ(overlaps[0], overlaps[1]);
        pairs += searches.of[0].num_overlaps;
    }
    EXPECT_GT(pairs, 1000);
}

// runs every kernel in a short time, for compute-sanitizer
TEST(CudaContact, EveryKernelOnce)
{
    NEEDS_GPU();
    touch_once(cases[2]);
    for (bool many : {false, true}) { // all blocks compute the forces; more points than the GPU computes forces for
        Block flat(cases[0], PLIANT_CUDA);
        flat.cells(many ? 24 : 14, many ? 16 : 10, 1, 1);
        flat.scene.solver.iterations = 2;
        ASSERT_EQ(flat.build(), PLIANT_OK) << pliant_last_error();
        flat.add("plate", PLIANT_PART_BOX, 0.03, 0.03, 0.02);
        for (int s = 1; s <= 3; s++) ASSERT_GE(flat.step(s), 0) << pliant_last_error();
        EXPECT_STREQ(pliant_data_get_backend(flat.data), "cuda") << pliant_last_error();
        EXPECT_GT(flat.data->statistics.contacts, many ? PLIANT_CONE_MAX_ROWS / 3 : 128);
        EXPECT_LT(flat.data->statistics.contacts, many ? 500 : PLIANT_CONE_MAX_ROWS / 3);
    }
}

TEST(CudaContact, EveryKernelOnceOfTissueOnTissue)
{
    NEEDS_GPU();
    touch_once(cases[6]);
    Drop drop(false, PLIANT_CUDA);
    drop.scene.solver.iterations = 3;
    ASSERT_EQ(drop.begin(), PLIANT_OK) << pliant_last_error();
    for (int s = 0; s < 8; s++) ASSERT_GE(pliant_step(drop.model, drop.data), 0) << pliant_last_error();
    EXPECT_STREQ(pliant_data_get_backend(drop.data), "cuda") << pliant_last_error();
    EXPECT_GT(drop.data->statistics.contacts, 0);
    for (bool still : {false, true}) {
        Fall body(1, true, still, PLIANT_CUDA);
        body.scene.tled.relaxation_steps = 64;
        ASSERT_EQ(body.begin(), PLIANT_OK) << pliant_last_error();
        for (int s = 4; s <= 6; s++) ASSERT_GE(body.step(s), 0) << pliant_last_error();
        EXPECT_STREQ(pliant_data_get_backend(body.data), "cuda") << pliant_last_error();
    }
}

// kernels of other preconditioners; cuda_test covers the rest
TEST(CudaContact, EveryKernelOnceOfOtherPreconditioners)
{
    NEEDS_GPU();
    touch_once(cases[1]);
    RodSheet sheet(PLIANT_CUDA, PLIANT_MULTIGRID, 2, 3);
    ASSERT_EQ(sheet.begin(), PLIANT_OK) << pliant_last_error();
    for (int s = 0; s < 3; s++) ASSERT_GE(sheet.step(s, 0.0275), 0) << pliant_last_error();
    EXPECT_STREQ(pliant_data_get_backend(sheet.data), "cuda") << pliant_last_error();
}

} // namespace
