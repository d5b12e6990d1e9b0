// Time of an image on the GPU, if there is one, and on the CPU, whose result must be bitwise identical.
//
// Usage:
//   bench_render [SCAN [cpu]]     640 x 480 from three sides, by value and by label, and a radiograph; cpu: no GPU
#include "base/clock.h"
#include "figure.h"
#include "pliant/pliant.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <string>
#include <vector>

namespace {

void exit_on_error(pliant_status status)
{
    if (status >= 0) return;
    std::fprintf(stderr, "bench_render: %s\n", pliant_last_error());
    std::exit(1);
}

struct Seen {
    std::vector<uint8_t> rgb, label;
    std::vector<float> depth, integral;
    double ms = 0;
};

// Return positions displaced by a smooth wave of 8 mm.
std::vector<double> moved(const pliant_mesh &mesh)
{
    std::vector<double> x(mesh.rest, mesh.rest + 3 * mesh.num_nodes);
    for (size_t n = 0; n < x.size(); n += 3) x[n + 1] += 0.008 * std::sin(25 * x[n]) * std::cos(20 * x[n + 2]);
    return x;
}

double median(int runs, const std::function<void()> &what)
{
    std::vector<double> ms;
    for (int run = 0; run < runs; run++) {
        const double start = pliant_seconds();
        what();
        ms.push_back(1e3 * (pliant_seconds() - start));
    }
    std::sort(ms.begin(), ms.end());
    return ms[ms.size() / 2];
}

} // namespace

int main(int argc, char **argv)
{
    const std::string path = argc > 1 ? argv[1] : "phantom:256x160x122";
    const bool gpu = !(argc > 2 && std::string(argv[2]) == "cpu");
    pliant_scene scene;
    pliant_volume scan{};
    pliant_labels labels{};
    pliant_material_table materials{};
    pliant_scene_defaults(&scene);
    scene.element.kind = PLIANT_LINEAR;
    exit_on_error(pliant_inputs_read(&scene, path.c_str(), &scan, &labels, &materials));
    double middle[3] = {0, 0, 0};
    bool same = true;
    std::vector<Seen> first;
    for (pliant_backend_choice backend : {PLIANT_CPU, PLIANT_CUDA}) {
        if (backend == PLIANT_CUDA && !gpu) break;
        pliant_model *model = nullptr;
        pliant_scene own = scene;
        own.solver.backend = backend;
        exit_on_error(
            pliant_model_build(&own, &scan, labels.voxels ? &labels : nullptr, &materials, pliant_progress{}, &model));
        const pliant_body *body = pliant_model_get_body(model);
        for (int d = 0; d < 3; d++) {
            middle[d] = 0;
            for (int32_t n = 0; n < body->fine.num_nodes; n++)
                middle[d] += body->fine.rest[3 * n + d] / body->fine.num_nodes;
        }
        pliant_view *view = nullptr;
        exit_on_error(pliant_view_create(model, nullptr, &view));
        exit_on_error(pliant_view_set(view, body, moved(body->fine).data(), nullptr));
        pliant_style style;
        exit_on_error(pliant_style_defaults(&scan, &style));
        const double up[3] = {0, 0, 1}, from[3][3] = {{0.1, -0.5, 0.1}, {0.55, -0.1, 0.05}, {0, -0.2, 0}};
        const int runs = backend == PLIANT_CUDA ? 50 : 3;
        size_t picture = 0;
        for (int by_label = 0; by_label < 2; by_label++)
            for (int side = 0; side < 4; side++) {
                const bool radiograph = side == 3;
                if (radiograph && by_label) continue;
                pliant_camera camera;
                Seen seen;
                style.by_label = by_label != 0;
                // skin, fat and the tissue behind them
                if (by_label) for (int label = 1; label < 4; label++) style.shown[label] = 0;
                if (radiograph) {
                    const pliant_c_arm arm = {{middle[0], middle[1], middle[2]}, 0.8, 1.2, 0.3, 0.1, 640, 480, 0.001};
                    exit_on_error(pliant_c_arm_camera(&arm, &camera));
                } else {
                    const double place[3] = {middle[0] + from[side][0], middle[1] + from[side][1],
                                             middle[2] + from[side][2]};
                    pliant_camera_of_view(640, 480, side == 2 ? 1.2 : 0.9, &camera);
                    exit_on_error(pliant_camera_look_at(&camera, place, middle, up));
                }
                seen.rgb.resize(radiograph ? 0 : 3 * 640 * 480), seen.label.resize(seen.rgb.size() / 3),
                    seen.depth.resize(seen.label.size());
                seen.integral.resize(radiograph ? 640 * 480 : 0);
                const pliant_image image = {seen.rgb.data(), seen.depth.data(), seen.label.data()};
                const auto draw = [&] {
                    exit_on_error(radiograph ? pliant_view_radiograph(view, &camera, PLIANT_WATER_ATTENUATION,
                                                                      seen.integral.data())
                                             : pliant_view_render(view, &camera, &style, &image));
                };
                draw();
                seen.ms = median(runs, draw);
                const char *what = radiograph ? "radiograph" : by_label ? "by label" : "by value";
                std::printf("%s %s, side %d: %.3f ms", backend == PLIANT_CPU ? "CPU" : "GPU", what, side, seen.ms);
                if (backend == PLIANT_CPU) first.push_back(seen);
                else {
                    const Seen &cpu = first[picture];
                    int grey = 0, other = 0;
                    double apart = 0, line = 0;
                    for (size_t n = 0; n < seen.rgb.size(); n++)
                        grey = std::max(grey, std::abs(seen.rgb[n] - cpu.rgb[n]));
                    for (size_t n = 0; n < seen.depth.size(); n++) {
                        other += seen.label[n] != cpu.label[n] || std::isnan(seen.depth[n]) != std::isnan(cpu.depth[n]);
                        if (std::isfinite(seen.depth[n]))
                            apart = std::max(apart, double(std::abs(seen.depth[n] - cpu.depth[n])));
                    }
                    for (size_t n = 0; n < seen.integral.size(); n++)
                        line = std::max(line, double(std::abs(seen.integral[n] - cpu.integral[n])));
                    same = same && grey == 0 && apart == 0 && line == 0 && other == 0;
                    std::printf("; beside the CPU: %d grey levels, %g m, %d labels or outlines, %g of a line integral",
                                grey, apart, other, line);
                }
                std::printf("\n");
                if (backend == PLIANT_CUDA)
                    figure("picture " + std::to_string(picture) + ", " + what, 1e3 * seen.ms, "us");
                picture++;
            }
        pliant_view_free(view);
        pliant_model_free(model);
    }
    pliant_material_table_free(&materials);
    pliant_labels_free(&labels);
    pliant_volume_free(&scan);
    std::printf("%s\n", gpu ? same ? "the same bits" : "NOT THE SAME" : "CPU alone");
    return same ? 0 : 1;
}
