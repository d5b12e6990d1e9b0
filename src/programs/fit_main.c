/* pliant_fit: fit Young's moduli of named materials to measured displacements. */
#define _POSIX_C_SOURCE 200809L
#include "command_line.h"
#include "console.h"
#include "base/fail.h"
#include "base/memory.h"
#include "pliant/pliant.h"
#include "report/report.h"
#include "sim/build/model.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char help[] =
    "Usage: pliant_fit [SCENE] --scan PATH --markers FILE --materials A,B --out DIR [options]\n"
    "\n"
    "Finds Young's moduli of materials from measured displacements, with their confidence.\n"
    "\n"
    "  SCENE              scene file (YAML); its material table gives the initial moduli\n"
    "  --scan PATH        DICOM folder, NIfTI, NRRD or MetaImage file; phantom or phantom:IxJxK for the built-in scan\n"
    "  --markers FILE     CSV, a line a marker: load,x,y,z,moved_x,moved_y,moved_z[,deviation], metres, LPS; "
    "loads count from 1.\n"
    "                     x, y, z is the position at rest. moved_x, moved_y, moved_z is the displacement: "
    "the deformed minus the\n"
    "                     rest position\n"
    "  --materials A,B    materials whose moduli are fitted, at most 8\n"
    "  --load FILE        tool path (YAML) of a load, as at its end, including gravity; once for each load (default: "
    "one load, the\n"
    "                     scene's own gravity)\n"
    "  --deviation D      standard deviation of a measured number [m], for lines without one (default: 0.0005; "
    "for bodies\n"
    "                     below 50 mm or above 600 mm, cube root of the tissue's volume, in proportion)\n"
    "  --set OPTION=VALUE change a scene option; may be repeated\n"
    "  --quiet            no progress and no table, warnings and errors only\n"
    "  --help             print this and end\n"
    "\n"
    "Results in DIR: moduli.csv (a row a material: modulus, 95 % interval, correlations). "
    "A modulus belongs to the\n"
    "mesh of the scene: a mesh that is too stiff gives a modulus that is too low. pliant_report --truth reports the\n"
    "error of a mesh.\n"
    "\n"
    "Exit codes: 0 done, 1 failed, 2 wrong usage, 130 stopped by Ctrl-C.\n";

enum { SCAN = 256, MARKERS, MATERIALS, LOAD, DEVIATION, OUT, SET, QUIET, HELP, MAX_LOADS = 16 };

static const struct option options[] = {
    {"scan", required_argument, NULL, SCAN},           {"markers", required_argument, NULL, MARKERS},
    {"materials", required_argument, NULL, MATERIALS}, {"load", required_argument, NULL, LOAD},
    {"deviation", required_argument, NULL, DEVIATION}, {"out", required_argument, NULL, OUT},
    {"set", required_argument, NULL, SET},             {"quiet", no_argument, NULL, QUIET},
    {"help", no_argument, NULL, HELP},                 {NULL, 0, NULL, 0},
};

static const double usual_deviation = 5e-4; /* standard deviation for a patient [m] */

typedef struct fit_arguments {
    pliant_scene scene;
    const char *scan, *markers, *folder, *loads[MAX_LOADS], *names[PLIANT_MAX_MODULI];
    int num_loads, num_names;
    double deviation; /* 0: the default */
    bool quiet;
} fit_arguments;

static bool wrong(const char *message)
{
    fprintf(stderr, "%s; see pliant_fit --help\n", message);
    return false;
}

/* Split a list "a,b" in place. */
static bool read_names(char *text, fit_arguments *out)
{
    for (char *name = strtok(text, ","); name; name = strtok(NULL, ",")) {
        if (out->num_names == PLIANT_MAX_MODULI) return wrong("--materials: there are too many");
        out->names[out->num_names++] = name;
    }
    return true;
}

static bool read_arguments(int argc, char **argv, fit_arguments *out, int *exit_code)
{
    *out = (fit_arguments){.deviation = 0};
    pliant_scene_defaults(&out->scene);
    *exit_code = EXIT_USAGE;
    for (int code; (code = getopt_long(argc, argv, "", options, NULL)) != -1;) {
        char *end = NULL;
        switch (code) {
        case SCAN: out->scan = optarg; break;
        case MARKERS: out->markers = optarg; break;
        case OUT: out->folder = optarg; break;
        case QUIET: out->quiet = true; break;
        case SET: break;
        case MATERIALS:
            if (!read_names(optarg, out)) return false;
            break;
        case LOAD:
            if (out->num_loads == MAX_LOADS) return wrong("--load: there are too many");
            out->loads[out->num_loads++] = optarg;
            break;
        case DEVIATION:
            out->deviation = strtod(optarg, &end);
            if (*end || !(out->deviation > 0)) return wrong("--deviation: expected a number above 0, in metres");
            break;
        case HELP:
            fputs(help, stdout);
            *exit_code = EXIT_OK;
            return false;
        default: return wrong("wrong usage");
        }
    }
    if (!out->scan || !out->markers || !out->folder || out->num_names == 0)
        return wrong("--scan, --markers, --materials and --out are needed");
    return command_line_scene(argc, argv, options, SET, &out->scene, exit_code);
}

static pliant_status write(const fit_arguments *arguments, const pliant_moduli *found)
{
    char path[4096];
    snprintf(path, sizeof path, "%s/moduli.csv", arguments->folder);
    FILE *file = fopen(path, "w");
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    fputs("material,young_modulus_pa,low_pa,high_pa,misfit,rms_m", file);
    for (int q = 0; q < found->count; ++q) fprintf(file, ",correlation_%s", arguments->names[q]);
    fputc('\n', file);
    printf("%-20s %12s %28s\n", "material", "E [Pa]", "95 % between");
    for (int p = 0; p < found->count; ++p) {
        printf("%-20s %12.4g %12.4g and %11.4g\n", arguments->names[p], found->young[p], found->low[p], found->high[p]);
        fprintf(file, "%s,%.6g,%.6g,%.6g,%.6g,%.6g", arguments->names[p], found->young[p], found->low[p],
                found->high[p], found->misfit, found->rms);
        for (int q = 0; q < found->count; ++q) fprintf(file, ",%.4g", found->correlation[p][q]);
        fputc('\n', file);
    }
    printf("root mean square error %.3g mm, misfit %.3g (1: as the deviations predict); %d iterations\n",
           1e3 * found->rms, found->misfit, found->passes);
    int failed = ferror(file) | fclose(file);
    return failed ? pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno)) : PLIANT_OK;
}

int main(int argc, char **argv)
{
    fit_arguments arguments;
    int exit_code, num_loads = 0;
    if (!read_arguments(argc, argv, &arguments, &exit_code)) return exit_code;
    console_start(arguments.quiet ? PLIANT_LOG_WARNING : PLIANT_LOG_INFO);
    pliant_volume scan = {0};
    pliant_labels labels = {0};
    pliant_material_table materials = {0};
    pliant_path loads[MAX_LOADS] = {{0}};
    pliant_marker *markers = NULL;
    pliant_moduli found;
    pliant_moduli_data data = {.num_loads = arguments.num_loads > 0 ? arguments.num_loads : 1,
                               .loads = arguments.num_loads > 0 ? loads : NULL};
    pliant_status status = command_line_folder(arguments.folder);
    double deviation = arguments.deviation, scale = 1;
    if (status >= 0) status = pliant_inputs_read(&arguments.scene, arguments.scan, &scan, &labels, &materials);
    if (status >= 0 && deviation == 0)
        status = pliant_length_scale(&scan, labels.voxels ? &labels : NULL, &materials, &scale);
    if (deviation == 0) deviation = usual_deviation * scale;
    if (status >= 0) status = pliant_markers_read(arguments.markers, deviation, &data.num_markers, &markers);
    for (; status >= 0 && num_loads < arguments.num_loads; ++num_loads)
        status = pliant_path_read(arguments.loads[num_loads], &loads[num_loads]);
    data.markers = markers;
    const pliant_report_input input = {&arguments.scene, &scan, labels.voxels ? &labels : NULL, &materials};
    if (status >= 0)
        status = pliant_moduli_fit(&input, &data, arguments.num_names, arguments.names, console_progress(), &found);
    console_progress_end();
    if (status == PLIANT_NOT_CONVERGED)
        pliant_log(PLIANT_LOG_WARNING, "the fit has not converged: the moduli are the best found");
    if (status >= 0) status = write(&arguments, &found);
    for (int n = 0; n < num_loads; ++n) pliant_path_free(&loads[n]);
    pliant_free(markers);
    pliant_material_table_free(&materials);
    pliant_labels_free(&labels);
    pliant_volume_free(&scan);
    if (console_stop_requested()) return EXIT_STOPPED;
    return status < 0 ? EXIT_FAILED : EXIT_OK;
}
