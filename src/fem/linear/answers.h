/* Blocks of an inverse stiffness: displacements of some unknowns under unit forces at each other. They are kept from
 * step to step while the same unknowns are used. */
#ifndef PLIANT_FEM_LINEAR_ANSWERS_H
#define PLIANT_FEM_LINEAR_ANSWERS_H

#include "fem/linear/halves.h"
#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_answers {
    int32_t num_free;
    int32_t *slot;         /* (num_free) slot of the unknown, or -1 */
    int32_t count, room;   /* number of slots in use, and capacity */
    int32_t *unknown;      /* (room) */
    /* (`room` x `room` x 9) displacement of the first unknown per force at the second, in the axes of the
     * preconditioner [m/N]. */
    double *block;
    double *column;        /* (3 x 3 num_free) work array */
    /* (`room`) half solves, whose products are the blocks (halves.h). Only for a factor with panels. */
    pliant_half *half;
} pliant_answers;

/* Errors: MEMORY. */
pliant_status pliant_answers_create(int32_t num_free, pliant_answers *out);
void pliant_answers_free(pliant_answers *answers);
/* Discard all blocks, after the preconditioner has changed. */
void pliant_answers_forget(pliant_answers *answers);
/* Compute the blocks of these unknowns (all different), with the same preconditioner as before. factor: Nullable: its
 * factor, if that has panels. Errors: MEMORY, NUMERIC. */
pliant_status pliant_answers_find(pliant_answers *answers, pliant_preconditioner *preconditioner, pliant_factor *factor,
                                  int32_t count, const int32_t *unknown);
static inline const double *pliant_answer(const pliant_answers *answers, int32_t a, int32_t b)
{
    return answers->block + 9 * ((size_t)answers->slot[a] * (size_t)answers->room + (size_t)answers->slot[b]);
}

/* Return the half solve of an unknown, for a factor. */
static inline const pliant_half *pliant_answer_half(const pliant_answers *answers, int32_t a)
{
    return answers->half + answers->slot[a];
}

#ifdef __cplusplus
}
#endif
#endif
