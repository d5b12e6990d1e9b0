/* pliant_segment: the labels that segment/kind gmm finds in a scan, as a map, a table and pictures, to pick targets from. */
#define _POSIX_C_SOURCE 200809L
#include "command_line.h"
#include "console.h"
#include "pliant/fail.h"
#include "picture.h"
#include "pliant/pliant.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { MOST_SHOWN = 30 };

static const char help[] =
    "Usage: pliant_segment [SCENE] [--scan PATH] --out DIR [--set segment/OPTION=VALUE]\n"
    "\n"
    "Finds tissues by intensity: a Gaussian mixture, neighbours that agree, connected pieces. Writes to DIR:\n"
    "labels.nii.gz (a label a piece), pieces.csv (label, class, mean intensity, volume, centre), axial.png, coronal.png,\n"
    "sagittal.png (the scan, and a colour a piece, through its middle). With segment/kind gmm in a scene, a material\n"
    "table names these labels; what it does not name goes by intensity.\n"
    "\n"
    "  SCENE              scene file (YAML); without one every option has its default\n"
    "  --scan PATH        DICOM folder, NIfTI, NRRD or MetaImage file; phantom or phantom:IxJxK (default: phantom)\n"
    "  --out DIR          folder for the results; made if it is missing\n"
    "  --set OPTION=VALUE change a scene option, e.g. --set segment/classes=8; may be repeated\n"
    "  --help             print this and end\n"
    "\n"
    "Exit codes: 0 done, 1 failed, 2 wrong usage.\n";

typedef struct segment_arguments {
    pliant_scene scene;
    const char *scan, *folder;
} segment_arguments;

/* True: go on; false: end with *exit_code. */
static bool read_arguments(int argc, char **argv, segment_arguments *out, int *exit_code)
{
    static const struct option options[] = {
        {"scan", required_argument, NULL, 'c'}, {"out", required_argument, NULL, 'o'}, {"set", required_argument, NULL, 's'},
        {"help", no_argument, NULL, 'h'},       {NULL, 0, NULL, 0},
    };
    bool good = true;
    *exit_code = EXIT_USAGE;
    out->scan = "phantom";
    pliant_scene_defaults(&out->scene);
    for (int code; good && (code = getopt_long(argc, argv, "", options, NULL)) != -1;)
        switch (code) {
        case 'c': out->scan = optarg; break;
        case 'o': out->folder = optarg; break;
        case 's': break;
        case 'h':
            fputs(help, stdout);
            *exit_code = EXIT_OK;
            return false;
        default: good = false;
        }
    if (good && out->folder) return command_line_scene(argc, argv, options, 's', &out->scene, exit_code);
    fputs(help, stderr);
    return false;
}

static pliant_status write_table(const char *folder, const pliant_segmentation *found)
{
    char path[4096];
    snprintf(path, sizeof path, "%s/pieces.csv", folder);
    FILE *file = fopen(path, "w");
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    fputs("label,class,class_mean,class_deviation,mean,volume_ml,centre_x_m,centre_y_m,centre_z_m\n", file);
    for (int32_t p = 0; p < found->num_pieces; p++) {
        const pliant_segment_piece *piece = found->pieces + p;
        const pliant_segment_class *of = found->classes + piece->class_index;
        fprintf(file, "%d,%d,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n", (int)p + 1, (int)piece->class_index, of->mean, of->deviation, piece->mean,
                1e6 * piece->volume, piece->centre[0], piece->centre[1], piece->centre[2]);
    }
    int failed = ferror(file) | fclose(file);
    return failed ? pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno)) : PLIANT_OK;
}

/* A colour a label, far from those of its neighbours in number: hues by the golden angle. */
static void colour_of(int label, uint8_t rgb[3])
{
    double hue = fmod(label * 0.61803398875, 1.0) * 6, shade = label % 3 == 0 ? 255 : label % 3 == 1 ? 200 : 150;
    for (int c = 0; c < 3; c++) {
        double apart = fabs(fmod(hue - 2 * c + 9, 6) - 3); /* 0 where the channel is strongest */
        rgb[c] = (uint8_t)(shade * fmin(fmax(2 - apart, 0.15), 1));
    }
}

typedef struct plane { const char *name; int right, down; } plane;

/* by index axes: of the usual scans i runs to a side, j to front or back, k up or down */
static pliant_status draw_plane(const char *folder, plane view, const pliant_volume *scan, const pliant_labels *labels)
{
    const pliant_geometry *g = &scan->geometry;
    const int32_t wide = g->size[view.right], tall = g->size[view.down];
    int normal = 3 - view.right - view.down;
    double low, high, aspect = g->spacing[view.down] / g->spacing[view.right];
    int32_t scale = wide < 300 ? 2 : 1, width = scale * wide, height = (int32_t)ceil(scale * tall * aspect);
    pliant_status status = picture_window(scan, &low, &high);
    if (status < 0) return status;
    uint8_t *rgb = pliant_calloc((size_t)(2 * width) * (size_t)height, 3);
    if (!rgb) return pliant_fail_memory("a picture");
    for (int32_t y = 0; y < height; y++)
        for (int32_t x = 0; x < width; x++) {
            size_t at[3];
            int32_t row = (int32_t)(y / (scale * aspect));
            at[normal] = (size_t)g->size[normal] / 2;
            at[view.right] = (size_t)(x / scale);
            at[view.down] = (size_t)(row < tall ? row : tall - 1);
            /* superior is up */
            if (view.down == 2 && g->direction[8] > 0) at[2] = (size_t)tall - 1 - at[2];
            size_t v = at[0] + (size_t)g->size[0] * (at[1] + (size_t)g->size[1] * at[2]);
            uint8_t grey = (uint8_t)(255 * fmin(fmax((pliant_volume_value(scan, v) - low) / (high - low), 0), 1));
            uint8_t *left = rgb + 3 * ((size_t)y * (size_t)(2 * width) + (size_t)x), *right = left + 3 * (size_t)width;
            memset(left, grey, 3);
            colour_of(labels->voxels[v], right);
        }
    char path[4096];
    snprintf(path, sizeof path, "%s/%s.png", folder, view.name);
    status = picture_png(path, rgb, 2 * width, height);
    pliant_free(rgb);
    return status;
}

static pliant_status write_results(const char *folder, const pliant_volume *scan, const pliant_segmentation *found)
{
    static const plane planes[] = {{"axial", 0, 1}, {"coronal", 0, 2}, {"sagittal", 1, 2}};
    char path[4096];
    pliant_status status = command_line_folder(folder);
    snprintf(path, sizeof path, "%s/labels.nii.gz", folder);
    if (status >= 0) status = pliant_labels_write(path, &found->labels);
    if (status >= 0) status = write_table(folder, found);
    for (int p = 0; status >= 0 && p < 3; p++) status = draw_plane(folder, planes[p], scan, &found->labels);
    return status;
}

static void print(const pliant_segmentation *found, double seconds)
{
    printf("%d classes, %d pieces in %.2f s, BIC %.6g\n%5s %5s %10s %10s\n", (int)found->num_classes, (int)found->num_pieces, seconds,
           found->criterion, "label", "class", "mean", "ml");
    for (int32_t p = 0; p < found->num_pieces && p < MOST_SHOWN; p++)
        printf("%5d %5d %10.1f %10.1f\n", (int)p + 1, (int)found->pieces[p].class_index, found->pieces[p].mean, 1e6 * found->pieces[p].volume);
    if (found->num_pieces > MOST_SHOWN) printf("and %d smaller ones, in pieces.csv\n", (int)found->num_pieces - MOST_SHOWN);
}

int main(int argc, char **argv)
{
    segment_arguments arguments = {.folder = NULL};
    pliant_volume scan = {0};
    pliant_labels labels = {0};
    pliant_material_table materials = {0};
    pliant_segmentation found = {0};
    int exit_code;
    if (!read_arguments(argc, argv, &arguments, &exit_code)) return exit_code;
    console_start(PLIANT_LOG_INFO);
    const pliant_scene *scene = &arguments.scene;
    arguments.scene.segment.kind = PLIANT_SEGMENT_NONE;
    pliant_status status = pliant_material_table_default(&materials); /* not looked at: any scan will do */
    if (status >= 0) status = pliant_scan_inputs_read(scene, &materials, arguments.scan, &scan, &labels);
    pliant_segment_options options = {scene->segment.classes, scene->segment.most_classes, scene->segment.coherence, scene->segment.smallest,
                                      scene->solver.threads, scene->solver.backend};
    double start = pliant_seconds();
    if (status >= 0) status = pliant_segment(&scan, &options, &found);
    if (status >= 0) print(&found, pliant_seconds() - start);
    if (status >= 0) status = write_results(arguments.folder, &scan, &found);
    if (status >= 0) printf("results in %s\n", arguments.folder);
    pliant_segmentation_free(&found);
    pliant_material_table_free(&materials);
    pliant_labels_free(&labels);
    pliant_volume_free(&scan);
    return status < 0 ? EXIT_FAILED : EXIT_OK;
}
