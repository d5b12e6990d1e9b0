// Contact force of rigid tools on coarse cells, and its estimated error, against references.
//
// A tool is pressed into a block of 120 x 120 x 60 mm, 10 kPa, nu 0.45, whose bottom is fixed. The references of the
// sphere and the punch are the axisymmetric solutions of test/reference/indentation.py, without friction. The forces of
// the cylinder and of an instrument's jaw have no reference: compare their values for smaller and smaller cells. The
// force is the mean of the last two steps, because contact points of some hexahedra alternate between steps.
//
// Usage:
//   bench_force [element/kind [cell ...] [tool ...]]     cells in mm; default: linear 10 5 2.5, all tools
#include "../pipeline/body.h"
#include "../solids.h"
#include "figure.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>

namespace {

const double edge = 0.12, height = 0.06;

struct Tool {
    const char *name;
    pliant_part part;
    double depth, reference; // [m], [N]; 0: none
    double x, y;             // from the middle of the block [m]
};

pliant_part sphere(double radius)
{
    return {PLIANT_PART_SPHERE, PLIANT_FRAME_TIP, {0, 0, radius}, {0, 0, 0}, radius, false, nullptr};
}
// One jaw of the prograsp forceps, lying on its outer side (contact/shapes/instruments.c).
pliant_part jaw()
{
    return {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {-0.01, 0, 0.0014}, {0.01, 0, 0.0014}, 0.0014, false, nullptr};
}
pliant_part rod(double radius, double half)
{
    return {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {-half, 0, radius}, {half, 0, radius}, radius, false, nullptr};
}

struct PressedBlock : Body {
    PressedBlock(double cell, pliant_element_kind kind, double friction)
        : Body(std::vector<int>{int(edge / cell + 0.5), int(edge / cell + 0.5), int(height / cell + 0.5)}.data(),
               std::vector<double>{edge, edge, height}.data(), {{10e3, 0.45, 1000, false}})
    {
        for (double &g : scene.model.gravity) g = 0;
        const int n = int(edge / cell + 0.5);
        cells(n, n, n / 2, 1);
        scene.element.kind = kind;
        scene.contact.friction = friction;
        scene.solver.iterations = 60;
        scene.solver.tolerance = 1e-5;
        fix_plane(0, 0, 1e-4, 0, 0, 1);
        if (build() != PLIANT_OK) std::exit((std::fprintf(stderr, "%s\n", pliant_last_error()), 1));
    }
    pliant_tool_state press(const Tool &tool)
    {
        const int steps = 8, rest = 16;
        pliant_tool_shape shape{};
        shape.num_parts = 1;
        shape.part[0] = tool.part;
        pliant_tool_state state{};
        double before = 0;
        int index;
        pliant_data_free(data);
        data = nullptr;
        if (pliant_data_create(model, &data) < 0 || pliant_tool_add(model, data, "tool", &index) < 0 ||
            pliant_tool_set_shape(data, index, &shape) < 0)
            std::exit((std::fprintf(stderr, "%s\n", pliant_last_error()), 1));
        for (int s = -1; s <= steps + rest; s++) {
            const double tip[3] = {edge / 2 + tool.x, edge / 2 + tool.y,
                                   height - tool.depth * std::fmin(1, s / double(steps))};
            pliant_tool_set_pose(data, index, tip, nullptr);
            if (pliant_step(model, data) < 0) std::exit((std::fprintf(stderr, "%s\n", pliant_last_error()), 1));
            before = state.contact_force[2];
            pliant_tool_get(data, index, &state);
        }
        state.contact_force[2] = 0.5 * (state.contact_force[2] + before);
        return state;
    }
};

} // namespace

int main(int argc, char **argv)
{
    const pliant_element_kind kind =
        argc > 1 && std::string(argv[1]) == "hexahedra" ? PLIANT_HEXAHEDRA : PLIANT_LINEAR;
    std::vector<double> cells;
    std::vector<std::string> only;
    for (int a = 2; a < argc; a++) {
        if (std::atof(argv[a]) > 0) cells.push_back(1e-3 * std::atof(argv[a]));
        else only.push_back(argv[a]);
    }
    if (cells.empty()) cells = {0.01, 0.005, 0.0025};
    std::vector<Tool> tools;
    const double radius = 0.02, depth[3] = {0.002, 0.004, 0.008}, force[3] = {0.2134, 0.5964, 1.6094};
    for (int d = 0; d < 3; d++) tools.push_back({"sphere", sphere(radius), depth[d], force[d], 0, 0});
    for (int d = 0; d < 3; d++) tools.push_back({"sphere aside", sphere(radius), depth[d], force[d], 0.0047, 0.0021});
    for (int d = 0; d < 3; d++) tools.push_back({"sphere aside", sphere(radius), depth[d], force[d], 0.0033, 0.0047});
    pliant_solid *solid = nullptr;
    pliant_solid_options options{};
    options.convex = true;
    if (rod_surface(0.015, 0.02, 96).make(options, &solid) != PLIANT_OK) return 1;
    const pliant_part punch = {PLIANT_PART_SOLID, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0}, 0, false, solid};
    const double deep[2] = {0.001, 0.003};
    const double hard[2] = {0.462, 1.314};
    for (int d = 0; d < 2; d++) tools.push_back({"punch", punch, deep[d], hard[d], 0, 0});
    for (int d = 0; d < 2; d++) tools.push_back({"punch aside", punch, deep[d], hard[d], 0.0033, 0.0047});
    for (int d = 0; d < 3; d++) tools.push_back({"cylinder", rod(0.01, 0.03), depth[d], 0, 0, 0});
    for (int d = 0; d < 3; d++) tools.push_back({"cylinder aside", rod(0.01, 0.03), depth[d], 0, 0.0021, 0.0037});
    for (int d = 0; d < 2; d++) tools.push_back({"jaw", jaw(), depth[d], 0, 0, 0});
    for (int d = 0; d < 2; d++) tools.push_back({"jaw aside", jaw(), depth[d], 0, 0.0033, 0.0047});
    int within = 0, count = 0;
    for (double cell : cells)
        for (double friction : {0.0, 0.3}) {
            PressedBlock block(cell, kind, friction);
            for (const Tool &tool : tools) {
                if (!only.empty() && std::find(only.begin(), only.end(), tool.name) == only.end()) continue;
                const pliant_tool_state state = block.press(tool);
                const double up = -state.contact_force[2];
                std::printf("%-14s depth %.0f mm, cell %.2f mm, friction %.1f: %.4f N, estimated error %.4f N",
                            tool.name, 1e3 * tool.depth, 1e3 * cell, friction, up, state.contact_force_error);
                const double error = up - tool.reference, ratio = state.contact_force_error / std::fabs(error);
                if (tool.reference > 0)
                    std::printf(", %.2f of the true error; force %+.1f %% off", ratio, 100 * error / tool.reference);
                std::printf("\n");
                within += tool.reference > 0 && ratio > 1.0 / 3 && ratio < 3;
                count += tool.reference > 0;
                std::fflush(stdout);
            }
        }
    std::printf("estimated error within a factor of 3 of the true one: %d of %d\n", within, count);
    pliant_solid_release(solid);
    return 0;
}
