/* Tools of a path in a run: grasps, motions and cuts. */
#ifndef PLIANT_TOOLS_DEFORM_TOOLS_H
#define PLIANT_TOOLS_DEFORM_TOOLS_H

#include "tool/path.h"

#include <stdio.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct deform_tools {
    const pliant_path *path;
    /* cuts.csv, one row for each step and tool that cut tissue; NULL: the path cuts nothing */
    FILE *cuts;
    uint32_t next;            /* index of the next instant cut of the path */
    /* severed area up to the last step, and up to the start of the stroke [m^2] */
    double area[PLIANT_MAX_TOOLS], before[PLIANT_MAX_TOOLS];
} deform_tools;

/* Add the path's tools in order, with their grasps or blades, to a simulation without tools, and create
 * folder/cuts.csv. Errors: as for pliant_tool_*, FILE. */
pliant_status deform_tools_begin(const pliant_path *path, const char *folder, const pliant_model *model,
                                 pliant_data *data, deform_tools *out);
/* Move the tools to their positions at a time, and perform the instant cuts that are due.
 * @param step its number
 * Errors: as for pliant_tool_* and pliant_data_cut. */
pliant_status deform_tools_move(deform_tools *tools, const pliant_model *model, pliant_data *data, long step,
                                double time);
/* Write what this step has cut to cuts.csv, and to stdout at the end of a stroke. */
void deform_tools_report(deform_tools *tools, const pliant_data *data, long step, double time);
/* Close the file. Errors: FILE. */
pliant_status deform_tools_end(deform_tools *tools, const pliant_data *data, double time);

/* Return a point of interest of the path: the grasped point of its first tool, or the midpoint of a blade's motion or
 * of a cut. Return false if there is none. */
bool deform_tools_point(const pliant_path *path, double point[3]);

#ifdef __cplusplus
}
#endif
#endif
