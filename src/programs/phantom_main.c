/* pliant_phantom: write the built-in scan and its label map to files. */
#include "command_line.h"
#include "console.h"
#include "pliant/pliant.h"
#include "scan/volume.h"

#include <stdio.h>
#include <stdlib.h>

static const char help[] =
    "Usage: pliant_phantom [--size IxJxK] [--seed N] --out FILE [--labels FILE]\n"
    "\n"
    "Writes the built-in scan, an abdomen in Hounsfield units, and its label map.\n"
    "\n"
    "  --size IxJxK    voxels (default: 256x160x122)\n"
    "  --seed N        of the noise (default: 1)\n"
    "  --out FILE      the scan: .nii, .nii.gz, .nrrd or .mha\n"
    "  --labels FILE   its label map\n"
    "  --list          print the labels and end\n"
    "  --help          print this and end\n"
    "\n"
    "The same size and seed give the same file everywhere. Exit codes: 0 done, 1 failed, 2 wrong usage.\n";

typedef struct phantom_arguments {
    int32_t size[3];
    uint32_t seed;
    const char *out, *labels;
} phantom_arguments;

static bool read_seed(const char *text, uint32_t *out)
{
    char *end;
    unsigned long value = strtoul(text, &end, 10);
    if (*text < '0' || *text > '9' || *end != '\0' || value > UINT32_MAX) return false;
    *out = (uint32_t)value;
    return true;
}

static bool read_size(const char *text, int32_t out[3])
{
    char rest;
    return sscanf(text, "%dx%dx%d%c", &out[0], &out[1], &out[2], &rest) == 3;
}

/* Return true to continue; false to exit with *exit_code. */
static bool read_arguments(int argc, char **argv, phantom_arguments *out, int *exit_code)
{
    static const struct option options[] = {
        {"size", required_argument, NULL, 'z'},   {"seed", required_argument, NULL, 's'},
        {"out", required_argument, NULL, 'o'},    {"labels", required_argument, NULL, 'l'},
        {"list", no_argument, NULL, 't'},         {"help", no_argument, NULL, 'h'},
        {NULL, 0, NULL, 0},
    };
    bool good = true;
    *exit_code = EXIT_USAGE;
    for (int code; good && (code = getopt_long(argc, argv, "", options, NULL)) != -1;)
        switch (code) {
        case 'z': good = read_size(optarg, out->size); break;
        case 's': good = read_seed(optarg, &out->seed); break;
        case 'o': out->out = optarg; break;
        case 'l': out->labels = optarg; break;
        case 't':
            for (int label = 0; label <= UINT16_MAX; ++label)
                if (*pliant_phantom_label_name(label)) printf("%3d %s\n", label, pliant_phantom_label_name(label));
            *exit_code = EXIT_OK;
            return false;
        case 'h':
            fputs(help, stdout);
            *exit_code = EXIT_OK;
            return false;
        default: good = false;
        }
    if (good && optind == argc && (out->out || out->labels)) return true;
    fputs(help, stderr);
    return false;
}

int main(int argc, char **argv)
{
    phantom_arguments arguments = {.size = {256, 160, 122}, .seed = 1};
    pliant_volume scan = {0};
    pliant_labels labels = {0};
    int exit_code;
    if (!read_arguments(argc, argv, &arguments, &exit_code)) return exit_code;
    console_start(PLIANT_LOG_INFO);
    pliant_status status = pliant_phantom(arguments.size, arguments.seed, &scan, &labels);
    if (status >= 0 && arguments.out) status = pliant_volume_write(arguments.out, &scan);
    if (status >= 0 && arguments.labels) status = pliant_labels_write(arguments.labels, &labels);
    pliant_labels_free(&labels);
    pliant_volume_free(&scan);
    return status < 0 ? EXIT_FAILED : EXIT_OK;
}
