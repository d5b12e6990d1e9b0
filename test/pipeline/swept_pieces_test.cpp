// No tool tunnels at 1 m/s through a detached piece, which is rigid with quasi-static solvers and is pushed along.
#include "sweeps.h"

#include "fem/rigid/rigid_pieces_data.h"
#include "base/memory.h"

#include <algorithm>
#include <array>
#include <vector>

namespace {

std::vector<double> positions_of(const pliant_data *data)
{
    return {data->positions, data->positions + 3 * data->body->fine.num_nodes};
}

int32_t node_of_piece(const Sheet &sheet) { return sheet.data->body->pieces->node[sheet.data->body->pieces->start[0]]; }

// The piece of cut_off (sweeps.h), 0.2 m from the sheet.
struct Piece {
    std::unique_ptr<Sheet> sheet;
    int32_t node;
    std::array<double, 3> before;
    double deepest = 0;
    int inside = 0, parts = 1;

    explicit Piece(double friction, const std::function<void(pliant_scene &)> &also = [](pliant_scene &) {})
        : sheet(std::make_unique<Sheet>(1, friction, 0, PLIANT_LINEAR, false,
                                        [&also](pliant_scene &scene) {
                                            scene.cut.kind = PLIANT_CUT_SUBDIVIDE;
                                            scene.warp.margin = 1;
                                            scene.grasp.radius = 0.003;
                                            also(scene);
                                        }))
    {
        cut_off(*sheet);
        node = node_of_piece(*sheet);
        for (int d = 0; d < 3; d++) before[d] = sheet->data->positions[3 * node + d];
    }
    void step(int tool)
    {
        ASSERT_GE(pliant_step(sheet->model, sheet->data), 0) << pliant_last_error();
        deepest = std::max(deepest, sheet->max_surface_penetration(tool));
        inside = std::max(inside, sheet->count_axis_points_inside(tool));
        parts = std::max(parts, sheet->data->statistics.legs);
        const pliant_pieces *pieces = sheet->data->body->pieces;
        for (int32_t i = 0; i < pieces->start[pieces->count]; i++)
            for (int d = 0; d < 3; d++)
                ASSERT_EQ(sheet->data->positions[3 * pieces->node[i] + d], sheet->data->rigid_pieces->x[3 * i + d])
                    << "a node of a piece is apart from the piece";
    }
    double motion() const
    {
        double maximum = 0;
        for (int d = 0; d < 3; d++)
            maximum = std::max(maximum, std::fabs(sheet->data->positions[3 * node + d] - before[d]));
        return maximum;
    }
    bool has_tunneled(const pliant_part &part) const { return inside > 0 || deepest > 0.9 * pliant_part_depth(&part); }
};

// Move a sweep of the sheet to the piece.
SweepPath through_the_piece(SweepPath on)
{
    on.from[1] = -0.197 + 0.5 * (on.from[1] - 0.03);
    return on;
}

// A free piece, hit anywhere. PLIANT_SWEEPS: number of sweeps, default 60.
TEST(SweptPieces, NothingIsSweptThroughAPiece)
{
    Sweeps sweeps;
    int through = 0, moved = 0;
    const int count = number_from("PLIANT_SWEEPS", 60), first = number_from("PLIANT_SWEEPS_FIRST", 0);
    for (int n = 0; n < count; n++) {
        const SweepPath on = through_the_piece(sweeps.next());
        if (n < first) continue;
        Piece piece(on.friction);
        const int tool = piece.sheet->add("tool", shape_of(on.part), on.from[0], on.from[1], on.from[2]);
        for (int step = 0; step < on.steps() + 2; step++) {
            move(*piece.sheet, tool, on, step);
            piece.step(tool);
        }
        if (piece.has_tunneled(on.part))
            std::printf("sweep %d: kind %d: %d points inside, %g mm deep, up to %d parts, gone %g mm\n", n, n % 7,
                        piece.inside, 1e3 * piece.deepest, piece.parts, 1e3 * piece.motion());
        through += piece.has_tunneled(on.part);
        moved += piece.motion() > 0.001;
    }
    std::printf("from %d to %d: %d through, %d moved\n", first, count, through, moved);
    EXPECT_EQ(through, 0);
    EXPECT_GT(moved, (count - first) / 2);
}

// On the ground, upright rods push the piece along, and it stays on the ground.
TEST(SweptPieces, UprightRodsPushAPieceAlongTheGround)
{
    for (const double radius : {0.0005, 0.002})
        for (const double aside : {-0.005, 0.0, 0.002})
            for (const bool lengthwise : {false, true}) {
                SCOPED_TRACE(testing::Message()
                             << radius << " m, " << aside << " m aside, " << (lengthwise ? "lengthwise" : "across"));
                Piece piece(0.2, [](pliant_scene &scene) {
                    scene.ground.normal[2] = 1;
                    scene.ground.friction = 0.3;
                    scene.model.gravity[2] = -9.81;
                });
                const pliant_part part = {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {0, 0, -0.01},
                                          {0, 0, 0.05},        radius,           false};
                const double middle[2] = {0.03 + (lengthwise ? 0 : aside), -0.197 + (lengthwise ? 0.3 * aside : 0)};
                const double from[3] = {middle[0] - (lengthwise ? 0.03 : 0), middle[1] - (lengthwise ? 0 : 0.03), 0};
                const int tool = piece.sheet->add("tool", shape_of(part), from[0], from[1], from[2]);
                for (int step = 0; step < 12; step++) {
                    const double gone = 0.02 * std::max(0, std::min(step - 6, 3));
                    piece.sheet->move(tool, from[0] + (lengthwise ? gone : 0), from[1] + (lengthwise ? 0 : gone),
                                      from[2]);
                    piece.step(tool);
                    double lowest = 1;
                    const pliant_pieces *pieces = piece.sheet->data->body->pieces;
                    for (int32_t i = 0; i < pieces->start[1]; i++)
                        lowest = std::min(lowest, piece.sheet->data->positions[3 * pieces->node[i] + 2]);
                    EXPECT_GT(lowest, -1e-6) << step;
                }
                EXPECT_FALSE(piece.has_tunneled(part))
                    << piece.inside << " points inside, " << piece.deepest << " deep";
                EXPECT_GT(piece.motion(), 0.008);
            }
}

// A tool on a path through the piece, and a tool that lifts the piece if it grasps it.
struct GrippedPiece : Piece {
    SweepPath on;
    int tool, grip;
    GrippedPiece(const SweepPath &path, bool is_held)
        : Piece(path.friction), on(path),
          tool(sheet->add("tool", shape_of(on.part), on.from[0], on.from[1], on.from[2])),
          grip(sheet->add("grip", pliant_tool_shape{}, 0.024, -0.197, 0.002))
    {
        const double rest[3] = {0.024, 0.003, 0.002};
        if (is_held)
            EXPECT_EQ(pliant_tool_grasp(sheet->model, sheet->data, grip, rest), PLIANT_OK) << pliant_last_error();
    }
    void move_tools(int step)
    {
        move(*sheet, tool, on, step);
        sheet->move(grip, 0.024, -0.197, 0.002 + 0.001 * step);
    }
};

// A step in parts that fails restores the piece, its velocity and its grasp. Repeated, it gives the result of an
// undisturbed step.
TEST(SweptPieces, AStepInPartsThatFailsIsUndone)
{
    Sweeps sweeps;
    const SweepPath on = through_the_piece(sweeps.at(9));
    for (const bool is_held : {false, true}) {
        GrippedPiece piece(on, is_held);
        Sheet &sheet = *piece.sheet;
        int failed = 0, parts = 1;
        for (int step = 0; step < on.steps() + 2; step++) {
            piece.move_tools(step);
            pliant_data *reference = nullptr;
            ASSERT_EQ(pliant_data_copy(sheet.model, sheet.data, &reference), PLIANT_OK);
            ASSERT_GE(pliant_step(sheet.model, reference), 0);
            parts = std::max(parts, reference->statistics.legs);
            const std::vector<double> before = positions_of(sheet.data), wanted = positions_of(reference);
            for (int64_t calls = 0; calls < 60; calls += 2) {
                pliant_data *data = nullptr;
                ASSERT_EQ(pliant_data_copy(sheet.model, sheet.data, &data), PLIANT_OK);
                pliant_memory_fail_after(calls);
                const pliant_status status = pliant_step(sheet.model, data);
                pliant_memory_fail_after(-1);
                if (status < 0) {
                    failed++;
                    EXPECT_EQ(status, PLIANT_ERROR_MEMORY);
                    EXPECT_EQ(before, positions_of(data)) << "step " << step << ", after " << calls << " allocations";
                    ASSERT_GE(pliant_step(sheet.model, data), 0);
                    const std::vector<double> after = positions_of(data);
                    double maximum = 0;
                    for (size_t i = 0; i < after.size(); i++)
                        maximum = std::max(maximum, std::fabs(after[i] - wanted[i]));
                    EXPECT_LT(maximum, 1e-6) << "step " << step << ", after " << calls << " allocations";
                }
                pliant_data_free(data);
            }
            pliant_data_free(reference);
            ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
        }
        EXPECT_GT(failed, 0);
        EXPECT_TRUE(is_held || parts > 1);
    }
}

TEST(SweptPieces, ArePlayedBackToTheBit)
{
    int parts = 1;
    for (const int n : {4, 29, 92}) {
        Sweeps sweeps;
        const SweepPath on = through_the_piece(sweeps.at(n));
        std::vector<uint32_t> taken;
        std::vector<double> ended[2];
        for (int played = 0; played < 2; played++) { // live, and replayed
            Piece piece(on.friction);
            const int tool = piece.sheet->add("tool", shape_of(on.part), on.from[0], on.from[1], on.from[2]);
            for (int step = 0; step < on.steps() + 4; step++) {
                move(*piece.sheet, tool, on, step);
                ASSERT_EQ(pliant_data_set_background(piece.sheet->data,
                                                     played ? PLIANT_BACKGROUND_PRESCRIBED : PLIANT_BACKGROUND_LIVE,
                                                     played ? taken[step] : 0),
                          PLIANT_OK);
                piece.step(tool);
                if (!played) taken.push_back(pliant_data_get_background_taken(piece.sheet->data));
            }
            ended[played] = positions_of(piece.sheet->data);
            parts = std::max(parts, piece.parts);
        }
        EXPECT_EQ(ended[0], ended[1]) << n;
    }
    EXPECT_GT(parts, 1);
}

} // namespace
