/* Signed distance of a point to the surface that contact uses (contact/detect/contact_surface.h), at the positions of
 * the last step. */
#ifndef PLIANT_TOOL_CLEARANCE_H
#define PLIANT_TOOL_CLEARANCE_H

#include "model_data/data.h"

/* Create the data for a simulation; empty until the first query. NULL: out of memory. */
pliant_clearance *pliant_clearance_create(void);
void pliant_clearance_free(pliant_clearance *clearance); /* Nullable */
/* Return the signed distance of a point [m]: negative inside, NAN without memory. */
double pliant_clearance_of(const pliant_model *model, const pliant_data *data, const double p[3]);

#endif
