// Cost of a cut on one thread: pliant_body_cut with a blade of 30 mm that moves by 1 mm. The body is the deformed
// abdomen of the test data (256 x 160 x 122 voxels, 13,720 tetrahedra). First each stroke cuts the initial
// body, then successive strokes cut one body.
//
// The mesh quality is reported after 1, 10 and 100 cuts, relative to the initial mesh: smallest edge, height and volume
// of a tetrahedron, and the stable explicit step. With cut/kind=subdivide sweep=0.06, strokes pass through whole
// tetrahedra at once.
//
// Usage:
//   bench_cut [strokes] [sweep=metres] [group/name=value ...]
#include "cut/cut.h"
#include "fem/dynamics/tled.h"
#include "frames.h"
#include "mesh/mesh.h"

#include <ctime>
#include <random>

namespace {

double cpu()
{
    timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return 1e3 * (double(t.tv_sec) + 1e-9 * double(t.tv_nsec));
}

// Compute a smooth deformation of about a centimetre.
void deform(const double x[3], double out[3])
{
    out[0] = x[0] + 0.010 * std::sin(20 * x[1] + 1);
    out[1] = x[1] + 0.008 * std::sin(25 * x[2] + 2);
    out[2] = x[2] + 0.010 * std::sin(18 * x[0] + 3);
}

struct Blade {
    std::vector<double> from, to;
};

// Return a blade that starts at a node surrounded by tissue, in a random direction, sampled every half voxel.
Blade blade(const pliant_body *body, const std::vector<double> &positions, double sweep, std::mt19937 &random)
{
    std::uniform_real_distribution<double> unit(-1, 1);
    int32_t tet = 0;
    do tet = static_cast<int32_t>(random() % static_cast<unsigned>(body->fine.num_tets));
    while (body->fine_material[tet].tissue < 1);
    const double *middle = positions.data() + 3 * body->fine.tets[4 * tet];
    double along[3], ahead[3], a = 0, b = 0;
    for (int d = 0; d < 3; d++) {
        along[d] = unit(random);
        ahead[d] = unit(random);
        a += along[d] * along[d];
        b += ahead[d] * ahead[d];
    }
    Blade out;
    const int points = 41;
    for (int p = 0; p < points; p++)
        for (int d = 0; d < 3; d++) {
            const double at = middle[d] + 0.03 * (p / (points - 1.0) - 0.5) * along[d] / std::sqrt(a);
            out.from.push_back(at);
            out.to.push_back(at + sweep * ahead[d] / std::sqrt(b));
        }
    return out;
}

struct Minima {
    double edge, height, volume, step;
};

Minima minima_of(const pliant_body *body)
{
    const pliant_mesh &mesh = body->fine;
    pliant_tled_system system{};
    system.mesh = &mesh;
    check(pliant_tled_find_bounds(body, &system));
    Minima out{1, 1, 1, std::fmin(system.edge_bound, system.eigenvalue_bound)};
    for (int32_t t = 0; t < mesh.num_tets; t++) {
        double gradients[12];
        out.volume = std::fmin(out.volume, pliant_mesh_gradients(&mesh, t, gradients));
        out.edge = std::fmin(out.edge, pliant_tled_shortest_edge(&mesh, mesh.tets + 4 * t));
        for (int v = 0; v < 4; v++)
            out.height = std::fmin(out.height, 1 / std::sqrt(gradients[3 * v] * gradients[3 * v] +
                                                             gradients[3 * v + 1] * gradients[3 * v + 1] +
                                                             gradients[3 * v + 2] * gradients[3 * v + 2]));
    }
    return out;
}

} // namespace

int main(int argc, char **argv)
{
    const int strokes = argc > 1 ? std::atoi(argv[1]) : 100;
    const bool sweeps = argc > 2 && std::string(argv[2]).compare(0, 6, "sweep=") == 0;
    const double sweep = sweeps ? std::atof(argv[2] + 6) : 0.001;
    Inputs inputs;
    const std::string scan = inputs.set_abdomen(PLIANT_TEST_DATA);
    inputs.set("cut/kind", "sever");
    inputs.scene.mesh.ratio = 2;
    inputs.scene.model.method = PLIANT_FINE;
    inputs.scene.solver.threads = 1;
    inputs.set_options(argc, argv, sweeps ? 3 : 2);
    inputs.read(scan);
    pliant_model *model = inputs.build();
    std::printf("%zu voxels, %d tetrahedra, %d nodes, %d bridges\n", pliant_geometry_voxels(&inputs.scan.geometry),
                model->body->fine.num_tets, model->body->fine.num_nodes,
                model->body->voxels ? model->body->voxels->num_bridges : 0);
    const Minima load = minima_of(model->body);
    std::mt19937 random(3);
    for (int chain = 0; chain < 2; chain++) {
        const pliant_body *body = pliant_body_retain(model->body);
        std::vector<double> all, sever, touched, links;
        for (int s = 0; s < strokes; s++) {
            std::vector<double> positions(3 * static_cast<size_t>(body->fine.num_nodes));
            for (int32_t n = 0; n < body->fine.num_nodes; n++)
                deform(body->fine.rest + 3 * n, positions.data() + 3 * n);
            const Blade edge = blade(model->body, positions, sweep, random);
            const pliant_cut_sweep sweep{static_cast<int32_t>(edge.from.size() / 3), edge.from.data(), edge.to.data(),
                                         nullptr};
            pliant_cut_report report;
            pliant_body *next = nullptr;
            const double t0 = cpu();
            check(pliant_body_cut(body, body->revision + 1, positions.data(), &sweep, nullptr, &report));
            const double t1 = cpu();
            check(pliant_body_cut(body, body->revision + 1, positions.data(), &sweep, &next, &report));
            const double t2 = cpu();
            if (!next) continue;
            sever.push_back(t1 - t0);
            all.push_back(t2 - t1);
            touched.push_back(report.touched);
            links.push_back(report.num_links);
            if (chain) {
                pliant_body_release(body);
                body = next;
                if (all.size() == 1 || all.size() == 10 || all.size() == 100) {
                    const Minima now = minima_of(body);
                    std::printf(
                        "after %zu: %d tetrahedra, %d pieces; of those at load: shortest edge %.3g %%, "
                        "least height %.3g %%, least volume %.3g %%, explicit step %.3g %%\n",
                        all.size(), body->fine.num_tets, report.pieces, 100 * now.edge / load.edge,
                        100 * now.height / load.height, 100 * now.volume / load.volume, 100 * now.step / load.step);
                }
            } else {
                pliant_body_release(next);
            }
        }
        std::printf(
            "%s: %zu strokes, median of %.0f links and %.0f tetrahedra; report alone %.2f ms (worst %.2f), "
            "next body %.2f ms (worst %.2f)\n",
            chain ? "one after the other" : "each on the body at load", all.size(), quantile(links, 0.5),
            quantile(touched, 0.5), quantile(sever, 0.5), quantile(sever, 1), quantile(all, 0.5), quantile(all, 1));
        pliant_body_release(body);
    }
    pliant_model_free(model);
    return 0;
}
