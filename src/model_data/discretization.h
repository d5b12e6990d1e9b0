/* Reference count of a discretization, usable from any thread. */
#ifndef PLIANT_MODEL_DATA_DISCRETIZATION_H
#define PLIANT_MODEL_DATA_DISCRETIZATION_H

#include "model_data/model.h"

#ifndef __cplusplus
#include <stdatomic.h>

struct pliant_discretization_holders {
    atomic_int count;
    void (*free)(pliant_discretization *discretization); /* called when the last reference is released */
};
#endif

#ifdef __cplusplus
extern "C" {
#endif

const pliant_discretization *pliant_discretization_retain(const pliant_discretization *discretization);
void pliant_discretization_release(const pliant_discretization *discretization); /* Nullable */

#ifdef __cplusplus
}
#endif
#endif
