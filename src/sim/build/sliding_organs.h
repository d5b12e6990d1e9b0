/* Organs that slide along others (material/slides). */
#ifndef PLIANT_SIM_BUILD_SLIDING_ORGANS_H
#define PLIANT_SIM_BUILD_SLIDING_ORGANS_H

#include "model_data/model.h"

/* Cut the rest topology, which must have voxels, where a sliding material meets another one. Errors: SCENE (no such
 * material), and as of pliant_body_sever. */
pliant_status pliant_model_part_slides(pliant_model *model);

#endif
