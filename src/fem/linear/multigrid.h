/* One V-cycle of geometric multigrid as a preconditioner. The coarse matrices are Galerkin products with linear
 * interpolation on nested lattices (NUMERICS.md). CHOLMOD factors the coarsest matrix. The smoother is Chebyshev
 * iteration with inverted diagonal blocks (Adams et al. 2003). Pre- and post-smoothing are equal, so the cycle is
 * symmetric and positive definite.
 *
 * The hierarchy (meshes, transfer, patterns) is built once and shared. A multigrid holds the values of one state. */
#ifndef PLIANT_FEM_LINEAR_MULTIGRID_H
#define PLIANT_FEM_LINEAR_MULTIGRID_H

#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_hierarchy pliant_hierarchy;
typedef struct pliant_multigrid pliant_multigrid;

/* Build the hierarchy of a system.
 * @param fragments       Separate the tissue on both sides of cuts on every level (hierarchy_fragments.c); false: only
 *     on the finest level.
 * @param largest_direct  Maximum number of free nodes of the coarsest level, if the lattice can be coarsened that much.
 * @param out             NULL if the lattice cannot be coarsened.
 * Errors: MEMORY. */
pliant_status pliant_hierarchy_create(const pliant_system *system, bool fragments, int32_t largest_direct,
                                      pliant_hierarchy **out);
pliant_hierarchy *pliant_hierarchy_retain(pliant_hierarchy *hierarchy); /* adds a reference, from any thread */
void pliant_hierarchy_free(pliant_hierarchy *hierarchy); /* removes a reference; Nullable */
/* Mark unknowns at the position of another unknown: opened (num_free). Errors: MEMORY. */
pliant_status pliant_hierarchy_mark_copies(const pliant_hierarchy *hierarchy, uint8_t *opened);
double pliant_hierarchy_operations(const pliant_hierarchy *hierarchy); /* of a refresh, approximately */

pliant_status pliant_multigrid_create(const pliant_hierarchy *hierarchy, int num_threads, pliant_multigrid **out);
void pliant_multigrid_free(pliant_multigrid *multigrid);
void pliant_multigrid_threads(pliant_multigrid *multigrid, int num_threads); /* applies to all later calls */
/* Compute the matrices of all levels at these tangents of the finest level. Errors: NUMERIC, MEMORY. */
pliant_status pliant_multigrid_numeric(pliant_multigrid *multigrid, const pliant_tangent *tangents);
/* Copy the values of another multigrid of the same hierarchy. */
pliant_status pliant_multigrid_copy(pliant_multigrid *to, const pliant_multigrid *from);
/* Compute out = M^-1 right, (3 num_free). */
pliant_status pliant_multigrid_solve(pliant_multigrid *multigrid, const double *right, double *out);

/* Return the values of a level above the coarsest, and the coarsest matrix (pattern.num_values), for backends.
 * @param blocks   Blocks of 9 values by complete rows (hierarchy.h), each column-major.
 * @param inverse  (num_free x 9) inverted diagonal blocks.
 * @param largest  Largest eigenvalue of the inverted diagonal times the matrix. */
void pliant_multigrid_level(const pliant_multigrid *multigrid, int level, const float **blocks, const float **inverse,
                            double *largest);
const double *pliant_multigrid_coarsest(const pliant_multigrid *multigrid);

#ifdef __cplusplus
}
#endif
#endif
