/* The command line of pliant_deform. */
#ifndef PLIANT_TOOLS_DEFORM_ARGUMENTS_H
#define PLIANT_TOOLS_DEFORM_ARGUMENTS_H

#include "pliant/scene.h"

#ifdef __cplusplus
extern "C" {
#endif


typedef struct deform_arguments {
    pliant_scene scene;    /* of the scene file and --set */
    const char *scan;      /* "phantom" unless told otherwise */
    const char *tools;     /* Nullable: no tools */
    const char *folder;    /* where results go */
    long steps;            /* 0: to the end of the tool path and until the solver has converged */
    long every;            /* 0: results at the end only */
    bool pictures, volume, quiet;
} deform_arguments;

/* True: go on. False: end now with *exit_code (help, a list that was asked for, or wrong usage told on stderr). */
bool deform_arguments_read(int argc, char **argv, deform_arguments *out, int *exit_code);

#ifdef __cplusplus
}
#endif
#endif
