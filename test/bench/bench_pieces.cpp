// Two plates squeeze a detached cube of 40 mm. With quasi-static solvers a detached piece is rigid, so the
// tools' virtual coupling determines the force. In explicit dynamics the piece deforms.
//
// Usage:
//   bench_pieces
#include "../pipeline/body.h"
#include "figure.h"

#include <array>

namespace
{

const double edge = 0.04, half_plate = 0.005;
enum { CLOSE = 40, HOLD = 60 };

pliant_tool_shape plate()
{
    pliant_tool_shape shape{};
    shape.num_parts = 1;
    shape.part[0] = {
        PLIANT_PART_BOX, PLIANT_FRAME_TIP, {-half_plate, -0.03, -0.03}, {half_plate, 0.03, 0.03}, 0, false};
    return shape;
}

// Squeeze by `depth` on each side. Return the force of one plate [N].
double squeeze(double young, double depth, bool dynamic)
{
    const int size[3] = {16, 16, 32};
    const double box[3] = {edge, edge, 2 * edge};
    Body body(size, box, {{young, 0.45, 1000, false}});
    body.cells(8, 8, 16, 1);
    body.fix_plane(0, 0, 1e-3, 0, 0, 1);
    body.scene.cut.kind = PLIANT_CUT_SUBDIVIDE;
    body.scene.warp.margin = 0.2;
    if (dynamic) {
        body.scene.solver.kind = PLIANT_TLED;
        body.scene.solver.step = 0.01;
    }
    EXPECT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const double points[6] = {-0.01, -0.01, 0.0401, -0.01, 0.05, 0.0401}, along[3] = {0.06, 0, 0};
    EXPECT_EQ(pliant_data_cut(body.model, body.data, 2, points, along, nullptr), PLIANT_OK) << pliant_last_error();
    const pliant_body *cut = body.data->body;
    if (!cut->pieces) return NAN;
    std::vector<double> positions(body.data->positions, body.data->positions + 3 * cut->fine.num_nodes);
    for (int32_t i = 0; i < cut->pieces->start[cut->pieces->count]; i++)
        positions[3 * cut->pieces->node[i] + 2] += 0.05;
    EXPECT_EQ(pliant_data_set_positions(body.model, body.data, positions.data()), PLIANT_OK) << pliant_last_error();
    const pliant_tool_shape shape = plate();
    int tool[2];
    for (int t = 0; t < 2; t++) {
        EXPECT_EQ(pliant_tool_add(body.model, body.data, t ? "right" : "left", &tool[t]), PLIANT_OK);
        EXPECT_EQ(pliant_tool_set_shape(body.data, tool[t], &shape), PLIANT_OK);
    }
    for (int step = 0; step < CLOSE + HOLD; step++) {
        const double gap = 0.001 - (0.001 + depth) * std::min(1.0, double(step) / CLOSE);
        for (int t = 0; t < 2; t++) {
            const double tip[3] = {t ? edge + half_plate + gap : -half_plate - gap, 0.02, 0.11};
            EXPECT_EQ(pliant_tool_set_pose(body.data, tool[t], tip, nullptr), PLIANT_OK) << pliant_last_error();
        }
        EXPECT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
    }
    pliant_tool_state state;
    EXPECT_EQ(pliant_tool_get(body.data, tool[1], &state), PLIANT_OK);
    const double force = std::fabs(state.contact_force[0]);
    std::printf("%s, E %.0f Pa, %.0f mm on each side: %.3f N, proxy error %.3f mm; E A strain %.3f N\n",
                dynamic ? "explicit dynamics" : "quasi-static", young, 1e3 * depth, force,
                1e3 * body.data->statistics.proxy_error, young * edge * 2 * depth);
    return force;
}

} // namespace

int main()
{
    for (double young : {2e3, 1e4, 5e4})
        for (double depth : {0.001, 0.003}) {
            const double rigid = squeeze(young, depth, false), deformed = squeeze(young, depth, true);
            figure("pieces/" + std::to_string(int(young)) + "_Pa/" + std::to_string(int(1e3 * depth)) + "_mm",
                   rigid / deformed, "rigid / deformable");
        }
    return 0;
}
