/* The command line of pliant_deform. */
#ifndef PLIANT_TOOLS_DEFORM_ARGUMENTS_H
#define PLIANT_TOOLS_DEFORM_ARGUMENTS_H

#include "pliant/render.h"

enum {
#define PLIANT_COUNT_CHOICE(name, yaml) +1
    PLIANT_NUM_SCALARS = 0 PLIANT_SCALAR_LIST(PLIANT_COUNT_CHOICE),
    PLIANT_NUM_METHODS = 0 PLIANT_METHOD_LIST(PLIANT_COUNT_CHOICE)
#undef PLIANT_COUNT_CHOICE
};

typedef struct deform_arguments {
    pliant_scene scene;    /* from the scene file and --set */
    const char *scan;      /* default "phantom" */
    const char *tools;     /* Nullable: no tools */
    const char *folder;    /* folder for results */
    long steps;            /* 0: to the end of the tool path, and until the solver has converged */
    long every;            /* interval of intermediate results in steps; 0: results at the end only */
    bool pictures, volume, quiet;
    /* Nullable: file names of displacement fields, in the convention of ITK and of the tissue */
    const char *displacement, *tissue_displacement;
    bool vtk;              /* write mesh and surface for ParaView */
    double unit;           /* unit of lengths in mesh files [m] */
    bool has_camera, has_arm; /* write the images of the camera and of the C-arm */
    pliant_camera camera;
    double arm[2];         /* angles of the C-arm: primary, secondary [degrees] */
    int num_scalars;       /* scalars per node and element, written to nodes.csv and elements.csv and as pictures */
    pliant_scalar scalars[PLIANT_NUM_SCALARS];
    int num_compared;      /* 0: only the scene's own method */
    pliant_method compared[PLIANT_NUM_METHODS]; /* the last one is the reference */
    double min_value;           /* minimum voxel value that counts in errors; -INFINITY: all voxels with tissue */
} deform_arguments;

/* Read the command line. Return true to continue. Return false to exit with *exit_code after help, a requested list, or
 * an error message. */
bool deform_arguments_read(int argc, char **argv, deform_arguments *out, int *exit_code);

const char *deform_method_name(pliant_method method);

#endif
