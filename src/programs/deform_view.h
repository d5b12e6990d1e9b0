/* What a camera sees of the deformed scan, and a radiograph of it, as PNG. */
#ifndef PLIANT_TOOLS_DEFORM_VIEW_H
#define PLIANT_TOOLS_DEFORM_VIEW_H

#include "deform_arguments.h"
#include "deform_run.h"

#ifdef __cplusplus
extern "C" {
#endif

/* "X,Y,Z:X,Y,Z[:DEGREES]" to a camera. false after a message. */
bool deform_view_read_camera(const char *text, pliant_camera *out);
/* "PRIMARY,SECONDARY" [degrees] to the angles of a C-arm. false after a message. */
bool deform_view_read_arm(const char *text, double angles[2]);

/* folder/cameraNUMBER.png, radiographNUMBER.png, as they were asked for. Errors: FILE, MEMORY, ARGUMENT. */
pliant_status deform_view_write(const deform_run *run, const char *number);

#ifdef __cplusplus
}
#endif
#endif
