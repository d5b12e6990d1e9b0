/* A supernodal Cholesky factor kept in single precision, for preconditioning: half the memory to read, which is what
 * the two triangular solves wait for. Sums are in double precision. */
#ifndef PLIANT_FEM_LINEAR_PANELS_H
#define PLIANT_FEM_LINEAR_PANELS_H

#include "pliant/status.h"

#include <stddef.h>
#include <stdint.h>

/* A factor as CHOLMOD lays it out: supernode s has columns first[s] .. first[s + 1], rows row[row_start[s]] .. (its own
 * columns first), and a panel of them by columns at value[value_start[s]]. Borrowed. */
typedef struct pliant_supernodes {
    int32_t count;
    const int *first, *row_start, *value_start, *row, *permutation;
    const double *value;
} pliant_supernodes;

/* Supernodes that some unknowns stand in, and all that these are eliminated into: what is solved for at those unknowns
 * alone goes through no others (Liu, SIAM J. Matrix Anal. Appl. 11:134, 1990). */
typedef struct pliant_reach {
    int32_t *above;     /* (supernodes) that one is eliminated into, or -1; it has the higher number */
    int32_t *length;    /* (supernodes) unknowns of it and of all that it is eliminated into */
    int32_t *of;        /* (size) supernode of an unknown */
    int32_t *place;     /* (size) its place in the order of elimination */
    uint8_t *marked;    /* (supernodes) */
    int32_t count, *supernode; /* ascending */
    int32_t num_nodes, *node;  /* (size / 3) unknowns, three numbers each */
    double *x;          /* (size) room */
} pliant_reach;

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

/* Errors: MEMORY. */
pliant_status pliant_reach_create(const pliant_supernodes *of, int32_t size, pliant_reach *out);
void pliant_reach_free(pliant_reach *reach);
void pliant_reach_mark(pliant_reach *reach, const pliant_supernodes *of, int32_t count, const int32_t *nodes);
/* The same solve in two parts. The first gives out at the nodes of the reach; then right may still change there, by
 * more (Nullable), before the second. */
void pliant_panels_begin(pliant_panels *panels, const pliant_supernodes *of, pliant_reach *reach, int32_t size, const double *right, double *out);
void pliant_panels_end(pliant_panels *panels, const pliant_supernodes *of, pliant_reach *reach, int32_t size, const double *more, double *out);
/* Likewise, where between the two all that is asked of the first is x, L^-1 right in the order of elimination, and more
 * is added to that (halves.h). */
void pliant_panels_begin_half(pliant_panels *panels, const pliant_supernodes *of, int32_t size, const double *right);
void pliant_panels_end_half(pliant_panels *panels, const pliant_supernodes *of, int32_t size, double *out);
/* through one supernode: x there is what L^-1 makes of it, x at rows below follows */
void pliant_panels_forward(pliant_panels *panels, const pliant_supernodes *of, int32_t s, double *x);

#endif
