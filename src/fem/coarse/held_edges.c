/* Correction of coarse hexahedra at edges between held faces and free faces (NUMERICS.md).
 *
 * The stress is singular along such an edge. Elements of size h miss a part of its energy there, which makes the whole
 * body too stiff, by about h^1.1 for any element formulation. The correction reduces the stiffness of the elements at
 * the edge by the same factor for every size (energy-corrected finite elements: Egger, Ruede, Wohlmuth, SIAM J. Numer.
 * Anal. 52:171, 2014). Coarse elements with fine elements inside need only the fraction 1 - ratio^-1.1 of it. The
 * singularity grows with incompressibility, and vanishes at a Poisson's ratio of 0. The remaining stiffness is the
 * fraction
 *     1 / (1 + part (1 - ratio^-order) alike lambda / (lambda + knee mu)).
 *
 * Condensed elements between soft and stiff tissue are too soft already and need no correction. `alike` is the square
 * of the ratio of the harmonic to the arithmetic mean of the shear moduli: 1 for tissue of one modulus. */
#include "base/fail.h"
#include "fem/system.h"
#include "base/memory.h"

#include <math.h>

enum { CORNERS = 8 };

/* Fitted to the sag of a beam; NUMERICS.md lists the error on other bodies. */
static const double part = 0.274, knee = 5.2, order = 1.1;

typedef struct edge_work {
    const pliant_mesh *coarse;
    const uint8_t *fixed;  /* (coarse nodes) */
    /* (coarse cells) weight of the tissue in each cell, and the weight times the added compliance at an edge of
     * homogeneous tissue. */
    double *weight, *gain;
    uint8_t *solid;        /* (coarse cells) nonzero: the cell has an element */
    double alike;
} edge_work;

static void weigh(edge_work *work, const pliant_body *body)
{
    const double missed = part * (1 - pow((double)work->coarse->cells[0] / body->fine.cells[0], order));
    double whole = 0, mean = 0, inverse = 0;
    for (int32_t t = 0; t < body->fine.num_tets; t++) {
        const pliant_tet_material *material = body->fine_material + t;
        const int32_t cell = work->coarse->lattice_of_tet[body->coarse_of_fine[t]] / 5;
        const double volume = body->fine.lattice_of_tet[t] % 5 == 0 ? 2 : 1, tissue = volume * material->tissue;
        const double weight = tissue + 1e-3 * volume; /* as averages have it */
        work->weight[cell] += weight;
        work->gain[cell] += weight * missed * material->lambda / (material->lambda + knee * material->mu);
        if (!(tissue > 0)) continue;
        whole += tissue;
        mean += volume * material->mu; /* of its tissue: mu / material->tissue */
        inverse += tissue * material->tissue / material->mu;
    }
    const double alike = whole > 0 ? whole * whole / (mean * inverse) : 0;
    work->alike = alike * alike;
}

/* Return whether there is no element beyond a face of a cell: across axis d, on side s. */
static bool is_open(const edge_work *work, int32_t cell, int d, int s)
{
    const int32_t *cells = work->coarse->cells, stride[3] = {1, cells[0], cells[0] * cells[1]};
    const int32_t beyond = cell / stride[d] % cells[d] + (s ? 1 : -1);
    return beyond < 0 || beyond >= cells[d] || !work->solid[cell + (s ? stride[d] : -stride[d])];
}

static bool is_held(const edge_work *work, const int32_t *corner, int d, int s)
{
    bool held = true;
    for (int v = 0; v < CORNERS; v++) held = held && ((v >> d & 1) != s || work->fixed[corner[v]]);
    return held;
}

/* Return whether the cell has a completely held face at a right angle to a free face. */
static bool is_at_edge(const edge_work *work, int32_t cell, const int32_t *corner)
{
    for (int face = 0; face < 6; face++) {
        if (!is_held(work, corner, face / 2, face % 2)) continue;
        for (int other = 0; other < 6; other++)
            if (other / 2 != face / 2 && is_open(work, cell, other / 2, other % 2) &&
                !is_held(work, corner, other / 2, other % 2))
                return true;
    }
    return false;
}

static void soften(const edge_work *work, pliant_macros *macros)
{
    for (int32_t e = 0; e < macros->count; e++) work->solid[macros->cell[e]] = 1;
    for (int32_t e = 0; e < macros->count; e++) {
        const int32_t cell = macros->cell[e];
        if (macros->start[e + 1] - macros->start[e] != CORNERS || macros->grounded[e] || !(work->weight[cell] > 0))
            continue;
        if (!is_at_edge(work, cell, macros->own + CORNERS * (size_t)e)) continue;
        const double root = sqrt(1 / (1 + work->alike * work->gain[cell] / work->weight[cell]));
        for (int32_t m = 0; m < 3 * CORNERS * macros->rank[e]; m++)
            macros->root[e][m] = (float)(root * macros->root[e][m]);
    }
}

pliant_status pliant_soften_held_edges(pliant_system *system, const pliant_body *body, const uint8_t *fixed)
{
    const pliant_mesh *coarse = system->mesh;
    const size_t cells = (size_t)coarse->cells[0] * (size_t)coarse->cells[1] * (size_t)coarse->cells[2];
    edge_work work = {.coarse = coarse,
                      .fixed = fixed,
                      .weight = pliant_calloc(cells, sizeof *work.weight),
                      .gain = pliant_calloc(cells, sizeof *work.gain),
                      .solid = pliant_calloc(cells, 1)};
    const bool good = work.weight && work.gain && work.solid;
    if (good) {
        weigh(&work, body);
        soften(&work, system->macros);
    }
    PLIANT_FREE(work.weight, work.gain, work.solid);
    return good ? PLIANT_OK : pliant_fail_memory("the coarse hexahedra");
}
