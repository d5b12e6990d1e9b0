/* Tables of a report: columns, files, and JSON. */
#define _POSIX_C_SOURCE 200809L
#include "base/fail.h"
#include "base/threads.h"
#include "report/report.h"
#include "report/rows.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/utsname.h>
#include <time.h>
#include <unistd.h>

#define MODEL_COLUMNS "setup", "ratio", "method", "submesh", "variant"
#define RUN_COLUMNS MODEL_COLUMNS, "budget", "case", "point"
#define STEP_MEDIAN(name) #name "_median_ms",
#define STEP_MEDIAN_P99(name) #name "_median_ms", #name "_p99_ms",
#define STEP_MS(name) , #name "_ms"
#define BUILD_S_MB(name) , #name "_s", #name "_mb"

static const char *const sweep_columns[] = {RUN_COLUMNS,
                                            "status",
                                            "message",
                                            "frames",
                                            "fine_tetrahedra",
                                            "solved_tetrahedra",
                                            "backend",
                                            "threads",
                                            "build_s",
                                            "model_mb",
                                            "data_mb",
                                            "solver_median_ms",
                                            "solver_p99_ms",
                                            "frame_median_ms",
                                            "frame_p99_ms",
                                            PLIANT_STEP_STAGE_LIST(STEP_MEDIAN_P99) "iterations_mean",
                                            "residual_worst",
                                            "not_converged",
                                            "rejected",
                                            "factors",
                                            "force_n",
                                            "points",
                                            "largest_mm",
                                            "max_mm",
                                            "rms_mm",
                                            "p95_mm",
                                            "max_percent",
                                            "rms_percent",
                                            "p95_percent",
                                            "max_own_percent",
                                            "rms_own_percent",
                                            "p95_own_percent",
                                            "final_max_mm",
                                            "final_rms_mm",
                                            "final_p95_mm",
                                            "refined_tetrahedra",
                                            "refined_points",
                                            "refined_largest_mm",
                                            "refined_max_mm",
                                            "refined_rms_mm",
                                            "refined_p95_mm",
                                            "refined_max_percent",
                                            "refined_rms_percent",
                                            "refined_p95_percent",
                                            "voxels",
                                            "voxel_max_mm",
                                            "voxel_rms_mm",
                                            "voxel_p95_mm"};
static const char *const frame_columns[] = {
    RUN_COLUMNS, "frame",      "iterations",
    "residual",  "largest_mm", "max_mm",
    "rms_mm",    "p95_mm",     "max_own_percent" PLIANT_STEP_STAGE_LIST(STEP_MS)};
static const char *const build_columns[] = {
    MODEL_COLUMNS,     "status",     "message",
    "fine_tetrahedra", "fine_nodes", "coarse_tetrahedra",
    "held_pieces",     "condition",  "threads",
    "total_s",         "held_mb",    "peak_mb" PLIANT_BUILD_STAGE_LIST(BUILD_S_MB)};
static const char *const histogram_columns[] = {RUN_COLUMNS, "bin", "low_mm", "high_mm", "voxels"};
static const char *const slice_columns[] = {RUN_COLUMNS,  "plane",      "column_mm", "row_mm",
                                            "largest_mm", "error_file", "image_file"};
static const char *const stage_columns[] = {"setup",
                                            "omitted",
                                            "status",
                                            "message",
                                            "steps",
                                            "backend",
                                            "threads",
                                            "step_median_ms",
                                            "step_p99_ms",
                                            PLIANT_STEP_STAGE_LIST(STEP_MEDIAN) "slices_median_ms",
                                            "scalar_median_ms",
                                            "frame_median_ms",
                                            "held_mb",
                                            "saved_ms",
                                            "saved_mb"};
static const char *const stability_columns[] = {
    "setup",         "case",          "parameter",     "method",       "verdict",    "message",     "steps",
    "steps_to_rest", "iterations",    "seconds",       "residual",     "largest_mm", "off_rest_mm", "inverted_max",
    "inverted_end",  "not_converged", "refused_steps", "growth_bytes", "figure"};
static const char *const choice_columns[] = {
    MODEL_COLUMNS,  "budget",      "options",     "budget_ms",     "max_error_percent",    "measure",
    "max_percent",  "p95_percent", "rms_percent", "worst",         "settled_percent",      "reference_mesh_percent",
    "mesh_percent", "larger",      "step_ms",     "within_budget", "reference_tetrahedra", "tried",
    "seconds"};

static const char *const dynamics_columns[] = {"setup",
                                               "status",
                                               "message",
                                               "fine_tetrahedra",
                                               "fine_nodes",
                                               "law",
                                               "backend",
                                               "threads",
                                               "edge_bound_us",
                                               "eigenvalue_bound_us",
                                               "time_step_us",
                                               "steps_a_frame",
                                               "frames",
                                               "frame_median_ms",
                                               "frame_p99_ms",
                                               "step_median_ms",
                                               "tetrahedra_steps_per_s",
                                               "energy_drift_percent",
                                               "time_error_mm",
                                               "time_error_percent"};

static const char *const truth_columns[] = {"setup",
                                            "case",
                                            "point",
                                            "law",
                                            "status",
                                            "message",
                                            "fine_tetrahedra",
                                            "tetrahedra_of_three",
                                            "order",
                                            "largest_mm",
                                            "mesh_max_mm",
                                            "mesh_rms_mm",
                                            "mesh_p95_mm",
                                            "mesh_p95_percent",
                                            "solver_max_mm",
                                            "solver_rms_mm",
                                            "solver_p95_mm",
                                            "solver_p95_percent",
                                            "larger",
                                            "mesh_p95_percent_refined",
                                            "law_distance_max_mm",
                                            "law_distance_p95_mm",
                                            "law_distance_p95_percent",
                                            "advice"};

static const char *const validation_columns[] = {"setup",  "body",    "state",     "status",       "message",
                                                 "role",   "fitted",  "markers",   "moved_rms_mm", "rms_mm",
                                                 "max_mm", "percent", "spread_mm", "deviation_mm", "seconds"};

#define COLUMNS(list) list, (int)(sizeof(list) / sizeof *(list))

enum { NUM_TABLES = 11 };

static void list_tables(pliant_report_tables *tables, pliant_results **out[NUM_TABLES])
{
    pliant_results **const list[NUM_TABLES] = {&tables->sweep,  &tables->frames, &tables->builds,   &tables->histogram,
                                               &tables->slices, &tables->stages, &tables->stability, &tables->choice,
                                               &tables->dynamics, &tables->truth, &tables->validation};
    memcpy(out, list, sizeof list);
}

static const struct {
    const char *name;
    const char *const *columns;
    int num_columns, num_keys;
} kinds[NUM_TABLES] = {
    {"sweep", COLUMNS(sweep_columns), RUN_KEYS},      {"frames", COLUMNS(frame_columns), RUN_KEYS + 1},
    {"builds", COLUMNS(build_columns), MODEL_KEYS},   {"histogram", COLUMNS(histogram_columns), RUN_KEYS + 1},
    {"slices", COLUMNS(slice_columns), RUN_KEYS + 1}, {"stages", COLUMNS(stage_columns), 2},
    {"stability", COLUMNS(stability_columns), 4},     {"choice", COLUMNS(choice_columns), 1},
    {"dynamics", COLUMNS(dynamics_columns), 1},       {"truth", COLUMNS(truth_columns), 4},
    {"validation", COLUMNS(validation_columns), 3},
};

pliant_status pliant_report_open(const char *folder, pliant_report_tables *out)
{
    pliant_report_tables tables = {0};
    pliant_results **list[NUM_TABLES];
    char path[4096];
    pliant_status status = PLIANT_OK;
    list_tables(&tables, list);
    for (int t = 0; status == PLIANT_OK && t < NUM_TABLES; t++) {
        if (folder && snprintf(path, sizeof path, "%s/%s.csv", folder, kinds[t].name) >= (int)sizeof path)
            status = pliant_fail(PLIANT_ERROR_FILE, "%s: the name is too long", folder);
        else
            status = pliant_results_open(folder ? path : NULL, kinds[t].columns, kinds[t].num_columns,
                                         kinds[t].num_keys, list[t]);
    }
    if (status != PLIANT_OK) {
        pliant_report_close(&tables);
        return status;
    }
    *out = tables;
    return PLIANT_OK;
}

pliant_status pliant_report_write(const char *folder, const pliant_report_tables *tables)
{
    pliant_report_tables all = *tables;
    pliant_results **list[NUM_TABLES];
    char path[4096];
    pliant_status status = PLIANT_OK;
    list_tables(&all, list);
    for (int t = 0; status == PLIANT_OK && t < NUM_TABLES; t++) {
        if (snprintf(path, sizeof path, "%s/%s.csv", folder, kinds[t].name) >= (int)sizeof path)
            status = pliant_fail(PLIANT_ERROR_FILE, "%s: the name is too long", folder);
        else if (pliant_results_rows(*list[t]) > 0) status = pliant_results_write(*list[t], path);
    }
    return status;
}

void pliant_report_close(pliant_report_tables *tables)
{
    pliant_results **list[NUM_TABLES];
    list_tables(tables, list);
    for (int t = 0; t < NUM_TABLES; t++) {
        pliant_results_close(*list[t]);
        *list[t] = NULL;
    }
}

/* ---- shards of a sweep */

static pliant_status copy_file(const char *from, const char *to, const char *name)
{
    char source[4096], target[4096], block[65536];
    size_t got;
    if (!name[0]) return PLIANT_OK;
    if (strchr(name, '/')) return pliant_fail(PLIANT_ERROR_FORMAT, "%s: %s is no name of a file in it", from, name);
    snprintf(source, sizeof source, "%s/%s", from, name);
    snprintf(target, sizeof target, "%s/%s", to, name);
    FILE *in = fopen(source, "rb"), *out = in ? fopen(target, "wb") : NULL;
    bool good = in && out;
    while (good && (got = fread(block, 1, sizeof block, in)) > 0) good = fwrite(block, 1, got, out) == got;
    good = good && !ferror(in);
    if (in) fclose(in);
    if (out) good &= fclose(out) == 0;
    return good ? PLIANT_OK : pliant_fail(PLIANT_ERROR_FILE, "%s could not be copied to %s", source, target);
}

static pliant_status merge_table(const char *from, const char *folder, const pliant_results *other,
                                 pliant_results *table)
{
    const char *cells[ROW_CELLS];
    const int columns = pliant_results_columns(other);
    const int files[2] = {pliant_results_column(other, "error_file"), pliant_results_column(other, "image_file")};
    pliant_status status = PLIANT_OK;
    for (size_t r = 0; status == PLIANT_OK && r < pliant_results_rows(other); r++) {
        for (int c = 0; c < columns; c++) cells[c] = pliant_results_cell(other, r, c);
        if (pliant_results_has(table, cells)) continue;
        for (int f = 0; status == PLIANT_OK && f < 2; f++)
            if (files[f] >= 0) status = copy_file(from, folder, cells[files[f]]);
        if (status == PLIANT_OK) status = pliant_results_add(table, cells);
    }
    return status;
}

pliant_status pliant_report_merge(const char *from, const char *folder, const pliant_report_tables *tables)
{
    pliant_report_tables other, all = *tables;
    pliant_results **theirs[NUM_TABLES], **ours[NUM_TABLES];
    if (access(from, R_OK) != 0) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", from, strerror(errno));
    pliant_status status = pliant_report_open(from, &other);
    if (status != PLIANT_OK) return status;
    list_tables(&other, theirs);
    list_tables(&all, ours);
    for (int t = 0; status == PLIANT_OK && t < NUM_TABLES; t++)
        status = merge_table(from, folder, *theirs[t], *ours[t]);
    pliant_report_close(&other);
    return status;
}

/* ---- JSON */

/* Read the value after "name :" in a file of /proc; "" if it is missing. */
static void read_field(const char *path, const char *name, char *out, size_t size)
{
    char line[256];
    FILE *file = fopen(path, "r");
    out[0] = '\0';
    if (!file) return;
    while (!out[0] && fgets(line, sizeof line, file)) {
        char *value = strchr(line, ':');
        if (strncmp(line, name, strlen(name)) != 0 || !value) continue;
        value += 1 + strspn(value + 1, " \t");
        value[strcspn(value, "\n\"\\")] = '\0';
        snprintf(out, size, "%s", value);
    }
    fclose(file);
}

static void write_machine(FILE *file, const pliant_scene *scene)
{
    struct utsname system;
    char processor[128], memory[64], date[32] = "";
    time_t now = time(NULL);
    struct tm split;
    if (uname(&system) != 0) memset(&system, 0, sizeof system);
    read_field("/proc/cpuinfo", "model name", processor, sizeof processor);
    read_field("/proc/meminfo", "MemTotal", memory, sizeof memory);
    if (gmtime_r(&now, &split)) strftime(date, sizeof date, "%Y-%m-%dT%H:%M:%SZ", &split);
    fprintf(file, "\"version\": \"%s\",\n\"date\": \"%s\",\n", PLIANT_VERSION, date);
    fprintf(file,
            "\"machine\": {\"system\": \"%s %s %s\", \"processor\": \"%s\", \"cores\": %ld, \"memory\": \"%s\"},\n",
            system.sysname, system.release, system.machine, processor, sysconf(_SC_NPROCESSORS_ONLN), memory);
    static const char *const backends[] = {
#define BACKEND_NAME(name, yaml) #yaml,
        PLIANT_BACKEND_LIST(BACKEND_NAME)
#undef BACKEND_NAME
    };
    fprintf(file, "\"threads\": %d,\n\"backend_asked_for\": \"%s\"", pliant_threads_or_cores(scene->solver.threads),
            backends[scene->solver.backend]);
}

pliant_status pliant_report_json(const char *folder, const char *setup, const pliant_scene *scene,
                                 const pliant_report_tables *tables)
{
    char path[4096];
    pliant_report_tables all = *tables;
    pliant_results **list[NUM_TABLES];
    list_tables(&all, list);
    snprintf(path, sizeof path, "%s/report.json", folder);
    FILE *file = fopen(path, "w");
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    fprintf(file, "{\"setup\": \"%s\",\n", setup);
    write_machine(file, scene);
    pliant_status status = PLIANT_OK;
    for (int t = 0; status == PLIANT_OK && t < NUM_TABLES; t++) {
        fprintf(file, ",\n\"%s\": ", kinds[t].name);
        /* stability and validation may concern other bodies than the scan; their rows contain the setup */
        status = pliant_results_json(
            *list[t], *list[t] == tables->stability || *list[t] == tables->validation ? NULL : setup, file);
    }
    fputs("}\n", file);
    bool failed = ferror(file);
    failed |= fclose(file) != 0;
    if (status == PLIANT_OK && failed)
        status = pliant_fail(PLIANT_ERROR_FILE, "%s could not be written completely: %s", path, strerror(errno));
    return status;
}
