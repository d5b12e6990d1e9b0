// Sliding layers with every method, and the estimated error while a tool presses.
#include "sheet.h"

#include <cstdio>
#include <string>

namespace {

// Two layers of 10 mm on a plate, without friction; the upper one is fixed at one end. Return the displacement of its
// other end along an axis [m].
double moved(const std::vector<std::string> &options, const char *slides, int axis, double *penetration = nullptr)
{
    const double box[3] = {0.08, 0.02, 0.02};
    Body layers(std::vector<int>{32, 8, 8}.data(), box, {{10e3, 0.3, 1000, false}, {10e3, 0.3, 1000, false}},
                [](int, int, int k) { return k >= 4; });
    layers.cells(8, 2, 2, 1);
    layers.scene.cut.kind = PLIANT_CUT_SEVER;
    layers.scene.contact.friction = 0;
    layers.scene.solver.threads = 1;
    layers.fix_plane(0, 0, 1e-4, 0, 0, 1);
    layers.scene.fixed.boxes[layers.scene.fixed.num_boxes++] = {{-1, -1, 0.0099}, {1e-4, 1, 1}};
    layers.scene.model.gravity[axis] = axis == 0 ? 3 : -3;
    for (const std::string &option : options) {
        const size_t at = option.find('=');
        EXPECT_EQ(pliant_scene_set(&layers.scene, option.substr(0, at).c_str(), option.substr(at + 1).c_str()),
                  PLIANT_OK)
            << pliant_last_error();
    }
    EXPECT_EQ(pliant_scene_set(&layers.scene, "material/slides", slides), PLIANT_OK);
    EXPECT_EQ(layers.build(), PLIANT_OK) << pliant_last_error();
    if (!layers.data) return NAN;
    const int steps = layers.scene.solver.kind == PLIANT_TLED ? 60 : 20; // until it rests
    for (int s = 0; s < steps; s++) EXPECT_GE(pliant_step(layers.model, layers.data), 0) << pliant_last_error();
    const pliant_mesh &fine = layers.model->body->fine;
    double sum = 0, count = 0;
    for (int32_t n = 0; n < fine.num_nodes; n++)
        if (fine.rest[3 * n] > box[0] - 1e-9 && fine.rest[3 * n + 2] > box[2] - 1e-9)
            sum += layers.data->positions[3 * n + axis] - fine.rest[3 * n + axis], count++;
    if (penetration) *penetration = layers.data->statistics.penetration;
    return sum / count;
}

// Along: the upper layer is stretched by its weight, rho g L^2 / 2 E, minus 2 to 6 % because its fixed end cannot
// contract. Glued to the other layer it moves less. Down: it presses as the whole block does; the two meshes differ by
// 5 %.
TEST(ContactMethods, LayersSlideForAllCuttableMethods)
{
    const struct { const char *name; std::vector<std::string> options; } rows[] = {
        {"fine", {}}, {"hexahedra", {"element/kind=hexahedra"}},
        {"coarse", {"model/method=coarse", "mesh/coarse_cells=4 2 2", "mesh/ratio=2"}},
        {"averaged", {"model/method=averaged", "mesh/coarse_cells=4 2 2", "mesh/ratio=2"}},
        {"schur", {"model/method=schur", "mesh/coarse_cells=4 2 2", "mesh/ratio=2"}},
        {"averaged, patch", {"model/method=averaged", "mesh/coarse_cells=4 2 2", "mesh/ratio=2", "model/patch=0.02"}},
        {"octree", {"mesh/kind=octree", "mesh/coarse_cells=4 2 2", "mesh/ratio=1", "mesh/depth=1"}},
        {"tled", {"solver/kind=tled", "tled/damping=40"}},
    };
    const double alone = 1000 * 3 * 0.08 * 0.08 / (2 * 10e3), whole = moved({}, "", 2);
    for (const auto &row : rows) {
        double deep[2] = {0, 0};
        const double along = moved(row.options, "m1", 0, deep), glued = moved(row.options, "", 0),
                     down = moved(row.options, "m1", 2, deep + 1);
        std::printf("%-16s along %.3f mm, glued %.3f, alone %.3f; down %.4f mm, of a block %.4f\n", row.name,
                    1e3 * along, 1e3 * glued, 1e3 * alone, 1e3 * down, 1e3 * whole);
        EXPECT_GT(along, 0.93 * alone) << row.name;
        EXPECT_LT(along, alone) << row.name;
        EXPECT_LT(glued, 0.65 * along) << row.name; // 0.2, and 0.59 with schur, which is too soft
        EXPECT_NEAR(down, whole, 0.08 * std::fabs(whole)) << row.name;
        for (double each : deep) EXPECT_LT(each, 1e-7) << row.name;
    }
}

TEST(ContactMethods, LodIsRefusedByWord)
{
    Body body(std::vector<int>{8, 8, 8}.data(), std::vector<double>{0.02, 0.02, 0.02}.data(),
              {{10e3, 0.3, 1000, false}, {10e3, 0.3, 1000, false}}, [](int, int, int k) { return k >= 4; });
    body.cells(2, 2, 2, 2);
    body.fix_plane(0, 0, 1e-4, 0, 0, 1);
    body.scene.model.method = PLIANT_LOD;
    body.scene.cut.kind = PLIANT_CUT_SEVER;
    ASSERT_EQ(pliant_scene_set(&body.scene, "material/slides", "m1"), PLIANT_OK);
    EXPECT_NE(body.build(), PLIANT_OK);
    EXPECT_NE(std::string(pliant_last_error()).find("lod interpolates within whole cubes"), std::string::npos)
        << pliant_last_error();
}

// A ball is pressed into a block and dragged along it. Each frame has a few evaluations. The reference frame starts
// from the same state and is solved to convergence. The error is the maximum over the nodes. error_estimates_test
// requires the estimate within a factor of three in 95 % of frames. Here 3 of 192 frames are outside. One estimate is
// below a third of the error: the volume bound holds many crushed hexahedra open, and a small change moves them far.
TEST(ContactMethods, EstimatedErrorWhileAToolPresses)
{
    int frames = 0, within = 0, below = 0;
    for (pliant_element_kind kind : {PLIANT_LINEAR, PLIANT_HEXAHEDRA})
        for (double friction : {0.08, 0.5})
            for (int iterations : {3, 6}) {
                const double box[3] = {0.06, 0.06, 0.03};
                Body block(std::vector<int>{12, 12, 6}.data(), box, {{4000, 0.4, 1000, false}});
                block.cells(12, 12, 6, 1);
                block.fix_plane(0, 0, 1e-4, 0, 0, 1);
                block.scene.element.kind = kind;
                block.scene.contact.friction = friction;
                block.scene.solver.threads = 1;
                block.scene.solver.iterations = iterations;
                block.scene.solver.tolerance = 1e-3;
                ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
                const int tool = block.add_ball(0.008);
                double minimum = 1e9, maximum = 0;
                for (int s = 0; s < 26; s++) {
                    const double tip[3] = {0.0303 + 0.0015 * std::max(0, s - 8), 0.0297,
                                           0.0385 - 0.001 * std::min(s, 8)};
                    pliant_data *right = nullptr;
                    ASSERT_EQ(pliant_data_copy(block.model, block.data, &right), PLIANT_OK);
                    ASSERT_EQ(pliant_data_set_limits(right, 300, 1e-8), PLIANT_OK);
                    for (pliant_data *data : {block.data, right}) {
                        ASSERT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
                        ASSERT_GE(pliant_step(block.model, data), 0) << pliant_last_error();
                    }
                    double error = 0;
                    for (int32_t n = 0; n < block.model->body->fine.num_nodes; n++) {
                        const double *a = block.data->positions + 3 * n, *b = right->positions + 3 * n;
                        error = std::fmax(error, std::hypot(std::hypot(a[0] - b[0], a[1] - b[1]), a[2] - b[2]));
                    }
                    pliant_data_free(right);
                    if (error < 1e-7) continue;
                    const double ratio = block.data->statistics.error / error;
                    frames++;
                    within += ratio > 1.0 / 3 && ratio < 3;
                    below += ratio < 1.0 / 3;
                    minimum = std::fmin(minimum, ratio), maximum = std::fmax(maximum, ratio);
                }
                std::printf("elements %d, friction %g, %d evaluations: told %.3g to %.3g of the error\n", kind,
                            friction, iterations, minimum, maximum);
            }
    EXPECT_GT(frames, 150);
    EXPECT_GE(within, 0.95 * frames);
    EXPECT_LE(below, 0.02 * frames);
}

} // namespace
