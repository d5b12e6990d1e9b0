/* Lengths of a scene that are auto: they follow from the size of the body. */
#ifndef PLIANT_SIM_LENGTHS_H
#define PLIANT_SIM_LENGTHS_H

#include "state/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Give the model's own scene a number for every length that is auto. The mesh must be there. Where a margin that was asked for makes the
 * deformed volume more than 4 times as large as the scan, warn of its size. */
void pliant_model_set_lengths(pliant_model *model);

#ifdef __cplusplus
}
#endif

#endif
