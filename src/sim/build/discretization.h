/* From a body to what is solved: the last stages of building a model, and what changes with a body. */
#ifndef PLIANT_SIM_DISCRETIZATION_H
#define PLIANT_SIM_DISCRETIZATION_H

#include "fem/system.h"
#include "state/discretization.h"

#ifdef __cplusplus
extern "C" {
#endif

/* One being made, and what is needed only for that. */
typedef struct pliant_discretizing {
    const pliant_scene *scene;
    pliant_progress progress;
    uint8_t *solved_fixed;       /* (solved nodes) those of the body, what hangs on too few of them or follows others; NULL: the fine nodes of the body */
    pliant_discretization *made; /* empty, but for the body */
    const pliant_kept *kept;     /* Nullable: of the next body: there is no factor yet, nor a pattern */
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
/* Of a body that follows another: what a cut has not touched is copied, with the bits that making it anew would give. What stands for the
 * inverse of the stiffness is made later, in the background: system->preconditioner is NULL, and the pattern empty. Errors: MEMORY, NUMERIC, SCENE. */
pliant_status pliant_discretization_next(const pliant_scene *scene, const pliant_discretization *before, const pliant_body *body,
                                         const pliant_body_map *map, const pliant_discretization **out);

#ifdef __cplusplus
}
#endif
#endif
