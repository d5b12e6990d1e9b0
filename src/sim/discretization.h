/* From a body to what is solved: the last stages of building a model, and what changes with a body. */
#ifndef PLIANT_SIM_DISCRETIZATION_H
#define PLIANT_SIM_DISCRETIZATION_H

#include "state/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/* One being made, and what is needed only for that. */
typedef struct pliant_discretizing {
    const pliant_scene *scene;
    pliant_progress progress;
    uint8_t *coarse_fixed;       /* (coarse nodes) those of the body and what hangs on too few of them; NULL: no coarse mesh */
    pliant_discretization *made; /* empty, but for the body */
} pliant_discretizing;
/* The body is retained. Errors: MEMORY. */
pliant_status pliant_discretizing_begin(const pliant_scene *scene, const pliant_body *body, pliant_progress progress, pliant_discretizing *out);
/* in this order. Errors: MEMORY, NUMERIC, SCENE, CANCELLED */
pliant_status pliant_discretizing_homogenize(pliant_discretizing *work);
pliant_status pliant_discretizing_analyze(pliant_discretizing *work);
pliant_status pliant_discretizing_factorize(pliant_discretizing *work);
/* What is left, made or not; NULL where it was handed on. */
void pliant_discretizing_end(pliant_discretizing *work);

/* all of this */
pliant_status pliant_discretization_create(const pliant_scene *scene, const pliant_body *body, const pliant_discretization **out);
const pliant_discretization *pliant_discretization_retain(const pliant_discretization *discretization);
void pliant_discretization_release(const pliant_discretization *discretization); /* Nullable; the last one frees it */

#ifdef __cplusplus
}
#endif
#endif
