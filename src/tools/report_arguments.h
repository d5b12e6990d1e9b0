/* The command line of pliant_report. */
#ifndef PLIANT_TOOLS_REPORT_ARGUMENTS_H
#define PLIANT_TOOLS_REPORT_ARGUMENTS_H

#include "pliant/report.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct report_arguments {
    pliant_scene scene;           /* of the scene file and --set */
    const char *scan;             /* Nullable: only stability, on a block */
    const char *folder;
    pliant_sweep sweep;           /* its points: those given with --at */
    int32_t labels[PLIANT_MAX_PULLS];
    int num_labels, num_points;   /* most points to pull at, where none are given */
    pliant_stability stability;
    bool do_sweep, do_truth, do_left_out, do_stability, stability_on_scan, pictures, quiet;
} report_arguments;

/* True: go on. False: end now with *exit_code. */
bool report_arguments_read(int argc, char **argv, report_arguments *out, int *exit_code);

#ifdef __cplusplus
}
#endif
#endif
