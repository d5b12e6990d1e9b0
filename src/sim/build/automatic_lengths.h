/* Lengths of a scene that are `auto`: they follow from the size of the tissue. */
#ifndef PLIANT_SIM_BUILD_AUTOMATIC_LENGTHS_H
#define PLIANT_SIM_BUILD_AUTOMATIC_LENGTHS_H

#include "model_data/model.h"

/* Set every length that is `auto` in the model's copy of the scene. The mesh must exist. Warn if the scene's margin
 * makes the deformed volume more than 4 times as large as the scan. */
void pliant_model_set_lengths(pliant_model *model);

#endif
