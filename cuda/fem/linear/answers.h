/* Columns of what stands for the inverse, for the unknowns that contacts move: kept from step to step while the same
 * ones are asked for, as src/fem/linear/answers.h keeps what it knows. */
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
    int32_t room, next;        /* of slots; where to look for one */
    int32_t *unknown;          /* (room) or -1 */
    uint64_t *asked;           /* (room) when it was asked for last */
    uint64_t now;              /* times that anything was */
    float *d_column;           /* (room x 3 x stride) */
    int32_t *h_which, *d_which; /* (room x 2) what is missing; page-locked */
} gpu_answers;

void pliant_cuda_answers_free(gpu_answers *answers);
/* Of another preconditioner: nothing is known. */
void pliant_cuda_answers_forget(gpu_answers *answers);
/* Makes sure of the columns of these unknown nodes (all different). made: out: some were missing; takes d_right then.
 * Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_answers_find(gpu_answers *answers, const gpu_preconditioner *preconditioner, const gpu_iteration *iteration, int32_t count,
                                       const int32_t *unknown, cudaStream_t stream, bool *made);

#ifdef __cplusplus
}
#endif
#endif
