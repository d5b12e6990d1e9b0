#include "deform_arguments.h"
#include "command_line.h"
#include "options_table.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char help[] =
    "Usage: pliant_deform [SCENE] [--scan PATH] [--tools FILE] --out DIR [options]\n"
    "\n"
    "Deforms a scan as tissue under tools and writes what comes out.\n"
    "\n"
    "  SCENE              scene file (YAML); without one every option has its default\n"
    "  --scan PATH        DICOM folder or multi-frame file, NIfTI, NRRD or MetaImage file; phantom or phantom:IxJxK for the\n"
    "                     built-in scan (default: phantom)\n"
    "  --tools FILE       tool path (YAML), which may turn gravity too; without one only the scene's gravity acts\n"
    "  --out DIR          folder for the results; made if it is missing\n"
    "  --set OPTION=VALUE change a scene option, e.g. --set mesh/ratio=3; may be repeated\n"
    "  --steps N          steps to do (default: to the end of the tool path and until the solver has converged)\n"
    "  --every N          write volume and nodes every N steps too (default: at the end only)\n"
    "  --no-volume        do not compute the deformed volume\n"
    "  --pictures         write axial.png, coronal.png, sagittal.png: before, after, difference\n"
    "  --quiet            no progress, warnings and errors only\n"
    "  --options          print every scene option as a table and end\n"
    "  --help             print this and end\n"
    "\n"
    "Results in DIR: deformed.nii.gz (the scan's values, deformed), nodes.csv (rest and deformed positions in metres,\n"
    "LPS), steps.csv (iterations, residual and seconds per stage, a row a step), tools.csv (force and held point of\n"
    "every tool), build.csv (seconds and bytes of every stage of the build).\n"
    "Where the scene has choose/budget_ms, DIR/choice holds what was tried: CSV and JSON as of pliant_report, and its\n"
    "picture with --pictures.\n"
    "With --every N also deformed_NNNNNN.nii.gz and nodes_NNNNNN.csv. Tables of times and memory go to stdout.\n"
    "\n"
    "Exit codes: 0 done, 1 failed, 2 wrong usage, 130 stopped by Ctrl-C (what was done so far is written).\n";

enum { SCAN = 256, TOOLS, OUT, SET, STEPS, EVERY, NO_VOLUME, PICTURES, QUIET, OPTIONS, HELP };

static const struct option options[] = {
    {"scan", required_argument, NULL, SCAN},   {"tools", required_argument, NULL, TOOLS},
    {"out", required_argument, NULL, OUT},     {"set", required_argument, NULL, SET},
    {"steps", required_argument, NULL, STEPS}, {"every", required_argument, NULL, EVERY},
    {"no-volume", no_argument, NULL, NO_VOLUME}, {"pictures", no_argument, NULL, PICTURES},
    {"quiet", no_argument, NULL, QUIET},       {"options", no_argument, NULL, OPTIONS},
    {"help", no_argument, NULL, HELP},         {NULL, 0, NULL, 0},
};

static bool read_count(const char *name, const char *text, long *out)
{
    char *end;
    long value = strtol(text, &end, 10);
    if (*text == '\0' || *end != '\0' || value < 1) {
        fprintf(stderr, "%s %s: a whole number of at least 1 is wanted\n", name, text);
        return false;
    }
    *out = value;
    return true;
}

bool deform_arguments_read(int argc, char **argv, deform_arguments *out, int *exit_code)
{
    memset(out, 0, sizeof *out);
    pliant_scene_defaults(&out->scene);
    out->scan = "phantom";
    out->volume = true;
    *exit_code = EXIT_USAGE;
    for (int code; (code = getopt_long(argc, argv, "", options, NULL)) != -1;)
        switch (code) {
        case SCAN: out->scan = optarg; break;
        case TOOLS: out->tools = optarg; break;
        case OUT: out->folder = optarg; break;
        case SET: break;
        case STEPS:
            if (!read_count("--steps", optarg, &out->steps)) return false;
            break;
        case EVERY:
            if (!read_count("--every", optarg, &out->every)) return false;
            break;
        case NO_VOLUME: out->volume = false; break;
        case PICTURES: out->pictures = true; break;
        case QUIET: out->quiet = true; break;
        case OPTIONS:
            options_table_print(stdout);
            *exit_code = EXIT_OK;
            return false;
        case HELP:
            fputs(help, stdout);
            *exit_code = EXIT_OK;
            return false;
        default: fputs("pliant_deform --help tells more\n", stderr); return false;
        }
    if (!out->folder) {
        fputs("--out DIR is missing; pliant_deform --help tells more\n", stderr);
        return false;
    }
    if (out->pictures && !out->volume) {
        fputs("--pictures needs the volume: leave --no-volume out\n", stderr);
        return false;
    }
    return command_line_scene(argc, argv, options, SET, &out->scene, exit_code);
}
