// Contact force of rigid tools on coarse cells, and its estimated error, against references.
//
// A tool is pressed into a block of 10 kPa and nu 0.45, whose bottom is fixed. References have the same law and no
// friction. For spheres and punches they are axisymmetric (test/reference/indentation.py). For the cylinder and the jaw
// of an instrument they are three-dimensional (test/reference/pressed_block.py). The force is the mean of the last two
// steps, because contact points of some hexahedra alternate between steps.
//
// Usage:
//   bench_force [element/kind] [element/law] [cell ...] [tool ...]     cells in mm; default: linear corotational
//                                                                      10 5 2.5, all tools
//   bench_force calibrate     other tools on another block; fit the constants of src/sim/api/contact_error.c
#include "../pipeline/body.h"
#include "../solids.h"
#include "figure.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <memory>

namespace
{

const double height = 0.06;

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
    double edge;
    PressedBlock(double edge, double cell, pliant_element_kind kind, pliant_elasticity law, double friction)
        : Body(std::vector<int>{int(edge / cell + 0.5), int(edge / cell + 0.5), int(height / cell + 0.5)}.data(),
               std::vector<double>{edge, edge, height}.data(), {{10e3, 0.45, 1000, false}}),
          edge(edge)
    {
        for (double &g : scene.model.gravity) g = 0;
        const int n = int(edge / cell + 0.5);
        cells(n, n, int(height / cell + 0.5), 1);
        scene.element.kind = kind;
        scene.element.law = law;
        scene.contact.friction = friction;
        scene.solver.iterations = 60;
        scene.solver.tolerance = 1e-5;
        fix_plane(0, 0, 1e-4, 0, 0, 1);
        if (build() != PLIANT_OK) std::exit((std::fprintf(stderr, "%s\n", pliant_last_error()), 1));
    }
    // Press a tool and hold it still. spread: (largest - smallest) / smallest force of the last eight steps.
    pliant_tool_state press(const Tool &tool, double &spread)
    {
        const int steps = 8, rest = 16;
        pliant_tool_shape shape{};
        shape.num_parts = 1;
        shape.part[0] = tool.part;
        pliant_tool_state state{};
        double before = 0, low = INFINITY, high = 0;
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
            if (s <= steps + rest - 8) continue;
            low = std::fmin(low, -state.contact_force[2]), high = std::fmax(high, -state.contact_force[2]);
        }
        state.contact_force[2] = 0.5 * (state.contact_force[2] + before);
        spread = high / low - 1;
        return state;
    }
};

pliant_part punch(double radius)
{
    static std::vector<std::shared_ptr<pliant_solid>> made;
    pliant_solid *solid = nullptr;
    pliant_solid_options options{};
    options.convex = true;
    if (rod_surface(radius, 0.02, 96).make(options, &solid) != PLIANT_OK) std::exit(1);
    made.emplace_back(solid, pliant_solid_release);
    return {PLIANT_PART_SOLID, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0}, 0, false, solid};
}

// Estimated and true errors, relative to the true force.
struct Errors {
    int count = 0, within = 0, below = 0, varying = 0;
    std::vector<double> missing, error;
    void add(double estimate, double fraction, double truth, double spread)
    {
        const double ratio = estimate / std::fabs(truth);
        count++, within += ratio > 1.0 / 3 && ratio<3, below += ratio >= 0.5, varying += spread> 1e-3;
        missing.push_back(fraction), error.push_back(truth);
    }
    void print() const
    {
        std::printf("estimated error: within a factor of 3 of the true one in %d of %d; at least half of it in %d\n"
                    "force that varies by more than 0.1 %% at rest: %d\n",
                    within, count, below, varying);
    }
    // Print the most likely constants: the variance of a relative error is (of_depth * missing)^2 + of_rest^2.
    void fit() const
    {
        double best = INFINITY, found[2] = {0, 0};
        for (double of_depth = 0; of_depth < 0.5; of_depth += 0.002)
            for (double of_rest = 0.002; of_rest < 0.1; of_rest += 0.001) {
                double sum = 0;
                for (size_t n = 0; n < error.size(); n++) {
                    const double deviation = std::hypot(of_depth * missing[n], of_rest), z = error[n] / deviation;
                    sum += std::log(deviation) + 0.5 * z * z;
                }
                if (sum < best) best = sum, found[0] = of_depth, found[1] = of_rest;
            }
        std::printf("fitted: of_depth %.3f, of_rest %.3f\n", found[0], found[1]);
    }
};

void measure(PressedBlock &block, const Tool &tool, const char *label, Errors &all, Errors &out)
{
    double spread;
    const pliant_tool_state state = block.press(tool, spread);
    const double up = -state.contact_force[2];
    std::printf("%-14s %s, depth %.1f mm: %.4f N, varies by %.2f %%, estimated error %.4f N", tool.name, label,
                1e3 * tool.depth, up, 100 * spread, state.contact_force_error);
    if (tool.reference > 0) {
        const double error = up / tool.reference - 1, estimate = state.contact_force_error / tool.reference;
        std::printf(", %.2f of the true error; force %+.1f %% off", estimate / std::fabs(error), 100 * error);
        for (Errors *to : {&all, &out}) to->add(estimate, block.data->tools[0].proxy.missing.fraction, error, spread);
    }
    std::printf("\n");
    std::fflush(stdout);
}

std::vector<Tool> table(pliant_elasticity law)
{
    std::vector<Tool> out;
    const double depth[3] = {0.002, 0.004, 0.008}, deep[2] = {0.001, 0.003}, sunk[3] = {0.001, 0.002, 0.004};
    const double forces[2][3] = {{0.2134, 0.5964, 1.6094}, {0.2279, 0.6628, 1.9286}}, // corotational, neo-Hookean
        punches[2][2] = {{0.462, 1.314}, {0.476, 1.434}}, cylinders[2][3] = {{0.785, 1.736, 3.723}, {0, 0, 0}},
                 jaws[2][3] = {{0.0986, 0, 0}, {0, 0, 0}}; // 0: none
    const double *force = forces[law], *hard = punches[law], *wide = cylinders[law], *narrow = jaws[law];
    const pliant_part ball = sphere(0.02), flat = punch(0.015), cylinder = rod(0.01, 0.03);
    for (int d = 0; d < 3; d++) out.push_back({"sphere", ball, depth[d], force[d], 0, 0});
    for (int d = 0; d < 3; d++) out.push_back({"sphere aside", ball, depth[d], force[d], 0.0047, 0.0021});
    for (int d = 0; d < 3; d++) out.push_back({"sphere aside", ball, depth[d], force[d], 0.0033, 0.0047});
    for (int d = 0; d < 2; d++) out.push_back({"punch", flat, deep[d], hard[d], 0, 0});
    for (int d = 0; d < 2; d++) out.push_back({"punch aside", flat, deep[d], hard[d], 0.0033, 0.0047});
    for (int d = 0; d < 3; d++) out.push_back({"cylinder", cylinder, depth[d], wide[d], 0, 0});
    for (int d = 0; d < 3; d++) out.push_back({"cylinder aside", cylinder, depth[d], wide[d], 0.0021, 0.0037});
    for (int d = 0; d < 3; d++) out.push_back({"jaw", jaw(), sunk[d], narrow[d], 0, 0});
    for (int d = 0; d < 3; d++) out.push_back({"jaw aside", jaw(), sunk[d], narrow[d], 0.0033, 0.0047});
    return out;
}

// Press other tools into a block of 140 x 140 x 60 mm, whose cells are 10 mm, at six places with and without friction.
void calibrate()
{
    const pliant_part small = sphere(0.012), middle = sphere(0.035), large = sphere(0.06), narrow = punch(0.01),
                      wide = punch(0.025);
    const Tool tools[] = {{"sphere 12", small, 0.0015, 0.1029, 0, 0}, {"sphere 12", small, 0.003, 0.2825, 0, 0},
                          {"sphere 12", small, 0.005, 0.5785, 0, 0},  {"sphere 35", middle, 0.002, 0.3015, 0, 0},
                          {"sphere 35", middle, 0.005, 1.2279, 0, 0}, {"sphere 35", middle, 0.01, 3.4820, 0, 0},
                          {"sphere 60", large, 0.002, 0.4212, 0, 0},  {"sphere 60", large, 0.006, 2.3996, 0, 0},
                          {"punch 10", narrow, 0.001, 0.2834, 0, 0},  {"punch 10", narrow, 0.0025, 0.6725, 0, 0},
                          {"punch 25", wide, 0.001, 0.9418, 0, 0},    {"punch 25", wide, 0.004, 3.5349, 0, 0}};
    Errors all;
    for (pliant_element_kind kind : {PLIANT_LINEAR, PLIANT_HEXAHEDRA}) {
        PressedBlock smooth(0.14, 0.01, kind, PLIANT_ELASTICITY_COROTATIONAL, 0),
            rough(0.14, 0.01, kind, PLIANT_ELASTICITY_COROTATIONAL, 0.3);
        Errors errors;
        for (const Tool &tool : tools)
            for (int n = 0; n < 6; n++) {
                Tool moved = tool; // to points that fill the square of a cell evenly
                moved.x = n > 0 ? 0.01 * (std::fmod(0.7549 * n, 1) - 0.5) : 0;
                moved.y = n > 0 ? 0.01 * (std::fmod(0.5698 * n, 1) - 0.5) : 0;
                measure(n % 2 ? rough : smooth, moved, kind == PLIANT_LINEAR ? "tetrahedra" : "hexahedra", all, errors);
            }
        errors.print();
    }
    all.fit();
}

} // namespace

int main(int argc, char **argv)
{
    if (argc > 1 && std::string(argv[1]) == "calibrate") return calibrate(), 0;
    pliant_element_kind kind = PLIANT_LINEAR;
    pliant_elasticity law = PLIANT_ELASTICITY_COROTATIONAL;
    std::vector<double> cells;
    std::vector<std::string> only;
    for (int a = 1; a < argc; a++) {
        const std::string word = argv[a];
        if (std::atof(argv[a]) > 0) cells.push_back(1e-3 * std::atof(argv[a]));
        else if (word == "hexahedra") kind = PLIANT_HEXAHEDRA;
        else if (word == "neo_hookean") law = PLIANT_ELASTICITY_NEO_HOOKEAN;
        else if (word != "linear" && word != "corotational") only.push_back(word);
    }
    if (cells.empty()) cells = {0.01, 0.005, 0.0025};
    const std::vector<Tool> tools = table(law);
    Errors all;
    for (double cell : cells) {
        Errors errors;
        for (double friction : {0.0, 0.3}) {
            PressedBlock block(0.12, cell, kind, law, friction);
            char label[60];
            std::snprintf(label, sizeof label, "cell %.2f mm, friction %.1f", 1e3 * cell, friction);
            for (const Tool &tool : tools)
                if (only.empty() || std::find(only.begin(), only.end(), tool.name) != only.end())
                    measure(block, tool, label, all, errors);
        }
        errors.print();
    }
    all.print();
    return 0;
}
