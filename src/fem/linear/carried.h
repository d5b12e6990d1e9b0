/* A preconditioner that is carried over to the next body, until there is one of its own.
 *
 * Of the body before there is V, nearly the inverse of its stiffness. Every unknown of the next body is a node of the
 * body before or a copy of one: with P, which gives copies what their sources have, P V P' answers to all loads as if
 * the cut were still closed. What it cannot see is mended around the cut, where S is the inverse of the stiffness with
 * everything else held (subdomain.h):
 *     M^-1 = S + E P V P' E',  E = I - S K
 * an overlapping Schwarz method in its balanced form (Mandel 1993, Balancing domain decomposition, with the two parts'
 * places changed): both terms are symmetric and positive semidefinite, whatever V is, and their sum is definite. */
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

/* What there is to know of a base's system where that may be gone. */
typedef struct pliant_carried_layout {
    int32_t num_free;
    int32_t *place;           /* (num_free) node of the fine lattice where each is; -1: a coarse one */
    uint8_t *cube;            /* Nullable: (cells of the fine lattice) how many elements of which kind it has there; NULL: no hexahedra */
} pliant_carried_layout;
/* Errors: MEMORY, with what was made in out. */
pliant_status pliant_carried_layout_create(const pliant_system *system, pliant_carried_layout *out);
void pliant_carried_layout_free(pliant_carried_layout *layout);

/* Which unknowns the base does not know as they are, opened: (num_free) out: their source is shared or missing, or
 * another that was there is gone, as where a cut was undone; and corners of hexahedra that have been divided since,
 * into parts or tetrahedra, which are stiffer, or the other way round. Errors: MEMORY. */
pliant_status pliant_carried_opened(const pliant_system *system, const pliant_carried_layout *base, const int32_t *source, uint8_t *opened);
/* source is taken over, also on an error; base is handed over later. positions: NULL: not mended yet. Errors: MEMORY,
 * NUMERIC. */
pliant_status pliant_carried_create(const pliant_system *system, const pliant_discretization *of, const pliant_system *of_base, int32_t *source,
                                    const double *positions, const double *axes, pliant_carried **out);
/* S, around what is opened, where there is none yet; before the first solve. Errors: MEMORY, NUMERIC. */
pliant_status pliant_carried_mend(const pliant_system *system, const double *positions, const double *axes, pliant_carried *carried);
void pliant_carried_free(pliant_carried *carried); /* Nullable; its base is whose it is */
/* M^-1 in two parts, between which whose the base is takes right to left = V right: S right, and P' E' right; then out
 * = all + E P left. Errors: MEMORY. */
pliant_status pliant_carried_restrict(pliant_carried *carried, const double *right);
pliant_status pliant_carried_extend(pliant_carried *carried, double *out);

#ifdef __cplusplus
}
#endif
#endif
