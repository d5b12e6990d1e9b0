/* One V-cycle of geometric multigrid as a preconditioner: Galerkin products with linear interpolation on nested
 * lattices down to a mesh that CHOLMOD factors in no time (NUMERICS.md: always the Galerkin product), Chebyshev
 * smoothing with the inverted diagonal blocks (Adams et al. 2003), the same before and after, so that the cycle is
 * symmetric and positive definite.
 *
 * The hierarchy (meshes, transfer, patterns) is built once and shared; a multigrid holds the numbers of one state. */
#ifndef PLIANT_FEM_LINEAR_MULTIGRID_H
#define PLIANT_FEM_LINEAR_MULTIGRID_H

#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_hierarchy pliant_hierarchy;
typedef struct pliant_multigrid pliant_multigrid;

/* fragments: where cuts have gone, every level has what they have parted apart (nested.c); else all levels but the
 * first are as before them. largest_direct: free nodes that the coarsest level may have, if the lattice can be halved
 * (or thirded ...) that far. *out is NULL when it cannot be coarsened at all. Errors: MEMORY. */
pliant_status pliant_hierarchy_create(const pliant_system *system, bool fragments, int32_t largest_direct, pliant_hierarchy **out);
pliant_hierarchy *pliant_hierarchy_retain(pliant_hierarchy *hierarchy); /* one more holder, from any thread */
void pliant_hierarchy_free(pliant_hierarchy *hierarchy); /* one less; Nullable */
int pliant_hierarchy_levels(const pliant_hierarchy *hierarchy);
/* Unknowns that lie where another one does: opened (num_free). Errors: MEMORY. */
pliant_status pliant_hierarchy_opened(const pliant_hierarchy *hierarchy, uint8_t *opened);
double pliant_hierarchy_operations(const pliant_hierarchy *hierarchy); /* of a refresh, roughly */

pliant_status pliant_multigrid_create(const pliant_hierarchy *hierarchy, int num_threads, pliant_multigrid **out);
void pliant_multigrid_free(pliant_multigrid *multigrid);
void pliant_multigrid_threads(pliant_multigrid *multigrid, int num_threads); /* from now on */
/* Matrices of all levels at these tangents of the finest. Errors: NUMERIC, MEMORY. */
pliant_status pliant_multigrid_numeric(pliant_multigrid *multigrid, const pliant_tangent *tangents);
/* the numbers of another one of the same hierarchy */
pliant_status pliant_multigrid_copy(pliant_multigrid *to, const pliant_multigrid *from);
/* out = M^-1 right, (3 num_free). */
pliant_status pliant_multigrid_solve(pliant_multigrid *multigrid, const double *right, double *out);

/* Numbers of a level above the coarsest, for backends: blocks by full rows (hierarchy.h) of 9, each by columns,
 * inverted diagonal blocks (num_free x 9), largest eigenvalue of inverse times matrix; and the coarsest matrix
 * (pattern.num_values). */
void pliant_multigrid_level(const pliant_multigrid *multigrid, int level, const float **blocks, const float **inverse, double *largest);
const double *pliant_multigrid_coarsest(const pliant_multigrid *multigrid);

#ifdef __cplusplus
}
#endif
#endif
