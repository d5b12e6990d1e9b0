/* The lower triangle of a matrix of 3 x 3 blocks, from whatever adds to it (pliant_pattern in system.h). */
#ifndef PLIANT_FEM_LINEAR_PATTERN_H
#define PLIANT_FEM_LINEAR_PATTERN_H

#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

/* what adds to block (row, column), row >= column; the caller says what a term means */
typedef struct pliant_entry {
    int32_t row, column, term;
} pliant_entry;

/* num_columns of the pattern is given; the entries are sorted in place, stably. Errors: MEMORY; the caller clears what is there then. */
pliant_status pliant_pattern_fill(pliant_pattern *pattern, pliant_entry *entries, int32_t count);
void pliant_pattern_clear(pliant_pattern *pattern);
/* blocks (num_blocks x 9, row-major) to values (num_values), as pliant_system_assemble lays them out */
void pliant_pattern_values(const pliant_pattern *pattern, const double *blocks, double *values);

#ifdef __cplusplus
}
#endif
#endif
