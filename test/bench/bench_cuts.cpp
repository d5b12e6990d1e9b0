// Cost of many cuts in one simulation, on the abdomen of the test data at 256 x 160 x 122, coarse cells 7 x 7 x 7.
// Small slits at random positions in the tissue; every fourth is followed by an undo, every eighth by a step. Reported
// are the CPU time per cut (of the process, without steps) and the memory, after 10, 100, 1000 cuts and so on.
//
// Usage:
//   bench_cuts [cuts=1000] [length=0.006] [steps=8] [undo=4] [reset=0] [warp=1] [stages=0] [frames=3]
//              [busy=0] [rests=0] [group/name=value ...]
//
// length: of a slit [m]
// steps, undo, reset: number of cuts between two steps, undos, resets (0: never)
// warp: with the deformed volume
// stages=1: wall time of each part of a cut, and of the frame after it. There is no undo, a step after each cut, and
//   `frames` other frames; with frames=0 there is no step. No step waits for the background.
// rests=1: only the host's work for a GPU, so less of the solver; a first cut is rehearsed
// busy=1: CPU time of the calling thread, for solver/threads=1 on a busy machine; excludes background work
#include "frames.h"
#include "base/memory.h"
#include "fem/quasistatic/solver.h"
#include "scan/volume.h"
#include "sim/api/data.h"
#include "sim/step/cut.h"
#include "sim/build/discretization.h"
#include "warp/device.h"

#include <ctime>
#include <functional>
#include <map>
#include <random>

#define STAGE_NAME(name) #name,

namespace {

double cpu(clockid_t clock = CLOCK_PROCESS_CPUTIME_ID)
{
    timespec t;
    clock_gettime(clock, &t);
    return 1e3 * (double(t.tv_sec) + 1e-9 * double(t.tv_nsec));
}

size_t resident()
{
    long pages = 0;
    FILE *file = std::fopen("/proc/self/statm", "r");
    if (file && std::fscanf(file, "%*s %ld", &pages) != 1) pages = 0;
    if (file) std::fclose(file);
    return size_t(pages) * 4096;
}

// FNV-1a
uint64_t hash_of(const void *block, size_t bytes, uint64_t hash)
{
    const auto *at = static_cast<const unsigned char *>(block);
    for (size_t b = 0; b < bytes; b++) hash = (hash ^ at[b]) * 0x100000001b3u;
    return hash;
}

// Hash the node positions and the deformed volume.
uint64_t bits(const pliant_model *model, pliant_data *data)
{
    check(pliant_step(model, data));
    const pliant_volume *drawn = data->warp ? pliant_warp_volume(data->warp) : nullptr;
    uint64_t hash =
        hash_of(data->positions, 3 * sizeof(double) * size_t(data->body->fine.num_nodes), 0xcbf29ce484222325u);
    if (drawn)
        hash = hash_of(drawn->voxels, pliant_geometry_voxels(&drawn->geometry) * pliant_encoding_size(drawn->encoding),
                       hash);
    return hash;
}

// Return a slit that starts at a deformed tissue node, in a random direction.
void slit(const pliant_data *data, double length, std::mt19937 &random, double points[6], double depth[3])
{
    std::uniform_real_distribution<double> unit(-1, 1);
    const pliant_body *body = data->body;
    int32_t tet = 0;
    do tet = static_cast<int32_t>(random() % static_cast<unsigned>(body->voxels->num_tets));
    while (body->fine_material[tet].tissue < 1);
    const double *at = data->positions + 3 * body->fine.tets[4 * tet];
    double along[3], down[3], a = 0, b = 0;
    for (int d = 0; d < 3; d++) {
        along[d] = unit(random), down[d] = unit(random);
        a += along[d] * along[d], b += down[d] * down[d];
    }
    for (int d = 0; d < 3; d++) {
        points[d] = at[d] - 0.5 * length * along[d] / std::sqrt(a);
        points[3 + d] = at[d] + 0.5 * length * along[d] / std::sqrt(a);
        depth[d] = 0.5 * length * down[d] / std::sqrt(b);
    }
}

bool busy = false;

double milliseconds(const std::function<void()> &what)
{
    if (busy) {
        const double start = cpu(CLOCK_THREAD_CPUTIME_ID);
        what();
        return cpu(CLOCK_THREAD_CPUTIME_ID) - start;
    }
    const auto start = std::chrono::steady_clock::now();
    what();
    return 1e3 * std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// Return a point every half voxel, as pliant_data_cut does.
std::vector<double> sampled(const double points[6], const double by[3], double spacing)
{
    double length = 0;
    for (int d = 0; d < 3; d++) length = std::hypot(length, points[3 + d] - points[d]);
    const int parts = std::max(1, int(std::ceil(length / spacing)));
    std::vector<double> out;
    for (int n = 0; n <= parts; n++)
        for (int d = 0; d < 3; d++) out.push_back(points[d] + double(n) / parts * (points[3 + d] - points[d]) + by[d]);
    return out;
}

// Parts of a cut: each part is repeated separately and discarded, then the complete cut is done.
enum Part { LINKS, BODY, MAP, DISCRETIZATION, SOLVER, WARP, SET_BODY, STEP, USUAL, NUM_PARTS };

void cut_by_parts(const pliant_model *model, pliant_data *data, const double points[6], const double depth[3],
                  bool steps, bool rests, std::vector<double> took[NUM_PARTS])
{
    const double none[3] = {0, 0, 0}, *size = model->scan->geometry.spacing,
                 spacing = 0.5 * std::min(size[0], std::min(size[1], size[2]));
    const std::vector<double> from = sampled(points, none, spacing), to = sampled(points, depth, spacing);
    const pliant_cut_sweep sweep{int32_t(from.size() / 3), from.data(), to.data(), nullptr};
    pliant_body *next = nullptr;
    const double links = milliseconds([&] {
        check(pliant_body_cut(data->body, data->last_revision + 1, data->positions, &sweep, nullptr, nullptr));
    });
    const double body = milliseconds(
        [&] { check(pliant_body_cut(data->body, data->last_revision + 1, data->positions, &sweep, &next, nullptr)); });
    if (!next) return;
    took[LINKS].push_back(links);
    took[BODY].push_back(body - links);
    pliant_body_map map;
    const pliant_discretization *discretization = nullptr;
    took[MAP].push_back(milliseconds([&] { check(pliant_body_map_create(data->discretization->body, next, &map)); }));
    took[DISCRETIZATION].push_back(milliseconds(
        [&] { check(pliant_discretization_next(&model->scene, data->discretization, next, &map, &discretization)); }));
    if (data->solver) {
        pliant_solver *solver = nullptr;
        took[SOLVER].push_back(milliseconds([&] {
            check(pliant_solver_carry_over_cut(&model->scene, discretization->system, data->solver, &map, rests,
                                               nullptr, &solver));
        }));
        pliant_solver_free(solver);
    }
    if (data->warp) {
        pliant_warp_next *warp = nullptr;
        took[WARP].push_back(milliseconds([&] { check(pliant_warp_prepare(data->warp, next, &warp)); }));
        pliant_warp_next_free(warp);
    }
    pliant_discretization_release(discretization);
    pliant_body_map_free(&map);
    took[SET_BODY].push_back(milliseconds([&] { check(pliant_data_set_body(model, data, next)); }));
    pliant_body_release(next);
    if (steps) took[STEP].push_back(milliseconds([&] { check(pliant_step(model, data)); }));
}

void by_parts(const pliant_model *model, pliant_data *data, double length, int cuts, int frames, bool rests)
{
    static const char *const names[NUM_PARTS] = {
        "links severed", "fragments and next body", "map of bodies",  "discretization", "solver",
        "warp",          "pliant_data_set_body",    "frame after it", "other frames"};
    std::vector<double> took[NUM_PARTS];
    std::mt19937 random(5);
    rests = rests || std::strcmp(pliant_data_get_backend(data), "cpu") != 0;
    if (rests) pliant_warm_up_cut(model, data);
    for (int c = 0; c < cuts; c++) {
        double points[6], depth[3];
        slit(data, length, random, points, depth);
        cut_by_parts(model, data, points, depth, frames > 0, rests, took);
        for (int f = 0; f < frames; f++) {
            const double gravity[3] = {0.2 * (c % 2), 9.81, 0.1 * f};
            check(pliant_data_set_gravity(data, gravity));
            took[USUAL].push_back(milliseconds([&] { check(pliant_step(model, data)); }));
        }
    }
    std::printf("%s, %d tetrahedra, %d nodes; [ms] of the %s: median, worst of %zu\n", pliant_data_get_backend(data),
                data->body->fine.num_tets, data->body->fine.num_nodes, busy ? "thread" : "clock",
                took[SET_BODY].size());
    for (int p = 0; p < NUM_PARTS; p++)
        if (!took[p].empty())
            std::printf("  %-24s %8.3f %8.3f\n", names[p], quantile(took[p], 0.5), quantile(took[p], 1));
}

} // namespace

int main(int argc, char **argv)
{
    std::map<std::string, double> with = {{"cuts", 1000}, {"length", 0.006}, {"steps", 8},  {"undo", 4}, {"reset", 0},
                                          {"warp", 1},    {"stages", 0},     {"frames", 3}, {"busy", 0}, {"rests", 0}};
    const std::string labels = std::string(PLIANT_TEST_DATA) + "/abdomen/labels_totalseg_fast.nii.gz",
                      scan = std::string(PLIANT_TEST_DATA) + "/abdomen/ct.nii.gz";
    pliant_scene scene;
    pliant_volume volume{};
    pliant_labels organs{};
    pliant_material_table materials{};
    pliant_scene_defaults(&scene);
    check(pliant_scene_set(&scene, "scan/resample", "256 160 122"));
    check(pliant_scene_set(&scene, "material/file", PLIANT_SOURCE_DIR "/test/bench/abdomen.yaml"));
    check(pliant_scene_set(&scene, "material/labels", labels.c_str()));
    check(pliant_scene_set(&scene, "cut/kind", "sever"));
    scene.mesh.keep_air = true;
    scene.mesh.ratio = 2;
    scene.model.method = PLIANT_FINE;
    scene.solver.backend = PLIANT_CPU;
    scene.solver.iterations = 6;
    for (int a = 1; a < argc; a++) {
        const std::string option = argv[a], name = option.substr(0, option.find('='));
        const char *value = argv[a] + std::min(name.size() + 1, option.size());
        if (with.count(name)) with[name] = std::atof(value);
        else check(pliant_scene_set(&scene, name.c_str(), value));
    }
    check(pliant_inputs_read(&scene, scan.c_str(), &volume, &organs, &materials));
    busy = with["busy"] > 0;
    pliant_model *model = nullptr;
    pliant_data *data = nullptr;
    check(pliant_model_build(&scene, &volume, &organs, &materials, {nullptr, nullptr}, &model));
    check(pliant_data_create(model, &data));
    if (with["stages"] > 0) data->background = pliant_background{PLIANT_BACKGROUND_LIVE, 0, 0};
    std::printf("load [ms]:");
    static const char *const stages[] = {PLIANT_BUILD_STAGE_LIST(STAGE_NAME)};
    for (int s = 0; s < PLIANT_NUM_BUILD_STAGES; s++) std::printf(" %s %.0f", stages[s], 1e3 * model->build_seconds[s]);
    std::printf("\n");
    if (with["warp"] > 0) check(pliant_data_set_warp(model, data, &volume.geometry));
    check(pliant_step(model, data));
    std::mt19937 random(5);
    std::vector<double> last;
    const int cuts = with["stages"] > 0 ? 0 : int(with["cuts"]), steps = int(with["steps"]), undo = int(with["undo"]),
              reset = int(with["reset"]);
    int next = 10;
    if (with["stages"] > 0)
        by_parts(model, data, with["length"], int(with["cuts"]), int(with["frames"]), with["rests"] > 0);
    else
        std::printf(
            "   cuts   tetrahedra   nodes   links    cut [ms]: median, worst of the last tenth    held, "
            "resident [MB]    bits\n");
    for (int c = 1; c <= cuts; c++) {
        double points[6], depth[3];
        slit(data, with["length"], random, points, depth);
        const double t0 = cpu();
        check(pliant_data_cut(model, data, 2, points, depth, nullptr));
        last.push_back(cpu() - t0);
        if (undo > 0 && c % undo == 0 && data->undo.count > 0) check(pliant_data_undo_cut(model, data));
        if (reset > 0 && c % reset == 0) check(pliant_data_reset(model, data));
        if (steps > 0 && c % steps == 0) check(pliant_step(model, data));
        if (c < next && c < cuts) continue;
        last.erase(last.begin(), last.end() - std::max<long>(c / 10, std::min<long>(c, 10)));
        std::printf("%7d   %9d %8d %7d        %8.2f %8.2f                    %8.1f %8.1f    %016llx\n", c,
                    data->body->fine.num_tets, data->body->fine.num_nodes,
                    data->body->cuts ? data->body->cuts->num_links : 0, quantile(last, 0.5), quantile(last, 1),
                    1e-6 * double(pliant_memory_in_use()), 1e-6 * double(resident()),
                    (unsigned long long)bits(model, data));
        std::fflush(stdout);
        next *= 10;
    }
    pliant_data_free(data);
    pliant_model_free(model);
    pliant_material_table_free(&materials);
    pliant_labels_free(&organs);
    pliant_volume_free(&volume);
    std::printf("held at the end: %zu bytes\n", pliant_memory_in_use());
    return 0;
}
