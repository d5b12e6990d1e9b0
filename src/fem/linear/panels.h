/* A supernodal Cholesky factor kept in single precision, for preconditioning: half the memory to read, which is what the two
 * triangular solves wait for. Sums are in double precision. */
#ifndef PLIANT_FEM_LINEAR_PANELS_H
#define PLIANT_FEM_LINEAR_PANELS_H

#include "pliant/status.h"

#include <stddef.h>
#include <stdint.h>

/* A factor as CHOLMOD lays it out: supernode s has columns first[s] .. first[s + 1], rows row[row_start[s]] .. (its own columns
 * first), and a panel of them by columns at value[value_start[s]]. Borrowed. */
typedef struct pliant_supernodes {
    int32_t count;
    const int *first, *row_start, *value_start, *row, *permutation;
    const double *value;
} pliant_supernodes;

typedef struct pliant_panels {
    size_t num_values;
    float *value;       /* (num_values), the diagonal inverted */
    double *x, *column; /* (size) room for the unknowns, and for the rows of a panel */
} pliant_panels;

/* Room for it; then its numbers, as often as they change. Errors: MEMORY. */
pliant_status pliant_panels_create(size_t num_values, int32_t size, pliant_panels *out);
void pliant_panels_fill(pliant_panels *panels, const pliant_supernodes *from);
/* out = (L L')^-1 right, (size) each; may be the same. */
void pliant_panels_solve(pliant_panels *panels, const pliant_supernodes *of, int32_t size, const double *right, double *out);
void pliant_panels_free(pliant_panels *panels);

#endif
