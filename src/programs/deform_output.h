/* What a run writes: node positions, scalars of nodes and elements, the deformed volume, pictures. */
#ifndef PLIANT_TOOLS_DEFORM_OUTPUT_H
#define PLIANT_TOOLS_DEFORM_OUTPUT_H

#include "deform_run.h"

#ifdef __cplusplus
extern "C" {
#endif

/* nodes.csv and, as the arguments ask, elements.csv, deformed.nii.gz and pictures in the run's folder.
 * @param step 0: the end; otherwise a number that the names get. Errors: FILE, MEMORY. */
pliant_status deform_write(const deform_run *run, long step);

/* The point that planes of pictures go through: what the path is about (deform_tools_point), or else the middle of the tissue. LPS [m] */
void deform_picture_point(const deform_run *run, double point[3]);

#ifdef __cplusplus
}
#endif
#endif
