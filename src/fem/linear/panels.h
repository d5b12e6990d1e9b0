/* A supernodal Cholesky factor in single precision, for preconditioning. It halves the memory traffic, which limits the
 * triangular solves. Sums are in double precision. */
#ifndef PLIANT_FEM_LINEAR_PANELS_H
#define PLIANT_FEM_LINEAR_PANELS_H

#include "pliant/status.h"

#include <stddef.h>
#include <stdint.h>

/* A factor in CHOLMOD's layout. Supernode s has the columns first[s] .. first[s + 1] and the rows row[row_start[s]] ..,
 * its own columns first. Its panel is column-major at value[value_start[s]]. Borrowed. */
typedef struct pliant_supernodes {
    int32_t count;
    const int *first, *row_start, *value_start, *row, *permutation;
    const double *value;
} pliant_supernodes;

/* The supernodes of some unknowns, and all supernodes into which these are eliminated. A solve restricted to those
 * unknowns needs no other supernodes (Liu, SIAM J. Matrix Anal. Appl. 11:134, 1990). */
typedef struct pliant_reach {
    int32_t *above;     /* (supernodes) supernode into which each is eliminated, or -1; it has a higher number */
    int32_t *length;    /* (supernodes) unknowns of it and of all supernodes into which it is eliminated */
    int32_t *of;        /* (size) supernode of an unknown */
    int32_t *place;     /* (size) index of an unknown in elimination order */
    uint8_t *marked;    /* (supernodes) */
    int32_t count, *supernode; /* ascending */
    int32_t num_nodes, *node;  /* (size / 3) unknowns, three numbers each */
    double *x;          /* (size) work array */
} pliant_reach;

typedef struct pliant_panels {
    size_t num_values;
    float *value;       /* (num_values), with inverted diagonal */
    double *x, *column; /* (size) work arrays for the unknowns, and for the rows of a panel */
} pliant_panels;

/* Allocate the panels, and fill in values, which may change. Errors: MEMORY. */
pliant_status pliant_panels_create(size_t num_values, int32_t size, pliant_panels *out);
void pliant_panels_fill(pliant_panels *panels, const pliant_supernodes *from);
/* Compute out = (L L')^-1 right, (size) each. Both may be the same array. */
void pliant_panels_solve(pliant_panels *panels, const pliant_supernodes *of, int32_t size, const double *right,
                         double *out);
void pliant_panels_free(pliant_panels *panels);

/* Create an empty reach. Errors: MEMORY. */
pliant_status pliant_reach_create(const pliant_supernodes *of, int32_t size, pliant_reach *out);
void pliant_reach_free(pliant_reach *reach);
void pliant_reach_mark(pliant_reach *reach, const pliant_supernodes *of, int32_t count, const int32_t *nodes);
/* Solve in two parts. The first part computes out at the nodes of the reach. Before the second part, the right side may
 * change there by `more` (Nullable). */
void pliant_panels_begin(pliant_panels *panels, const pliant_supernodes *of, pliant_reach *reach, int32_t size,
                         const double *right, double *out);
void pliant_panels_end(pliant_panels *panels, const pliant_supernodes *of, pliant_reach *reach, int32_t size,
                       const double *more, double *out);
/* Solve in two parts for half solves. Between the parts, x holds L^-1 right in elimination order, and callers add to it
 * (half_solve.h). */
void pliant_panels_begin_half(pliant_panels *panels, const pliant_supernodes *of, int32_t size, const double *right);
void pliant_panels_end_half(pliant_panels *panels, const pliant_supernodes *of, int32_t size, double *out);
/* Apply L^-1 of one supernode to x, and update the rows below it. */
void pliant_panels_forward(pliant_panels *panels, const pliant_supernodes *of, int32_t s, double *x);

#endif
