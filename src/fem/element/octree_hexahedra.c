/* Hexahedra on the leaves of an octree. A node in the middle of a larger leaf's edge or face follows that leaf's
 * corners (Hughes, The Finite Element Method, 3.A). Displacements u = C u_m are then equal on both sides. An element
 * with such corners has C'KC on the followed nodes.
 *
 * There are again eight followed nodes. A following corner is a middle of the parent cube, which has twice the leaf's
 * size. It follows the parent's corners on this edge or face, one of which is the leaf's opposite corner. No followed
 * node is a follower itself: the sibling leaf with this corner would then share an edge with a leaf of four times its
 * size.
 *
 * Leaves divided by a cut are tetrahedra, whose corners follow no nodes. Larger leaves with such a corner in the middle
 * of an edge or face are tetrahedra as well, and so are leaves whose followers would follow duplicated nodes. */
#include "base/fail.h"
#include "fem/element/hexahedra.h"
#include "mesh/octree.h"
#include "base/memory.h"

#include <string.h>

enum { CORNERS = 8, UNKNOWNS = 24, PLACES = 27 };

typedef struct leaves {
    const pliant_mesh *mesh;
    pliant_system *system;
    pliant_upsample *upsample; /* what every node follows */
    int32_t (*origin)[3];     /* (num_leaves) in smallest cells */
    int32_t *size;            /* (num_leaves) in smallest cells; 0: no tissue */
    int32_t *first, *next;    /* (num_leaves) list of tetrahedra: 1 + the first one; next (tetrahedra) */
    int32_t (*node)[PLACES];  /* (num_leaves) nodes at its corners, middles and centre, x fastest; -1: none */
    uint8_t *whole;           /* (num_leaves) nonzero: it is a hexahedron */
    uint8_t *follows, *of_tet; /* (nodes) nonzero: it follows others; a tetrahedron has it */
    bool changed;
    pliant_cube_shape *shape; /* (PLIANT_MAX_DEPTH + 1) x 2, by size and parity */
    bool known[PLIANT_MAX_DEPTH + 1][2];
    const pliant_macros *earlier; /* Nullable: from before the cut */
    const uint8_t *kept;      /* (tetrahedra) */
    int32_t *element;         /* (num_leaves) 1 + its earlier hexahedron; 0: none */
} leaves;

static int place_of_corner(int v) { return 2 * (v & 1) + 6 * (v >> 1 & 1) + 18 * (v >> 2); }

static void find_leaves(leaves *work)
{
    const pliant_mesh *mesh = work->mesh;
    int32_t at[3], cell = 0;
    for (at[2] = 0; at[2] < mesh->cells[2]; at[2]++)
        for (at[1] = 0; at[1] < mesh->cells[1]; at[1]++)
            for (at[0] = 0; at[0] < mesh->cells[0]; at[0]++, cell++) {
                const int32_t leaf = mesh->leaf_of_cell[cell];
                if (mesh->leaf_start[leaf] == mesh->leaf_start[leaf + 1]) continue;
                if (work->size[leaf] == 0) memcpy(work->origin[leaf], at, sizeof at);
                work->size[leaf] = at[2] - work->origin[leaf][2] + 1;
            }
    for (int32_t t = mesh->num_tets - 1; t >= 0; t--) {
        const int32_t leaf = pliant_cell_of_tet(mesh, t);
        work->next[t] = work->first[leaf] - 1;
        work->first[leaf] = t + 1;
    }
}

/* Find the nodes of a leaf by position. Return false if a cut has added a tetrahedron to the leaf or duplicated a
 * node. */
static bool find_places(leaves *work, int32_t leaf)
{
    const pliant_mesh *mesh = work->mesh;
    const int32_t nx = mesh->cells[0] + 1, ny = mesh->cells[1] + 1;
    int32_t *node = work->node[leaf], tets = 0;
    bool whole = true;
    memset(node, 0xff, sizeof work->node[leaf]);
    for (int32_t t = work->first[leaf] - 1; t >= 0; t = work->next[t], tets++)
        for (int v = 0; v < 4; v++) {
            const int32_t other = mesh->tets[4 * t + v], at = mesh->lattice_of_node[other],
                          along[3] = {at % nx, at / nx % ny, at / nx / ny};
            int place = 0;
            for (int d = 2; d >= 0; d--) place = 3 * place + 2 * (along[d] - work->origin[leaf][d]) / work->size[leaf];
            whole = whole && (node[place] < 0 || node[place] == other);
            node[place] = other;
        }
    return whole && tets == mesh->leaf_start[leaf + 1] - mesh->leaf_start[leaf];
}

/* ---- Followers. */

/* Compute the trilinear weights of a position in the leaf, and the leaf's corner nodes. */
static void follow_corners(const leaves *work, int32_t leaf, int place, int32_t node[CORNERS], double weight[CORNERS])
{
    const int32_t halves[3] = {place % 3, place / 3 % 3, place / 9};
    for (int v = 0; v < CORNERS; v++) {
        node[v] = work->node[leaf][place_of_corner(v)];
        weight[v] = 1;
        for (int d = 0; d < 3; d++) weight[v] *= halves[d] == 1 ? 0.5 : halves[d] == 2 * (v >> d & 1);
    }
}

static bool follow_alike(const leaves *work, int32_t follower, const int32_t node[CORNERS],
                         const double weight[CORNERS])
{
    const pliant_upsample *upsample = work->upsample;
    for (int v = 0; v < CORNERS; v++) {
        double other = 0;
        for (int m = 0; m < CORNERS; m++)
            if (upsample->node[CORNERS * follower + m] == node[v]) other += upsample->weights[CORNERS * follower + m];
        if (weight[v] > 0 && other != weight[v]) return false;
    }
    return true;
}

static void divide(leaves *work, int32_t leaf)
{
    work->whole[leaf] = 0;
    work->changed = true;
}

/* Make every node follow itself, and nodes in the middle of a hexahedron's edges and faces follow its corners. */
static void find_followers(leaves *work)
{
    const pliant_mesh *mesh = work->mesh;
    pliant_upsample *upsample = work->upsample;
    for (int32_t v = 0; v < CORNERS * mesh->num_nodes; v++) {
        upsample->node[v] = v / CORNERS;
        upsample->weights[v] = v % CORNERS == 0;
    }
    memset(work->follows, 0, (size_t)mesh->num_nodes);
    for (int32_t leaf = 0; leaf < mesh->num_leaves; leaf++)
        for (int place = 0; work->whole[leaf] && place < PLACES; place++) {
            const int32_t follower = work->node[leaf][place];
            int32_t node[CORNERS];
            double weight[CORNERS];
            if (follower < 0 || (place % 3 != 1 && place / 3 % 3 != 1 && place / 9 != 1)) continue;
            follow_corners(work, leaf, place, node, weight);
            if (work->of_tet[follower] || (work->follows[follower] && !follow_alike(work, follower, node, weight))) {
                divide(work, leaf);
                continue;
            }
            work->follows[follower] = 1;
            memcpy(upsample->node + CORNERS * (size_t)follower, node, sizeof node);
            memcpy(upsample->weights + CORNERS * (size_t)follower, weight, sizeof weight);
        }
}

/* List the nodes that a leaf's corners follow, and C. Return their number. More than eight means that a cut has
 * duplicated nodes. */
static int followed(const leaves *work, int32_t leaf, int32_t node[CORNERS], double c[CORNERS][CORNERS])
{
    const pliant_upsample *upsample = work->upsample;
    int count = 0;
    memset(c, 0, CORNERS * sizeof *c);
    for (int v = 0; v < CORNERS; v++)
        for (int m = 0; m < CORNERS; m++) {
            const size_t entry = CORNERS * (size_t)work->node[leaf][place_of_corner(v)] + (size_t)m;
            const int32_t other = upsample->node[entry];
            int at = 0;
            if (!(upsample->weights[entry] > 0)) continue;
            while (at < count && node[at] != other) at++;
            if (at == CORNERS) return CORNERS + 1;
            if (at == count) node[count++] = other;
            c[v][at] += upsample->weights[entry];
        }
    return count;
}

/* Choose the leaves that are hexahedra; repeat until no further leaf is divided. */
static void choose(leaves *work)
{
    const pliant_mesh *mesh = work->mesh;
    do {
        work->changed = false;
        for (int32_t leaf = 0; leaf < mesh->num_leaves; leaf++)
            for (int32_t t = work->first[leaf] - 1; !work->whole[leaf] && t >= 0; t = work->next[t])
                for (int v = 0; v < 4; v++) work->of_tet[mesh->tets[4 * t + v]] = 1;
        find_followers(work);
        for (int32_t leaf = 0; leaf < mesh->num_leaves; leaf++) {
            int32_t node[CORNERS];
            double c[CORNERS][CORNERS];
            if (work->whole[leaf] && followed(work, leaf, node, c) != CORNERS) divide(work, leaf);
        }
    } while (work->changed);
}

static void hold_followers(const leaves *work, uint8_t *fixed)
{
    const pliant_mesh *mesh = work->mesh;
    const pliant_upsample *upsample = work->upsample;
    for (int32_t n = 0; n < mesh->num_nodes; n++)
        for (int v = 0; work->follows[n] && fixed[n] && v < CORNERS; v++)
            if (upsample->weights[CORNERS * n + v] > 0) fixed[upsample->node[CORNERS * n + v]] = fixed[n];
    for (int32_t n = 0; n < mesh->num_nodes; n++)
        if (work->follows[n]) fixed[n] = PLIANT_FIXED_AT_REST; /* this affects the solver only */
}

/* ---- Elements. */

static const pliant_cube_shape *shape_of(leaves *work, int32_t leaf, const pliant_cube *cube)
{
    const pliant_mesh *mesh = work->mesh;
    int level = 0, parity = 0;
    while (1 << level < work->size[leaf]) level++;
    for (int d = 0; d < 3; d++) parity ^= work->origin[leaf][d] / work->size[leaf] & 1;
    pliant_cube_shape *shape = work->shape + 2 * level + parity;
    if (!work->known[level][parity] || mesh->num_moved > 0) pliant_cube_integrate(mesh, cube, parity, shape);
    work->known[level][parity] = true;
    return shape;
}

/* Return the earlier element of a leaf with the same tetrahedra and the same followed nodes; -1: the leaf has
 * changed. */
static int32_t find_earlier(const leaves *work, int32_t leaf, const int32_t node[CORNERS])
{
    const int32_t was = work->earlier ? work->element[leaf] - 1 : -1;
    bool same = was >= 0 && memcmp(work->earlier->own + CORNERS * (size_t)was, node, CORNERS * sizeof *node) == 0;
    for (int32_t t = work->first[leaf] - 1; same && t >= 0; t = work->next[t]) same = work->kept[t];
    return same ? was : -1;
}

/* Compute C'KC of a leaf, and C' times its mean gradient. law: Nullable. */
static void condense(leaves *work, int32_t leaf, const pliant_tet_material *material,
                     const pliant_tet_material *complete, double c[CORNERS][CORNERS], double *shear, double *gradient,
                     pliant_macro_law *law, double *out)
{
    const int32_t *start = work->mesh->leaf_start + leaf;
    pliant_cube cube = {.part = false};
    double k[UNKNOWNS * UNKNOWNS], half[UNKNOWNS * UNKNOWNS] = {0};
    for (int v = 0; v < CORNERS; v++) cube.node[v] = work->node[leaf][place_of_corner(v)];
    /* A divided leaf has one material. */
    for (int slot = 0; slot < 5; slot++) cube.tet[slot] = start[1] - start[0] == 5 ? start[0] + slot : start[0];
    const pliant_cube_shape *shape = shape_of(work, leaf, &cube);
    const double missing = pliant_cube_missing_lambda(&cube, shape->volume, material, complete);
    const double bulk = pliant_cube_deviatoric(shape, &cube, material, missing, k);
    memset(out, 0, UNKNOWNS * UNKNOWNS * sizeof *out);
    for (int i = 0; i < UNKNOWNS; i++)
        for (int j = 0; j < UNKNOWNS; j++) {
            const double value = k[UNKNOWNS * i + j] + bulk * shape->mean[i] * shape->mean[j];
            for (int m = 0; m < CORNERS; m++) half[UNKNOWNS * i + 3 * m + j % 3] += value * c[j / 3][m];
        }
    for (int i = 0; i < UNKNOWNS; i++)
        for (int m = 0; m < CORNERS; m++) {
            gradient[3 * m + i % 3] += c[i / 3][m] * shape->mean[i];
            for (int j = 0; j < UNKNOWNS; j++)
                out[UNKNOWNS * (3 * m + i % 3) + j] += c[i / 3][m] * half[UNKNOWNS * i + j];
        }
    if (law) pliant_cube_law(&cube, shape->volume, material, law);
    *shear = 0;
    for (int slot = 0; slot < 5; slot++) *shear += shape->volume[slot] * material[cube.tet[slot]].mu;
}

static pliant_status add_leaf(leaves *work, int32_t leaf, const pliant_tet_material *material,
                              const pliant_tet_material *complete, int32_t element)
{
    pliant_macros *macros = work->system->macros;
    double c[CORNERS][CORNERS], k[UNKNOWNS * UNKNOWNS], *gradient = macros->gradient + UNKNOWNS * (size_t)element;
    int32_t node[CORNERS], begin = macros->start[element];
    followed(work, leaf, node, c);
    memcpy(macros->own + CORNERS * (size_t)element, node, sizeof node);
    memcpy(macros->node + begin, node, sizeof node);
    macros->start[element + 1] = begin + CORNERS;
    macros->cell[element] = leaf;
    const int32_t was = find_earlier(work, leaf, node);
    if (was >= 0) {
        memcpy(gradient, work->earlier->gradient + UNKNOWNS * (size_t)was, UNKNOWNS * sizeof *gradient);
        macros->shear[element] = work->earlier->shear[was];
        if (macros->law) macros->law[element] = work->earlier->law[was];
        pliant_macros_share_root(work->earlier, was, macros, element);
        return PLIANT_OK;
    }
    condense(work, leaf, material, complete, c, &macros->shear[element], gradient,
             macros->law ? macros->law + element : NULL, k);
    return pliant_macros_keep(macros, element, UNKNOWNS, k);
}

static pliant_status add_all(leaves *work, const pliant_tet_material *material, const pliant_tet_material *complete)
{
    const pliant_mesh *mesh = work->mesh;
    pliant_macros *macros = work->system->macros;
    pliant_status status = PLIANT_OK;
    int32_t element = 0;
    for (int32_t leaf = 0; status == PLIANT_OK && leaf < mesh->num_leaves; leaf++) {
        if (work->whole[leaf]) status = add_leaf(work, leaf, material, complete, element++);
        for (int32_t t = work->first[leaf] - 1; status == PLIANT_OK && !work->whole[leaf] && t >= 0;
             t = work->next[t]) {
            memcpy(macros->node + macros->start[element], mesh->tets + 4 * t, 4 * sizeof *mesh->tets);
            macros->start[element + 1] = macros->start[element] + 4;
            macros->cell[element] = leaf;
            status = pliant_macros_add_tet(mesh, material, t, macros, element++);
        }
    }
    return status;
}

static pliant_status begin(leaves *work)
{
    const size_t num_leaves = (size_t)work->mesh->num_leaves;
    bool good = (work->origin = pliant_calloc(num_leaves, sizeof *work->origin)) &&
                (work->size = pliant_calloc(num_leaves, sizeof *work->size)) &&
                (work->first = pliant_calloc(num_leaves, sizeof *work->first)) &&
                (work->next = pliant_calloc((size_t)work->mesh->num_tets, sizeof *work->next)) &&
                (work->node = pliant_calloc(num_leaves, sizeof *work->node)) &&
                (work->whole = pliant_calloc(num_leaves, 1));
    if (!good) return pliant_fail_memory("the hexahedra");
    find_leaves(work);
    for (int32_t leaf = 0; leaf < work->mesh->num_leaves; leaf++)
        work->whole[leaf] = work->size[leaf] > 0 && find_places(work, leaf);
    return PLIANT_OK;
}

static void end(leaves *work)
{
    void *blocks[] = {work->origin, work->size,    work->first,  work->next,  work->node,
                      work->whole,  work->follows, work->of_tet, work->shape, work->element};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
}

/* Allocate the arrays for `choose`. */
static pliant_status reserve_followers(leaves *work, pliant_upsample *upsample)
{
    const size_t nodes = (size_t)work->mesh->num_nodes;
    work->upsample = upsample;
    bool good = (work->follows = pliant_calloc(nodes, 1)) && (work->of_tet = pliant_calloc(nodes, 1)) &&
                (upsample->node = pliant_calloc(nodes, CORNERS * sizeof *upsample->node)) &&
                (upsample->weights = pliant_calloc(nodes, CORNERS * sizeof *upsample->weights));
    upsample->corners = CORNERS;
    return good ? PLIANT_OK : pliant_fail_memory("the hexahedra");
}

static pliant_status reserve_capacity(leaves *work)
{
    pliant_system *system = work->system;
    bool good = (system->upsample = pliant_calloc(1, sizeof *system->upsample)) &&
                (work->shape = pliant_calloc(2 * (PLIANT_MAX_DEPTH + 1), sizeof *work->shape)) &&
                (work->element = pliant_calloc((size_t)work->mesh->num_leaves, sizeof *work->element)) &&
                (system->macros = pliant_calloc(1, sizeof *system->macros));
    return good ? reserve_followers(work, system->upsample) : pliant_fail_memory("the hexahedra");
}

static pliant_status allocate_elements(leaves *work)
{
    size_t count = 0, corners = 0;
    for (int32_t leaf = 0; leaf < work->mesh->num_leaves; leaf++) {
        count += work->whole[leaf];
        corners += work->whole[leaf] ? CORNERS : 0;
        for (int32_t t = work->first[leaf] - 1; !work->whole[leaf] && t >= 0; t = work->next[t]) count++, corners += 4;
    }
    work->system->num_blocks = pliant_macros_blocks(count, corners);
    for (int32_t e = 0; work->earlier && e < work->earlier->count; e++)
        if (work->earlier->start[e + 1] - work->earlier->start[e] == CORNERS)
            work->element[work->earlier->cell[e]] = e + 1;
    const pliant_status status = pliant_macros_allocate(work->system->macros, count, corners);
    return status == PLIANT_OK ? pliant_macros_allocate_law(work->system->macros, work->system->law) : status;
}

pliant_status pliant_system_octree_hexahedra(pliant_system *system, const pliant_tet_material *material,
                                             const pliant_tet_material *complete, const pliant_system *before,
                                             const uint8_t *kept, uint8_t *fixed)
{
    leaves work = {
        .mesh = system->mesh, .system = system, .earlier = before && kept ? before->macros : NULL, .kept = kept};
    pliant_status status = begin(&work);
    if (status == PLIANT_OK) status = reserve_capacity(&work);
    if (status == PLIANT_OK) {
        choose(&work);
        hold_followers(&work, fixed);
        status = allocate_elements(&work);
    }
    if (status == PLIANT_OK) status = add_all(&work, material, complete);
    end(&work);
    return status;
}

pliant_status pliant_octree_cubes_find(const pliant_mesh *mesh, pliant_cube **out, int32_t **size, int32_t *count)
{
    leaves work = {.mesh = mesh};
    *count = 0;
    *out = pliant_calloc((size_t)mesh->num_leaves, sizeof **out);
    *size = pliant_calloc((size_t)mesh->num_leaves, sizeof **size);
    pliant_status status = *out && *size ? begin(&work) : pliant_fail_memory("the hexahedra");
    for (int32_t leaf = 0; status == PLIANT_OK && leaf < mesh->num_leaves; leaf++) {
        pliant_cube *cube = *out + *count;
        if (!work.whole[leaf] || mesh->leaf_start[leaf + 1] - mesh->leaf_start[leaf] != 5) continue;
        for (int v = 0; v < CORNERS; v++) cube->node[v] = work.node[leaf][place_of_corner(v)];
        for (int slot = 0; slot < 5; slot++) cube->tet[slot] = mesh->leaf_start[leaf] + slot;
        (*size)[*count] = work.size[leaf];
        *count += pliant_cube_is_box(mesh, cube, work.size[leaf]);
    }
    end(&work);
    return status;
}

pliant_status pliant_octree_corners_find(const pliant_mesh *mesh, int32_t (**out)[8])
{
    leaves work = {.mesh = mesh};
    pliant_upsample upsample = {0};
    *out = pliant_calloc((size_t)mesh->num_leaves, sizeof **out);
    pliant_status status = *out ? begin(&work) : pliant_fail_memory("the hexahedra");
    if (status == PLIANT_OK) status = reserve_followers(&work, &upsample);
    if (status == PLIANT_OK) choose(&work);
    for (int32_t leaf = 0; status == PLIANT_OK && leaf < mesh->num_leaves; leaf++)
        for (int v = 0; v < CORNERS; v++) (*out)[leaf][v] = work.whole[leaf] ? work.node[leaf][place_of_corner(v)] : -1;
    pliant_free(upsample.node);
    pliant_free(upsample.weights);
    end(&work);
    if (status == PLIANT_OK) return PLIANT_OK;
    pliant_free(*out);
    *out = NULL;
    return status;
}
