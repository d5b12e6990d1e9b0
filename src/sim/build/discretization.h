/* From a topology to the discretization that is solved: the last stages of building a model, repeated after each
 * cut. */
#ifndef PLIANT_SIM_DISCRETIZATION_H
#define PLIANT_SIM_DISCRETIZATION_H

#include "fem/system.h"
#include "model_data/discretization.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A discretization under construction, and buffers for that. */
typedef struct pliant_discretizing {
    const pliant_scene *scene;
    pliant_progress progress;
    /* (solved nodes) fixed nodes: the topology's, nodes of pieces with fewer than three fixed nodes, and nodes that
     * depend on others; NULL: use the topology's fixed fine nodes */
    uint8_t *solved_fixed;
    pliant_discretization *made; /* empty except for the topology */
    /* Nullable: parts kept from the previous topology; no pattern and no factor are computed then */
    const pliant_unchanged_elements *kept;
} pliant_discretizing;
/* Begin a discretization. The topology is retained. Errors: MEMORY. */
pliant_status pliant_discretizing_begin(const pliant_scene *scene, const pliant_body *body, pliant_progress progress,
                                        pliant_discretizing *out);
/* Run the stages, in this order. Errors: MEMORY, NUMERIC, SCENE, CANCELLED. */
pliant_status pliant_discretizing_homogenize(pliant_discretizing *work);
pliant_status pliant_discretizing_analyze(pliant_discretizing *work);
pliant_status pliant_discretizing_factorize(pliant_discretizing *work);
/* Free all buffers, and the discretization unless the caller has taken it. */
void pliant_discretizing_end(pliant_discretizing *work);

/* Run all stages. */
pliant_status pliant_discretization_create(const pliant_scene *scene, const pliant_body *body,
                                           const pliant_discretization **out);
/* Compute the discretization of the topology after a cut. Parts that the cut has not changed are copied, with
 * identical bits. The preconditioner is computed later, in the background: system->preconditioner is NULL, and the
 * pattern is empty. Errors: MEMORY, NUMERIC, SCENE. */
pliant_status pliant_discretization_next(const pliant_scene *scene, const pliant_discretization *before,
                                         const pliant_body *body, const pliant_body_map *map,
                                         const pliant_discretization **out);

#ifdef __cplusplus
}
#endif
#endif
