/* Write the results of a run: node positions, scalars of nodes and elements, the deformed volume, pictures. */
#ifndef PLIANT_TOOLS_DEFORM_OUTPUT_H
#define PLIANT_TOOLS_DEFORM_OUTPUT_H

#include "deform_run.h"

/* Write nodes.csv and, if requested, elements.csv, deformed.nii.gz and pictures to the run's folder.
 * @param step 0: the end; otherwise a number that is inserted into the names
 * Errors: FILE, MEMORY. */
pliant_status deform_write(const deform_run *run, long step);

/* Return the point through which the planes of pictures go: the point of the path (deform_tools_point), or the centre
 * of the tissue. LPS [m] */
void deform_picture_point(const deform_run *run, double point[3]);

#endif
