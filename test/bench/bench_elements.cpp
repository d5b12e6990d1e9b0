// Cost of an evaluation of hexahedra relative to tetrahedra on the same nodes: both models alternately, minimum CPU
// time of each part.
//
// Usage:
//   bench_elements SCENE SCAN [group/name=value ...]
#include "frames.h"

#include "fem/system.h"

#include <ctime>
#include <functional>

namespace {

double cpu_time()
{
    timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

struct Side {
    pliant_model *model = nullptr;
    std::vector<double> x, right, out;
    std::vector<double> forces; // forces of elements
    std::vector<pliant_tangent> tangents;
};

} // namespace

int main(int argc, char **argv)
{
    if (argc < 3) {
        std::fprintf(stderr, "usage: bench_elements SCENE SCAN [group/name=value ...]\n");
        return 2;
    }
    Inputs inputs;
    check(pliant_scene_read(argv[1], &inputs.scene));
    inputs.set("solver/threads", "1");
    inputs.set_options(argc, argv, 3);
    inputs.read(argv[2]);
    Side sides[2];
    for (int kind = 0; kind < 2; kind++) {
        Side &side = sides[kind];
        inputs.scene.element.kind = kind ? PLIANT_HEXAHEDRA : PLIANT_LINEAR;
        side.model = inputs.build();
        const pliant_system *system = side.model->system;
        const pliant_mesh *mesh = system->mesh;
        side.x.assign(mesh->rest, mesh->rest + 3 * mesh->num_nodes);
        for (size_t i = 0; i < side.x.size(); i++)
            side.x[i] += 2e-3 * std::sin(40 * mesh->rest[(i * 7) % side.x.size()]);
        side.right.assign(3 * size_t(system->num_free), 1);
        side.out = side.right;
        side.forces.resize(size_t(system->num_blocks) * 12 * LANES);
        side.tangents.resize(size_t(system->num_blocks));
        std::printf("%s: %d nodes, %d free, %.1f MB of factor, condition of the matrix %.3g\n",
                    kind ? "hexahedra" : "tetrahedra", mesh->num_nodes, system->num_free,
                    1e-6 * double(pliant_preconditioner_bytes(system->preconditioner)),
                    pliant_preconditioner_condition(system->preconditioner));
    }
    using blocks = double (*)[12][LANES];
    const struct {
        const char *name;
        std::function<void(Side &)> run;
    } parts[] = {
        {"forces", [](Side &s) { pliant_system_element_forces(s.model->system, s.x.data(), blocks(s.forces.data())); }},
        {"gather", [](Side &s) { pliant_system_gather(s.model->system, blocks(s.forces.data()), s.out.data()); }},
        {"solve",
         [](Side &s) {
             check(pliant_preconditioner_solve(s.model->system->preconditioner, 1, s.right.data(), s.out.data()));
         }},
        {"refresh",
         [](Side &s) {
             pliant_system_tangents(s.model->system, s.x.data(), PLIANT_TWIST_POSITIVE, s.tangents.data());
             check(pliant_preconditioner_numeric(s.model->system->preconditioner, s.tangents.data()));
         }},
    };
    double evaluation[2] = {0, 0};
    for (const auto &part : parts) {
        double minimum[2] = {1e9, 1e9};
        for (int turn = 0; turn < 9; turn++)
            for (int kind = 0; kind < 2; kind++) {
                const double begin = cpu_time();
                part.run(sides[kind]);
                minimum[kind] = std::min(minimum[kind], cpu_time() - begin);
            }
        std::printf("%-10s %9.3f %9.3f ms  %.2f\n", part.name, 1e3 * minimum[0], 1e3 * minimum[1],
                    minimum[1] / minimum[0]);
        for (int kind = 0; kind < 2 && &part != parts + 3; kind++) evaluation[kind] += minimum[kind];
    }
    std::printf("%-10s %9.3f %9.3f ms  %.2f\n", "evaluation", 1e3 * evaluation[0], 1e3 * evaluation[1],
                evaluation[1] / evaluation[0]);
    for (Side &side : sides) pliant_model_free(side.model);
    return 0;
}
