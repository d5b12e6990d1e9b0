// Cost of a topology change: the stages of pliant_data_set_body, and the number of frames until the solver converges as
// before.
//
// Default: the abdomen of the test data at 256 x 160 x 122, coarse cells 7 x 7 x 7. A tool pulls at the liver while
// strokes open a slit in it, one per frame. With cut/kind=sever a blade makes the strokes, 30 mm wide and 20 mm deep,
// at random positions around the grasp.
//
// bar=DEPTH: a bar that sags under its weight is cut to this depth in one step.
// The benchmark measures how frames with six evaluations converge to the new equilibrium. For tissue that never rests,
// it measures the cost of the cut, and its first frame relative to the median frame.
//
// Usage:
//   bench_adapt [bar=DEPTH] [group/name=value ...]
#include "../pipeline/body.h"
#include "../pipeline/fragments.h"
#include "cut/cut.h"
#include "frames.h"
#include "sim/api/data.h"

#include <ctime>
#include <functional>
#include <random>

namespace {

enum { STROKES = 12, AFTER = 10 };

double cpu(clockid_t clock)
{
    timespec t;
    clock_gettime(clock, &t);
    return 1e3 * (double(t.tv_sec) + 1e-9 * double(t.tv_nsec));
}

struct Run {
    pliant_data *data = nullptr;
    int tool = -1;
    double from[3];
};

Run begin(const pliant_model *model)
{
    Run run;
    check(pliant_data_create(model, &run.data));
    check(pliant_tool_add(model, run.data, "bench", &run.tool));
    check(pliant_tool_grasp(model, run.data, run.tool, liver));
    check(pliant_tool_set_drive(run.data, run.tool, PLIANT_DRIVE_RIGID, nullptr));
    std::memcpy(run.from, run.data->tools[run.tool].tip, sizeof run.from);
    return run;
}

void move(const Run &run, int frame)
{
    double tip[3], by[3];
    offset_at(frame, by);
    for (int d = 0; d < 3; d++) tip[d] = run.from[d] + by[d];
    check(pliant_tool_set_pose(run.data, run.tool, tip, nullptr));
}

void settle(const pliant_model *model, const Run &run)
{
    pliant_status status = PLIANT_NOT_CONVERGED;
    for (int left = 20; left > 0 && status == PLIANT_NOT_CONVERGED; left--)
        check(status = pliant_step(model, run.data));
}

// Return the body after a random blade stroke in deformed space; NULL: it severs nothing.
const pliant_body *stroke_at_random(const pliant_data *data, const pliant_body *body, std::mt19937 &random)
{
    std::uniform_real_distribution<double> unit(-1, 1);
    double along[3], down[3], from[6], to[6], point[3];
    for (int d = 0; d < 3; d++)
        along[d] = unit(random), down[d] = unit(random),
        point[d] = liver[d] + 0.03 * unit(random) + (d == 1 ? 0.02 : 0);
    const double a = std::hypot(std::hypot(along[0], along[1]), along[2]),
                 b = std::hypot(std::hypot(down[0], down[1]), down[2]);
    for (int d = 0; d < 3; d++)
        for (int e = 0; e < 2; e++) {
            from[3 * e + d] = point[d] + (e ? 0.015 : -0.015) * along[d] / a - 0.01 * down[d] / b;
            to[3 * e + d] = from[3 * e + d] + 0.02 * down[d] / b;
        }
    const pliant_cut_sweep sweep{2, from, to, nullptr};
    pliant_body *next = nullptr;
    check(pliant_body_cut(body, body->revision + 1, data->positions, &sweep, &next, nullptr));
    return next;
}

double milliseconds(const std::function<void()> &what)
{
    const double start = cpu(CLOCK_MONOTONIC);
    what();
    return cpu(CLOCK_MONOTONIC) - start;
}

int bar(double depth, int argc, char **argv)
{
    const int size[3] = {56, 14, 14};
    const double box[3] = {0.28, 0.07, 0.07};
    for (pliant_preconditioner_choice choice : {PLIANT_DIRECT, PLIANT_MULTIGRID}) {
        Body fast(size, box, {{10000, 0.4, 1000, false}}), tight(size, box, {{10000, 0.4, 1000, false}});
        const Plane plane{{0.073, 0.035, 0.035}, {1, 0.05, 0.02}};
        double whole = 0, set_body = 0, first = 0;
        std::vector<double> usual;
        for (Body *body : {&fast, &tight}) {
            body->fix_plane(1e-6, 0, 0, 1, 0, 0);
            body->cells(28, 7, 7, 1);
            body->scene.cut.kind = PLIANT_CUT_SEVER; /* a GPU then carries its data over */
            body->scene.solver.preconditioner = choice;
            body->scene.solver.iterations = body == &fast ? 6 : 200;
            body->scene.solver.tolerance = 1e-7;
            body->scene.model.gravity[2] = -0.6;
            for (int a = 2; a < argc; a++) {
                const std::string option = argv[a];
                const size_t equals = std::min(option.find('='), option.size() - 1);
                check(pliant_scene_set(&body->scene, option.substr(0, equals).c_str(),
                                       option.substr(equals + 1).c_str()));
            }
            check(body->build());
            for (int s = 0; s < 40; s++) check(pliant_step(body->model, body->data));
            for (int s = 0; s < 40 && body == &fast; s++) { // it sways, and returns to its position
                const double gravity[3] = {0, s < 20 ? 0.1 * s * (19 - s) / 90 : 0, -0.6};
                check(pliant_data_set_gravity(body->data, gravity));
                const double took = milliseconds([&] { check(pliant_step(body->model, body->data)); });
                if (s > 0 && s < 19) usual.push_back(took);
            }
            const pliant_body *next =
                sever_plane(body->data->body, 2, plane, [&](const double *x) { return x[2] > 0.07 * (1 - depth); });
            if (!next) check(PLIANT_ERROR_ARGUMENT);
            const double took = milliseconds([&] { check(pliant_data_set_body(body->model, body->data, next)); });
            if (body == &fast) set_body = took;
            pliant_body_release(next);
        }
        for (int s = 0; s < 30; s++) check(pliant_step(tight.model, tight.data));
        const size_t nodes = size_t(tight.data->body->fine.num_nodes);
        whole = largest_distance(tight.data->positions, tight.data->body->fine.rest, nodes);
        std::printf("%s, %d nodes new: %.2f %% before", choice == PLIANT_DIRECT ? "factor" : "V-cycle",
                    int(nodes) - fast.model->body->fine.num_nodes,
                    100 * largest_distance(fast.data->positions, tight.data->positions, nodes) / whole);
        for (int s = 0; s < 10; s++) {
            const double took = milliseconds([&] { check(pliant_step(fast.model, fast.data)); });
            if (s == 0) first = took;
            std::printf(", %.3f", 100 * largest_distance(fast.data->positions, tight.data->positions, nodes) / whole);
        }
        std::printf("; on %s: set_body %.2f ms, first step %.2f ms, median of others %.2f ms\n",
                    pliant_data_get_backend(fast.data), set_body, first, quantile(usual, 0.5));
    }
    return 0;
}

} // namespace

int main(int argc, char **argv)
{
    if (argc > 1 && std::strncmp(argv[1], "bar=", 4) == 0) return bar(std::atof(argv[1] + 4), argc, argv);
    Inputs inputs;
    pliant_scene &scene = inputs.scene;
    const std::string scan = inputs.set_abdomen(PLIANT_TEST_DATA);
    scene.mesh.ratio = 2;
    scene.model.method = PLIANT_FINE;
    scene.solver.iterations = 6;
    scene.solver.tolerance = 1e-6;
    inputs.set_options(argc, argv, 1);
    inputs.read(scan);
    pliant_model *model = inputs.build();
    std::printf("%d fine tetrahedra, %d nodes, %d solved\n", model->body->fine.num_tets, model->body->fine.num_nodes,
                model->system ? model->system->num_free : 0);
    Run fast = begin(model), tight = begin(model);
    check(pliant_data_set_limits(tight.data, 60, 1e-8));
    std::vector<double> thread, process, wall, step_ms, cut_ms, first_error, usual;
    std::mt19937 random(11);
    std::vector<int8_t> sides;
    const pliant_body *body = pliant_body_retain(model->body);
    const Plane plane{{liver[0] + 0.004, liver[1], liver[2]}, {0.96, 0.2, 0.19}};
    const int frames = STROKES + 10 + AFTER;
    double whole = 0;
    std::printf("frame  touched  new nodes   set_body [ms]: thread, process, wall   evaluations   error\n");
    for (int f = 1; f <= frames; f++) {
        move(fast, f);
        move(tight, f);
        const int stroke = f - 11;
        if (stroke >= 0 && stroke < STROKES) {
            auto reaches = [&](const double *x) {
                return std::fabs(x[2] - liver[2]) < 0.015 && x[1] - liver[1] < -0.02 + 0.008 * stroke;
            };
            const pliant_body *next = nullptr;
            while (!next)
                next = scene.cut.kind == PLIANT_CUT_SEVER
                           ? stroke_at_random(fast.data, body, random)
                           : sever_plane(body, body->revision + 1, plane, reaches, &sides);
            const double t0 = cpu(CLOCK_THREAD_CPUTIME_ID), p0 = cpu(CLOCK_PROCESS_CPUTIME_ID),
                         w0 = cpu(CLOCK_MONOTONIC);
            check(pliant_data_set_body(model, fast.data, next));
            const double t1 = cpu(CLOCK_THREAD_CPUTIME_ID), p1 = cpu(CLOCK_PROCESS_CPUTIME_ID),
                         w1 = cpu(CLOCK_MONOTONIC);
            check(pliant_data_set_body(model, tight.data, next));
            if (next->changes.num_touched > 0)
                thread.push_back(t1 - t0), process.push_back(p1 - p0), wall.push_back(w1 - w0);
            std::printf("%4d %7d %7d        %8.2f %8.2f %8.2f", f, next->changes.num_touched,
                        next->fine.num_nodes - body->fine.num_nodes, t1 - t0, p1 - p0, w1 - w0);
            pliant_body_release(body);
            body = next;
        } else {
            std::printf("%4d                                                  ", f);
        }
        const double s0 = cpu(CLOCK_THREAD_CPUTIME_ID);
        check(pliant_step(model, fast.data));
        step_ms.push_back(cpu(CLOCK_THREAD_CPUTIME_ID) - s0);
        (stroke >= 0 && stroke < STROKES ? cut_ms : usual).push_back(step_ms.back());
        settle(model, tight);
        const size_t nodes = size_t(body->fine.num_nodes);
        whole = std::max(whole, largest_distance(tight.data->positions, body->fine.rest, nodes));
        const double error = 100 * largest_distance(fast.data->positions, tight.data->positions, nodes) / whole;
        if (stroke >= 0 && stroke < STROKES) first_error.push_back(error);
        std::printf("   %2d   %7.3f %%  step %6.2f ms of its thread  residual %.1e factors %llu\n",
                    fast.data->statistics.iterations, error, step_ms.back(), fast.data->statistics.residual,
                    (unsigned long long)fast.data->statistics.factors);
    }
    std::printf(
        "median of set_body [ms]: thread %.2f, process %.2f, wall %.2f; step of the thread [ms]: after a stroke %.2f, "
        "others %.2f; worst error after a stroke %.3f %%\n",
        quantile(thread, 0.5), quantile(process, 0.5), quantile(wall, 0.5), quantile(cut_ms, 0.5), quantile(usual, 0.5),
        quantile(first_error, 1));
    pliant_body_release(body);
    pliant_data_free(fast.data);
    pliant_data_free(tight.data);
    pliant_model_free(model);
    return 0;
}
