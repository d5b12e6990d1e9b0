// The GPU's times next to the hardware limits of the same card, measured in the same run.
//
// Usage:
//   bench_gpu warp [SIZE [RUNS]]   rasterization alone, for the sizes of the paper and 512^3, or one of the three
//   bench_gpu run SCENE SCAN [FRAMES [group/name=value ...]]
//                                  whole frames: a tool pulls 1 mm per frame, with a turn; error and time for each
//                                  budget
//   bench_gpu cut SCENE SCAN [FRAMES [group/name=value ...]]
//                                  whole frames while a blade of 30 mm moves 2 mm per frame through hanging soft
//                                  tissue, one stroke next to another (solver/backend=cpu: the same on the CPU)
//
// Limits: identity sampling of a 3-D texture into a volume of the same size, and its copy to page-locked memory.
#include "backend/backend.h"
#include "base/clock.h"
#include "displacement.h"
#include "figure.h"
#include "mesh/mesh.h"
#include "sim/api/data.h"
#include "model_data/data.h"
#include "pliant/pliant.h"
#include "tool/pick.h"
#include "warp/warp.h"

#include <cuda_runtime.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <random>
#include <string>
#include <vector>

namespace {

void exit_on_error(pliant_status status)
{
    if (status >= 0) return;
    std::fprintf(stderr, "bench_gpu: %s\n", pliant_last_error());
    std::exit(1);
}

void exit_on_error(cudaError_t error)
{
    if (error == cudaSuccess) return;
    std::fprintf(stderr, "bench_gpu: %s\n", cudaGetErrorString(error));
    std::exit(1);
}

double median(std::vector<double> v)
{
    std::nth_element(v.begin(), v.begin() + v.size() / 2, v.end());
    return v[v.size() / 2];
}

double percentile(std::vector<double> v, double fraction)
{
    std::sort(v.begin(), v.end());
    return v[std::min(v.size() - 1, size_t(fraction * double(v.size())))];
}

// Return the median of many runs, each measured by events [ms].
double time_events(int runs, cudaStream_t stream, const std::function<void()> &work)
{
    cudaEvent_t begin, end;
    exit_on_error(cudaEventCreate(&begin));
    exit_on_error(cudaEventCreate(&end));
    std::vector<double> ms;
    for (int run = 0; run < runs + 5; run++) {
        exit_on_error(cudaEventRecord(begin, stream));
        work();
        exit_on_error(cudaEventRecord(end, stream));
        exit_on_error(cudaEventSynchronize(end));
        float one;
        exit_on_error(cudaEventElapsedTime(&one, begin, end));
        if (run >= 5) ms.push_back(one);
    }
    cudaEventDestroy(begin);
    cudaEventDestroy(end);
    return median(ms);
}

__global__ void identity_kernel(cudaTextureObject_t texture, short *out, int nx, int ny, int nz)
{
    int i = int(blockIdx.x * blockDim.x + threadIdx.x), j = int(blockIdx.y * blockDim.y + threadIdx.y),
        k = int(blockIdx.z * blockDim.z + threadIdx.z);
    if (i >= nx || j >= ny || k >= nz) return;
    float value = tex3D<float>(texture, float(i) + 0.5f, float(j) + 0.5f, float(k) + 0.5f);
    out[i + size_t(nx) * (j + size_t(ny) * k)] = short(__float2int_rn(value * 32767.0f));
}

struct limits { double sample, copy; };

limits measure_limits(const int32_t size[3], int runs)
{
    cudaStream_t stream;
    cudaArray_t array;
    cudaTextureObject_t texture;
    short *d_out, *h_out;
    size_t count = size_t(size[0]) * size[1] * size[2];
    exit_on_error(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking));
    cudaExtent extent = make_cudaExtent(size[0], size[1], size[2]);
    cudaChannelFormatDesc format = cudaCreateChannelDesc<short>();
    exit_on_error(cudaMalloc3DArray(&array, &format, extent));
    std::vector<short> voxels(count);
    std::mt19937 random(1);
    for (short &v : voxels) v = short(random() % 2000) - 1000;
    cudaMemcpy3DParms copy = {};
    copy.srcPtr = make_cudaPitchedPtr(voxels.data(), size[0] * sizeof(short), size[0], size[1]);
    copy.dstArray = array;
    copy.extent = extent;
    copy.kind = cudaMemcpyHostToDevice;
    exit_on_error(cudaMemcpy3DAsync(&copy, stream));
    cudaResourceDesc resource = {};
    resource.resType = cudaResourceTypeArray;
    resource.res.array.array = array;
    cudaTextureDesc description = {};
    description.filterMode = cudaFilterModeLinear;
    description.readMode = cudaReadModeNormalizedFloat;
    exit_on_error(cudaCreateTextureObject(&texture, &resource, &description, nullptr));
    exit_on_error(cudaMalloc(&d_out, count * sizeof(short)));
    exit_on_error(cudaMallocHost(&h_out, count * sizeof(short)));
    dim3 threads(32, 4, 2), blocks((size[0] + 31) / 32, (size[1] + 3) / 4, (size[2] + 1) / 2);
    limits result;
    result.sample = time_events(runs, stream, [&] {
        identity_kernel<<<blocks, threads, 0, stream>>>(texture, d_out, size[0], size[1], size[2]);
    });
    result.copy = time_events(runs, stream, [&] {
        exit_on_error(cudaMemcpyAsync(h_out, d_out, count * sizeof(short), cudaMemcpyDeviceToHost, stream));
    });
    cudaDestroyTextureObject(texture);
    cudaFreeArray(array);
    cudaFree(d_out);
    cudaFreeHost(h_out);
    cudaStreamDestroy(stream);
    return result;
}

/* ---- rasterization alone */

// Pick along a diagonal ray without a hit, with the volume on the GPU and on the host.
void bench_pick(const pliant_warp *warp, const pliant_mesh *mesh, const double *positions, const double extent[3],
                int runs)
{
    pliant_ray ray = {};
    for (int d = 0; d < 3; d++) ray.origin[d] = -0.1 * extent[d], ray.direction[d] = extent[d];
    const pliant_volume *volume = pliant_warp_volume(warp);
    std::vector<double> there, here;
    for (int run = 0; run < runs; run++) {
        pliant_picked picked;
        double start = pliant_seconds();
        exit_on_error(pliant_pick_warped(warp, positions, &ray, 5000, &picked));
        double middle = pliant_seconds();
        exit_on_error(pliant_pick(volume, mesh, positions, &ray, 5000, &picked));
        here.push_back(1e3 * (pliant_seconds() - middle));
        there.push_back(1e3 * (middle - start));
    }
    std::printf("    a ray from corner to corner: GPU %7.4f, CPU %7.4f ms\n", median(there), median(here));
}

void bench_warp(const int32_t size[3], const int32_t cells[3], int runs)
{
    pliant_volume scan = {};
    pliant_mesh mesh = {};
    pliant_warp *warp = nullptr;
    pliant_geometry geometry = {{size[0], size[1], size[2]},
                                {0, 0, 0},
                                {0.384 / size[0], 0.24 / size[1], 0.244 / size[2]},
                                {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    exit_on_error(pliant_volume_create(&geometry, PLIANT_INT16, &scan));
    std::mt19937 random(1);
    for (size_t v = 0; v < pliant_geometry_voxels(&geometry); v++)
        static_cast<int16_t *>(scan.voxels)[v] = int16_t(int(random() % 2000) - 1000);
    exit_on_error(pliant_mesh_grid(&geometry, cells, nullptr, &mesh));
    exit_on_error(pliant_warp_create(&scan, &mesh, &geometry, 2, &warp));
    exit_on_error(pliant_warp_backend(warp, PLIANT_CUDA));
    double extent[3];
    for (int d = 0; d < 3; d++) extent[d] = size[d] * geometry.spacing[d];
    std::vector<double> states[2];
    for (int s = 0; s < 2; s++) {
        states[s].assign(mesh.rest, mesh.rest + 3 * mesh.num_nodes);
        for (size_t n = 0; n < states[s].size(); n += 3) {
            double by[3];
            displacement(mesh.rest + n, extent, s ? 0.97 : 1, by);
            for (size_t d = 0; d < 3; d++) states[s][n + d] += by[d];
        }
    }
    std::vector<double> cull, rasterize, both, fetch;
    for (int run = 0; run < runs + 5; run++) {
        double c, r;
        exit_on_error(pliant_warp_update(warp, states[run % 2].data()));
        pliant_warp_seconds(warp, &c, &r);
        double start = pliant_seconds();
        if (run % 8 == 7) pliant_warp_volume(warp);
        if (run < 5) continue;
        if (run % 8 == 7) fetch.push_back(1e3 * (pliant_seconds() - start));
        cull.push_back(1e3 * c);
        rasterize.push_back(1e3 * r);
        both.push_back(1e3 * (c + r));
    }
    limits limit = measure_limits(size, runs);
    std::printf(
        "%4d x %3d x %3d, %7d tetrahedra: cull %7.4f  rasterize %7.4f  both %7.4f ms | texture %7.4f ms: x %5.2f, "
        "both x %5.2f | to the host %6.3f, bare copy %6.3f ms\n",
        size[0], size[1], size[2], mesh.num_tets, median(cull), median(rasterize), median(both), limit.sample,
        median(rasterize) / limit.sample, median(both) / limit.sample, median(fetch), limit.copy);
    char name[80];
    std::snprintf(name, sizeof name, "cull and rasterize, %d x %d x %d", size[0], size[1], size[2]);
    figure(name, 1e3 * median(both), "us");
    bench_pick(warp, &mesh, states[(runs + 4) % 2].data(), extent, runs);
    pliant_warp_free(warp);
    pliant_mesh_free(&mesh);
    pliant_volume_free(&scan);
}

/* ---- whole frames */

struct Run {
    std::vector<std::vector<double>> positions;
    std::vector<double> frame, solve, fetch;
    double iterations, largest;
    int unconverged;
};

// Find a point of soft tissue 2 cm below the front.
bool find_front(const pliant_model *model, double out[3])
{
    const pliant_geometry *geometry = &model->scan->geometry;
    double index[3] = {0.6 * geometry->size[0], 0.5 * geometry->size[1], 0.6 * geometry->size[2]};
    pliant_geometry_to_world(geometry, index, out);
    for (int s = 0; s < 500; s++) {
        double point[3] = {out[0], out[1] - 0.25 + 0.001 * s, out[2]}, barycentric[4];
        int32_t tet = pliant_mesh_locate(&model->body->fine, point, barycentric);
        if (tet < 0 || model->body->fine_material[tet].tissue < 0.9 || model->body->fine_material[tet].mu < 500)
            continue;
        out[1] = point[1] + 0.02;
        return true;
    }
    return false;
}

Run run(const pliant_model *model, pliant_data *data, const double at[3], pliant_drive drive, int frames, int budget,
        double tolerance, bool fetch)
{
    exit_on_error(pliant_data_reset(model, data));
    exit_on_error(pliant_data_set_limits(data, budget, tolerance));
    int tool;
    exit_on_error(pliant_tool_add(model, data, "bench", &tool));
    exit_on_error(pliant_tool_grasp(model, data, tool, at));
    double from[3];
    std::memcpy(from, data->tools[tool].tip, sizeof from);
    Run out = {};
    for (int s = 1; s <= frames; s++) {
        double ahead = std::min(s, frames / 2) * 0.001, aside = std::max(0, s - frames / 2) * 0.001;
        double tip[3] = {from[0] + aside, from[1] - ahead, from[2] + 0.5 * aside},
               force[3] = {100 * aside, -200 * ahead, 0};
        exit_on_error(pliant_tool_set_drive(data, tool, drive, force));
        exit_on_error(pliant_tool_set_pose(data, tool, tip, nullptr));
        double start = pliant_seconds();
        pliant_status status = pliant_step(model, data);
        exit_on_error(status);
        double stepped = pliant_seconds();
        if (fetch) pliant_warp_volume(data->warp);
        double end = pliant_seconds();
        out.frame.push_back(1e3 * (end - start));
        out.fetch.push_back(1e3 * (end - stepped));
        out.solve.push_back(1e3 * data->statistics.seconds[PLIANT_STEP_solve]);
        out.iterations += double(data->statistics.iterations) / frames;
        out.unconverged += status == PLIANT_NOT_CONVERGED;
        out.positions.emplace_back(data->positions, data->positions + 3 * size_t(model->body->fine.num_nodes));
    }
    for (size_t n = 0; n < out.positions.back().size(); n += 3) {
        double u = 0;
        for (size_t d = 0; d < 3; d++) u += std::pow(out.positions.back()[n + d] - model->body->fine.rest[n + d], 2);
        out.largest = std::max(out.largest, std::sqrt(u));
    }
    if (std::string(pliant_data_get_backend(data)) != "cuda") std::printf("NOT ON THE GPU\n");
    return out;
}

double worst_error(const Run &a, const Run &b)
{
    double worst = 0;
    for (size_t s = 0; s < a.positions.size(); s++)
        for (size_t n = 0; n < a.positions[s].size(); n += 3) {
            double e = 0;
            for (size_t d = 0; d < 3; d++) e += std::pow(a.positions[s][n + d] - b.positions[s][n + d], 2);
            worst = std::max(worst, std::sqrt(e));
        }
    return worst / b.largest;
}

void set_option(pliant_scene *scene, const std::string &option)
{
    size_t equals = option.find('=');
    exit_on_error(pliant_scene_set(scene, option.substr(0, equals).c_str(),
                                   equals == std::string::npos ? "" : option.substr(equals + 1).c_str()));
}

void bench_run(const char *scene_path, const char *scan_path, int frames, char **options, int num_options)
{
    pliant_scene scene;
    pliant_volume scan = {};
    pliant_labels labels = {};
    pliant_material_table materials = {};
    pliant_model *model = nullptr;
    exit_on_error(pliant_scene_read(scene_path, &scene));
    scene.solver.backend = PLIANT_CUDA;
    for (int n = 0; n < num_options; n++) set_option(&scene, options[n]);
    double began = pliant_seconds();
    exit_on_error(pliant_inputs_read(&scene, scan_path, &scan, &labels, &materials));
    std::printf("inputs in %.1f s\n", pliant_seconds() - began);
    const pliant_preconditioner_choice choices[] = {PLIANT_DIRECT, PLIANT_MULTIGRID};
    for (pliant_preconditioner_choice choice : choices) {
        const double cells = double(scene.mesh.coarse_cells[0]) * scene.mesh.coarse_cells[1] *
                             scene.mesh.coarse_cells[2] * std::pow(scene.mesh.ratio, 3);
        if (choice == PLIANT_DIRECT && cells > 14000) continue; // building its model takes minutes
        scene.solver.preconditioner = choice;
        double start = pliant_seconds();
        exit_on_error(pliant_model_build(&scene, &scan, labels.voxels ? &labels : nullptr, &materials,
                                         {nullptr, nullptr}, &model));
        double built = pliant_seconds(), at[3];
        if (!find_front(model, at)) {
            std::printf("no soft tissue at the front of %s\n", scan_path);
            std::exit(1);
        }
        pliant_data *data = nullptr;
        pliant_status status = pliant_data_create(model, &data);
        std::printf("%s, %s, %s: %d x %d x %d voxels, %d tetrahedra, %d nodes; model %.2f s, state on the GPU %.2f s\n",
                    scene_path, scan_path, choice == PLIANT_DIRECT ? "direct" : "multigrid", scan.geometry.size[0],
                    scan.geometry.size[1], scan.geometry.size[2], model->body->fine.num_tets,
                    model->body->fine.num_nodes, built - start, pliant_seconds() - built);
        if (status != PLIANT_OK) {
            std::printf("  %s\n", pliant_last_error());
            pliant_model_free(model);
            continue;
        }
        const pliant_drive drives[] = {PLIANT_DRIVE_RIGID, PLIANT_DRIVE_FORCE};
        const int budgets[] = {1, 2, 3, 4, 6, 10};
        Run exact[2], forces[2][6];
        for (int d = 0; d < 2; d++) {
            exact[d] = run(model, data, at, drives[d], frames, 200, 1e-7, false);
            for (int b = 0; b < 6; b++) forces[d][b] = run(model, data, at, drives[d], frames, budgets[b], 1e-3, false);
        }
        exit_on_error(pliant_data_set_warp(model, data, &model->scan->geometry));
        for (int d = 0; d < 2; d++) {
            std::printf("  %s, largest %.1f mm, exact in %.1f evaluations a frame\n", d == 0 ? "displacement" : "force",
                        1e3 * exact[d].largest, exact[d].iterations);
            for (int b = 0; b < 6; b++) {
                Run fast = run(model, data, at, drives[d], frames, budgets[b], 1e-3, false),
                    copied = run(model, data, at, drives[d], frames, budgets[b], 1e-3, true);
                std::printf(
                    "    budget %2d: worst frame %6.2f %%, %4.1f evaluations | frame %6.3f ms (p99 %6.3f), "
                    "solve %6.3f | with the copy %6.3f (p99 %6.3f) | no volume %6.3f (p99 %6.3f)\n",
                    budgets[b], 100 * worst_error(fast, exact[d]), fast.iterations, median(fast.frame),
                    percentile(fast.frame, 0.99), median(fast.solve), median(copied.frame),
                    percentile(copied.frame, 0.99), median(forces[d][b].frame), percentile(forces[d][b].frame, 0.99));
                const std::string file = std::strrchr(scene_path, '/') ? std::strrchr(scene_path, '/') + 1 : scene_path;
                const std::string size = std::to_string(model->body->fine.num_tets) + " tetrahedra";
                const char *inverse = choice == PLIANT_DIRECT ? "direct, " : "multigrid, ";
                if (budgets[b] == 3)
                    figure("frame, " + file + ", " + size + ", " + inverse + (d == 0 ? "displacement" : "force"),
                           1e3 * median(fast.frame), "us");
            }
        }
        pliant_data_free(data);
        pliant_model_free(model);
        model = nullptr;
    }
    pliant_material_table_free(&materials);
    pliant_labels_free(&labels);
    pliant_volume_free(&scan);
}

/* ---- while cutting */

enum { STROKE = 40, BETWEEN = 5 }; // numbers of frames

struct CutFrames { std::vector<double> whole, stage[PLIANT_NUM_STEP_STAGES], evaluations; };

void print_frames(const char *what, const CutFrames &frames)
{
    if (frames.whole.empty()) return;
    std::printf("  %-8s %4zu frames: median %7.3f ms, p95 %7.3f, worst %7.3f (x %.2f); evaluations %.0f, at most %.0f;",
                what, frames.whole.size(), median(frames.whole), percentile(frames.whole, 0.95),
                percentile(frames.whole, 1), percentile(frames.whole, 1) / median(frames.whole),
                median(frames.evaluations), percentile(frames.evaluations, 1));
    for (int s = 0; s < PLIANT_NUM_STEP_STAGES; s++)
        std::printf(" %s %.3f (%.3f)", pliant_step_stage_name(s), median(frames.stage[s]),
                    percentile(frames.stage[s], 1));
    std::printf("\n");
}

void bench_cut(const char *scene_path, const char *scan_path, int frames, char **options, int num_options)
{
    pliant_scene scene;
    pliant_volume scan = {};
    pliant_labels labels = {};
    pliant_material_table materials = {};
    pliant_model *model = nullptr;
    pliant_data *data = nullptr;
    exit_on_error(pliant_scene_read(scene_path, &scene));
    scene.solver.backend = PLIANT_CUDA;
    scene.cut.kind = PLIANT_CUT_SEVER;
    scene.cut.resistance = 0;
    scene.model.gravity[2] = -2;
    for (int n = 0; n < num_options; n++) set_option(&scene, options[n]);
    exit_on_error(pliant_inputs_read(&scene, scan_path, &scan, &labels, &materials));
    exit_on_error(
        pliant_model_build(&scene, &scan, labels.voxels ? &labels : nullptr, &materials, {nullptr, nullptr}, &model));
    exit_on_error(pliant_data_create(model, &data));
    exit_on_error(pliant_data_set_warp(model, data, &model->scan->geometry));
    double at[3], from[3] = {-0.015, 0, 0}, to[3] = {0.015, 0, 0};
    int tool;
    if (!find_front(model, at)) exit_on_error(PLIANT_ERROR_ARGUMENT);
    exit_on_error(pliant_tool_add(model, data, "blade", &tool));
    exit_on_error(pliant_tool_set_blade(data, tool, from, to));
    const pliant_background live = {PLIANT_BACKGROUND_LIVE, 0, 0};
    data->background = live;
    CutFrames cutting, other;
    for (int f = -20; f < frames; f++) {
        const int stroke = f < 0 ? 0 : f / (STROKE + BETWEEN), place = f < 0 ? -1 : f % (STROKE + BETWEEN);
        const double tip[3] = {at[0] + 0.027 * (stroke % 4 - 1.5), at[1] - 0.02 + 0.002 * place,
                               at[2] + 0.02 * (stroke / 4 % 3)};
        exit_on_error(pliant_tool_set_pose(data, tool, tip, nullptr));
        exit_on_error(pliant_tool_set_cutting(data, tool, f >= 0 && place < STROKE));
        const uint64_t revision = data->body->revision, factors = data->statistics.factors;
        const double start = pliant_seconds();
        exit_on_error(pliant_step(model, data));
        const double whole = 1e3 * (pliant_seconds() - start);
        CutFrames &frame = data->body->revision != revision ? cutting : other;
        if (std::getenv("VERBOSE"))
            std::printf("    %4d %s %7.3f ms, cut %7.3f solve %7.3f warp %7.3f, %2d evaluations, %d nodes%s\n", f,
                        &frame == &cutting ? "cuts" : "    ", whole, 1e3 * data->statistics.seconds[PLIANT_STEP_cut],
                        1e3 * data->statistics.seconds[PLIANT_STEP_solve],
                        1e3 * data->statistics.seconds[PLIANT_STEP_warp], data->statistics.iterations,
                        data->body->fine.num_nodes, data->statistics.factors != factors ? ", renewed" : "");
        if (f < 0) continue;
        frame.whole.push_back(whole);
        frame.evaluations.push_back(data->statistics.iterations);
        for (int s = 0; s < PLIANT_NUM_STEP_STAGES; s++) frame.stage[s].push_back(1e3 * data->statistics.seconds[s]);
    }
    std::printf("%s: %d x %d x %d voxels, %d tetrahedra, %d nodes at load, %d at the end, %llu preconditioners\n",
                pliant_data_get_backend(data), scan.geometry.size[0], scan.geometry.size[1], scan.geometry.size[2],
                model->body->fine.num_tets, model->body->fine.num_nodes, data->body->fine.num_nodes,
                (unsigned long long)data->statistics.factors);
    std::printf("  severed %.1f cm2, front at %.1f %.1f %.1f mm\n", 1e4 * data->tools[tool].blade.severed_area,
                1e3 * at[0], 1e3 * at[1], 1e3 * at[2]);
    print_frames("cutting", cutting);
    print_frames("other", other);
    pliant_data_free(data);
    pliant_model_free(model);
    pliant_material_table_free(&materials);
    pliant_labels_free(&labels);
    pliant_volume_free(&scan);
}

} // namespace

int main(int count, char **arguments)
{
    if (count >= 2 && std::strcmp(arguments[1], "warp") == 0) {
        const int32_t sizes[3][3] = {{256, 160, 122}, {524, 176, 144}, {512, 512, 512}},
                      cells[3][3] = {{14, 14, 14}, {36, 18, 18}, {58, 58, 58}};
        const int only = count > 2 ? std::atoi(arguments[2]) : -1,
                  runs = count > 3 ? std::max(10, std::atoi(arguments[3])) : 300;
        for (int n = 0; n < 3; n++)
            if (only < 0 || n == only) bench_warp(sizes[n], cells[n], n == 2 ? std::min(runs, 60) : runs);
        return 0;
    }
    if (count >= 4 && std::strcmp(arguments[1], "run") == 0) {
        bench_run(arguments[2], arguments[3], count > 4 ? std::atoi(arguments[4]) : 60, arguments + 5,
                  std::max(0, count - 5));
        return 0;
    }
    if (count >= 4 && std::strcmp(arguments[1], "cut") == 0) {
        bench_cut(arguments[2], arguments[3], count > 4 ? std::atoi(arguments[4]) : 270, arguments + 5,
                  std::max(0, count - 5));
        return 0;
    }
    std::fprintf(
        stderr, "usage: bench_gpu warp [SIZE [RUNS]] | bench_gpu run|cut SCENE SCAN [FRAMES [group/name=value ...]]\n");
    return 2;
}
