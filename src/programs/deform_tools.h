/* The tools of a path in a run: what they hold, where they go, what they cut. */
#ifndef PLIANT_TOOLS_DEFORM_TOOLS_H
#define PLIANT_TOOLS_DEFORM_TOOLS_H

#include "pliant/path.h"

#include <stdio.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct deform_tools {
    const pliant_path *path;
    FILE *cuts;               /* cuts.csv, a row for each step and tool that parted tissue; NULL: the path cuts nothing */
    uint32_t next;            /* of the path's cuts */
    double area[PLIANT_MAX_TOOLS], before[PLIANT_MAX_TOOLS]; /* severed until the last step, and until the stroke began [m^2] */
} deform_tools;

/* Adds the tools, with hold or blade, in the order of the path to a data without any; opens folder/cuts.csv. Errors: as of pliant_tool_*,
 * FILE. */
pliant_status deform_tools_begin(const pliant_path *path, const char *folder, const pliant_model *model, pliant_data *data, deform_tools *out);
/* To where the path has them at a time, cuts that are due among it. @param step its number. Errors: as of pliant_tool_* and pliant_data_cut. */
pliant_status deform_tools_move(deform_tools *tools, const pliant_model *model, pliant_data *data, long step, double time);
/* What the step that was done then has cut, to cuts.csv, and to stdout when a stroke is over. */
void deform_tools_tell(deform_tools *tools, const pliant_data *data, long step, double time);
/* Errors: FILE. */
pliant_status deform_tools_end(deform_tools *tools, const pliant_data *data, double time);

/* A point that the path is about: what its first tool holds, or the middle of where a blade goes, or of a cut. false: of none. */
bool deform_tools_point(const pliant_path *path, double point[3]);

#ifdef __cplusplus
}
#endif
#endif
