// Contact of six spheres pressed into the front of the belly and dragged along it, fine corotational: cost per frame,
// penetration depth, and forces. The forces are compared with tightly converged frames, from the first frame on, and
// each with its own frame solved tightly. Where tissue slips off a tool, its direction is sensitive, so two tight
// solves can differ, too. Errors are also reported apart for tools with a slipping contact, and for all others. A
// contact slips if its tangential force in the tightly converged frame is at least 0.999 of friction times normal
// force.
//
// Usage:
//   bench_press FOLDER [group/name=value ...]     the test data; OMP_NUM_THREADS=1 for CPU time of one thread
#include "frames.h"

#include "pliant/contact.h"
#include "sim/api/data.h"

#include <array>
#include <ctime>

namespace {

enum { TOOLS = 6, PRESS = 8, SLIDE = 10, REST = 4, FRAMES = PRESS + SLIDE + REST };
const double radius = 0.008, speed = 0.1;

struct Run {
    // (frames x tools) forces on the tissue; forces solved tightly from the same state
    std::vector<std::array<double, 3>> force, own;
    std::vector<bool> slips; // of each force: whether a contact of the tool slips
    double contact = 0, first = 0, solve = 0, deepest = 0, spent = 0;
    int32_t evaluations = 0, max_contacts = 0, refused = 0;
};

// CPU time of this thread; other threads do background work
double cpu()
{
    timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
}

// Find the foremost node near x, z of a tetrahedron with tissue; for hexahedra, of one with at least half tissue, where
// their surface is. Return false if none is near.
bool front_of(const pliant_body &body, bool hexahedra, double x, double z, double out[3])
{
    double best = 1e9;
    for (int32_t i = 0; i < 4 * body.fine.num_tets; i++) {
        const double *at = body.fine.rest + 3 * body.fine.tets[i];
        const double apart = std::hypot(at[0] - x, at[2] - z);
        if (apart > 0.02 || at[1] + 0.5 * apart > best || body.fine_material[i / 4].tissue < (hexahedra ? 0.5 : 0))
            continue;
        best = at[1] + 0.5 * apart;
        std::copy(at, at + 3, out);
    }
    return best < 1e9;
}

void append_forces(pliant_data *data, std::vector<std::array<double, 3>> *out)
{
    for (int t = 0; t < TOOLS; t++) {
        pliant_tool_state state;
        check(pliant_tool_get(data, t, &state));
        out->push_back({state.contact_force[0], state.contact_force[1], state.contact_force[2]});
    }
}

// Append, for each tool, whether a contact slips.
void append_slips(const pliant_model *model, const pliant_data *data, std::vector<bool> *out)
{
    std::vector<pliant_contact> contacts(static_cast<size_t>(pliant_data_get_contacts(data, 0, nullptr)));
    pliant_data_get_contacts(data, static_cast<int32_t>(contacts.size()), contacts.data());
    const size_t first = out->size();
    out->resize(first + TOOLS);
    for (const pliant_contact &contact : contacts) {
        const double *f = contact.force, *n = contact.normal, normal = f[0] * n[0] + f[1] * n[1] + f[2] * n[2],
                     along = std::sqrt(std::max(0.0, f[0] * f[0] + f[1] * f[1] + f[2] * f[2] - normal * normal));
        if (contact.tool >= 0 && std::fabs(normal) > 0 &&
            along >= 0.999 * model->scene.contact.friction * std::fabs(normal))
            (*out)[first + static_cast<size_t>(contact.tool)] = true;
    }
}

Run press(const pliant_model *model, const double middle[3], int iterations, double tolerance, int settle)
{
    Run run;
    pliant_data *data = nullptr, *second = nullptr;
    check(pliant_data_create(model, &data));
    check(pliant_data_set_limits(data, iterations, tolerance));
    pliant_tool_shape shape{};
    shape.num_parts = 1;
    shape.part[0].kind = PLIANT_PART_SPHERE;
    shape.part[0].radius = radius;
    double start[TOOLS][3];
    for (int t = 0; t < TOOLS; t++) {
        int tool;
        check(pliant_tool_add(model, data, ("probe" + std::to_string(t)).c_str(), &tool));
        check(pliant_tool_set_shape(data, tool, &shape));
        const double x = middle[0] + 0.04 * (t % 3 - 1), z = middle[2] + 0.04 * (t / 3 - 0.5);
        if (!front_of(*model->body, model->scene.element.kind == PLIANT_HEXAHEDRA, x, z, start[t])) {
            std::fprintf(stderr,
                         "no tissue lies within 2 cm of x %g, z %g: this scan or these cells are not the bench's\n", x,
                         z);
            std::exit(1);
        }
        start[t][1] -= radius + 0.001;
    }
    const double step = pliant_model_get_scene(model)->solver.step;
    for (int frame = 0; frame < FRAMES; frame++) {
        const double in = speed * step * std::min(frame, int(PRESS)),
                     along = 0.3 * speed * step * std::max(0, std::min(frame - PRESS, int(SLIDE)));
        for (int t = 0; t < TOOLS; t++) {
            const double tip[3] = {start[t][0] + along, start[t][1] + in, start[t][2]};
            check(pliant_tool_set_pose(data, t, tip, nullptr));
        }
        if (settle == 0) {
            check(second ? pliant_data_move(model, second, data) : pliant_data_copy(model, data, &second));
            check(pliant_data_set_limits(second, 100, 1e-6));
            check(pliant_step(model, second));
            append_forces(second, &run.own);
        }
        const double begun = cpu();
        for (int s = 0; s <= settle; s++) {
            const pliant_status status = pliant_step(model, data);
            check(status);
            if (status == PLIANT_OK) break;
        }
        run.spent += cpu() - begun;
        const pliant_statistics *statistics = pliant_data_get_statistics(data);
        // the first detection also computes the tissue's end within elements
        (frame > 0 ? run.contact : run.first) += statistics->seconds[PLIANT_STEP_contact];
        run.solve += statistics->seconds[PLIANT_STEP_solve];
        run.evaluations += statistics->iterations;
        run.max_contacts = std::max(run.max_contacts, statistics->contacts);
        run.deepest = std::max(run.deepest, statistics->penetration);
        run.refused = int32_t(statistics->rejected);
        append_forces(data, &run.force);
        append_slips(model, data, &run.slips);
    }
    pliant_data_free(second);
    pliant_data_free(data);
    return run;
}

double length(const std::array<double, 3> &f) { return std::sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]); }

enum class Which { ALL, SLIPPING, STICKING };

// Return the errors in ascending order, of forces with at least a twentieth of the maximum; may be empty.
std::vector<double> errors_of(const std::vector<std::array<double, 3>> &forces,
                              const std::vector<std::array<double, 3>> &exact, double maximum, Which which,
                              const std::vector<bool> &slips)
{
    std::vector<double> errors;
    for (size_t f = 0; f < forces.size(); f++) {
        if (which != Which::ALL && slips[f] != (which == Which::SLIPPING)) continue;
        const std::array<double, 3> apart = {forces[f][0] - exact[f][0], forces[f][1] - exact[f][1],
                                             forces[f][2] - exact[f][2]};
        if (length(exact[f]) > 0.05 * maximum) errors.push_back(100 * length(apart) / length(exact[f]));
    }
    std::sort(errors.begin(), errors.end());
    return errors;
}

} // namespace

int main(int argc, char **argv)
{
    if (argc < 2) {
        std::fprintf(stderr, "usage: bench_press FOLDER [group/name=value ...]\n");
        return 2;
    }
    Inputs inputs;
    const std::string scan = inputs.set_abdomen(argv[1]);
    inputs.scene.mesh.keep_air = false;
    inputs.scene.model.method = PLIANT_FINE;
    inputs.set_options(argc, argv, 2);
    inputs.read(scan);
    const double middle[3] = {-0.03, 0, 0.39};
    pliant_model *model = inputs.build();
    std::printf("%d tetrahedra, %d nodes, frames of %g ms\n", model->body->fine.num_tets, model->body->fine.num_nodes,
                1e3 * inputs.scene.solver.step);
    { // the same solver without contact: rotating gravity
        pliant_data *data = nullptr;
        check(pliant_data_create(model, &data));
        check(pliant_data_set_limits(data, 6, 1e-9));
        double seconds = 0, used = cpu();
        int32_t evaluations = 0;
        for (int s = 0; s < 20; s++) {
            const double gravity[3] = {9.81 * std::sin(0.05 * s), 9.81 * std::cos(0.05 * s), 0};
            check(pliant_data_set_gravity(data, gravity));
            check(pliant_step(model, data));
            seconds += pliant_data_get_statistics(data)->seconds[PLIANT_STEP_solve];
            evaluations += pliant_data_get_statistics(data)->iterations;
        }
        std::printf("without contact: %.2f ms an evaluation, %.2f ms a frame (CPU %.2f)\n", 1e3 * seconds / evaluations,
                    1e3 * seconds / 20, 1e3 * (cpu() - used) / 20);
        pliant_data_free(data);
    }
    const Run exact = press(model, middle, 100, 1e-6, 10);
    double maximum = 0;
    for (const auto &f : exact.force) maximum = std::max(maximum, length(f));
    std::printf("tightly: largest force of a tool %.3f N, deepest %.4f mm, up to %d contacts\n", maximum,
                1e3 * exact.deepest, exact.max_contacts);
    if (maximum == 0) std::printf("nothing is touched: no error to tell\n");
    for (int iterations : {3, 4, 6, 10}) {
        const Run run = press(model, middle, iterations, 1e-9, 0);
        const std::vector<double> errors = errors_of(run.force, exact.force, maximum, Which::ALL, exact.slips),
                                  own = errors_of(run.force, run.own, maximum, Which::ALL, exact.slips);
        std::printf(
            "%2d iterations: solve %.2f ms a frame (%.2f an evaluation), contact stage %.3f (the first frame's %.1f), "
            "CPU %.2f; deepest %.4f mm; force off by %.2f %% (median), %.2f (95 %%), %.2f (worst); "
            "from its own frame %.2f, %.2f, %.2f; refused %d\n",
            iterations, 1e3 * run.solve / FRAMES, 1e3 * run.solve / run.evaluations, 1e3 * run.contact / (FRAMES - 1),
            1e3 * run.first, 1e3 * run.spent / FRAMES, 1e3 * run.deepest, quantile(errors, 0.5), quantile(errors, 0.95),
            quantile(errors, 1), quantile(own, 0.5), quantile(own, 0.95), quantile(own, 1), run.refused);
        for (const Which which : {Which::SLIPPING, Which::STICKING}) {
            const std::vector<double> part = errors_of(run.force, exact.force, maximum, which, exact.slips);
            if (part.empty()) continue;
            std::printf("    %zu forces of tools %s: off by %.2f %% (median), %.2f (95 %%), %.2f (worst)\n",
                        part.size(),
                        which == Which::SLIPPING ? "with slip" : "without slip", quantile(part, 0.5),
                        quantile(part, 0.95), quantile(part, 1));
        }
    }
    pliant_model_free(model);
    return 0;
}
