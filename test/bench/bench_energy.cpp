// Energy of thrown cubes of tissue in explicit dynamics without damping. Friction and collisions reduce the sum of
// kinetic, elastic and gravity energy, minus the work of a tool.
//
// Usage:
//   bench_energy [seeds [safety [nu]]]     seeds: for each kind of throw, default 200. safety: tled/safety, default
//                                          0.9. nu: Poisson's ratio, default 0.3
#include "../thrown.h"
#include "figure.h"

#include <cstdlib>

int main(int argc, char **argv)
{
    const unsigned seeds = argc > 1 ? static_cast<unsigned>(std::atoi(argv[1])) : 200;
    double maximum = 1;
    int count = 0, above = 0, all = 0, gain = 0;
    unsigned worst = 0;
    for (Throw with : all_throws(seeds, {3e3, 10e3})) {
        if (argc > 2) with.safety = std::atof(argv[2]);
        if (argc > 3) with.poisson = std::atof(argv[3]);
        const double ratio = energy_ratio(with);
        if (ratio > maximum) worst = with.seed;
        maximum = std::fmax(maximum, ratio);
        above += ratio > 1.001;
        all++;
        gain += ratio > 1.001;
        if (with.seed + 1 < seeds) continue;
        std::printf("%s: maximum energy %.4f of the initial energy (throw %u), above 1.001 in %d of %u throws\n",
                    name_of(with).c_str(), maximum, worst, above, seeds);
        maximum = 1, above = 0, worst = 0;
        count++;
    }
    std::printf("%d kinds of throws, %d throws, %d above 1.001\n", count, all, gain);
    figure("throws that gain energy", gain, "");
    return 0;
}
