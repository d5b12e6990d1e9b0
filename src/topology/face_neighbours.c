/* Find the tetrahedron on the other side of each face of the next body, among the fragments of the tetrahedron across
 * the initial face. Only faces whose corners changed are recomputed. The surface follows from the result. */
#include "topology/divide.h"
#include "topology/links.h"

#include "base/fail.h"
#include "base/buffer.h"
#include "mesh/faces.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <string.h>

static bool list_face(body_faces *other, int32_t face)
{
    if (!pliant_reserve(&other->face, &other->capacity, other->count, 256, sizeof *other->face)) return false;
    other->face[other->count++] = face;
    return true;
}

/* Return false if memory is exhausted. */
static bool set(const pliant_body *next, int32_t face, int32_t found, body_faces *other)
{
    if (next->across[face] == found) return true;
    next->across[face] = found;
    pliant_mark_written(next->across, (size_t)face, 1, sizeof found);
    return list_face(other, face);
}

static bool find_one(const pliant_body *next, const pliant_cuts *cuts, int32_t tet, int corner, int32_t beyond,
                     body_faces *other_faces)
{
    const int32_t *nodes = next->fine.tets + 4 * (size_t)tet, *list;
    const int32_t count = pliant_fragments_of(cuts, &beyond, &list);
    int32_t found = -1;
    for (int32_t f = 0; f < count && found < 0; f++) {
        const int32_t *other = next->fine.tets + 4 * (size_t)list[f];
        int common = 0;
        for (int v = 0; v < 4; v++)
            for (int w = 0; w < 4; w++) common += v != corner && nodes[v] == other[w];
        if (common == 3) found = list[f];
    }
    return set(next, 4 * tet + corner, found, other_faces);
}

static bool find_around(const pliant_body *next, const pliant_cuts *cuts, int32_t tet, body_faces *other)
{
    bool good = true;
    const int32_t parent = next->tet_parent ? next->tet_parent[tet] : tet, *load = next->voxels->across;
    for (int c = 0; c < 4 && good; c++) {
        const int32_t beyond = load[4 * (size_t)parent + c], *list;
        good = beyond < 0 ? set(next, 4 * tet + c, -1, other) : find_one(next, cuts, tet, c, beyond, other);
        if (beyond < 0) continue;
        const int32_t count = pliant_fragments_of(cuts, &beyond, &list);
        for (int back = 0; back < 4; back++)
            for (int32_t f = 0; f < count && good && load[4 * (size_t)beyond + back] == parent; f++)
                good = find_one(next, cuts, list[f], back, parent, other);
    }
    return good;
}

pliant_status pliant_body_find_across(const pliant_body *before, const pliant_cuts *cuts, pliant_body *next,
                                      body_faces *other)
{
    const size_t tets = (size_t)next->fine.num_tets, old = (size_t)before->fine.num_tets;
    const int32_t *known = before->across                            ? before->across
                           : before->voxels && before->revision == 1 ? before->voxels->across
                                                                     : NULL;
    bool good = true;
    other->known = cuts && known;
    next->across = other->known ? pliant_next_version(known, 4 * old, 4 * tets, sizeof *known)
                                : pliant_malloc(tets, 4 * sizeof *next->across);
    if (!next->across) return pliant_fail_memory("the next body");
    if (!other->known) return pliant_mesh_neighbours(&next->fine, next->across);
    memset(next->across + 4 * old, 0xff, 4 * (tets - old) * sizeof *known);
    for (size_t f = 4 * old; f < 4 * tets && good; f++) good = list_face(other, (int32_t)f);
    for (int32_t i = 0; i < next->changes.num_touched && good; i++) {
        const size_t t = (size_t)next->changes.touched[i];
        if (memcmp(before->fine.tets + 4 * t, next->fine.tets + 4 * t, 4 * sizeof *next->fine.tets) != 0)
            good = find_around(next, cuts, (int32_t)t, other);
    }
    for (size_t t = old; t < tets && good; t++) good = find_around(next, cuts, (int32_t)t, other);
    return good ? PLIANT_OK : pliant_fail_memory("the next body");
}

/* ---- the surface */

static pliant_status list_outside(const pliant_body *body, const int32_t *across, int32_t count, int32_t **out)
{
    int32_t *list = *out = pliant_malloc((size_t)count + 1, sizeof *list), listed = 0;
    if (!list) return pliant_fail_memory("the surface");
    for (int32_t f = 0; f < 4 * body->fine.num_tets && listed < count; f++)
        if (across[f] < 0) list[listed++] = f;
    return PLIANT_OK;
}

/* Merge the previous surface triangles on unchanged faces with the changed faces that have no neighbour, in order.
 * outside: faces of the previous triangles */
static void merge(const pliant_body *before, const int32_t *outside, const body_faces *other, pliant_body *next)
{
    int32_t count = 0, from = 0;
    for (int32_t i = 0; i <= other->count; i++) {
        const int32_t face = i < other->count ? other->face[i] : INT32_MAX, first = from;
        while (from < before->num_triangles && outside[from] < face) from++;
        memcpy(next->outside + count, outside + first, (size_t)(from - first) * sizeof *outside);
        memcpy(next->triangles + 3 * (size_t)count, before->triangles + 3 * (size_t)first,
               3 * (size_t)(from - first) * sizeof *before->triangles);
        count += from - first;
        if (i == other->count) break;
        if (from < before->num_triangles && outside[from] == face) from++;
        if (next->across[face] >= 0) continue;
        next->outside[count] = face;
        pliant_face_triangle(&next->fine, face, next->triangles + 3 * (size_t)count++);
    }
    next->num_triangles = count;
}

pliant_status pliant_body_find_surface(const pliant_body *before, pliant_body *next, body_faces *other)
{
    if (!other->known)
        return pliant_mesh_surface(&next->fine, next->across, NULL, &next->triangles, &next->num_triangles);
    int32_t *outside = NULL;
    bool good = true;
    for (int32_t i = 0; i < next->changes.num_touched && good; i++)
        for (int c = 0; c < 4 && good; c++) good = list_face(other, 4 * next->changes.touched[i] + c);
    if (other->count > 0) other->count = sort_once(other->face, other->count);
    pliant_status status = good ? PLIANT_OK : pliant_fail_memory("the surface");
    if (status == PLIANT_OK && !before->outside)
        status = list_outside(before, before->across ? before->across : before->voxels->across, before->num_triangles,
                              &outside);
    const size_t maximum = (size_t)before->num_triangles + (size_t)other->count + 1;
    if (status == PLIANT_OK && (!(next->outside = pliant_malloc(maximum, sizeof *next->outside)) ||
                                !(next->triangles = pliant_malloc(maximum, 3 * sizeof *next->triangles))))
        status = pliant_fail_memory("the surface");
    if (status == PLIANT_OK) merge(before, before->outside ? before->outside : outside, other, next);
    pliant_free(outside);
    return status;
}
