/* pliant_segment: write the labels that segment/kind gmm finds in a scan, as a map, a table and pictures. */
#define _POSIX_C_SOURCE 200809L
#include "command_line.h"
#include "base/clock.h"
#include "console.h"
#include "base/fail.h"
#include "picture.h"
#include "pliant/pliant.h"
#include "sim/build/model.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { MAX_SHOWN = 30 };

static const char help[] =
    "Usage: pliant_segment [SCENE] [--scan PATH] --out DIR [--set segment/OPTION=VALUE]\n"
    "\n"
    "Finds tissues by intensity: a Gaussian mixture, neighbours that agree, connected pieces. Writes to DIR:\n"
    "labels.nii.gz (a label a piece), pieces.csv (label, class, mean intensity, volume, centre), axial.png, "
    "coronal.png,\n"
    "sagittal.png (the scan, and a colour a piece, through its middle or --at). With segment/kind gmm in a scene, "
    "a material\n"
    "table names these labels; what it does not name goes by intensity.\n"
    "\n"
    "  SCENE              scene file (YAML); without one every option has its default\n"
    "  --scan PATH        DICOM folder, NIfTI, NRRD or MetaImage file; phantom or phantom:IxJxK (default: phantom)\n"
    "  --out DIR          folder for the results; made if it is missing\n"
    "  --set OPTION=VALUE change a scene option, e.g. --set segment/classes=8; may be repeated\n"
    "  --at X,Y,Z         print the piece at this point [m, LPS], and draw the pictures through it\n"
    "  --help             print this and end\n"
    "\n"
    "Exit codes: 0 done, 1 failed, 2 wrong usage, 130 stopped by Ctrl-C.\n";

typedef struct segment_arguments {
    pliant_scene scene;
    const char *scan, *folder;
    bool has_point;
    double point[3]; /* point on the planes of pictures, LPS [m] */
} segment_arguments;

/* Return true to continue; false to exit with *exit_code. */
static bool read_arguments(int argc, char **argv, segment_arguments *out, int *exit_code)
{
    static const struct option options[] = {
        {"scan", required_argument, NULL, 'c'}, {"out", required_argument, NULL, 'o'},
        {"set", required_argument, NULL, 's'},  {"at", required_argument, NULL, 'a'},
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
        case 'a':
            if (!command_line_point("--at", optarg, out->point)) return false;
            out->has_point = true;
            break;
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
        fprintf(file, "%d,%d,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n", (int)p + 1, (int)piece->class_index, of->mean,
                of->deviation, piece->mean, 1e6 * piece->volume, piece->centre[0], piece->centre[1], piece->centre[2]);
    }
    int failed = ferror(file) | fclose(file);
    return failed ? pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno)) : PLIANT_OK;
}

static pliant_status write_results(const char *folder, const pliant_volume *scan, const pliant_segmentation *found,
                                   const double point[3])
{
    char path[4096];
    pliant_status status = command_line_folder(folder);
    snprintf(path, sizeof path, "%s/labels.nii.gz", folder);
    if (status >= 0) status = pliant_labels_write(path, &found->labels);
    if (status >= 0) status = write_table(folder, found);
    return status < 0 ? status : picture_write_labels(folder, scan, &found->labels, point);
}

static void print(const pliant_segmentation *found, double seconds)
{
    printf("%d classes, %d pieces in %.2f s, BIC %.6g\n%5s %5s %10s %10s\n", (int)found->num_classes,
           (int)found->num_pieces, seconds, found->criterion, "label", "class", "mean", "ml");
    for (int32_t p = 0; p < found->num_pieces && p < MAX_SHOWN; p++)
        printf("%5d %5d %10.1f %10.1f\n", (int)p + 1, (int)found->pieces[p].class_index, found->pieces[p].mean,
               1e6 * found->pieces[p].volume);
    if (found->num_pieces > MAX_SHOWN)
        printf("and %d smaller ones, in pieces.csv\n", (int)found->num_pieces - MAX_SHOWN);
}

/* Set the point for pictures: --at, or the centre of the scan. Errors: ARGUMENT (outside the scan). */
static pliant_status find_point(segment_arguments *arguments, const pliant_geometry *geometry)
{
    double middle[3], index[3], *at = arguments->point;
    for (int d = 0; d < 3; d++) middle[d] = 0.5 * (geometry->size[d] - 1);
    if (!arguments->has_point) pliant_geometry_to_world(geometry, middle, at);
    pliant_geometry_to_index(geometry, at, index);
    for (int d = 0; d < 3; d++)
        if (!(index[d] >= -0.5 && index[d] < geometry->size[d] - 0.5))
            return pliant_fail(PLIANT_ERROR_ARGUMENT,
                               "--at %g,%g,%g lies outside of the scan; use a point inside [m, LPS]", at[0], at[1],
                               at[2]);
    return PLIANT_OK;
}

static void print_piece(const pliant_segmentation *found, const pliant_geometry *geometry, const double point[3])
{
    double index[3];
    size_t voxel = 0;
    pliant_geometry_to_index(geometry, point, index);
    for (int d = 2; d >= 0; d--) voxel = voxel * (size_t)geometry->size[d] + (size_t)lround(index[d]);
    const int label = found->labels.voxels[voxel];
    printf("the piece at the point: label %d, %.1f ml\n", label, 1e6 * found->pieces[label - 1].volume);
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
    /* the materials are not used, so any scan is accepted */
    pliant_status status = pliant_material_table_default(&materials);
    if (status >= 0) status = pliant_scan_inputs_read(scene, &materials, arguments.scan, &scan, &labels);
    pliant_segment_options options;
    if (status >= 0) pliant_segment_options_from(scene, &scan.geometry, &options);
    double start = pliant_seconds();
    if (status >= 0) status = find_point(&arguments, &scan.geometry);
    if (status >= 0) status = pliant_segment(&scan, &options, &found);
    if (status >= 0) print(&found, pliant_seconds() - start);
    if (status >= 0 && arguments.has_point) print_piece(&found, &scan.geometry, arguments.point);
    if (status >= 0) status = write_results(arguments.folder, &scan, &found, arguments.point);
    if (status >= 0) printf("results in %s\n", arguments.folder);
    pliant_segmentation_free(&found);
    pliant_material_table_free(&materials);
    pliant_labels_free(&labels);
    pliant_volume_free(&scan);
    return status < 0 ? EXIT_FAILED : EXIT_OK;
}
