/* Entries of an inverse: what unit forces at some unknowns move at each other. Kept from step to step while the same
 * unknowns are asked for. */
#ifndef PLIANT_FEM_LINEAR_ANSWERS_H
#define PLIANT_FEM_LINEAR_ANSWERS_H

#include "fem/linear/halves.h"
#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_answers {
    int32_t num_free;
    int32_t *slot;         /* (num_free) or -1 */
    int32_t count, room;   /* of slots */
    int32_t *unknown;      /* (room) */
    double *block;         /* (room x room x 9) what a force at the second moves at the first, in the axes of the preconditioner [m/N] */
    double *column;        /* (3 x 3 num_free) room to find them */
    pliant_half *half;     /* (room) by a factor with panels: of what they are products (halves.h) */
} pliant_answers;

/* Errors: MEMORY. */
pliant_status pliant_answers_create(int32_t num_free, pliant_answers *out);
void pliant_answers_free(pliant_answers *answers);
/* They are of a preconditioner before: nothing is known. */
void pliant_answers_forget(pliant_answers *answers);
/* Makes sure of these unknowns (all different), by the same preconditioner as before. factor: Nullable: its own, if
 * that has panels. Errors: MEMORY, NUMERIC. */
pliant_status pliant_answers_find(pliant_answers *answers, pliant_preconditioner *preconditioner, pliant_factor *factor, int32_t count,
                                  const int32_t *unknown);
static inline const double *pliant_answer(const pliant_answers *answers, int32_t a, int32_t b)
{
    return answers->block + 9 * ((size_t)answers->slot[a] * (size_t)answers->room + (size_t)answers->slot[b]);
}

/* by a factor, likewise */
static inline const pliant_half *pliant_answer_half(const pliant_answers *answers, int32_t a) { return answers->half + answers->slot[a]; }

#ifdef __cplusplus
}
#endif
#endif
