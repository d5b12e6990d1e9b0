// Compare the error estimate of a step with the true error, on the bodies and loads of error_estimates.h. The result
// is the fraction of frames within a factor of three.
//
// Usage:
//   bench_error_estimates [SCENE or all] [group/name=value ...]     with -v: each frame outside this factor
#include "../pipeline/error_estimates.h"

int main(int argc, char **argv)
{
    const std::string wanted = argc > 1 ? argv[1] : "all";
    bool verbose = false;
    std::vector<std::string> options;
    for (int a = 2; a < argc; a++) {
        const std::string option = argv[a];
        const size_t equals = option.find('=');
        if (option == "-v") verbose = true;
        else
            options.insert(options.end(),
                           {option.substr(0, equals), equals == std::string::npos ? "" : option.substr(equals + 1)});
    }
    error_estimates::Counts whole;
    for (const error_estimates::Scene &scene : error_estimates::scenes()) {
        if (wanted != "all" && wanted != scene.name) continue;
        error_estimates::Counts counts;
        std::string by_load;
        for (size_t move = 0; move < scene.moves.size(); move++) {
            const std::vector<std::vector<double>> right = error_estimates::solve_tightly(scene, move, options);
            error_estimates::Counts of_load;
            for (pliant_preconditioner_choice choice : {PLIANT_DIRECT, PLIANT_MULTIGRID}) {
                if (choice == PLIANT_MULTIGRID && std::string(scene.name) == "octree") continue;
                for (int iterations : {2, 3, 5}) {
                    if (wanted == "parity" && iterations != 2) continue;
                    of_load.add(error_estimates::run(scene, move, choice, iterations, options, right, verbose));
                }
            }
            by_load += "  " + std::to_string(of_load.within) + "/" + std::to_string(of_load.counted);
            counts.add(of_load);
        }
        std::printf("%-10s within 3: %5.1f %% of %d, a step later %5.1f %% of %d   loads:%s\n", scene.name,
                    100.0 * counts.within / counts.counted, counts.counted,
                    100.0 * counts.within_next / counts.judged, counts.judged, by_load.c_str());
        std::fflush(stdout);
        whole.add(counts);
    }
    std::printf("%-10s within 3: %5.1f %% of %d, a step later %5.1f %% of %d\n", "all",
                100.0 * whole.within / whole.counted, whole.counted, 100.0 * whole.within_next / whole.judged,
                whole.judged);
    return 0;
}
