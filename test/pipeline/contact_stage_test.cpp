// The stage of a step that detects contact with instruments: no tool passes through, nothing diverges, and it costs
// nothing without possible contact.
#include "base/memory.h"
#include "fem/element/scalar.h"
#include "sheet.h"
#include "sim/build/linear_wrench.h"
#include "sim/step/contact.h"
#include "sim/step/legs.h"
#include "solids.h"

#include <fstream>

namespace {

// Add a plate of 50 mm, and return its number.
int add_plate(Body &body)
{
    pliant_tool_shape plate{};
    plate.num_parts = 1;
    plate.part[0] = {PLIANT_PART_BOX, PLIANT_FRAME_TIP, {-0.025, -0.025, 0}, {0.025, 0.025, 0.02}, 0, false};
    int tool = -1;
    EXPECT_EQ(pliant_tool_add(body.model, body.data, "plate", &tool), PLIANT_OK);
    EXPECT_EQ(pliant_tool_set_shape(body.data, tool, &plate), PLIANT_OK) << pliant_last_error();
    return tool;
}

// Tissue ends halfway up the highest cubes, where a plate meets it. Before contact there is no force; afterwards it
// equals the force of a mesh whose cubes end there.
TEST(ContactStage, ElementsAreTouchedWhereTheirTissueEnds)
{
    const int size[3] = {16, 16, 16};
    const double box[3] = {0.08, 0.08, 0.08}, top = 0.07;
    for (const pliant_element_kind kind : {PLIANT_HEXAHEDRA, PLIANT_LINEAR}) {
        double force[2][2]; // coarse, fine; before, pressed
        for (int fine = 0; fine < 2; fine++) {
            Body block(size, box, {{4000, 0.3, 1000, false}, {1, 0.3, 1, true}},
                       [](int, int, int k) { return k < 14 ? 0 : 1; });
            block.scene.element.kind = kind;
            block.cells(fine ? 8 : 4, fine ? 8 : 4, fine ? 8 : 4, 1);
            block.fix_plane(0, 0, 1e-6, 0, 0, 1);
            block.scene.solver.iterations = 30;
            block.scene.solver.tolerance = 1e-4;
            ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
            double tip[3] = {0.04, 0.04, top + 0.001}, torque[3];
            const int tool = add_plate(block);
            for (int pressed = 0; pressed < 2; pressed++) {
                for (int s = 0; s < (pressed ? 6 : 1); s++) {
                    if (pressed && s < 4) tip[2] -= 0.002;
                    ASSERT_EQ(pliant_tool_set_pose(block.data, tool, tip, nullptr), PLIANT_OK);
                    ASSERT_GE(pliant_step(block.model, block.data), 0) << pliant_last_error();
                }
                double felt[3];
                pliant_contact_wrench(block.data, tool, felt, torque);
                force[fine][pressed] = -felt[2];
            }
        }
        std::printf(
            "plate 7 mm into tissue that ends within cubes: %.3f N, cubes that end with it: %.3f N; 1 mm above: "
            "%.3g N\n",
            force[0][1], force[1][1], force[0][0]);
        EXPECT_LT(std::fabs(force[0][0]), 1e-6);
        EXPECT_NEAR(force[0][1], force[1][1], 0.1 * force[1][1]);
    }
}

// Tissue fills an eighth of the highest cubes. Their upper nodes carry no force. Cubes that end with the tissue need
// the same force.
TEST(ContactStage, HexahedraWithLittleTissueCarryNoContact)
{
    const double top = 0.0625;
    double force[2]; // cubes that end above the tissue, with it
    for (int ends = 0; ends < 2; ends++) {
        Body block(std::vector<int>{16, 16, ends ? 25 : 32}.data(),
                   std::vector<double>{0.08, 0.08, ends ? top : 0.08}.data(),
                   {{4000, 0.3, 1000, false}, {1, 0.3, 1, true}}, [](int, int, int k) { return k < 25 ? 0 : 1; });
        block.scene.element.kind = PLIANT_HEXAHEDRA;
        block.cells(4, 4, ends ? 3 : 4, 1);
        block.fix_plane(0, 0, 1e-6, 0, 0, 1);
        block.scene.solver.iterations = 30;
        block.scene.solver.tolerance = 1e-4;
        ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
        const int tool = add_plate(block);
        for (int s = 0; s < 6; s++) {
            const double tip[3] = {0.04, 0.04, top + 0.001 - 0.002 * std::min(s, 4)};
            ASSERT_EQ(pliant_tool_set_pose(block.data, tool, tip, nullptr), PLIANT_OK);
            ASSERT_GE(pliant_step(block.model, block.data), 0) << pliant_last_error();
        }
        double felt[3], torque[3];
        pliant_contact_wrench(block.data, tool, felt, torque);
        force[ends] = -felt[2];
        EXPECT_GT(block.data->contacts.count, 0);
        for (int32_t p = 0; p < block.data->contacts.count; p++)
            for (int32_t k = 0; k < block.data->contacts.point[p].count; k++)
                EXPECT_LT(block.data->body->fine.rest[3 * block.data->contacts.point[p].node[k] + 2], top + 1e-6);
    }
    std::printf("plate 7 mm into tissue that fills an eighth of its cubes: %.3f N, cubes that end with it: %.3f N\n",
                force[0], force[1]);
    EXPECT_NEAR(force[0], force[1], 0.05 * force[1]);
}

// A ball presses into sloping tissue and slides. Most cubes at its surface contain little tissue. Six
// evaluations per step find the same forces as many evaluations.
TEST(ContactStage, ForcesOfHexahedraWithLittleTissueDoNotDependOnTheIterations)
{
    Body block(std::vector<int>{32, 32, 32}.data(), std::vector<double>{0.16, 0.16, 0.16}.data(),
               {{4000, 0.45, 1000, false}, {1, 0.3, 1, true}},
               [](int i, int j, int k) { return k + 0.43 * i + 0.17 * j < 33 ? 0 : 1; });
    block.scene.element.kind = PLIANT_HEXAHEDRA;
    block.scene.contact.friction = 0.08;
    block.cells(7, 7, 7, 1);
    block.fix_plane(0, 0, 1e-6, 0, 0, 1);
    ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
    std::vector<double> forces[2];
    for (int exact = 0; exact < 2; exact++) {
        pliant_data *data = nullptr;
        pliant_tool_shape ball{};
        ball.num_parts = 1;
        ball.part[0].kind = PLIANT_PART_SPHERE;
        ball.part[0].radius = 0.008;
        int tool = -1;
        ASSERT_EQ(pliant_data_create(block.model, &data), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_data_set_limits(data, exact ? 100 : 6, exact ? 1e-6 : 1e-9), PLIANT_OK);
        ASSERT_EQ(pliant_tool_add(block.model, data, "ball", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_shape(data, tool, &ball), PLIANT_OK);
        for (int s = 0; s < 20; s++) {
            const double along = 0.0006 * std::max(0, s - 8), x = 0.08 + along, y = 0.08;
            const double tip[3] = {x, y, 0.165 - 0.43 * x - 0.17 * y + 0.01 - 0.002 * std::min(s, 8)};
            ASSERT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
            for (int again = 0; again < (exact ? 10 : 1); again++)
                if (pliant_step(block.model, data) == PLIANT_OK) break;
            pliant_tool_state state;
            ASSERT_EQ(pliant_tool_get(data, tool, &state), PLIANT_OK);
            forces[exact].push_back(std::sqrt(state.contact_force[0] * state.contact_force[0] +
                                              state.contact_force[1] * state.contact_force[1] +
                                              state.contact_force[2] * state.contact_force[2]));
        }
        pliant_data_free(data);
    }
    double worst = 0;
    for (size_t s = 0; s < forces[0].size(); s++)
        worst = std::max(worst, std::fabs(forces[0][s] - forces[1][s]) / forces[1].back());
    std::printf("ball on sloping hexahedra: %.3f N, error of six evaluations at most %.3f %%\n", forces[1].back(),
                100 * worst);
    EXPECT_GT(forces[1].back(), 0.05);
    EXPECT_LT(worst, 0.005);
}

TEST(ContactStage, CostsNothingWithoutNearbyTools)
{
    Sheet sheet;
    int tool;
    ASSERT_EQ(pliant_tool_add(sheet.model, sheet.data, "tool", &tool), PLIANT_OK);
    sheet.move(tool, 0.03, 0.03, 0.002);
    ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
    EXPECT_EQ(sheet.data->contact_search, nullptr);
    EXPECT_EQ(sheet.data->contacts.capacity, 0);
}

// Jump into the sheet and out of it. A node more than half inside leaves on the other side or stays; it moves no
// farther than its penetration depth.
TEST(ContactStage, AToolThatJumpsIntoTheTissueDoesNotExplode)
{
    for (double z : {0.006, 0.003, 0.001}) {
        Sheet sheet;
        const int tool = sheet.add("ball", ball(0.004), 0.03, 0.03, 0.1);
        ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
        sheet.move(tool, 0.0311, 0.0292, z);
        for (int step = 0; step < 8; step++) {
            ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
            EXPECT_LT(sheet.farthest(), 0.010) << z << " step " << step;
        }
        sheet.move(tool, 0.03, 0.03, 0.1);
        for (int step = 0; step < 8; step++) ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
        EXPECT_LT(sheet.farthest(), 1e-4) << z;
        EXPECT_EQ(sheet.data->contacts.count, 0);
    }
}

TEST(ContactStage, AToolInsideTissueAtLoadIsIgnoredUntilItLeaves)
{
    Sheet sheet;
    const int tool = sheet.add("needle", rod(0.001, 0.02), 0.03, 0.03, 0.002); // completely inside
    for (int step = 0; step < 10; step++) {
        ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
        EXPECT_LT(sheet.farthest(), 0.002) << step;
    }
    sheet.move(tool, 0.03, 0.03, 0.012); // moves out without resistance
    for (int step = 0; step < 10; step++) ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
    EXPECT_LT(sheet.farthest(), 2e-4);
    sheet.move(tool, 0.03, 0.03, -0.004);
    for (int step = 0; step < 10; step++) ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
    EXPECT_GT(sheet.farthest(), 0.004) << "and pushes from now on";
}

TEST(ContactStage, ASpinningToolStaysOutOfTheTissue)
{
    Sheet sheet;
    pliant_tool_shape paddle{};
    paddle.num_parts = 1;
    paddle.part[0] = {PLIANT_PART_BOX, PLIANT_FRAME_TIP, {-0.012, -0.01, -0.001}, {0.012, 0.01, 0.001}, 0, false};
    const int tool = sheet.add("paddle", paddle, 0.03, 0.03, 0.009); // its edge is 7 mm below the middle of the sheet
    double maximum = 0;
    for (int step = 0; step < 10; step++) {
        const double half = 0.5 * 2.1 * step, rotation[4] = {0, std::sin(half), 0, std::cos(half)};
        sheet.move(tool, 0.03, 0.03, 0.009, rotation);
        ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
        ASSERT_LT(sheet.farthest(), 0.05) << step;
        maximum = std::fmax(maximum, sheet.farthest());
    }
    EXPECT_GT(maximum, 0.004);
}

TEST(ContactStage, NonFinitePosesAreRefusedAndChangeNothing)
{
    Sheet sheet;
    const int tool = sheet.add("ball", ball(0.004), 0.03, 0.03, 0.0075);
    const double nowhere[3] = {0.03, NAN, 0.0075}, tip[3] = {0.03, 0.03, 0.0075}, turned[4] = {0, 0, INFINITY, 1};
    EXPECT_EQ(pliant_tool_set_pose(sheet.data, tool, nowhere, nullptr), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_tool_set_pose(sheet.data, tool, tip, turned), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_tool_set_jaw(sheet.data, tool, NAN), PLIANT_ERROR_ARGUMENT);
    pliant_tool_shape shape = ball(0.004);
    shape.part[0].from[2] = NAN;
    EXPECT_EQ(pliant_tool_set_shape(sheet.data, tool, &shape), PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::string(pliant_last_error()).find("tool ball: part 1 of its shape"), std::string::npos)
        << pliant_last_error();
    shape = ball(0.004);
    shape.part[0].frame = PLIANT_FRAME_JAW_PLUS;
    EXPECT_EQ(pliant_tool_set_shape(sheet.data, tool, &shape), PLIANT_ERROR_ARGUMENT) << "no axis";
    shape.num_parts = PLIANT_MAX_PARTS + 1;
    EXPECT_EQ(pliant_tool_set_shape(sheet.data, tool, &shape), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_tool_set_shape(sheet.data, 3, &shape), PLIANT_ERROR_ARGUMENT);
    ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
    EXPECT_GT(sheet.data->contacts.count, 0);
    EXPECT_NEAR(sheet.deepest(tool), 0, 1e-4);
}

// Eight instruments with six or more parts: the same points in the same order for every number of threads.
TEST(ContactStage, EightToolsTouchAlikeForEveryNumberOfThreads)
{
    std::vector<pliant_contact_point> first;
    for (int threads : {1, 2, 3}) {
        Sheet sheet(threads);
        const char *const names[] = {"large_needle_driver",
                                     "prograsp_forceps",
                                     "monopolar_curved_scissors",
                                     "maryland_bipolar_forceps",
                                     "fenestrated_bipolar_forceps",
                                     "permanent_cautery_hook",
                                     "probe",
                                     "camera"};
        const double down[4] = {1, 0, 0, 0}; // z axis down
        for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
            pliant_tool_shape shape;
            ASSERT_EQ(pliant_tool_shape_find(names[t], &shape), PLIANT_OK);
            const double x = 0.012 + 0.012 * (t % 4), y = t < 4 ? 0.015 : 0.045;
            const int tool = sheet.add(names[t], shape, x, y, 0.003);
            sheet.move(tool, x, y, 0.003, down);
            ASSERT_EQ(pliant_tool_set_jaw(sheet.data, tool, 0.6), PLIANT_OK);
        }
        ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
        const pliant_contacts &contacts = sheet.data->contacts;
        if (first.empty()) {
            first.assign(contacts.point, contacts.point + contacts.count);
            bool seen[PLIANT_MAX_TOOLS] = {};
            for (const pliant_contact_point &point : first) seen[point.tool] = true;
            for (bool each : seen) EXPECT_TRUE(each);
        }
        ASSERT_EQ(static_cast<size_t>(contacts.count), first.size());
        for (int32_t n = 0; n < contacts.count; n++) {
            if (n > 0) EXPECT_LT(contacts.point[n - 1].feature, contacts.point[n].feature);
            EXPECT_EQ(contacts.point[n].feature, first[n].feature);
            EXPECT_EQ(std::memcmp(contacts.point[n].place, first[n].place, sizeof first[n].place), 0);
            EXPECT_EQ(std::memcmp(contacts.point[n].normal, first[n].normal, sizeof first[n].normal), 0);
        }
        for (int step = 0; step < 3; step++) ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
        EXPECT_LT(sheet.farthest(), 0.02);
    }
}

TEST(ContactStage, AToolDoesNotPushItsGraspedTissue)
{
    Sheet sheet;
    const int tool = sheet.add("ball", ball(0.004), 0.03, 0.03, 0.005);
    ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
    EXPECT_GT(sheet.data->contacts.count, 0);
    sheet.data->tools[tool].radius = 0.02;
    const double middle[3] = {0.03, 0.03, 0.002};
    ASSERT_EQ(pliant_tool_grasp(sheet.model, sheet.data, tool, middle), PLIANT_OK);
    ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
    EXPECT_EQ(sheet.data->contacts.count, 0);
    pliant_tool_release(sheet.data, tool);
    ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
    EXPECT_GT(sheet.data->contacts.count, 0);
}

// A sagging bar rests with its weight on a box, and on a plane.
TEST(ContactStage, TissueRestsOnObstacles)
{
    const std::string file = ::testing::TempDir() + "contact_stage_test.yaml";
    for (const int kind : {0, 1, 2}) { // a box, a plane, and the box as a hull from a file
        const bool plane = kind == 1;
        Sheet sheet;
        sheet.scene.model.gravity[2] = -9.81;
        ASSERT_EQ(sheet.build(), PLIANT_OK);
        for (int step = 0; step < 12; step++) ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
        const double sag = sheet.farthest();
        ASSERT_GT(sag, 0.002);
        if (plane) sheet.scene.obstacles.planes[sheet.scene.obstacles.num_planes++] = {{0, 0, -0.001}, {0, 0, 2}};
        else if (kind == 2) {
            std::ofstream(file)
                << "parts: [{kind: convex, from: [0.02, -0.01, -0.02], points: [[0, 0, 0], [0.02, 0, 0], [0, 0.08, 0], "
                   "[0.02, 0.08, 0], [0, 0, 0.019], [0.02, 0, 0.019], [0, 0.08, 0.019], [0.02, 0.08, 0.019]]}]\n";
            std::snprintf(sheet.scene.contact.obstacles, sizeof sheet.scene.contact.obstacles, "%s", file.c_str());
        } else
            sheet.scene.obstacles.boxes[sheet.scene.obstacles.num_boxes++] = {{0.02, -0.01, -0.02},
                                                                              {0.04, 0.07, -0.001}};
        ASSERT_EQ(sheet.build(), PLIANT_OK);
        for (int step = 0; step < 12; step++) ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
        EXPECT_GT(sheet.data->contacts.count, 0);
        double lowest = 0, force = 0;
        for (int32_t n = 0; n < sheet.model->body->fine.num_nodes; n++) {
            const double *x = sheet.data->positions + 3 * n;
            // next to the box and at its edges, the sheet hangs lower
            if (plane || std::fabs(x[0] - 0.03) < 0.009) lowest = std::fmin(lowest, x[2]);
        }
        for (int32_t n = 0; n < sheet.data->contacts.count; n++) {
            EXPECT_EQ(sheet.data->contacts.point[n].kind, PLIANT_OBSTACLE_GROUND);
            EXPECT_EQ(sheet.data->contacts.point[n].tool, -1);
            force += sheet.data->contacts.point[n].force[2];
        }
        EXPECT_GT(lowest, -0.00105) << plane;
        EXPECT_LT(lowest, -0.0009);
        EXPECT_GT(force, 0.02); // part of a weight of 0.14 N; the fixed sides carry the rest
        EXPECT_LT(force, 0.14);
    }
    std::ofstream(file) << "parts: [{kind: mesh, file: none.stl}]\n";
    Sheet sheet;
    std::snprintf(sheet.scene.contact.obstacles, sizeof sheet.scene.contact.obstacles, "%s", file.c_str());
    EXPECT_EQ(sheet.build(), PLIANT_ERROR_FORMAT);
    EXPECT_NE(std::string(pliant_last_error()).find("none.stl: cannot be opened"), std::string::npos)
        << pliant_last_error();
    std::remove(file.c_str());
}

// A ball, its hull of triangles and its distance field exert the same force; the latter two are up to 0.05 mm thinner.
TEST(ContactStage, SolidsPressAsTheShapeThatTheyAre)
{
    double force[3] = {0, 0, 0};
    for (int kind = 0; kind < 3; kind++) {
        pliant_solid *solid = nullptr;
        pliant_solid_options options{};
        options.convex = kind == 1;
        options.resolution = 4e-4;
        ASSERT_EQ(ball_surface(0.006).make(options, &solid), PLIANT_OK) << pliant_last_error();
        const size_t before = pliant_memory_in_use();
        {
            Sheet sheet;
            pliant_tool_shape shape{};
            shape.num_parts = 1;
            shape.part[0].kind = kind ? PLIANT_PART_SOLID : PLIANT_PART_SPHERE;
            shape.part[0].solid = kind ? solid : nullptr;
            shape.part[0].radius = kind ? 0 : 0.006;
            const int tool = sheet.add("ball", shape, 0.031, 0.029, 0.0105);
            ASSERT_EQ(pliant_tool_set_shape(sheet.data, tool, &shape), PLIANT_OK) << "again";
            for (int step = 0; step < 6; step++) {
                sheet.move(tool, 0.031, 0.029, 0.0105 - 0.0005 * (step + 1));
                ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
            }
            EXPECT_LT(sheet.deepest(tool), 2e-5);
            double torque[3], total[3];
            pliant_contact_wrench(sheet.data, tool, total, torque);
            force[kind] = -total[2];
            pliant_data *copy = nullptr;
            // the copy holds a reference to the solid, too
            ASSERT_EQ(pliant_data_copy(sheet.model, sheet.data, &copy), PLIANT_OK);
            pliant_data_free(copy);
        }
        EXPECT_EQ(pliant_memory_in_use(), before);
        pliant_solid_release(solid);
    }
    EXPECT_GT(force[0], 0.01);
    EXPECT_NEAR(force[1], force[0], 0.03 * force[0]);
    EXPECT_NEAR(force[2], force[0], 0.03 * force[0]);
}

TEST(ContactStage, ForcesOfNodesAreAScalar)
{
    Sheet sheet;
    const int tool = sheet.add("ball", ball(0.006), 0.03, 0.03, 0.0085);
    ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
    sheet.move(tool, 0.03, 0.03, 0.0075);
    ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
    const size_t nodes = static_cast<size_t>(sheet.data->body->fine.num_nodes);
    std::vector<float> scalar(nodes);
    std::vector<double> force(3 * nodes);
    ASSERT_EQ(pliant_data_get_scalar(sheet.model, sheet.data, PLIANT_SCALAR_CONTACT_FORCE, scalar.data()), PLIANT_OK);
    pliant_data_get_contact_forces(sheet.data, force.data());
    double total[3], torque[3], sum = 0, largest = 0;
    pliant_contact_wrench(sheet.data, tool, total, torque);
    for (size_t n = 0; n < nodes; n++) {
        EXPECT_FLOAT_EQ(scalar[n],
                        static_cast<float>(std::sqrt(force[3 * n] * force[3 * n] + force[3 * n + 1] * force[3 * n + 1] +
                                                     force[3 * n + 2] * force[3 * n + 2])));
        sum += force[3 * n + 2];
        largest = std::fmax(largest, scalar[n]);
    }
    EXPECT_NEAR(sum, total[2], 1e-9);
    EXPECT_LT(total[2], -0.001);
    EXPECT_GT(largest, 0.1 * -total[2]);
    EXPECT_EQ(pliant_data_scalar(sheet.model, sheet.data->body, sheet.data->positions, PLIANT_SCALAR_CONTACT_FORCE,
                                 scalar.data()),
              PLIANT_ERROR_ARGUMENT);
}

// A failed allocation leaves positions and contact points unchanged, and the next step continues normally.
TEST(ContactStage, FailingAllocationsChangeNothing)
{
    Sheet sheet, again;
    Sheet *const both[] = {&sheet, &again};
    for (Sheet *one : both) one->add("rod", rod(0.0042), 0.03, 0.03, 0.009);
    int failures = 0;
    for (int64_t calls = 0;; calls++) {
        const std::vector<double> before(sheet.data->positions,
                                         sheet.data->positions + 3 * sheet.model->body->fine.num_nodes);
        const int32_t count = sheet.data->contacts.count;
        pliant_memory_fail_after(calls);
        const pliant_status status = pliant_legs_find(sheet.model, sheet.data, false);
        pliant_memory_fail_after(-1);
        if (status == PLIANT_OK) break;
        ASSERT_EQ(status, PLIANT_ERROR_MEMORY);
        failures++;
        EXPECT_EQ(sheet.data->contacts.count, count);
        EXPECT_EQ(std::memcmp(before.data(), sheet.data->positions, before.size() * sizeof before[0]), 0);
    }
    EXPECT_GT(failures, 5);
    for (int step = 0; step < 3; step++)
        for (Sheet *one : both) {
            one->move(0, 0.03, 0.03, 0.008 - 0.002 * step);
            ASSERT_GE(pliant_step(one->model, one->data), 0);
        }
    EXPECT_EQ(std::memcmp(sheet.data->positions, again.data->positions,
                          3 * static_cast<size_t>(sheet.model->body->fine.num_nodes) * sizeof(double)),
              0);
}

// A copy continues bitwise identically, including contact sides and tissue motion; a reset restarts.
TEST(ContactStage, ACopyContinuesAndAResetRestarts)
{
    Sheet sheet;
    const int tool = sheet.add("rod", rod(0.002), 0.03, 0.03, 0.007);
    auto run = [&](pliant_data *data) {
        std::vector<double> out;
        for (int step = 0; step < 4; step++) {
            const double tip[3] = {0.03 + 0.001 * step, 0.03, 0.006 - 0.0015 * step};
            EXPECT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
            EXPECT_GE(pliant_step(sheet.model, data), 0);
        }
        for (int32_t n = 0; n < data->contacts.count; n++)
            out.insert(out.end(), data->contacts.point[n].place, data->contacts.point[n].place + 3);
        return out;
    };
    const std::vector<double> first = run(sheet.data);
    ASSERT_FALSE(first.empty());
    pliant_data *copy = nullptr;
    ASSERT_EQ(pliant_data_copy(sheet.model, sheet.data, &copy), PLIANT_OK);
    const double tip[3] = {0.034, 0.03, 0.0};
    for (pliant_data *data : {sheet.data, copy}) {
        ASSERT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
        ASSERT_EQ(pliant_legs_find(sheet.model, data, false), PLIANT_OK);
    }
    ASSERT_EQ(copy->contacts.count, sheet.data->contacts.count);
    for (int32_t n = 0; n < copy->contacts.count; n++) {
        EXPECT_EQ(copy->contacts.point[n].feature, sheet.data->contacts.point[n].feature);
        EXPECT_EQ(std::memcmp(copy->contacts.point[n].place, sheet.data->contacts.point[n].place, 3 * sizeof(double)),
                  0);
    }
    pliant_data_free(copy);
    ASSERT_EQ(pliant_data_reset(sheet.model, sheet.data), PLIANT_OK);
    EXPECT_EQ(sheet.data->contacts.count, 0);
    sheet.move(tool, 0.03, 0.03, 0.007);
    const std::vector<double> second = run(sheet.data);
    ASSERT_EQ(second.size(), first.size());
}

// Linearized force of a ball or rod that presses and sticks, compared with the solver's forces after a motion.
TEST(ContactStage, StiffnessOfAToolThatPresses)
{
    for (bool is_ball : {true, false}) {
        Sheet sheet(1);
        sheet.scene.solver.tolerance = 1e-8;
        sheet.scene.contact.friction = 50;
        ASSERT_EQ(sheet.build(), PLIANT_OK);
        pliant_tool_shape shape = is_ball ? ball(0.01) : rod(0.005, 0.03);
        const double above[3] = {0, 0, is_ball ? 0.01 : 0.005};
        pliant_tool_shape_move(&shape, above); // the tip is on its lowest line
        const int tool = sheet.add("presses", shape, 0.03, 0.03, 0.006);
        pliant_tool_linear linear{};
        const auto change = [&](int axis, double step, double out[6]) {
            for (int sign = -1; sign < 2; sign += 2) {
                const double turn = axis > 2 ? sign * step : 0,
                             rotation[4] = {std::sin(0.5 * turn), 0, 0, std::cos(0.5 * turn)};
                double to[3] = {0.03, 0.03, linear.tip[2]};
                if (axis < 3) to[axis] += sign * step;
                pliant_tool_linear there{};
                for (int s = 0; s < 30; s++) {
                    sheet.move(tool, to[0], to[1], to[2], rotation);
                    ASSERT_GE(pliant_step(sheet.model, sheet.data), 0) << pliant_last_error();
                }
                ASSERT_EQ(pliant_tool_linearize(sheet.data, tool, &there), PLIANT_OK);
                for (int a = 0; a < 6; a++)
                    out[a] = (there.wrench[a] - (sign > 0 ? out[a] : 0)) / (sign > 0 ? 2 * step : 1);
            }
        };
        for (int s = 0; s < 40; s++) {
            sheet.move(tool, 0.03, 0.03, 0.006 - 0.0001 * std::min(s, 35));
            ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
        }
        ASSERT_EQ(pliant_tool_linearize(sheet.data, tool, &linear), PLIANT_OK);
        ASSERT_FALSE(linear.by_secants);
        sheet.move(tool, 0.03, 0.03, 0.01); // not used yet: the wrench belongs to the pose of the step
        ASSERT_EQ(pliant_tool_linearize(sheet.data, tool, &linear), PLIANT_OK);
        EXPECT_NEAR(linear.tip[2], 0.006 - 0.0001 * 35, 1e-6); // pose of the proxy
        ASSERT_LT(linear.wrench[2], -0.005);
        double measured[6];
        for (int axis = is_ball ? 0 : 2; axis < (is_ball ? 3 : 4); axis++) {
            change(axis, axis < 3 ? 2e-6 : 1e-4, measured);
            EXPECT_GT(linear.stiffness[7 * axis], 1e-6);
            EXPECT_NEAR(linear.stiffness[7 * axis], measured[axis], 0.15 * measured[axis]) << axis;
        }
    }
}

} // namespace
