#include "report_arguments.h"
#include "command_line.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char help[] =
    "Usage: pliant_report [SCENE] [--scan PATH] --out DIR [options]\n"
    "\n"
    "Measures error against run time on your scan, extreme cases of the solver, and the cost of each stage.\n"
    "\n"
    "  SCENE               scene file (YAML); without one every option has its default\n"
    "  --scan PATH         DICOM folder, NIfTI, NRRD or MetaImage file; phantom or phantom:IxJxK for the built-in one\n"
    "  --out DIR           folder for the results; existing rows are not recomputed\n"
    "  --set OPTION=VALUE  change a scene option; may be repeated\n"
    "\n"
    "Measurements (default: all):\n"
    "  --sweep             error against run time\n"
    "  --truth             error of the mesh, from three resolutions, compared with the error of the solver; for\n"
    "                      model/method: fine, with both laws (element/law), and the distance between the laws\n"
    "  --validate FOLDER   measured bodies: fitted on one state, predicted in the others; may be repeated, "
    "and needs no scan. FOLDER holds\n"
    "                       gravity_markers.csv, truthcube*.csv, tables like these of any name, or scene.yaml, "
    "scan.* and markers.csv (as of\n"
    "                       pliant_fit) with load_1.yaml ...; or folders with such\n"
    "  --materials A,B     materials that the fit of a scene.yaml determines (default: all except empty and fixed)\n"
    "  --ablation          time and memory without each stage of the scene\n"
    "  --stability         extreme cases, on a small block; with --full also loads on the scan (needs no scan "
    "otherwise)\n"
    "  --case NAME         one stability case only; --cases prints their names\n"
    "  --steps N           steps of the long run (default: 20000; 1000000 with --full)\n"
    "\n"
    "Cases of the sweep:\n"
    "  --quick             one pull, the scene's ratio, a few budgets (the default: an hour on two busy\n"
    "                       cores)\n"
    "  --full              three pulls, ratios 2 and 4, more budgets (several hours)\n"
    "  --methods A,B       methods to compare (default: all that support the elements of the scene)\n"
    "  --ratios 1,2        fine cells along a coarse one\n"
    "  --budgets 1,2,0     iterations a step; 0: until the scene's tolerance is met\n"
    "  --vary OPTION=A,B   one more option of the scene, with each of these values\n"
    "  --at X,Y,Z          pull here [m, LPS]; may be repeated\n"
    "  --labels 5,20       pull at the fronts of these labels\n"
    "  --points N          maximum number of points to pull at, without --at and --labels\n"
    "  --pull X,Y,Z        displacement of a pulled point [m] (default: 0.004,-0.029,0.006;\n"
    "                      a hundredth of it for solver/kind tled; "
    "in proportion for bodies below 50 mm or above 600 mm)\n"
    "  --frames N          of a pull (default: 30)\n"
    "  --repeats N         runs of each case; the fastest time of each frame is reported, "
    "for a machine that does other work\n"
    "  --refined N         maximum number of tetrahedra of a mesh of twice the resolution, which is also solved (0: "
    "never)\n"
    "  --shard I/N         one part of N of the sweep's models, I from 1 to N, each in a separate folder; "
    "results do not depend on N\n"
    "  --merge DIR         add the rows of a part in DIR to --out; may be repeated, and needs no scan\n"
    "  --no-warp           no deformed volume: no times and errors of it\n"
    "\n"
    "  --no-pictures       tables only\n"
    "  --quiet             no progress and no tables, warnings and errors only\n"
    "  --help              print this and end\n"
    "\n"
    "Results in DIR: sweep.csv (a row a run), frames.csv, builds.csv, histogram.csv, slices.csv, stages.csv, "
    "truth.csv, validation.csv,\n"
    "dynamics.csv (of tled), stability.csv, report.json (all of it, with machine, threads, backend and version), "
    "plot.py and its pictures;\n"
    "reference_*.bin hold the fine reference solutions, so that a sweep can continue.\n"
    "\n"
    "Exit codes: 0 done, 1 failed or a stability case was broken, 2 wrong usage, "
    "130 stopped by Ctrl-C (finished rows are kept).\n";

/* WITH: option with an argument */
#define OPTION_LIST(FLAG, WITH) \
    WITH(SCAN, "scan") WITH(OUT, "out") WITH(SET, "set") FLAG(SWEEP, "sweep") FLAG(TRUTH, "truth") \
    WITH(VALIDATE, "validate") WITH(MATERIALS, "materials") FLAG(ABLATION, "ablation") FLAG(STABILITY, "stability") \
    WITH(CASE, "case") FLAG(CASES, "cases") WITH(STEPS, "steps") FLAG(QUICK, "quick") FLAG(FULL, "full") \
    WITH(METHODS, "methods") WITH(RATIOS, "ratios") WITH(BUDGETS, "budgets") WITH(VARY, "vary") WITH(AT, "at") \
    WITH(LABELS, "labels") WITH(POINTS, "points") WITH(PULL, "pull") WITH(FRAMES, "frames") WITH(REPEATS, "repeats") \
    WITH(REFINED, "refined") WITH(SHARD, "shard") WITH(MERGE, "merge") FLAG(NO_WARP, "no-warp") \
    FLAG(NO_PICTURES, "no-pictures") FLAG(QUIET, "quiet") FLAG(HELP, "help")
#define NUMBER(code, name) code,
#define FLAG(code, name) {name, no_argument, NULL, code},
#define WITH(code, name) {name, required_argument, NULL, code},
enum { BEFORE_FIRST = 255, OPTION_LIST(NUMBER, NUMBER) };
static const struct option options[] = {OPTION_LIST(FLAG, WITH){NULL, 0, NULL, 0}};
#undef NUMBER
#undef FLAG
#undef WITH

#define NAME(name, yaml) #yaml,
static const char *const method_names[] = {PLIANT_METHOD_LIST(NAME)};
#undef NAME

static bool wrong(const char *option, const char *text, const char *wanted)
{
    fprintf(stderr, "%s %s: %s\n", option, text, wanted);
    return false;
}

/* Read a list "1,2,0". */
static bool read_list(const char *option, const char *text, long low, long high, int32_t *out, int *count, int maximum)
{
    *count = 0;
    for (const char *at = text;; at++) {
        char *end;
        long value = strtol(at, &end, 10);
        if (end == at || value < low || value > high || *count == maximum || (*end && *end != ','))
            return wrong(option, text, "expected whole numbers in range, separated by commas");
        out[(*count)++] = (int32_t)value;
        at = end;
        if (!*end) return true;
    }
}

static bool read_methods(const char *text, uint32_t *out)
{
    *out = 0;
    for (const char *at = text;; at++) {
        size_t length = strcspn(at, ","), m = 0;
        while (m < sizeof method_names / sizeof *method_names &&
               (strlen(method_names[m]) != length || strncmp(at, method_names[m], length) != 0))
            m++;
        if (m == sizeof method_names / sizeof *method_names) return wrong("--methods", text, "not a method of a scene");
        *out |= 1u << m;
        at += length;
        if (!*at) return true;
    }
}

/* Split a list "a,b" in place. */
static bool read_names(char *text, report_arguments *out)
{
    out->num_names = 0;
    for (char *name = strtok(text, ","); name; name = strtok(NULL, ",")) {
        if (out->num_names == PLIANT_MAX_MODULI) return wrong("--materials", name, "there are too many");
        out->names[out->num_names++] = name;
    }
    return true;
}

/* Read "group/name=a,b". */
static bool read_vary(const char *text, pliant_sweep *out)
{
    const char *equals = strchr(text, '=');
    if (!equals || (size_t)(equals - text) >= sizeof out->option) return wrong("--vary", text, "expected OPTION=A,B");
    memcpy(out->option, text, (size_t)(equals - text));
    out->option[equals - text] = '\0';
    out->num_values = 0;
    for (const char *at = equals + 1;; at++) {
        size_t length = strcspn(at, ",");
        if (length == 0 || length >= sizeof out->values[0] || out->num_values == PLIANT_MAX_VARIED)
            return wrong("--vary", text, "expected at most eight short values");
        memcpy(out->values[out->num_values], at, length);
        out->values[out->num_values++][length] = '\0';
        at += length;
        if (!*at) return true;
    }
}

static void set_full_sweep(report_arguments *out)
{
    static const int32_t budgets[] = {1, 2, 3, 4, 6, 12, 0};
    out->sweep.num_ratios = out->sweep.num_iterations = 0;
    out->sweep.ratios[out->sweep.num_ratios++] = 2;
    out->sweep.ratios[out->sweep.num_ratios++] = 4;
    for (size_t b = 0; b < sizeof budgets / sizeof *budgets; b++)
        out->sweep.iterations[out->sweep.num_iterations++] = budgets[b];
    out->num_points = 3;
    out->sweep.max_refined_tets = 2e6;
    out->stability_on_scan = true;
    out->stability.long_steps = 1000000;
}

/* Read the scene first, then --quick and --full, then single options, in any order on the command line. */
static bool read_scene(int argc, char **argv, report_arguments *out, int *exit_code)
{
    bool full = false;
    *exit_code = EXIT_USAGE;
    for (int code; (code = getopt_long(argc, argv, "", options, NULL)) != -1;) {
        if (code == '?') return false;
        if (code == FULL || code == QUICK) full = code == FULL;
    }
    if (!command_line_scene(argc, argv, options, SET, &out->scene, exit_code)) return false;
    pliant_sweep_defaults(&out->scene, &out->sweep);
    pliant_stability_defaults(&out->stability);
    out->num_points = 1;
    if (full) set_full_sweep(out);
    optind = 1;
    return true;
}

static bool read_number(const char *option, const char *text, double low, double high, double *out)
{
    char *end;
    *out = strtod(text, &end);
    return (end != text && !*end && *out >= low && *out <= high) || wrong(option, text, "expected a number in range");
}

static bool read_count(const char *option, const char *text, double high, int32_t *out)
{
    double number;
    const bool good = read_number(option, text, 1, high, &number);
    if (good) *out = (int32_t)number;
    return good;
}

/* Add a folder to a list of them. */
static bool add_folder(const char *option, const char *text, int maximum, int *count, const char **out)
{
    if (*count == maximum) return wrong(option, text, "there are too many folders");
    out[(*count)++] = text;
    return true;
}

static bool read_point(const char *text, pliant_sweep *sweep)
{
    if (sweep->num_points == PLIANT_MAX_PULLS) return wrong("--at", text, "there are too many points");
    if (!command_line_point("--at", text, sweep->points[sweep->num_points].rest)) return false;
    snprintf(sweep->points[sweep->num_points].name, sizeof sweep->points->name, "point %d", sweep->num_points + 1);
    sweep->num_points++;
    return true;
}

static bool read_shard(const char *text, pliant_sweep *sweep)
{
    char rest;
    return (sscanf(text, "%" SCNd32 "/%" SCNd32 "%c", &sweep->shard, &sweep->shards, &rest) == 2 &&
            sweep->shards >= 1 && sweep->shard >= 1 && sweep->shard <= sweep->shards) ||
           wrong("--shard", text, "expected a part and the number of parts, such as 2/8");
}

static bool read_one(int code, report_arguments *out)
{
    pliant_sweep *sweep = &out->sweep;
    double number = 0;
    bool good = true;
    switch (code) {
    case SCAN: out->scan = optarg; break;
    case OUT: out->folder = optarg; break;
    case SWEEP: out->do_sweep = true; break;
    case TRUTH: out->do_truth = true; break;
    case VALIDATE: good = add_folder("--validate", optarg, MAX_MEASURED, &out->num_measured, out->measured); break;
    case MATERIALS: good = read_names(optarg, out); break;
    case ABLATION: out->do_ablation = true; break;
    case STABILITY: out->do_stability = true; break;
    case CASE:
        out->do_stability = true;
        out->stability.only = optarg;
        break;
    case STEPS:
        good = read_number("--steps", optarg, 1, 1e12, &number);
        out->stability.long_steps = (int64_t)number;
        break;
    case METHODS:
        good = read_methods(optarg, &sweep->methods);
        out->stability.methods = sweep->methods;
        break;
    case RATIOS: good = read_list("--ratios", optarg, 1, 8, sweep->ratios, &sweep->num_ratios, PLIANT_MAX_SWEPT); break;
    case BUDGETS:
        good = read_list("--budgets", optarg, 0, 1000, sweep->iterations, &sweep->num_iterations, PLIANT_MAX_SWEPT);
        break;
    case VARY: good = read_vary(optarg, sweep); break;
    case AT: good = read_point(optarg, sweep); break;
    case LABELS: good = read_list("--labels", optarg, 1, 65535, out->labels, &out->num_labels, PLIANT_MAX_PULLS); break;
    case POINTS: good = read_count("--points", optarg, PLIANT_MAX_PULLS, &out->num_points); break;
    case PULL: good = out->pull_given = command_line_point("--pull", optarg, sweep->pull); break;
    case FRAMES: good = read_count("--frames", optarg, 1e4, &sweep->frames); break;
    case REPEATS: good = read_count("--repeats", optarg, 1000, &sweep->repeats); break;
    case REFINED: good = read_number("--refined", optarg, 0, 1e12, &sweep->max_refined_tets); break;
    case SHARD: good = read_shard(optarg, sweep); break;
    case MERGE: good = add_folder("--merge", optarg, MAX_PARTS, &out->num_parts, out->parts); break;
    case NO_WARP: sweep->warp = false; break;
    case NO_PICTURES: out->pictures = false; break;
    case QUIET: out->quiet = true; break;
    default: break;
    }
    return good;
}

/* Remove the arguments __name:=... and __log:=... that roslaunch adds. Return the remaining count. */
static int remove_roslaunch_arguments(int argc, char **argv)
{
    int kept = 1;
    for (int a = 1; a < argc; a++)
        if (strncmp(argv[a], "__", 2) != 0 || !strstr(argv[a], ":=")) argv[kept++] = argv[a];
    return kept;
}

bool report_arguments_read(int argc, char **argv, report_arguments *out, int *exit_code)
{
    memset(out, 0, sizeof *out);
    pliant_scene_defaults(&out->scene);
    out->pictures = true;
    *exit_code = EXIT_OK;
    argc = remove_roslaunch_arguments(argc, argv);
    for (int a = 1; a < argc; a++) {
        if (strcmp(argv[a], "--help") == 0) return fputs(help, stdout), false;
        if (strcmp(argv[a], "--cases") != 0) continue;
        for (int c = 0; pliant_stability_case(c); c++) puts(pliant_stability_case(c));
        return false;
    }
    if (!read_scene(argc, argv, out, exit_code)) return false;
    for (int code; (code = getopt_long(argc, argv, "", options, NULL)) != -1;)
        if (!read_one(code, out)) return false;
    if (!out->do_sweep && !out->do_truth && !out->do_ablation && !out->do_stability && !out->num_measured &&
        !out->num_parts)
        out->do_sweep = out->do_truth = out->do_ablation = out->do_stability = true;
    if (!out->folder) return wrong("--out", "DIR", "is missing; see pliant_report --help");
    if (!out->scan && (out->do_sweep || out->do_truth || out->do_ablation))
        return wrong("--scan", "PATH", "is missing: only --stability needs no scan");
    return true;
}
