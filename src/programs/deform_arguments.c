#include "deform_arguments.h"
#include "command_line.h"
#include "deform_view.h"
#include "options_table.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

static const char help[] =
    "Usage: pliant_deform [SCENE] [--scan PATH] [--tools FILE] --out DIR [options]\n"
    "\n"
    "Deforms a scan under tools and writes the results.\n"
    "\n"
    "  SCENE              scene file (YAML); without one every option has its default\n"
    "  --scan PATH        DICOM folder or multi-frame file, NIfTI, NRRD or MetaImage file; "
    "phantom or phantom:IxJxK for the\n"
    "                     built-in scan (default: phantom)\n"
    "  --labels PATH      label map or segmentation (.seg.nrrd, DICOM SEG) of the scan: --set material/labels=PATH\n"
    "  --tools FILE       tool path (YAML), which may also change gravity; without one, only the scene's gravity acts\n"
    "  --out DIR          folder for the results; made if it is missing\n"
    "  --set OPTION=VALUE change a scene option, e.g. --set mesh/ratio=3; may be repeated\n"
    "  --steps N          steps to do (default: to the end of the tool path and until the solver has converged)\n"
    "  --every N          write volume, tables and pictures every N steps too (default: at the end only)\n"
    "  --no-volume        do not compute the deformed volume\n"
    "  --pictures         write axial.png, coronal.png, sagittal.png: before, after, difference; "
    "and mesh_axial.png and so on:\n"
    "                     tetrahedra in colours of their materials, in red where tissue presses on them, white: "
    "cuts of the path\n"
    "  --camera FROM:AT   write camera.png, what a camera sees of the deformed scan: X,Y,Z:X,Y,Z[:DEGREES] [m, LPS], "
    "from where,\n"
    "                     at what, the field of view (50)\n"
    "  --radiograph P,S   write radiograph.png: by a C-arm of these angles, "
    "primary (LAO) and secondary (cranial) [degrees]\n"
    "  --scalars A,B      numbers for every node and element, in the tables and, with --pictures, in colours: "
    "von_mises,\n"
    "                     strain_energy, volume_ratio, principal_stress, mass_change, contact_force\n"
    "  --compare A,B,C    the same by each of these methods, into DIR/A and so on; errors against the last one in\n"
    "                     DIR/compare.csv, with --pictures the scan and the methods side by side in DIR/axial.png ...\n"
    "  --displacement FILE\n"
    "                     write the displacement field, a vector per voxel [mm, LPS], as .nii.gz, .nii, .nrrd or .mha, "
    "and a mask in the same folder\n"
    "                     (FILE with _mask). A FILE without a folder lies in DIR. With a folder and --compare, "
    "FILE gets the\n"
    "                     method's name: u_fine.nii.gz. With the field as transform, "
    "ITK and 3D Slicer resample the scan into\n"
    "                     deformed.nii.gz: from a voxel there to where its tissue was at rest\n"
    "  --tissue-displacement FILE\n"
    "                     the displacement of the tissue, on the grid of the scan: "
    "from a voxel of the scan to where its tissue is\n"
    "  --vtk              write mesh.vtu (elements, stress, strain, forces) and surface.vtp for ParaView and meshio; "
    "with --every\n"
    "                     also mesh.pvd and surface.pvd, the series of all steps\n"
    "  --unit m|mm        of lengths in surface.ply, mesh.vtu and surface.vtp (default: m)\n"
    "  --min-value VALUE  errors of --compare count only voxels of at least this value, as in an isosurface\n"
    "  --quiet            no progress and no tables, warnings and errors only\n"
    "  --options          print every scene option as a table and end\n"
    "  --help             print this and end\n"
    "\n"
    "Results in DIR: deformed.nii.gz (the scan's values, deformed), nodes.csv (rest and deformed positions in metres,\n"
    "LPS; scalars), elements.csv (tetrahedra: nodes as rows of nodes.csv from 0, material, scalars), "
    "surface.ply (the surface\n"
    "with its cut faces: deformed and rest positions, material, scalars; of every triangle whether a cut has made it), "
    "steps.csv\n"
    "(iterations, residual, seconds per stage, of the warp cull_s and rasterize_s too, inverted elements; "
    "a row a step),\n"
    "tools.csv (force and held point of every tool, of a blade or a shape its tip; force and torque by contact), "
    "cuts.csv (with a path that cuts: area,\n"
    "pieces, mesh and seconds of every step that cut tissue),\n"
    "probes.csv (where the tool path's probes are), build.csv (seconds and bytes of every stage of the build).\n"
    "Where the scene has choose/budget_ms, DIR/choice holds the tried settings: CSV and JSON as of pliant_report, and "
    "its\n"
    "picture with --pictures.\n"
    "With --every N also deformed_NNNNNN.nii.gz, nodes_NNNNNN.csv and so on. Tables of times and memory go to stdout.\n"
    "\n"
    "Exit codes: 0 done, 1 failed, 2 wrong usage, 130 stopped by Ctrl-C (what was done so far is written).\n";

/* WITH: option with an argument */
#define OPTION_LIST(FLAG, WITH) \
    WITH(SCAN, "scan") WITH(LABELS, "labels") WITH(TOOLS, "tools") WITH(OUT, "out") WITH(SET, "set") \
    WITH(STEPS, "steps") WITH(EVERY, "every") FLAG(NO_VOLUME, "no-volume") FLAG(PICTURES, "pictures") \
    WITH(CAMERA, "camera") WITH(RADIOGRAPH, "radiograph") WITH(SCALARS, "scalars") WITH(COMPARE, "compare") \
    WITH(MIN_VALUE, "min-value") WITH(DISPLACEMENT, "displacement") WITH(TISSUE_DISPLACEMENT, "tissue-displacement") \
    FLAG(VTK, "vtk") WITH(UNIT, "unit") FLAG(QUIET, "quiet") FLAG(OPTIONS, "options") FLAG(HELP, "help")
#define NUMBER(code, name) code,
#define FLAG(code, name) {name, no_argument, NULL, code},
#define WITH(code, name) {name, required_argument, NULL, code},
enum { BEFORE_FIRST = 255, OPTION_LIST(NUMBER, NUMBER) };
static const struct option options[] = {OPTION_LIST(FLAG, WITH){NULL, 0, NULL, 0}};
#undef NUMBER
#undef FLAG
#undef WITH

static bool read_count(const char *name, const char *text, long *out)
{
    char *end;
    long value = strtol(text, &end, 10);
    if (*text == '\0' || *end != '\0' || value < 1) {
        fprintf(stderr, "%s %s: expected a whole number of at least 1\n", name, text);
        return false;
    }
    *out = value;
    return true;
}

#define NAME(name, yaml) #yaml,
static const char *const method_names[] = {PLIANT_METHOD_LIST(NAME)};
static const char *const scalar_names[] = {PLIANT_SCALAR_LIST(NAME)};
#undef NAME

const char *deform_method_name(pliant_method method) { return method_names[method]; }

/* Read a list "a,b" as indices of names, without duplicates and without the first `skipped` names. Return the count; 0
 * after a message. */
static int read_names(const char *option, const char *text, const char *const *names, int num_names, int skipped,
                      int *out)
{
    int count = 0;
    for (const char *at = text;; at++) {
        size_t length = strcspn(at, ",");
        int found = skipped;
        while (found < num_names && (strlen(names[found]) != length || strncmp(at, names[found], length) != 0)) found++;
        for (int n = 0; n < count; n++)
            if (out[n] == found) found = num_names;
        if (found == num_names) {
            fprintf(stderr, "%s %s: '%.*s' is not one of", option, text, (int)length, at);
            for (int n = skipped; n < num_names; n++) fprintf(stderr, " %s", names[n]);
            fputs(", or is named twice\n", stderr);
            return 0;
        }
        out[count++] = found;
        at += length;
        if (!*at) return count;
    }
}

static bool read_scalars(const char *text, deform_arguments *out)
{
    int found[PLIANT_NUM_SCALARS];
    out->num_scalars = read_names("--scalars", text, scalar_names, PLIANT_NUM_SCALARS, 1, found);
    for (int n = 0; n < out->num_scalars; n++) out->scalars[n] = (pliant_scalar)found[n];
    return out->num_scalars > 0;
}

static bool read_compared(const char *text, deform_arguments *out)
{
    int found[PLIANT_NUM_METHODS];
    out->num_compared = read_names("--compare", text, method_names, PLIANT_NUM_METHODS, 0, found);
    for (int n = 0; n < out->num_compared; n++) out->compared[n] = (pliant_method)found[n];
    return out->num_compared > 0;
}

static bool read_min_value(const char *text, double *out)
{
    char *end;
    *out = strtod(text, &end);
    if (*text && !*end && isfinite(*out)) return true;
    fprintf(stderr, "--min-value %s: expected the value of a voxel\n", text);
    return false;
}

static bool read_unit(const char *text, double *out)
{
    *out = strcmp(text, "mm") == 0 ? 1e-3 : 1;
    if (strcmp(text, "m") == 0 || strcmp(text, "mm") == 0) return true;
    fprintf(stderr, "--unit %s: use m or mm\n", text);
    return false;
}

/* Reject an unknown file extension before the simulation. */
static bool read_field(const char *option, const char *text, const char **out)
{
    static const char *const endings[] = {".nii", ".nii.gz", ".nrrd", ".mha"};
    const size_t length = strlen(text);
    for (size_t e = 0; e < sizeof endings / sizeof *endings; e++) {
        const size_t size = strlen(endings[e]);
        if (length > size && strcasecmp(text + length - size, endings[e]) == 0) {
            *out = text;
            return true;
        }
    }
    fprintf(stderr, "%s %s: unknown file extension; use .nii.gz, .nii, .nrrd or .mha\n", option, text);
    return false;
}

/* Reject names for which one result would overwrite another. */
static bool check_fields(const deform_arguments *arguments)
{
    const char *names[] = {arguments->displacement, arguments->tissue_displacement};
    for (int n = 0; n < 2; n++) {
        const bool same = names[n] && names[1 - n] && strcmp(names[n], names[1 - n]) == 0;
        if (!same && !(names[n] && strcmp(names[n], "deformed.nii.gz") == 0)) continue;
        fprintf(stderr, "%s %s: %s is written to that file; use another name\n",
                n ? "--tissue-displacement" : "--displacement", names[n],
                same ? "the other field" : "the deformed volume");
        return false;
    }
    return true;
}

/* @param exit_code set if the program ends without an error */
static bool read_one(int code, deform_arguments *out, const char **labels, int *exit_code)
{
    switch (code) {
    case SCAN: out->scan = optarg; return true;
    case LABELS: *labels = optarg; return true;
    case TOOLS: out->tools = optarg; return true;
    case OUT: out->folder = optarg; return true;
    case SET: return true;
    case STEPS: return read_count("--steps", optarg, &out->steps);
    case EVERY: return read_count("--every", optarg, &out->every);
    case NO_VOLUME: out->volume = false; return true;
    case PICTURES: out->pictures = true; return true;
    case CAMERA: return out->has_camera = deform_view_read_camera(optarg, &out->camera);
    case RADIOGRAPH: return out->has_arm = deform_view_read_arm(optarg, out->arm);
    case SCALARS: return read_scalars(optarg, out);
    case COMPARE: return read_compared(optarg, out);
    case MIN_VALUE: return read_min_value(optarg, &out->min_value);
    case DISPLACEMENT: return read_field("--displacement", optarg, &out->displacement);
    case TISSUE_DISPLACEMENT: return read_field("--tissue-displacement", optarg, &out->tissue_displacement);
    case VTK: out->vtk = true; return true;
    case UNIT: return read_unit(optarg, &out->unit);
    case QUIET: out->quiet = true; return true;
    case OPTIONS:
        options_table_print(stdout);
        *exit_code = EXIT_OK;
        return false;
    case HELP:
        fputs(help, stdout);
        *exit_code = EXIT_OK;
        return false;
    default: fputs("see pliant_deform --help\n", stderr); return false;
    }
}

bool deform_arguments_read(int argc, char **argv, deform_arguments *out, int *exit_code)
{
    memset(out, 0, sizeof *out);
    pliant_scene_defaults(&out->scene);
    out->scan = "phantom";
    out->volume = true;
    out->min_value = -INFINITY;
    out->unit = 1;
    *exit_code = EXIT_USAGE;
    const char *labels = NULL;
    for (int code; (code = getopt_long(argc, argv, "", options, NULL)) != -1;)
        if (!read_one(code, out, &labels, exit_code)) return false;
    if (!out->folder) {
        fputs("--out DIR is missing; see pliant_deform --help\n", stderr);
        return false;
    }
    if (!out->volume && (out->pictures || isfinite(out->min_value))) {
        fprintf(stderr, "%s needs the volume: remove --no-volume\n", out->pictures ? "--pictures" : "--min-value");
        return false;
    }
    if (!check_fields(out) || !command_line_scene(argc, argv, options, SET, &out->scene, exit_code)) return false;
    if (!labels || pliant_scene_set(&out->scene, "material/labels", labels) == PLIANT_OK) return true;
    fprintf(stderr, "--labels: %s\n", pliant_last_error());
    *exit_code = EXIT_USAGE;
    return false;
}
