/* The command line of pliant_deform. */
#ifndef PLIANT_TOOLS_DEFORM_ARGUMENTS_H
#define PLIANT_TOOLS_DEFORM_ARGUMENTS_H

#include "pliant/render.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
#define PLIANT_COUNT_CHOICE(name, yaml) +1
    PLIANT_NUM_SCALARS = 0 PLIANT_SCALAR_LIST(PLIANT_COUNT_CHOICE),
    PLIANT_NUM_METHODS = 0 PLIANT_METHOD_LIST(PLIANT_COUNT_CHOICE)
#undef PLIANT_COUNT_CHOICE
};

typedef struct deform_arguments {
    pliant_scene scene;    /* of the scene file and --set */
    const char *scan;      /* "phantom" unless told otherwise */
    const char *tools;     /* Nullable: no tools */
    const char *folder;    /* where results go */
    long steps;            /* 0: to the end of the tool path and until the solver has converged */
    long every;            /* 0: results at the end only */
    bool pictures, volume, quiet;
    const char *displacement, *tissue_displacement; /* Nullable: names of displacement fields, in the sense of ITK and of the tissue */
    bool vtk;              /* mesh and surface for ParaView */
    double unit;           /* of lengths in files of meshes [m] */
    bool has_camera, has_arm; /* what they see is written, too */
    pliant_camera camera;
    double arm[2];         /* angles of a C-arm: primary, secondary [degrees] */
    int num_scalars;       /* per node and element, in nodes.csv and elements.csv, and as pictures */
    pliant_scalar scalars[PLIANT_NUM_SCALARS];
    int num_compared;      /* 0: the scene's own method alone */
    pliant_method compared[PLIANT_NUM_METHODS]; /* the last one is the reference */
    double seen;           /* voxels below it do not count in errors; -INFINITY: all that show tissue do */
} deform_arguments;

/* True: go on. False: end now with *exit_code (help, a list that was asked for, or wrong usage told on stderr). */
bool deform_arguments_read(int argc, char **argv, deform_arguments *out, int *exit_code);

const char *deform_method_name(pliant_method method);

#ifdef __cplusplus
}
#endif
#endif
