/* Camera images and radiographs of the deformed scan, as PNG. */
#ifndef PLIANT_TOOLS_DEFORM_VIEW_H
#define PLIANT_TOOLS_DEFORM_VIEW_H

#include "deform_arguments.h"
#include "deform_run.h"

/* Convert "X,Y,Z:X,Y,Z[:DEGREES]" to a camera. Return false after a message. */
bool deform_view_read_camera(const char *text, pliant_camera *out);
/* Convert "PRIMARY,SECONDARY" [degrees] to the angles of a C-arm. Return false after a message. */
bool deform_view_read_arm(const char *text, double angles[2]);

/* Write folder/cameraNUMBER.png and radiographNUMBER.png as requested. Errors: FILE, MEMORY, ARGUMENT. */
pliant_status deform_view_write(const deform_run *run, const char *number);

#endif
