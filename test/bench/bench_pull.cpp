// Discretization error of a pull with tetrahedra and hexahedra. On the lattice of every ratio, a point is moved, or
// pulled by one force, until equilibrium. Results are compared at the nodes of the coarsest lattice with the finest
// ratio of either kind. A lattice with ratio 8 takes minutes.
//
// Usage:
//   bench_pull SCENE SCAN X Y Z [group/name=value ...] [ratios=2,4,8] [pull=0.004,-0.029,0.006] [steps=6]
//              [force=0] [methods=] [dump=FOLDER]
//
// force=1: apply the force of the first model, hexahedra of the finest ratio
// methods: also coarse models of the coarsest ratio's cubes, composed of the finest ones
// dump: write rest positions, positions, fixed flags and tissue of nodes as text
#include "frames.h"
#include "mesh/mesh.h"

#include <fstream>
#include <map>
#include <memory>
#include <sstream>

namespace {

struct Pulled {
    pliant_model *model = nullptr;
    std::string name;
    int ratio;
    std::vector<double> positions;
    double force[3] = {0, 0, 0};
};

const char *name_of(pliant_element_kind kind) { return kind == PLIANT_LINEAR ? "tetrahedra" : "hexahedra"; }

std::vector<double> numbers(const std::string &text)
{
    std::vector<double> out;
    std::stringstream stream(text);
    for (std::string one; std::getline(stream, one, ',');) out.push_back(std::atof(one.c_str()));
    return out;
}

void settle(Pulled *run, const double at[3], const std::vector<double> &pull, int steps, const double *force)
{
    pliant_data *data = nullptr;
    int tool = -1, evaluations = 0;
    double from[3];
    check(pliant_data_create(run->model, &data));
    check(pliant_tool_add(run->model, data, "bench", &tool));
    check(pliant_tool_grasp(run->model, data, tool, at));
    std::copy(data->tools[tool].tip, data->tools[tool].tip + 3, from);
    pliant_status status = PLIANT_OK;
    for (int s = 1; s <= steps; s++) {
        double tip[3], part[3] = {0, 0, 0};
        for (int d = 0; d < 3; d++) {
            tip[d] = from[d] + pull[size_t(d)] * s / steps;
            if (force) part[d] = force[d] * s / steps;
        }
        check(pliant_tool_set_pose(data, tool, tip, nullptr));
        check(pliant_tool_set_drive(data, tool, force ? PLIANT_DRIVE_FORCE : PLIANT_DRIVE_RIGID, part));
        status = PLIANT_NOT_CONVERGED;
        for (int left = 40; left > 0 && status == PLIANT_NOT_CONVERGED; left--) {
            check(status = pliant_step(run->model, data));
            evaluations += data->statistics.iterations;
        }
    }
    run->positions.assign(data->positions, data->positions + 3 * size_t(run->model->body->fine.num_nodes));
    std::copy(data->tools[tool].force, data->tools[tool].force + 3, run->force);
    std::printf(
        "%-10s ratio %d: %7d nodes, %d nodes held, force %.2f N, held point moves by %.2f mm, %d evaluations%s\n",
        run->name.c_str(), run->ratio, run->model->body->fine.num_nodes, data->tools[tool].num_held,
        std::hypot(std::hypot(run->force[0], run->force[1]), run->force[2]),
        1e3 *
            std::hypot(std::hypot(data->tools[tool].held_point[0] - from[0], data->tools[tool].held_point[1] - from[1]),
                       data->tools[tool].held_point[2] - from[2]),
        evaluations, status == PLIANT_OK ? "" : ", not settled");
    std::fflush(stdout);
    pliant_data_free(data);
}

// Compare at the nodes of the coarsest lattice that both have, at a distance of at least `beyond` from a point.
void compare(const Pulled &run, const Pulled &fine, const pliant_mesh &coarsest, const double at[3])
{
    std::vector<double> apart[2];
    for (int32_t n = 0; n < coarsest.num_nodes; n++) {
        const int32_t a = pliant_mesh_node_in(&run.model->body->fine, &coarsest, n),
                      b = pliant_mesh_node_in(&fine.model->body->fine, &coarsest, n);
        if (a < 0 || b < 0) continue;
        const double *x = &run.positions[3 * size_t(a)], *y = &fine.positions[3 * size_t(b)],
                     *rest = coarsest.rest + 3 * n;
        const double error = std::hypot(std::hypot(x[0] - y[0], x[1] - y[1]), x[2] - y[2]);
        apart[0].push_back(error);
        if (std::hypot(std::hypot(rest[0] - at[0], rest[1] - at[1]), rest[2] - at[2]) > 0.04) apart[1].push_back(error);
    }
    std::printf(
        "  %-10s ratio %d against %-10s ratio %d, %zu nodes: median %.3f, 95 %% %.3f, largest %.2f mm; "
        "beyond 4 cm of the hold %.3f, %.3f, %.2f mm\n",
        run.name.c_str(), run.ratio, fine.name.c_str(), fine.ratio, apart[0].size(), 1e3 * quantile(apart[0], 0.5),
        1e3 * quantile(apart[0], 0.95), 1e3 * quantile(apart[0], 1), 1e3 * quantile(apart[1], 0.5),
        1e3 * quantile(apart[1], 0.95), 1e3 * quantile(apart[1], 1));
}

void dump(const std::string &folder, const Pulled &run)
{
    const pliant_mesh &mesh = run.model->body->fine;
    std::vector<double> tissue(size_t(mesh.num_nodes), 0);
    for (int32_t v = 0; v < 4 * mesh.num_tets; v++)
        tissue[size_t(mesh.tets[v])] =
            std::max<double>(tissue[size_t(mesh.tets[v])], run.model->body->fine_material[v / 4].tissue);
    std::ofstream out(folder + "/" + run.name + std::to_string(run.ratio) + ".txt");
    for (int32_t n = 0; n < mesh.num_nodes; n++) {
        for (int d = 0; d < 3; d++) out << mesh.rest[3 * n + d] << ' ';
        for (int d = 0; d < 3; d++) out << run.positions[3 * size_t(n) + size_t(d)] << ' ';
        out << int(run.model->body->fine_fixed[n]) << ' ' << tissue[size_t(n)] << '\n';
    }
}

} // namespace

int main(int argc, char **argv)
{
    if (argc < 6) {
        std::fprintf(
            stderr,
            "usage: bench_pull SCENE SCAN X Y Z [group/name=value ...] [ratios=2,4,8] [pull=...] [steps=6] [force=0] "
            "[dump=FOLDER]\n");
        return 2;
    }
    std::map<std::string, std::string> own = {{"ratios", "2,4,8"}, {"pull", "0.004,-0.029,0.006"},
                                              {"steps", "6"},      {"force", "0"},
                                              {"methods", ""},     {"dump", ""}};
    Inputs inputs;
    check(pliant_scene_read(argv[1], &inputs.scene));
    inputs.scene.solver.iterations = 60;
    inputs.scene.solver.tolerance = 1e-4;
    inputs.scene.grasp.radius = 0.012;
    inputs.scene.mesh.keep_air = false;
    for (int a = 6; a < argc; a++) {
        const std::string option = argv[a], name = option.substr(0, option.find('='));
        if (own.count(name)) own[name] = option.substr(option.find('=') + 1);
        else inputs.set_options(a + 1, argv, a);
    }
    inputs.read(argv[2]);
    const double at[3] = {std::atof(argv[3]), std::atof(argv[4]), std::atof(argv[5])};
    const std::vector<double> ratios = numbers(own["ratios"]), pull = numbers(own["pull"]);
    const std::vector<int> cells(inputs.scene.mesh.coarse_cells, inputs.scene.mesh.coarse_cells + 3);
    std::vector<Pulled> runs;
    auto one = [&](const std::string &name, int ratio) {
        Pulled run;
        run.name = name;
        run.ratio = ratio;
        run.model = inputs.build();
        settle(&run, at, pull, std::atoi(own["steps"].c_str()),
               own["force"] == "1" && !runs.empty() ? runs[0].force : nullptr);
        if (!own["dump"].empty()) dump(own["dump"], run);
        runs.push_back(run);
    };
    for (size_t r = ratios.size(); r-- > 0;)
        for (pliant_element_kind kind : {PLIANT_HEXAHEDRA, PLIANT_LINEAR}) {
            inputs.scene.element.kind = kind;
            inputs.scene.mesh.ratio = int(ratios[r]);
            one(name_of(kind), int(ratios[r]));
        }
    std::stringstream methods(own["methods"]);
    for (std::string name; std::getline(methods, name, ',');) {
        inputs.scene.element.kind = PLIANT_HEXAHEDRA;
        for (int d = 0; d < 3; d++) inputs.scene.mesh.coarse_cells[d] = cells[d] * int(ratios[0]);
        inputs.scene.mesh.ratio = int(ratios.back() / ratios[0]);
        inputs.set("model/method", name);
        one(name, int(ratios[0]));
    }
    const pliant_mesh &coarsest = runs[2 * ratios.size() - 1].model->body->fine;
    for (const Pulled &run : runs)
        for (int fine = 0; fine < 2; fine++)
            if (&run != &runs[size_t(fine)]) compare(run, runs[size_t(fine)], coarsest, at);
    for (Pulled &run : runs) pliant_model_free(run.model);
    return 0;
}
