/* A preconditioner carried over a cut, used until a new one is ready.
 *
 * V approximates the inverse stiffness before the cut. Every unknown after the cut is a node from before the cut or a
 * copy of one. P gives copies the values of their sources. P V P' then responds to all loads as if the cut were still
 * closed. A local inverse S around the cut corrects it, with all other nodes held (subdomain.h):
 *     M^-1 = S + E P V P' E',  E = I - S K
 * This is an overlapping Schwarz method in balanced form (Mandel 1993, Balancing domain decomposition, with both parts
 * exchanged). Both terms are symmetric and positive semidefinite for any V, and their sum is definite. */
#ifndef PLIANT_FEM_LINEAR_CARRIED_PRECONDITIONER_H
#define PLIANT_FEM_LINEAR_CARRIED_PRECONDITIONER_H

#include "fem/linear/subdomain.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Rings of elements around the cut whose unknowns are solved locally (test/bench/bench_adapt). */
enum { PLIANT_CARRIED_RINGS = 1 };

typedef struct pliant_carried {
    pliant_preconditioner *base;     /* V; NULL until pliant_preconditioner_take_base */
    const pliant_discretization *of; /* discretization of the base; retained */
    const pliant_system *system;     /* system of the base, part of `of` */
    int32_t num_free, base_free;     /* unknowns after and before the cut */
    int32_t *source;                 /* (num_free) unknown before the cut, or -1 */
    bool is_corrected;               /* `near` has been computed */
    pliant_subdomain *near;          /* Nullable: the cut opens nothing */
    double *rest, *all;              /* (3 num_free) work arrays */
    double *right, *left;            /* (3 base_free) work arrays */
} pliant_carried;

/* Layout of a base's system, kept after that system may have been freed. */
typedef struct pliant_carried_layout {
    int32_t num_free;
    int32_t *place;           /* (num_free) node of the fine lattice of each unknown; -1: a coarse node */
    /* Nullable: (cells of the fine lattice) encoded number and kind of the base's elements in each cell; NULL: no
     * hexahedra. */
    uint8_t *cube;
} pliant_carried_layout;
/* Create the layout. Errors: MEMORY, with a partial result in out. */
pliant_status pliant_carried_layout_create(const pliant_system *system, pliant_carried_layout *out);
void pliant_carried_layout_free(pliant_carried_layout *layout);

/* Mark the unknowns whose elements differ from the base's.
 * @param opened  Out: (num_free) nonzero where the source is shared or missing, where another unknown of the base has
 *     gone (after an undone cut), and at corners of hexahedra that were split into parts or tetrahedra, or restored.
 * Errors: MEMORY. */
pliant_status pliant_carried_mark_opened(const pliant_system *system, const pliant_carried_layout *base,
                                         const int32_t *source, uint8_t *opened);
/* Create a carried preconditioner. It takes ownership of source, also on an error. The base is handed over later.
 * positions: NULL: pliant_carried_correct computes S later. Errors: MEMORY, NUMERIC. */
pliant_status pliant_carried_create(const pliant_system *system, const pliant_discretization *of,
                                    const pliant_system *of_base, int32_t *source, const double *positions,
                                    const double *axes, pliant_carried **out);
/* Compute S around the opened unknowns if it is missing. Call it before the first solve. Errors: MEMORY, NUMERIC. */
pliant_status pliant_carried_correct(const pliant_system *system, const double *positions, const double *axes,
                                     pliant_carried *carried);
void pliant_carried_free(pliant_carried *carried); /* Nullable; does not free the base */
/* Apply M^-1 in two parts. `restrict` computes S right and P' E' right. The owner of the base then sets left = V right.
 * `extend` computes out = all + E P left. Errors: MEMORY. */
pliant_status pliant_carried_restrict(pliant_carried *carried, const double *right);
pliant_status pliant_carried_extend(pliant_carried *carried, double *out);

#ifdef __cplusplus
}
#endif
#endif
