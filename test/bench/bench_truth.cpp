// Cost of accuracy for hexahedra and tetrahedra of several sizes. The results are the sag of the tests' beam relative
// to the converged sag, and the CPU time to load and settle. The largest meshes take minutes.
//
// Usage:
//   bench_truth [maximum cells across the beam, default 12]
#include "../pipeline/beam.h"

#include <ctime>

namespace {

double cpu() { return double(std::clock()) / CLOCKS_PER_SEC; }

} // namespace

int main(int argc, char **argv)
{
    const int maximum = argc > 1 ? std::atoi(argv[1]) : 12;
    const double poisson[3] = {0.45, 0.49, 0.499}, converged[3] = {6.87e-3, 6.79e-3, 6.75e-3};
    std::printf("                nu   cells    nodes      sag   load [s]  settle [s]   evaluations\n");
    for (int n = 0; n < 3; n++)
        for (pliant_element_kind kind : {PLIANT_HEXAHEDRA, PLIANT_LINEAR})
            for (int across : {2, 3, 4, 6, 9, 12, 18, 24}) {
                if (across > maximum || (kind == PLIANT_HEXAHEDRA && across > 6)) continue;
                Beam beam(kind, poisson[n], across);
                beam.scene.solver.threads = 1;
                beam.scene.solver.iterations = 20;
                beam.scene.solver.tolerance = 1e-4;
                const double start = cpu();
                if (beam.build() != PLIANT_OK) return std::fprintf(stderr, "%s\n", pliant_last_error()), 1;
                const double built = cpu();
                pliant_status status = PLIANT_NOT_CONVERGED;
                int evaluations = 0;
                for (int s = 0; s < 100 && status == PLIANT_NOT_CONVERGED; s++) {
                    status = pliant_step(beam.model, beam.data);
                    evaluations += beam.data->statistics.iterations;
                }
                const double settled = cpu();
                std::printf("%-12s %5g %4.1f mm %8d %+7.1f %% %9.3f %11.3f %13d%s\n",
                            kind == PLIANT_LINEAR ? "tetrahedra" : "hexahedra", poisson[n], 30.0 / across,
                            beam.model->body->fine.num_nodes, 100 * (beam.tip_sag() / converged[n] - 1), built - start,
                            settled - built, evaluations, status == PLIANT_OK ? "" : "  not settled");
                std::fflush(stdout);
            }
    return 0;
}
