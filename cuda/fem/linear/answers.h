/* Columns of the approximate inverse for the unknowns of contact points. They are kept from step to step while the same
 * unknowns are used, as in src/fem/linear/answers.h. */
#ifndef PLIANT_CUDA_ANSWERS_H
#define PLIANT_CUDA_ANSWERS_H

#include "cuda/fem/linear/preconditioner.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gpu_answers {
    int32_t num_free;
    size_t stride;             /* of a column, padded */
    int32_t *slot;             /* (num_free) of an unknown node, or -1 */
    int32_t room, next;        /* number of slots, and where the search for a free one starts */
    int32_t *unknown;          /* (`room`) or -1 */
    uint64_t *asked;           /* (`room`) time of the last use */
    uint64_t now;              /* number of uses so far */
    float *d_column;           /* (`room` x 3 x stride) */
    int32_t *h_which, *d_which; /* (`room` x 2) missing columns; h_which is page-locked */
} gpu_answers;

void pliant_cuda_answers_free(gpu_answers *answers);
/* Discard all columns, after the preconditioner has changed. */
void pliant_cuda_answers_forget(gpu_answers *answers);
/* Compute the missing columns of these unknown nodes (all different). made: out: some columns were missing, and d_right
 * was overwritten. Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_answers_find(gpu_answers *answers, const gpu_preconditioner *preconditioner,
                                       const gpu_iteration *iteration, int32_t count, const int32_t *unknown,
                                       cudaStream_t stream, bool *made);

#ifdef __cplusplus
}
#endif
#endif
