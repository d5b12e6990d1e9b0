/* Columns of the approximate inverse for the unknowns of contact points. They are kept from step to step while the same
 * unknowns are used, as in src/fem/linear/compliance.h. */
#ifndef PLIANT_CUDA_COMPLIANCE_H
#define PLIANT_CUDA_COMPLIANCE_H

#include "cuda/fem/linear/preconditioner.h"

typedef struct gpu_compliance_columns {
    int32_t num_free;
    size_t stride;              /* of a column, padded */
    int32_t *slot;              /* (num_free) of an unknown node, or -1 */
    int32_t capacity, next;     /* number of slots, and where the search for a free one starts */
    int32_t *unknown;           /* (`capacity`) or -1 */
    uint64_t *last_use;         /* (`capacity`) time of the last use */
    uint64_t now;               /* number of uses so far */
    float *d_column;            /* (`capacity` x 3 x stride) */
    int32_t *h_which, *d_which; /* (`capacity` x 2) missing columns; h_which is page-locked */
} gpu_compliance_columns;

void pliant_cuda_compliance_free(gpu_compliance_columns *blocks);
/* Discard all columns, after the preconditioner has changed. */
void pliant_cuda_compliance_discard(gpu_compliance_columns *blocks);
/* Compute the missing columns of these unknown nodes (all different). made: out: some columns were missing, and d_right
 * was overwritten. Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_compliance_compute(gpu_compliance_columns *blocks, const gpu_preconditioner *preconditioner,
                                             const gpu_iteration *iteration, int32_t count, const int32_t *unknown,
                                             cudaStream_t stream, bool *made);

#endif
