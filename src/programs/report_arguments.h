/* The command line of pliant_report. */
#ifndef PLIANT_TOOLS_REPORT_ARGUMENTS_H
#define PLIANT_TOOLS_REPORT_ARGUMENTS_H

#include "report/report.h"

enum { MAX_MEASURED = 16, MAX_PARTS = 256 };

typedef struct report_arguments {
    pliant_scene scene;           /* from the scene file and --set */
    const char *scan;             /* Nullable: only the stability tests, on a block */
    const char *folder;
    const char *measured[MAX_MEASURED]; /* folders with measurements for validation */
    const char *names[PLIANT_MAX_MODULI];
    const char *parts[MAX_PARTS];       /* folders whose rows are merged */
    int num_measured, num_names, num_parts;
    pliant_sweep sweep;           /* including the points given with --at */
    int32_t labels[PLIANT_MAX_PULLS];
    int num_labels, num_points;   /* num_points: maximum number of points to pull if none is given */
    pliant_stability stability;
    bool pull_given;              /* the pull was given; otherwise it is scaled to the body */
    bool do_sweep, do_truth, do_ablation, do_stability, stability_on_scan, pictures, quiet;
} report_arguments;

/* Read the command line. Return true to continue; false to exit with *exit_code. */
bool report_arguments_read(int argc, char **argv, report_arguments *out, int *exit_code);

#endif
