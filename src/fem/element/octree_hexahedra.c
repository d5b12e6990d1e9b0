/* Hexahedra on the leaves of an octree. What lies in the middle of an edge or face of a larger leaf follows its corners (Hughes, The Finite Element
 * Method, 3.A), so that displacements are the same on both sides: u = C u_m, and an element with such corners has C'KC on the nodes that they
 * follow. These are eight again: a corner that follows is a middle of the cube twice the size that was split into this leaf and its seven brothers,
 * and follows the corners of that cube on this edge or face, of which one is opposite. None of them follows itself: a brother has it as its
 * corner, and would share an edge with a leaf four times its size. */
#include "base/fail.h"
#include "fem/element/hexahedra.h"
#include "mesh/octree.h"
#include "pliant/memory.h"

#include <string.h>

enum { CORNERS = 8, UNKNOWNS = 24 };

typedef struct leaves {
    pliant_system *system;
    int32_t count;          /* with tissue */
    int32_t (*origin)[3];   /* (num_leaves) in smallest cells */
    int32_t *size;          /* (num_leaves) likewise; 0: without tissue */
    uint8_t *follows;       /* (nodes) */
    pliant_cube_shape *shape; /* (PLIANT_MAX_DEPTH + 1) x 2, by size and parity */
    bool known[PLIANT_MAX_DEPTH + 1][2];
} leaves;

static int32_t node_of(const leaves *work, int32_t leaf, const int32_t halves[3])
{
    const pliant_mesh *mesh = work->system->mesh;
    return mesh->node_of_lattice[pliant_octree_place(mesh->cells, work->origin[leaf], work->size[leaf], halves)];
}

static void find_leaves(leaves *work)
{
    const pliant_mesh *mesh = work->system->mesh;
    int32_t at[3], cell = 0;
    for (at[2] = 0; at[2] < mesh->cells[2]; at[2]++)
        for (at[1] = 0; at[1] < mesh->cells[1]; at[1]++)
            for (at[0] = 0; at[0] < mesh->cells[0]; at[0]++, cell++) {
                const int32_t leaf = mesh->leaf_of_cell[cell];
                if (mesh->leaf_start[leaf] == mesh->leaf_start[leaf + 1]) continue;
                if (work->size[leaf] == 0) {
                    memcpy(work->origin[leaf], at, sizeof at);
                    work->count++;
                }
                work->size[leaf] = at[2] - work->origin[leaf][2] + 1;
            }
}

/* every node itself, and what is in the middle of a leaf its corners */
static void find_followers(leaves *work, uint8_t *fixed)
{
    const pliant_mesh *mesh = work->system->mesh;
    pliant_upsample *upsample = work->system->upsample;
    for (int32_t v = 0; v < CORNERS * mesh->num_nodes; v++) {
        upsample->node[v] = v / CORNERS;
        upsample->weights[v] = v % CORNERS == 0;
    }
    for (int32_t leaf = 0; leaf < mesh->num_leaves; leaf++)
        for (int i = 0; work->size[leaf] > 1 && i < 27; i++) {
            const int32_t halves[3] = {i % 3, i / 3 % 3, i / 9}, node = node_of(work, leaf, halves);
            if (node < 0 || (halves[0] != 1 && halves[1] != 1 && halves[2] != 1)) continue;
            work->follows[node] = 1;
            for (int v = 0; v < CORNERS; v++) {
                double weight = 1;
                for (int d = 0; d < 3; d++) weight *= halves[d] == 1 ? 0.5 : halves[d] == 2 * (v >> d & 1);
                upsample->node[CORNERS * node + v] = node_of(work, leaf, (int32_t[3]){2 * (v & 1), 2 * (v >> 1 & 1), 2 * (v >> 2)});
                upsample->weights[CORNERS * node + v] = weight;
            }
        }
    for (int32_t n = 0; n < mesh->num_nodes; n++)
        for (int v = 0; work->follows[n] && fixed[n] && v < CORNERS; v++)
            if (upsample->weights[CORNERS * n + v] > 0) fixed[upsample->node[CORNERS * n + v]] = fixed[n];
    for (int32_t n = 0; n < mesh->num_nodes; n++)
        if (work->follows[n]) fixed[n] = PLIANT_FIXED_AT_REST; /* as far as the solver goes */
}

/* the nodes that a leaf's corners follow, and C */
static void followed(const leaves *work, const int32_t corner[CORNERS], int32_t node[CORNERS], double c[CORNERS][CORNERS])
{
    const pliant_upsample *upsample = work->system->upsample;
    int count = 0;
    memset(c, 0, CORNERS * sizeof *c);
    for (int v = 0; v < CORNERS; v++)
        for (int m = 0; m < CORNERS; m++) {
            const int32_t other = upsample->node[CORNERS * corner[v] + m];
            const double weight = upsample->weights[CORNERS * corner[v] + m];
            int at = 0;
            if (!(weight > 0)) continue;
            while (at < count && node[at] != other) at++;
            if (at == count) node[count++] = other;
            c[v][at] += weight;
        }
}

static const pliant_cube_shape *shape_of(leaves *work, int32_t leaf, const pliant_cube *cube)
{
    const pliant_mesh *mesh = work->system->mesh;
    int level = 0, parity = 0;
    while (1 << level < work->size[leaf]) level++;
    for (int d = 0; d < 3; d++) parity ^= work->origin[leaf][d] / work->size[leaf] & 1;
    pliant_cube_shape *shape = work->shape + 2 * level + parity;
    if (!work->known[level][parity] || mesh->num_moved > 0) pliant_cube_integrate(mesh, cube, parity, shape);
    work->known[level][parity] = true;
    return shape;
}

static pliant_status add_leaf(leaves *work, int32_t leaf, const pliant_tet_material *material, int32_t element)
{
    pliant_macros *macros = work->system->macros;
    const int32_t *start = work->system->mesh->leaf_start + leaf;
    pliant_cube cube;
    double c[CORNERS][CORNERS], k[UNKNOWNS * UNKNOWNS], half[UNKNOWNS * UNKNOWNS] = {0}, whole[UNKNOWNS * UNKNOWNS] = {0}, shear = 0;
    int32_t node[CORNERS];
    for (int v = 0; v < CORNERS; v++) cube.node[v] = node_of(work, leaf, (int32_t[3]){2 * (v & 1), 2 * (v >> 1 & 1), 2 * (v >> 2)});
    for (int slot = 0; slot < 5; slot++) cube.tet[slot] = start[1] - start[0] == 5 ? start[0] + slot : start[0]; /* what is divided is of one material */
    followed(work, cube.node, node, c);
    const pliant_cube_shape *shape = shape_of(work, leaf, &cube);
    const double bulk = pliant_cube_deviatoric(shape, &cube, material, k);
    double *gradient = macros->gradient + UNKNOWNS * (size_t)element;
    for (int i = 0; i < UNKNOWNS; i++)
        for (int j = 0; j < UNKNOWNS; j++) {
            const double value = k[UNKNOWNS * i + j] + bulk * shape->mean[i] * shape->mean[j];
            for (int m = 0; m < CORNERS; m++) half[UNKNOWNS * i + 3 * m + j % 3] += value * c[j / 3][m];
        }
    for (int i = 0; i < UNKNOWNS; i++)
        for (int m = 0; m < CORNERS; m++) {
            gradient[3 * m + i % 3] += c[i / 3][m] * shape->mean[i];
            for (int j = 0; j < UNKNOWNS; j++) whole[UNKNOWNS * (3 * m + i % 3) + j] += c[i / 3][m] * half[UNKNOWNS * i + j];
        }
    for (int slot = 0; slot < 5; slot++) shear += shape->volume[slot] * material[cube.tet[slot]].mu;
    macros->shear[element] = shear;
    memcpy(macros->own + CORNERS * (size_t)element, node, sizeof node);
    memcpy(macros->node + CORNERS * (size_t)element, node, sizeof node);
    macros->start[element + 1] = CORNERS * (element + 1);
    return pliant_macros_keep(macros, element, UNKNOWNS, whole);
}

static pliant_status make_room(leaves *work)
{
    pliant_system *system = work->system;
    const size_t num_leaves = (size_t)system->mesh->num_leaves, nodes = (size_t)system->mesh->num_nodes;
    pliant_upsample *upsample = system->upsample = pliant_calloc(1, sizeof *upsample);
    bool good = upsample && (work->origin = pliant_calloc(num_leaves, sizeof *work->origin)) && (work->size = pliant_calloc(num_leaves, sizeof *work->size)) &&
                (work->follows = pliant_calloc(nodes, 1)) && (work->shape = pliant_calloc(2 * (PLIANT_MAX_DEPTH + 1), sizeof *work->shape)) &&
                (upsample->node = pliant_calloc(nodes, CORNERS * sizeof *upsample->node)) &&
                (upsample->weights = pliant_calloc(nodes, CORNERS * sizeof *upsample->weights)) && (system->macros = pliant_calloc(1, sizeof *system->macros));
    if (!good) return pliant_fail_memory("the hexahedra");
    upsample->corners = CORNERS;
    find_leaves(work);
    return pliant_macros_allocate(system->macros, (size_t)work->count, CORNERS * (size_t)work->count);
}

pliant_status pliant_system_octree_hexahedra(pliant_system *system, const pliant_tet_material *material, uint8_t *fixed)
{
    leaves work = {.system = system};
    int32_t element = 0;
    pliant_status status = make_room(&work);
    if (status == PLIANT_OK) find_followers(&work, fixed);
    for (int32_t leaf = 0; status == PLIANT_OK && leaf < system->mesh->num_leaves; leaf++)
        if (work.size[leaf] > 0) status = add_leaf(&work, leaf, material, element++);
    const int32_t corners = CORNERS * element;
    system->num_blocks = (corners + 4 * LANES - 1) / (4 * LANES); /* as in hexahedra.c */
    pliant_free(work.origin);
    pliant_free(work.size);
    pliant_free(work.follows);
    pliant_free(work.shape);
    return status;
}
