// Segmentation by a mixture: time, classes, and agreement of each labelled organ with one piece and with all pieces of
// one class (Dice).
// Usage:
//   bench_segment [SCAN LABELS] [classes = 0] [coherence = 1]   on the CPU; default: the phantom at 256 x 160 x 122
//   bench_segment cuda [SCAN]                                   on the GPU; number of voxels that differ from the
//                                                               CPU's labels
#include "base/clock.h"
#include "figure.h"
#include "pliant/pliant.h"
#include "scan/volume.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <vector>

static int bench_gpu(const char *path)
{
    const int32_t size[3] = {256, 160, 122};
    pliant_volume scan{};
    pliant_segmentation gpu{}, cpu{};
    pliant_segment_options options{0, 12, 1.0, 1e-6, 2, PLIANT_CUDA};
    pliant_status status = path ? pliant_volume_read(path, nullptr, 0, &scan) : pliant_phantom(size, 1, &scan, nullptr);
    double best = INFINITY;
    for (int run = 0; run < 6 && status == PLIANT_OK; run++) {
        pliant_segmentation_free(&gpu);
        double start = pliant_seconds();
        status = pliant_segment(&scan, &options, &gpu);
        best = std::min(best, pliant_seconds() - start);
    }
    options.backend = PLIANT_CPU;
    double start = pliant_seconds();
    if (status == PLIANT_OK) status = pliant_segment(&scan, &options, &cpu);
    if (status != PLIANT_OK) {
        std::fprintf(stderr, "%s\n", pliant_last_error());
        return 1;
    }
    double seconds = pliant_seconds() - start;
    size_t different = 0, voxels = pliant_geometry_voxels(&scan.geometry);
    for (size_t v = 0; v < voxels; v++) different += cpu.labels.voxels[v] != gpu.labels.voxels[v];
    std::printf(
        "%d x %d x %d: %.1f ms on the GPU (the fastest of 6, from and to the host's memory), %.0f ms on the CPU, "
        "%d threads; %d classes, %d pieces; %zu voxels differ\n",
        scan.geometry.size[0], scan.geometry.size[1], scan.geometry.size[2], 1e3 * best, 1e3 * seconds,
        options.num_threads, gpu.num_classes, gpu.num_pieces, different);
    figure("segment, " + std::to_string(voxels) + " voxels", 1e6 * best, "us");
    return 0;
}

int main(int argc, char **argv)
{
    if (argc > 1 && std::strcmp(argv[1], "cuda") == 0) return bench_gpu(argc > 2 ? argv[2] : nullptr);
    pliant_volume scan{};
    pliant_labels truth{};
    pliant_status status;
    bool file = argc > 2;
    if (file) {
        status = pliant_volume_read(argv[1], nullptr, 0, &scan);
        if (status == PLIANT_OK) status = pliant_labels_read(argv[2], 0, &truth);
    } else {
        const int32_t size[3] = {256, 160, 122};
        status = pliant_phantom(size, 1, &scan, &truth);
    }
    int rest = file ? 3 : 1;
    pliant_segment_options options{argc > rest ? std::atoi(argv[rest]) : 0,
                                   12,
                                   argc > rest + 1 ? std::atof(argv[rest + 1]) : 1.0,
                                   1e-6,
                                   2,
                                   PLIANT_CPU};
    pliant_segmentation found{};
    double start = pliant_seconds();
    if (status == PLIANT_OK) status = pliant_segment(&scan, &options, &found);
    if (status != PLIANT_OK) {
        std::fprintf(stderr, "%s\n", pliant_last_error());
        return 1;
    }
    std::printf("%d x %d x %d, %d threads: %.2f s, %d classes, %d pieces\n", scan.geometry.size[0],
                scan.geometry.size[1], scan.geometry.size[2], options.num_threads, pliant_seconds() - start,
                found.num_classes, found.num_pieces);
    for (int k = 0; k < found.num_classes; k++)
        std::printf("  class %d: weight %.3f mean %.1f deviation %.1f\n", k, found.classes[k].weight,
                    found.classes[k].mean, found.classes[k].deviation);
    size_t voxels = pliant_geometry_voxels(&scan.geometry);
    std::map<int, size_t> organ;
    std::map<std::pair<int, int>, size_t> both, both_class;
    std::vector<size_t> pieces(found.num_pieces), classes(found.num_classes);
    for (size_t v = 0; v < voxels; v++) {
        int p = found.labels.voxels[v] - 1, c = found.pieces[p].class_index, t = truth.voxels[v];
        organ[t]++;
        pieces[p]++;
        classes[c]++;
        both[{t, p}]++;
        both_class[{t, c}]++;
    }
    std::printf("%-24s %10s %22s %22s\n", "organ", "ml", "best piece, Dice", "best class, Dice");
    double ml = 1e6 * scan.geometry.spacing[0] * scan.geometry.spacing[1] * scan.geometry.spacing[2];
    for (auto &entry : organ) {
        int t = entry.first;
        size_t count = entry.second;
        double best[2] = {0, 0};
        int which[2] = {0, 0};
        for (auto &overlap : both) {
            double dice = 2.0 * overlap.second / (count + pieces[overlap.first.second]);
            if (overlap.first.first == t && dice > best[0]) best[0] = dice, which[0] = overlap.first.second + 1;
        }
        for (auto &overlap : both_class) {
            double dice = 2.0 * overlap.second / (count + classes[overlap.first.second]);
            if (overlap.first.first == t && dice > best[1]) best[1] = dice, which[1] = overlap.first.second;
        }
        char name[32];
        std::snprintf(name, sizeof name, "%d %s", t, file ? "" : pliant_phantom_label_name(t));
        std::printf("%-24s %10.0f %15.2f (%4d) %15.2f (%4d)\n", name, count * ml, best[0], which[0], best[1], which[1]);
    }
}
