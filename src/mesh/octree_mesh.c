/* Tetrahedra of an octree's leaves.
 *
 * A leaf without smaller neighbours is cut into five tetrahedra, like the cubes of a lattice of its size. The diagonal
 * of a face joins the two corners whose coordinates, in units of the leaf, have an even sum. A leaf with smaller
 * neighbours gets a node at its centre, which is joined to the triangles of its faces. A face with a node in its middle
 * or on an edge (a corner of a smaller leaf) gets a node in its middle, which is joined to the pieces of its edges. All
 * other faces are cut along the same diagonal as above.
 *
 * The cut of a face depends only on nodes on the face, so both sides are cut equally. The diagonals of four smaller
 * faces meet in the middle, where coordinates in units of the smaller leaf have an even sum. With neighbours balanced
 * across edges, none of them is divided further. */
#include "base/buffer.h"
#include "base/fail.h"
#include "mesh/mesh.h"
#include "mesh/octree.h"
#include "base/memory.h"

#include <string.h>

typedef struct octree_builder {
    const pliant_octree *tree;
    const pliant_tet_material *cell_material; /* (5 * smallest cells) */
    bool keep_air, hexahedra, flipped;
    uint8_t *kept;            /* (leaves) */
    pliant_tet_material *leaf_material;       /* (leaves) */
    uint8_t *corner;          /* (lattice nodes) a corner of a kept leaf */
    pliant_mesh *mesh;
    int32_t capacity;
    pliant_tet_material *materials;           /* (capacity) */
    bool failed;              /* out of memory */
} octree_builder;

static int32_t size_of(const pliant_octree *tree, int32_t leaf) { return 1 << (tree->depth - tree->level[leaf]); }

static int32_t node_at(const pliant_octree *tree, const int32_t at[3])
{
    return pliant_octree_node(tree->cells[tree->depth], at);
}

/* Average the material over the smallest cells' tetrahedra in a leaf, weighted by their voxels. */
static void sum_leaf(octree_builder *build, int32_t leaf)
{
    const pliant_octree *tree = build->tree;
    const int32_t *origin = tree->origin[leaf], size = size_of(tree, leaf);
    pliant_tet_material sum = {0}, any = build->cell_material[5 * pliant_octree_flat(tree, tree->depth, origin)];
    double weight = 0, tissue = 0;
    uint32_t maximum = 0;
    for (int32_t c = origin[2]; c < origin[2] + size; c++)
        for (int32_t b = origin[1]; b < origin[1] + size; b++)
            for (int32_t a = origin[0]; a < origin[0] + size; a++)
                for (int slot = 0; slot < 5; slot++) {
                    const pliant_tet_material *part =
                        build->cell_material + 5 * pliant_octree_flat(tree, tree->depth, (int32_t[3]){a, b, c}) + slot;
                    double voxels = part->num_voxels;
                    sum.lambda += voxels * part->lambda;
                    sum.mu += voxels * part->mu;
                    sum.density += voxels * part->density;
                    tissue += voxels * part->tissue;
                    sum.num_voxels += part->num_voxels;
                    weight += voxels;
                    /* In a pure leaf nearly all are equal. */
                    if (part->num_voxels > maximum) {
                        maximum = part->num_voxels;
                        sum.material = part->material;
                    }
                }
    build->leaf_material[leaf] = any;
    if (!(weight > 0)) return;
    sum.lambda /= weight;
    sum.mu /= weight;
    sum.density /= weight;
    sum.tissue = (float)(tissue / weight);
    build->leaf_material[leaf] = sum;
}

static void choose_leaves(octree_builder *build)
{
    const pliant_octree *tree = build->tree;
    for (int32_t leaf = 0; leaf < tree->num_leaves; leaf++) {
        int32_t size = size_of(tree, leaf);
        sum_leaf(build, leaf);
        build->kept[leaf] = build->keep_air || build->leaf_material[leaf].tissue > 0;
        const pliant_tet_material *own =
            build->cell_material + 5 * pliant_octree_flat(tree, tree->depth, tree->origin[leaf]);
        for (int slot = 0; size == 1 && slot < 5; slot++) build->kept[leaf] |= own[slot].tissue > 0;
        for (int n = 0; build->kept[leaf] && n < 8; n++) {
            int32_t at[3];
            for (int d = 0; d < 3; d++) at[d] = tree->origin[leaf][d] + (n >> d & 1) * size;
            build->corner[node_at(tree, at)] = 1;
        }
    }
}

static void add_tet(octree_builder *build, int32_t corners[4][3], const pliant_tet_material *material)
{
    pliant_mesh *mesh = build->mesh;
    if (mesh->num_tets == build->capacity && !build->failed) {
        int32_t capacity = build->capacity ? 2 * build->capacity : 4096;
        build->failed = !pliant_grow(&mesh->tets, (size_t)capacity, 4 * sizeof *mesh->tets) ||
                        !pliant_grow(&build->materials, (size_t)capacity, sizeof *build->materials);
        if (!build->failed) build->capacity = capacity;
    }
    if (build->failed) return;
    int64_t e[3][3];
    for (int v = 0; v < 3; v++)
        for (int d = 0; d < 3; d++) e[v][d] = corners[v + 1][d] - corners[0][d];
    int64_t determinant = e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) -
                          e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
                          e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0]);
    bool swap = (determinant < 0) != build->flipped;
    int32_t *tet = mesh->tets + 4 * (size_t)mesh->num_tets;
    for (int v = 0; v < 4; v++) tet[v] = node_at(build->tree, corners[swap && v >= 2 ? 5 - v : v]);
    build->materials[mesh->num_tets++] = *material;
}

/* Return the lattice position of a corner (bits), middle (1 of 0..2 steps of half a leaf) or centre of a leaf. */
static void place(const pliant_octree *tree, int32_t leaf, const int32_t halves[3], int32_t out[3])
{
    for (int d = 0; d < 3; d++) out[d] = tree->origin[leaf][d] + halves[d] * size_of(tree, leaf) / 2;
}

static bool has_corner(const octree_builder *build, int32_t leaf, const int32_t halves[3])
{
    int32_t at[3];
    place(build->tree, leaf, halves, at);
    return build->corner[node_at(build->tree, at)];
}

static bool has_smaller_neighbour(const octree_builder *build, int32_t leaf)
{
    if (size_of(build->tree, leaf) == 1) return false;
    for (int n = 0; n < 27; n++) {
        int32_t halves[3] = {n % 3, n / 3 % 3, n / 9};
        int middle = (halves[0] == 1) + (halves[1] == 1) + (halves[2] == 1);
        if ((middle == 1 || middle == 2) && has_corner(build, leaf, halves)) return true;
    }
    return false;
}

static void cut_in_five(octree_builder *build, int32_t leaf)
{
    const pliant_octree *tree = build->tree;
    int32_t size = size_of(tree, leaf), parity = 0;
    for (int d = 0; d < 3; d++) parity ^= tree->origin[leaf][d] / size & 1;
    const pliant_tet_material *own =
        build->cell_material + 5 * pliant_octree_flat(tree, tree->depth, tree->origin[leaf]);
    for (int slot = 0; slot < 5; slot++) {
        if (size == 1 && !build->keep_air && !build->hexahedra && !(own[slot].tissue > 0)) continue;
        int bits[4];
        int32_t corners[4][3];
        pliant_mesh_slot_corners(parity, slot, bits);
        for (int v = 0; v < 4; v++)
            for (int d = 0; d < 3; d++) corners[v][d] = tree->origin[leaf][d] + (bits[v] >> d & 1) * size;
        add_tet(build, corners, size == 1 ? own + slot : build->leaf_material + leaf);
    }
}

/* Join a triangle of a face, in steps of half a leaf, to the centre. */
static void add_cone(octree_builder *build, int32_t leaf, int32_t halves[3][3])
{
    int32_t corners[4][3];
    place(build->tree, leaf, (const int32_t[3]){1, 1, 1}, corners[0]);
    for (int v = 0; v < 3; v++) place(build->tree, leaf, halves[v], corners[v + 1]);
    add_tet(build, corners, build->leaf_material + leaf);
}

static void cut_face(octree_builder *build, int32_t leaf, int axis, int side)
{
    static const int32_t around[8][2] = {{0, 0}, {1, 0}, {2, 0}, {2, 1}, {2, 2}, {1, 2}, {0, 2}, {0, 1}};
    const pliant_octree *tree = build->tree;
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    int32_t ring[8][3], middle[3], size = size_of(tree, leaf);
    int count = 0, corners = 0;
    for (int n = 0; n < 8; n++) {
        ring[count][axis] = 2 * side;
        ring[count][u] = around[n][0];
        ring[count][v] = around[n][1];
        bool corner = n % 2 == 0;
        if (!corner && !has_corner(build, leaf, ring[count])) continue;
        corners += corner;
        count++;
    }
    middle[axis] = 2 * side;
    middle[u] = middle[v] = 1;
    if (count > corners || has_corner(build, leaf, middle)) {
        for (int n = 0; n < count; n++) {
            int32_t triangle[3][3];
            memcpy(triangle[0], middle, sizeof middle);
            memcpy(triangle[1], ring[n], sizeof middle);
            memcpy(triangle[2], ring[(n + 1) % count], sizeof middle);
            add_cone(build, leaf, triangle);
        }
        return;
    }
    int32_t first = 0; /* a corner of the ring whose coordinates have an even sum */
    for (int d = 0; d < 3; d++) first += tree->origin[leaf][d] / size + ring[0][d] / 2;
    first &= 1;
    for (int half = 0; half < 2; half++) {
        int32_t triangle[3][3];
        for (int n = 0; n < 3; n++) memcpy(triangle[n], ring[(first + 2 * half + n) % 4], sizeof middle);
        add_cone(build, leaf, triangle);
    }
}

static pliant_status cut_leaves(octree_builder *build)
{
    const pliant_octree *tree = build->tree;
    pliant_mesh *mesh = build->mesh;
    mesh->leaf_start = pliant_calloc((size_t)tree->num_leaves + 1, sizeof *mesh->leaf_start);
    if (!mesh->leaf_start) return pliant_fail_memory("the leaves");
    for (int32_t leaf = 0; leaf < tree->num_leaves; leaf++) {
        if (build->kept[leaf]) {
            if (!has_smaller_neighbour(build, leaf)) cut_in_five(build, leaf);
            else
                for (int face = 0; face < 6; face++) cut_face(build, leaf, face / 2, face % 2);
        }
        mesh->leaf_start[leaf + 1] = mesh->num_tets;
    }
    if (build->failed) return pliant_fail_memory("the tetrahedra");
    if (mesh->num_tets == 0)
        return pliant_fail(PLIANT_ERROR_SCENE,
                           "the mesh has no tetrahedra: no voxel of the scan has a tissue of these materials");
    return PLIANT_OK;
}

/* Number the nodes in lattice order, and compute positions. */
static pliant_status number_nodes(pliant_mesh *mesh)
{
    size_t lattice = (size_t)(mesh->cells[0] + 1) * (size_t)(mesh->cells[1] + 1) * (size_t)(mesh->cells[2] + 1);
    int32_t count = 0, nx = mesh->cells[0] + 1, ny = mesh->cells[1] + 1;
    mesh->node_of_lattice = pliant_calloc(lattice, sizeof *mesh->node_of_lattice);
    if (!mesh->node_of_lattice) return pliant_fail_memory("the nodes");
    for (int32_t v = 0; v < 4 * mesh->num_tets; v++) mesh->node_of_lattice[mesh->tets[v]] = 1;
    for (size_t n = 0; n < lattice; n++) mesh->node_of_lattice[n] = mesh->node_of_lattice[n] ? count++ : -1;
    mesh->num_nodes = count;
    mesh->rest = pliant_calloc((size_t)count, 3 * sizeof *mesh->rest);
    mesh->lattice_of_node = pliant_calloc((size_t)count, sizeof *mesh->lattice_of_node);
    if (!mesh->rest || !mesh->lattice_of_node) return pliant_fail_memory("the nodes");
    for (int32_t v = 0; v < 4 * mesh->num_tets; v++) mesh->tets[v] = mesh->node_of_lattice[mesh->tets[v]];
    for (size_t n = 0; n < lattice; n++) {
        int32_t node = mesh->node_of_lattice[n], at = (int32_t)n;
        if (node < 0) continue;
        mesh->lattice_of_node[node] = at;
        double along[3] = {at % nx * mesh->cell_size[0], at / nx % ny * mesh->cell_size[1],
                           at / nx / ny * mesh->cell_size[2]};
        for (int r = 0; r < 3; r++) {
            mesh->rest[3 * node + r] = mesh->corner[r];
            for (int d = 0; d < 3; d++) mesh->rest[3 * node + r] += mesh->direction[3 * r + d] * along[d];
        }
    }
    return PLIANT_OK;
}

static pliant_status check(const int32_t roots[3], int32_t depth)
{
    double cells = 1;
    if (depth < 0 || depth > PLIANT_MAX_DEPTH)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "an octree's depth is 0 to %d, not %d", PLIANT_MAX_DEPTH, depth);
    for (int d = 0; d < 3; d++) {
        if (roots[d] < 1)
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "a mesh needs at least one cell along each axis, not %d",
                               roots[d]);
        cells *= (double)roots[d] * (1 << depth);
    }
    if (cells > 4e7)
        return pliant_fail(PLIANT_ERROR_SCENE, "mesh/coarse_cells halved %d times are %.3g cells: at most 4e7", depth,
                           cells);
    return PLIANT_OK;
}

pliant_status pliant_mesh_octree(const pliant_geometry *geometry, const int32_t roots[3], int32_t depth, double purity,
                                 bool keep_air, bool hexahedra, const uint8_t *material_of_voxel,
                                 const pliant_material_table *table, pliant_mesh *out, pliant_tet_material **materials)
{
    pliant_status status = check(roots, depth);
    if (status != PLIANT_OK) return status;
    pliant_octree tree = {0};
    pliant_mesh mesh = {0};
    pliant_tet_material *cells = NULL;
    const double *m = geometry->direction;
    double handed =
        m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) + m[2] * (m[3] * m[7] - m[4] * m[6]);
    octree_builder build = {
        .tree = &tree, .keep_air = keep_air, .hexahedra = hexahedra, .flipped = handed < 0, .mesh = &mesh};
    if ((status = pliant_octree_create(roots, depth, purity, geometry, material_of_voxel, &tree)) != PLIANT_OK)
        goto done;
    for (int d = 0; d < 3; d++) {
        mesh.cells[d] = tree.cells[depth][d];
        mesh.cell_size[d] = geometry->size[d] * geometry->spacing[d] / mesh.cells[d];
    }
    memcpy(mesh.direction, geometry->direction, sizeof mesh.direction);
    pliant_geometry_to_world(geometry, (const double[3]){-0.5, -0.5, -0.5}, mesh.corner);
    size_t lattice = (size_t)(mesh.cells[0] + 1) * (size_t)(mesh.cells[1] + 1) * (size_t)(mesh.cells[2] + 1);
    build.cell_material = cells = pliant_calloc(5 * pliant_octree_count(&tree, depth), sizeof *cells);
    build.kept = pliant_calloc((size_t)tree.num_leaves, 1);
    build.leaf_material = pliant_calloc((size_t)tree.num_leaves, sizeof *build.leaf_material);
    build.corner = pliant_calloc(lattice, 1);
    status = cells && build.kept && build.leaf_material && build.corner
                 ? pliant_lattice_integrate(geometry, mesh.cells, material_of_voxel, table, cells)
                 : pliant_fail_memory("the octree");
    if (status != PLIANT_OK) goto done;
    choose_leaves(&build);
    if ((status = cut_leaves(&build)) != PLIANT_OK) goto done;
    status = number_nodes(&mesh);
done:
    if (status == PLIANT_OK) {
        mesh.num_leaves = tree.num_leaves;
        mesh.leaf_of_cell = tree.leaf_of_cell;
        tree.leaf_of_cell = NULL;
        *out = mesh;
        *materials = build.materials;
    } else {
        pliant_mesh_free(&mesh);
        pliant_free(build.materials);
    }
    pliant_octree_free(&tree);
    PLIANT_FREE(cells, build.kept, build.leaf_material, build.corner);
    return status;
}
