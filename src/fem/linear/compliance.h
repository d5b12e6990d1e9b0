/* Blocks of an inverse stiffness: displacements of some unknowns under unit forces at each other. They are kept from
 * step to step while the same unknowns are used. */
#ifndef PLIANT_FEM_LINEAR_COMPLIANCE_H
#define PLIANT_FEM_LINEAR_COMPLIANCE_H

#include "fem/linear/half_solve.h"
#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_compliance_blocks {
    int32_t num_free;
    int32_t *slot;           /* (num_free) slot of the unknown, or -1 */
    int32_t count, capacity; /* number of slots in use, and capacity */
    int32_t *unknown;        /* (capacity) */
    /* (`capacity` x `capacity` x 9) displacement of the first unknown per force at the second, in the axes of the
     * preconditioner [m/N]. */
    double *block;
    double *column;        /* (3 x 3 num_free) work array */
    /* (`capacity`) half solves, whose products are the blocks (half_solve.h). Only for a factor with panels. */
    pliant_half_solve *half;
} pliant_compliance_blocks;

/* Errors: MEMORY. */
pliant_status pliant_compliance_create(int32_t num_free, pliant_compliance_blocks *out);
void pliant_compliance_free(pliant_compliance_blocks *blocks);
/* Discard all blocks, after the preconditioner has changed. */
void pliant_compliance_discard(pliant_compliance_blocks *blocks);
/* Compute the blocks of these unknowns (all different), with the same preconditioner as before. factor: Nullable: its
 * factor, if that has panels. Errors: MEMORY, NUMERIC. */
pliant_status pliant_compliance_compute(pliant_compliance_blocks *blocks, pliant_preconditioner *preconditioner,
                                        pliant_factor *factor, int32_t count, const int32_t *unknown);
static inline const double *pliant_compliance_block(const pliant_compliance_blocks *blocks, int32_t a, int32_t b)
{
    return blocks->block + 9 * ((size_t)blocks->slot[a] * (size_t)blocks->capacity + (size_t)blocks->slot[b]);
}

/* Return the half solve of an unknown, for a factor. */
static inline const pliant_half_solve *pliant_compliance_half_solve(const pliant_compliance_blocks *blocks, int32_t a)
{
    return blocks->half + blocks->slot[a];
}

#ifdef __cplusplus
}
#endif
#endif
