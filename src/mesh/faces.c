/* Faces of a tetrahedral mesh: neighbours, surface, connected pieces and their supports. */
#include "mesh/faces.h"

#include "base/union_find.h"
#include "base/fail.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <math.h>
#include <string.h>

static void sorted_face(const int32_t *nodes, int face, int32_t out[3])
{
    for (int v = 0; v < 3; v++) out[v] = nodes[pliant_face_corners[face][v]];
    for (int pass = 0; pass < 2; pass++)
        for (int v = 0; v < 2; v++)
            if (out[v] > out[v + 1]) {
                int32_t swap = out[v];
                out[v] = out[v + 1];
                out[v + 1] = swap;
            }
}

/* Return whether the corners of a face, seen from outside, are in cyclic ascending order. It is true for one of two
 * tetrahedra with a common face. */
static bool has_ascending_corners(const int32_t *nodes, int face)
{
    const int32_t a = nodes[pliant_face_corners[face][0]], b = nodes[pliant_face_corners[face][1]],
                  c = nodes[pliant_face_corners[face][2]];
    return (a < b && b < c) || (b < c && c < a) || (c < a && a < b);
}

/* Return whether two tetrahedra on one side of a face are fragments of one tetrahedron. Their fourth nodes then have
 * the same lattice position. */
static bool are_fragments_of_one_tet(const pliant_mesh *mesh, int32_t a, int32_t b)
{
    return mesh->lattice_of_node[mesh->tets[a]] == mesh->lattice_of_node[mesh->tets[b]];
}

/* A face in the bucket of its smallest node, with its two other nodes, ascending. */
typedef struct listed_face {
    int32_t face, second, third;
} listed_face;

/* Pair the faces of a bucket. They are sorted and few, so direct comparison suffices. */
static pliant_status pair_faces(const pliant_mesh *mesh, const listed_face *faces, int32_t count, int32_t smallest,
                                int32_t *neighbours)
{
    for (int32_t a = 0; a < count; a++)
        for (int32_t b = a + 1; b < count; b++) {
            if (faces[b].second != faces[a].second || faces[b].third != faces[a].third) continue;
            const int32_t one = faces[a].face, other = faces[b].face;
            if (has_ascending_corners(mesh->tets + 4 * (one / 4), one % 4) !=
                has_ascending_corners(mesh->tets + 4 * (other / 4), other % 4)) {
                if (neighbours[one] < 0) neighbours[one] = other / 4;
                if (neighbours[other] < 0) neighbours[other] = one / 4;
            } else if (!are_fragments_of_one_tet(mesh, one, other)) {
                return pliant_fail(PLIANT_ERROR_FORMAT, "tetrahedra %d and %d are on one side of the face %d %d %d",
                                   one / 4, other / 4, smallest, faces[a].second, faces[a].third);
            }
        }
    return PLIANT_OK;
}

pliant_status pliant_mesh_neighbours(const pliant_mesh *mesh, int32_t *neighbours)
{
    int32_t num_faces = 4 * mesh->num_tets;
    int32_t *start = pliant_calloc((size_t)mesh->num_nodes + 2, sizeof *start);
    listed_face *faces = pliant_calloc((size_t)num_faces, sizeof *faces);
    pliant_status status = start && faces ? PLIANT_OK : pliant_fail_memory("the faces of the mesh");
    int32_t key[3];
    for (int32_t f = 0; status == PLIANT_OK && f < num_faces; f++) {
        sorted_face(mesh->tets + 4 * (f / 4), f % 4, key);
        start[key[0] + 2]++;
    }
    for (int32_t n = 0; status == PLIANT_OK && n < mesh->num_nodes; n++) start[n + 2] += start[n + 1];
    for (int32_t f = 0; status == PLIANT_OK && f < num_faces; f++) {
        sorted_face(mesh->tets + 4 * (f / 4), f % 4, key);
        faces[start[key[0] + 1]++] = (listed_face){f, key[1], key[2]};
    }
    memset(neighbours, 0xff, (size_t)num_faces * sizeof *neighbours);
    for (int32_t n = 0; n < mesh->num_nodes && status == PLIANT_OK; n++)
        status = pair_faces(mesh, faces + start[n], start[n + 1] - start[n], n, neighbours);
    pliant_free(start);
    pliant_free(faces);
    return status;
}

/* Set *neighbours to *own, which the caller frees, unless they are given. */
static pliant_status need_neighbours(const pliant_mesh *mesh, const int32_t **neighbours, int32_t **own)
{
    if (*neighbours) return PLIANT_OK;
    *neighbours = *own = pliant_calloc((size_t)mesh->num_tets, 4 * sizeof **own);
    return *own ? pliant_mesh_neighbours(mesh, *own) : pliant_fail_memory("the faces of the mesh");
}

/* Return whether a face lies between the inside and the outside. inside: Nullable */
static bool is_outer(const int32_t *neighbours, const uint8_t *inside, int32_t face)
{
    return (!inside || inside[face / 4]) && (neighbours[face] < 0 || (inside && !inside[neighbours[face]]));
}

pliant_status pliant_mesh_surface(const pliant_mesh *mesh, const int32_t *neighbours, const uint8_t *inside,
                                  int32_t **triangles, int32_t *count)
{
    int32_t *own = NULL, outer = 0, *out = NULL;
    pliant_status status = need_neighbours(mesh, &neighbours, &own);
    for (int32_t f = 0; status == PLIANT_OK && f < 4 * mesh->num_tets; f++) outer += is_outer(neighbours, inside, f);
    if (status == PLIANT_OK && !(out = pliant_calloc(3 * (size_t)outer + 1, sizeof *out)))
        status = pliant_fail_memory("the surface");
    if (status == PLIANT_OK) {
        *triangles = out;
        *count = outer;
        for (int32_t f = 0; f < 4 * mesh->num_tets; f++)
            if (is_outer(neighbours, inside, f)) {
                pliant_face_triangle(mesh, f, out);
                out += 3;
            }
    }
    pliant_free(own);
    return status;
}

/* Label every tetrahedron with its connected piece. Pieces are joined across faces and numbered by their first
 * tetrahedra. Return the number of pieces. */
static int32_t label_pieces(const pliant_mesh *mesh, const int32_t *neighbours, int32_t *piece)
{
    int32_t pieces = 0;
    for (int32_t t = 0; t < mesh->num_tets; t++) piece[t] = t;
    for (int32_t f = 0; f < 4 * mesh->num_tets; f++)
        if (neighbours[f] >= 0) pliant_set_join(piece, f / 4, neighbours[f]);
    for (int32_t t = 0; t < mesh->num_tets; t++) piece[t] = pliant_set_root(piece, t);
    for (int32_t t = 0; t < mesh->num_tets; t++) piece[t] = piece[t] == t ? pieces++ : piece[piece[t]];
    return pieces;
}

/* Fixed support of a piece so far: up to three points that span a triangle. */
typedef struct piece_support {
    int count;
    const double *point[3];
    bool is_supported, fresh;   /* supported; became supported in this sweep */
    int32_t tets;
} piece_support;

static void add_support_point(piece_support *foot, const double *point, double length)
{
    if (foot->count == 3) return;
    if (foot->count == 0) {
        foot->point[foot->count++] = point;
        return;
    }
    double u[3], v[3], area[3];
    for (int d = 0; d < 3; d++) u[d] = point[d] - foot->point[0][d];
    double distance = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
    if (distance < 1e-6 * length) return;
    if (foot->count == 2) {
        for (int d = 0; d < 3; d++) v[d] = foot->point[1][d] - foot->point[0][d];
        for (int d = 0; d < 3; d++) area[d] = u[(d + 1) % 3] * v[(d + 2) % 3] - u[(d + 2) % 3] * v[(d + 1) % 3];
        double base = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
        if (sqrt(area[0] * area[0] + area[1] * area[1] + area[2] * area[2]) < 1e-6 * distance * base) return;
    }
    foot->point[foot->count++] = point;
}

/* Run one sweep: fixed nodes and nodes of supported pieces support other pieces. Return whether a piece became
 * supported. */
static bool find_supports(const pliant_mesh *mesh, const int32_t *piece, uint8_t *firm_node, piece_support *feet,
                          int32_t pieces)
{
    double length = mesh->cell_size[0] + mesh->cell_size[1] + mesh->cell_size[2];
    for (int32_t t = 0; t < mesh->num_tets; t++)
        for (int v = 0; feet[piece[t]].count < 3 && v < 4; v++) {
            const int32_t node = mesh->tets[4 * (size_t)t + (size_t)v];
            if (firm_node[node]) add_support_point(feet + piece[t], mesh->rest + 3 * (size_t)node, length);
        }
    bool changed = false;
    for (int32_t p = 0; p < pieces; p++) {
        feet[p].fresh = !feet[p].is_supported && feet[p].count == 3;
        if (feet[p].fresh) changed = feet[p].is_supported = true;
    }
    for (int32_t t = 0; changed && t < mesh->num_tets; t++)
        for (int v = 0; feet[piece[t]].fresh && v < 4; v++) firm_node[mesh->tets[4 * (size_t)t + (size_t)v]] = 1;
    return changed;
}

pliant_status pliant_mesh_fix_loose_pieces(const pliant_mesh *mesh, const int32_t *neighbours, uint8_t how, bool whole,
                                           uint8_t *fixed, uint8_t *loose, int32_t *pieces)
{
    size_t tets = (size_t)mesh->num_tets;
    int32_t *piece = pliant_calloc(tets, sizeof *piece);
    uint8_t *firm_node = pliant_calloc((size_t)mesh->num_nodes, 1);
    piece_support *feet = NULL;
    int32_t *own = NULL;
    pliant_status status =
        piece && firm_node ? need_neighbours(mesh, &neighbours, &own) : pliant_fail_memory("the pieces of the mesh");
    if (status != PLIANT_OK) goto done;
    int32_t count = label_pieces(mesh, neighbours, piece), largest = 0, num_loose = 0;
    if (!(feet = pliant_calloc((size_t)count, sizeof *feet))) {
        status = pliant_fail_memory("the pieces of the mesh");
        goto done;
    }
    for (int32_t t = 0; t < mesh->num_tets; t++) feet[piece[t]].tets++;
    memcpy(firm_node, fixed, (size_t)mesh->num_nodes);
    while (find_supports(mesh, piece, firm_node, feet, count)) {}
    for (int32_t p = 0; p < count; p++) {
        if (feet[p].tets > feet[largest].tets) largest = p;
        num_loose += !feet[p].is_supported;
    }
    if (whole && !feet[largest].is_supported) {
        status = pliant_fail(
            PLIANT_ERROR_SCENE,
            "nothing holds the largest piece of tissue (%d of %d tetrahedra): it needs three fixed nodes that are not "
            "in a line. Mark a material as fixed (bone), or add a box or plane under fixed: in the scene",
            feet[largest].tets, mesh->num_tets);
        goto done;
    }
    for (int32_t t = 0; t < mesh->num_tets; t++) loose[t] = !feet[piece[t]].is_supported;
    for (int32_t v = 0; v < 4 * mesh->num_tets; v++)
        if (loose[v / 4] && !firm_node[mesh->tets[v]]) fixed[mesh->tets[v]] = how;
    *pieces = num_loose;
done:
    PLIANT_FREE(own, piece, firm_node, feet);
    return status;
}
