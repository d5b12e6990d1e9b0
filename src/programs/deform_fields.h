/* Write displacement fields, and meshes for ParaView. */
#ifndef PLIANT_TOOLS_DEFORM_FIELDS_H
#define PLIANT_TOOLS_DEFORM_FIELDS_H

#include "deform_run.h"

/* Write the displacement fields, mesh.vtu and surface.vtp that the arguments request, with a number before each
 * extension.
 * step: 0 at the end; otherwise mesh.pvd and surface.pvd list the step
 * Errors: FILE, MEMORY. */
pliant_status deform_fields_write(const deform_run *run, const char *number, long step);

#endif
