/* One cycle of multigrid as a preconditioner: aggregates of nodes that move as rigid bodies (hierarchy.h), Galerkin products down to a
 * matrix that CHOLMOD factors in little time (NUMERICS 7.5: always the Galerkin product), Chebyshev smoothing with the inverted diagonal
 * blocks (Adams et al. 2003), the same before and after, so that the cycle is symmetric and positive definite. It asks for nothing but
 * the matrix and where nodes are: any mesh will do.
 *
 * The hierarchy (aggregates, patterns) is built once, from the matrix at rest, and shared; a multigrid holds the numbers of one state. */
#ifndef PLIANT_FEM_LINEAR_MULTIGRID_H
#define PLIANT_FEM_LINEAR_MULTIGRID_H

#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_hierarchy pliant_hierarchy;
typedef struct pliant_multigrid pliant_multigrid;

/* largest_direct: nodes of three unknowns, two an aggregate, that the coarsest level may have; more where aggregates cannot be gathered
 * further. Errors: MEMORY. */
pliant_status pliant_hierarchy_create(const pliant_system *system, int32_t largest_direct, pliant_hierarchy **out);
void pliant_hierarchy_free(pliant_hierarchy *hierarchy);
double pliant_hierarchy_operations(const pliant_hierarchy *hierarchy); /* of a refresh, roughly */

pliant_status pliant_multigrid_create(const pliant_hierarchy *hierarchy, int num_threads, pliant_multigrid **out);
void pliant_multigrid_free(pliant_multigrid *multigrid);
void pliant_multigrid_threads(pliant_multigrid *multigrid, int num_threads); /* from now on */
/* Matrices of all levels at these tangents of the finest, with nodes (num_nodes x 3) at these positions. Errors: NUMERIC, MEMORY. */
pliant_status pliant_multigrid_numeric(pliant_multigrid *multigrid, const double *positions, const pliant_tangent *tangents);
/* the numbers of another one of the same hierarchy */
pliant_status pliant_multigrid_copy(pliant_multigrid *to, const pliant_multigrid *from);
/* out = M^-1 right, (3 num_free). */
pliant_status pliant_multigrid_solve(pliant_multigrid *multigrid, const double *right, double *out);

/* Numbers of a level above the coarsest, for backends: blocks by full rows (hierarchy.h) of 9, column after column, inverted diagonal
 * blocks (nodes x 9), arms (nodes x 3), largest eigenvalue of inverse times matrix; and the coarsest matrix (pattern.num_values). */
void pliant_multigrid_level(const pliant_multigrid *multigrid, int level, const float **blocks, const float **inverse, const float **arm,
                            double *largest);
const double *pliant_multigrid_coarsest(const pliant_multigrid *multigrid);

/* Chebyshev iteration for A x = b on [share, 1] of the spectrum of D^-1 A (Saad, Iterative Methods, 12.3), two steps: step = first D^-1 r;
 * then step = again step + fresh D^-1 r (Adams et al. 2003; test/bench/bench_budget: two and a tenth need the fewest evaluations for the
 * time). Levels below the finest are gone through twice (W), as aggregates that move as rigid bodies need. */
typedef struct pliant_chebyshev {
    float first, again, fresh;
} pliant_chebyshev;
pliant_chebyshev pliant_multigrid_smoother(double largest);
enum { PLIANT_CYCLES_BELOW = 2 };

#ifdef __cplusplus
}
#endif
#endif
