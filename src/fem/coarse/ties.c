/* Where a cut ends in a face between two coarse elements, or in front of what it has parted, nodes of either side lie at one place, and what is left
 * of the face ties them:
 *     k_i = kappa int N_i (sum over such places of N) dA,   kappa = stiffness mu / h,
 * over the fine faces that still join the two, N the shape functions there, h the edge of a coarse cube: linear in the place of the cut's end
 * between two coarse nodes, where gluing the face would move it back to the one and parting the face on to the other. A tie turns with its nodes. */
#include "base/fail.h"
#include "base/room.h"
#include "fem/coarse/cubes.h"
#include "pliant/memory.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { CORNERS = 8 };

/* found with bars of two materials, cubes of an eighth to a half of their height (NUMERICS 10). Where a cut ends within an element, its averages open
 * already. */
static const double stiffness = 8, stiffness_beside_end = 1;

typedef struct tie {
    int32_t node[2], cell;
    double k;
} tie;

typedef struct tying {
    const pliant_system *system;
    const pliant_body *body;
    int32_t *element_of_tet; /* (coarse tetrahedra) */
    uint8_t *copied;         /* (coarse nodes) there is another one at its place */
    uint8_t *ends;           /* (coarse tetrahedra) a cut ends in it: it holds two fine nodes at one place */
    tie *list;
    int32_t count, room;
} tying;

static bool has_copies(const tying *work, int32_t tet)
{
    const int32_t *nodes = work->system->mesh->tets + 4 * (size_t)tet;
    return work->copied[nodes[0]] || work->copied[nodes[1]] || work->copied[nodes[2]] || work->copied[nodes[3]];
}

/* nodes of the element that a coarse tetrahedron is in, and their shape functions at a point; returns how many */
static int shapes_at(const tying *work, int32_t tet, const double *point, const int32_t **nodes, double *shape)
{
    const pliant_macros *macros = work->system->macros;
    const int32_t element = work->element_of_tet[tet];
    if (macros->start[element + 1] - macros->start[element] == CORNERS) {
        *nodes = macros->node + macros->start[element];
        pliant_trilinear_weights(work->system, macros->cell[element], point, shape);
        return CORNERS;
    }
    *nodes = work->system->mesh->tets + 4 * (size_t)tet;
    pliant_mesh_barycentric(work->system->mesh, tet, point, shape);
    return 4;
}

static pliant_status add(tying *work, int32_t a, int32_t b, int32_t cell, double k)
{
    if (work->count == work->room) {
        tie *more = pliant_resize(work->list, 2 * (size_t)work->room + 64, sizeof *more);
        if (!more) return pliant_fail_memory("the coarse hexahedra");
        work->list = more;
        work->room = 2 * work->room + 64;
    }
    work->list[work->count++] = (tie){{a < b ? a : b, a < b ? b : a}, cell, k};
    return PLIANT_OK;
}

/* one point of a fine face between two coarse tetrahedra, weight: of its area times kappa */
static pliant_status tie_at(tying *work, int32_t a, int32_t b, const double *point, double weight)
{
    const int32_t *at = work->system->mesh->lattice_of_node, *of_a, *of_b, cell = pliant_cell_of_tet(work->system->mesh, a);
    double shape_a[CORNERS], shape_b[CORNERS], sum = 0;
    const int num_a = shapes_at(work, a, point, &of_a, shape_a), num_b = shapes_at(work, b, point, &of_b, shape_b);
    int pair[CORNERS], pairs[CORNERS], count = 0;
    for (int v = 0; v < num_a; v++)
        for (int w = 0; w < num_b; w++) {
            if (of_a[v] == of_b[w] || at[of_a[v]] != at[of_b[w]] || !(shape_a[v] > 1e-6)) continue;
            sum += shape_a[v];
            pair[count] = v;
            pairs[count++] = w;
        }
    pliant_status status = PLIANT_OK;
    for (int p = 0; p < count && status == PLIANT_OK; p++) status = add(work, of_a[pair[p]], of_b[pairs[p]], cell, weight * sum * shape_a[pair[p]]);
    return status;
}

static pliant_status tie_face(tying *work, int32_t face, int32_t other)
{
    const pliant_body *body = work->body;
    const pliant_mesh *fine = &body->fine;
    const int32_t tet = face / 4;
    const double *x[3], *cell = work->system->mesh->cell_size;
    double edge[2][3], normal[3], mu[2] = {body->fine_material[tet].mu, body->fine_material[other].mu};
    for (int v = 0, c = 0; v < 4; v++)
        if (v != face % 4) x[c++] = fine->rest + 3 * fine->tets[4 * (size_t)tet + (size_t)v];
    for (int d = 0; d < 3; d++) edge[0][d] = x[1][d] - x[0][d], edge[1][d] = x[2][d] - x[0][d];
    for (int d = 0; d < 3; d++) normal[d] = edge[0][(d + 1) % 3] * edge[1][(d + 2) % 3] - edge[0][(d + 2) % 3] * edge[1][(d + 1) % 3];
    const double area = 0.5 * sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    const double between = mu[0] + mu[1] > 0 ? 2 * mu[0] * mu[1] / (mu[0] + mu[1]) : 0, edge_of_cube = cbrt(cell[0] * cell[1] * cell[2]);
    const bool end = work->ends[body->coarse_of_fine[tet]] || work->ends[body->coarse_of_fine[other]];
    const double weight = (end ? stiffness_beside_end : stiffness) * between / edge_of_cube * area / 3;
    pliant_status status = PLIANT_OK;
    for (int p = 0; p < 3 && status == PLIANT_OK; p++) {
        double middle[3];
        for (int d = 0; d < 3; d++) middle[d] = 0.5 * (x[p][d] + x[(p + 1) % 3][d]);
        status = tie_at(work, body->coarse_of_fine[tet], body->coarse_of_fine[other], middle, weight);
    }
    return status;
}

typedef struct copied_node {
    int32_t tet, at, node;
} copied_node;

static int by_place(const void *a, const void *b)
{
    const copied_node *i = a, *j = b;
    if (i->tet != j->tet) return i->tet < j->tet ? -1 : 1;
    if (i->at != j->at) return i->at < j->at ? -1 : 1;
    return i->node < j->node ? -1 : i->node > j->node;
}

/* (nodes) there is another one at its place. Errors: MEMORY. */
static pliant_status find_copied(const pliant_mesh *mesh, uint8_t **out)
{
    const size_t places = ((size_t)mesh->cells[0] + 1) * ((size_t)mesh->cells[1] + 1) * ((size_t)mesh->cells[2] + 1);
    uint8_t *seen = pliant_calloc(places, 1);
    if (seen) *out = pliant_calloc((size_t)mesh->num_nodes, 1);
    for (int32_t n = 0; *out && n < mesh->num_nodes; n++) seen[mesh->lattice_of_node[n]] |= seen[mesh->lattice_of_node[n]] ? 2 : 1;
    for (int32_t n = 0; *out && n < mesh->num_nodes; n++) (*out)[n] = seen[mesh->lattice_of_node[n]] > 1;
    pliant_free(seen);
    return *out ? PLIANT_OK : pliant_fail_memory("the coarse hexahedra");
}

static pliant_status find_ends(const pliant_body *body, uint8_t **out)
{
    const pliant_mesh *fine = &body->fine;
    uint8_t *copied = NULL;
    pliant_status status = find_copied(fine, &copied);
    copied_node *list = pliant_calloc(4 * (size_t)fine->num_tets, sizeof *list);
    if (status == PLIANT_OK && (!list || !(*out = pliant_calloc((size_t)body->coarse.num_tets, 1)))) status = pliant_fail_memory("the coarse hexahedra");
    int32_t count = 0;
    for (int32_t v = 0; status == PLIANT_OK && v < 4 * fine->num_tets; v++)
        if (copied[fine->tets[v]]) list[count++] = (copied_node){body->coarse_of_fine[v / 4], fine->lattice_of_node[fine->tets[v]], fine->tets[v]};
    if (status == PLIANT_OK) qsort(list, (size_t)count, sizeof *list, by_place);
    for (int32_t i = 1; i < count; i++)
        if (list[i].tet == list[i - 1].tet && list[i].at == list[i - 1].at && list[i].node != list[i - 1].node) (*out)[list[i].tet] = 1;
    pliant_free(list);
    pliant_free(copied);
    return status;
}

static int by_nodes(const void *a, const void *b)
{
    const tie *i = a, *j = b;
    if (i->node[0] != j->node[0]) return i->node[0] < j->node[0] ? -1 : 1;
    return i->node[1] < j->node[1] ? -1 : i->node[1] > j->node[1];
}

static void sum_up(tying *work)
{
    int32_t count = 0;
    qsort(work->list, (size_t)work->count, sizeof *work->list, by_nodes);
    for (int32_t i = 0; i < work->count; i++) {
        if (count > 0 && by_nodes(work->list + count - 1, work->list + i) == 0) work->list[count - 1].k += work->list[i].k;
        else work->list[count++] = work->list[i];
    }
    work->count = count;
}

static pliant_status make_room(pliant_macros *macros, size_t count, size_t corners)
{
    const bool good = pliant_grow(&macros->start, count + 1, sizeof *macros->start) && pliant_grow(&macros->node, corners, sizeof *macros->node) && pliant_grow(&macros->held, corners, 1) &&
                      pliant_grow(&macros->grounded, count, 1) && pliant_grow(&macros->own, count, CORNERS * sizeof *macros->own) &&
                      pliant_grow(&macros->gradient, count, 3 * CORNERS * sizeof *macros->gradient) && pliant_grow(&macros->cell, count, sizeof *macros->cell) &&
                      pliant_grow(&macros->shear, count, sizeof *macros->shear) && pliant_grow(&macros->rank, count, sizeof *macros->rank) && pliant_grow(&macros->root, count, sizeof *macros->root);
    return good ? PLIANT_OK : pliant_fail_memory("the coarse hexahedra");
}

/* Of two corners. It keeps R = I: between two nodes at one place that is as good as any. */
static pliant_status append_one(const tie *made, pliant_macros *macros)
{
    const int32_t e = macros->count, begin = macros->start[e];
    double root[18] = {0};
    for (int c = 0; c < 2; c++) {
        macros->node[begin + c] = made->node[c];
        macros->held[begin + c] = 1;
    }
    for (int v = 0; v < CORNERS; v++) macros->own[CORNERS * (size_t)e + (size_t)v] = v < 2 ? made->node[v] : -1;
    memset(macros->gradient + 3 * CORNERS * (size_t)e, 0, 3 * CORNERS * sizeof *macros->gradient);
    macros->grounded[e] = 1;
    macros->cell[e] = made->cell;
    macros->shear[e] = 0;
    macros->root[e] = NULL;
    macros->start[e + 1] = begin + 2;
    macros->count++;
    for (int d = 0; d < 3; d++) {
        root[6 * d + d] = sqrt(made->k);
        root[6 * d + 3 + d] = -sqrt(made->k);
    }
    return pliant_cube_keep_root(macros, e, 6, 3, root);
}

static pliant_status append(const tying *work, pliant_system *system)
{
    pliant_macros *macros = system->macros;
    const int32_t count = macros->count + work->count, corners = macros->start[macros->count] + 2 * work->count;
    pliant_status status = make_room(macros, (size_t)count, (size_t)corners);
    for (int32_t i = 0; status == PLIANT_OK && i < work->count; i++) status = append_one(work->list + i, macros);
    system->num_blocks = pliant_macros_blocks((size_t)count, (size_t)corners);
    return status;
}

pliant_status pliant_cubes_tie(pliant_system *system, const pliant_body *body)
{
    if (body->cuts_open != PLIANT_CUTS_TIED || !body->across || !body->coarse_node_parent) return PLIANT_OK;
    tying work = {.system = system, .body = body};
    pliant_status status = find_copied(system->mesh, &work.copied);
    if (status == PLIANT_OK) status = find_ends(body, &work.ends);
    if (status == PLIANT_OK) status = pliant_hexahedra_of_tets(system->mesh, system->macros, &work.element_of_tet);
    for (int32_t f = 0; status == PLIANT_OK && f < 4 * body->fine.num_tets; f++) {
        const int32_t other = body->across[f];
        if (other < f / 4) continue; /* from one side is enough */
        const int32_t a = body->coarse_of_fine[f / 4], b = body->coarse_of_fine[other];
        if (work.element_of_tet[a] != work.element_of_tet[b] && has_copies(&work, a) && has_copies(&work, b)) status = tie_face(&work, f, other);
    }
    if (status == PLIANT_OK && work.count > 0) {
        sum_up(&work);
        status = append(&work, system);
    }
    pliant_free(work.list);
    pliant_free(work.copied);
    pliant_free(work.ends);
    pliant_free(work.element_of_tet);
    return status;
}
