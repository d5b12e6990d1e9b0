/* A preconditioner that is carried over to the next body, until there is one of its own.
 *
 * Of the body before there is V, nearly the inverse of its stiffness. Every unknown of the next body is a node of the body before or a
 * copy of one: with P, which gives copies what their sources have, P V P' answers to all loads as if the cut were still closed. What it
 * cannot see is mended around the cut, where S is the inverse of the stiffness with everything else held (subdomain.h):
 *     M^-1 = S + E P V P' E',  E = I - S K
 * an overlapping Schwarz method in its balanced form (Mandel 1993, Balancing domain decomposition, with the two parts' places changed):
 * both terms are symmetric and positive semidefinite, whatever V is, and their sum is definite. */
#ifndef PLIANT_FEM_LINEAR_CARRIED_H
#define PLIANT_FEM_LINEAR_CARRIED_H

#include "fem/linear/subdomain.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Elements around the cut whose unknowns are solved for there (test/bench/bench_adapt). */
enum { PLIANT_CARRIED_RINGS = 1 };

typedef struct pliant_carried {
    pliant_preconditioner *base;      /* V; NULL until it is handed over */
    const pliant_discretization *of;  /* what it is of; retained */
    const pliant_system *system;      /* one of its systems: the base's */
    int32_t num_free, base_free;      /* here; there */
    int32_t *source;                  /* (num_free) unknown there, or -1 */
    bool mended;                      /* near was found */
    pliant_subdomain *near;           /* Nullable: nothing is opened */
    double *rest, *all;               /* (3 num_free) room */
    double *right, *left;             /* (3 base_free) room */
} pliant_carried;

/* opened: (num_free) out: 1 where the source is shared or missing. Errors: MEMORY. */
pliant_status pliant_carried_opened(int32_t num_free, int32_t base_free, const int32_t *source, uint8_t *opened);
/* Which cubes of the fine lattice are hexahedra: (cells), freed with pliant_free; NULL: the system has none. Errors: MEMORY. */
pliant_status pliant_carried_whole(const pliant_system *system, uint8_t **out);
/* Besides: corners of hexahedra of the base (whole, NULL: none) that a cut has divided into tetrahedra, which are stiffer. */
void pliant_carried_open_divided(const pliant_system *system, const uint8_t *whole, uint8_t *opened);
/* source is taken over, also on an error; base is handed over later. positions: NULL: not mended yet. Errors: MEMORY, NUMERIC. */
pliant_status pliant_carried_create(const pliant_system *system, const pliant_discretization *of, const pliant_system *of_base, int32_t *source,
                                    const double *positions, const double *axes, pliant_carried **out);
/* S, around what is opened, where there is none yet; before the first solve. Errors: MEMORY, NUMERIC. */
pliant_status pliant_carried_mend(const pliant_system *system, const double *positions, const double *axes, pliant_carried *carried);
void pliant_carried_free(pliant_carried *carried); /* Nullable; its base is whose it is */
/* M^-1 in two parts, between which whose the base is takes right to left = V right: S right, and P' E' right; then out = all + E P left. Errors: MEMORY. */
pliant_status pliant_carried_restrict(pliant_carried *carried, const double *right);
pliant_status pliant_carried_extend(pliant_carried *carried, double *out);

#ifdef __cplusplus
}
#endif
#endif
