/* Separate tetrahedra at the faces whose three corners a stroke has passed. A node is copied for each group of
 * tetrahedra around it that no face connects any more. */
#include "topology/sorted_numbers.h"
#include "cut/subdivide.h"

#include "base/buffer.h"
#include "base/fail.h"
#include "base/memory.h"
#include "base/vector3.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A face on the stroke: 4 tetrahedron + corner for both sides. */
typedef struct face {
    int32_t side[2];
    double area;
    bool flat; /* all four corners of one side's tetrahedron are on the stroke */
} face;

typedef struct face_list {
    int32_t count, capacity;
    face *faces;
} face_list;

static int count_passed(const cut_splitting *work, int32_t tet)
{
    int count = 0;
    for (int v = 0; v < 4; v++) count += (work->on[work->corners[4 * (size_t)tet + v]] & CUT_PASSED) != 0;
    return count;
}

/* Return 4 tetrahedron + corner on the other side of a face; -1: none. */
static int32_t across(const cut_splitting *work, int32_t tet, int corner)
{
    const int32_t *nodes = work->corners + 4 * (size_t)tet;
    for (int32_t at = work->first[nodes[corner == 0]]; at >= 0; at = work->next[at]) {
        const int32_t *others = work->corners + 4 * (size_t)(at / 4);
        const int back = at / 4 == tet ? -1 : pliant_split_opposite(nodes, corner, others);
        if (back >= 0) return 4 * (at / 4) + back;
    }
    return -1;
}

static double area_of(const cut_splitting *work, int32_t tet, int corner)
{
    const double *x[3];
    double u[3], v[3], squares = 0;
    for (int c = 0, n = 0; c < 4; c++)
        if (c != corner) x[n++] = work->rest + 3 * (size_t)work->corners[4 * (size_t)tet + c];
    for (int d = 0; d < 3; d++) {
        u[d] = x[1][d] - x[0][d];
        v[d] = x[2][d] - x[0][d];
    }
    for (int d = 0; d < 3; d++) {
        const double normal = u[(d + 1) % 3] * v[(d + 2) % 3] - u[(d + 2) % 3] * v[(d + 1) % 3];
        squares += normal * normal;
    }
    return 0.5 * sqrt(squares);
}

static pliant_status list_faces(const cut_splitting *work, face_list *list)
{
    for (int32_t t = 0; t < work->num_tets; t++) {
        const int count = count_passed(work, t);
        for (int c = 0; c < 4 && count >= 3; c++) {
            if (count == 3 && work->on[work->corners[4 * (size_t)t + c]] & CUT_PASSED) continue;
            const int32_t other = across(work, t, c);
            if (other / 4 <= t) continue; /* no neighbour, or listed from the other side */
            if (!pliant_reserve(&list->faces, &list->capacity, list->count, 64, sizeof *list->faces))
                return pliant_fail_memory("the faces that the blade splits");
            list->faces[list->count++] = (face){
                {4 * t + c, other}, area_of(work, t, c), count == 4 || count_passed(work, other / 4) == 4};
        }
    }
    return PLIANT_OK;
}

static int by_area(const void *a, const void *b)
{
    const face *i = a, *j = b;
    if (i->area < j->area || i->area > j->area) return i->area > j->area ? -1 : 1;
    return i->side[0] < j->side[0] ? -1 : i->side[0] > j->side[0];
}

static bool have_edge(const cut_splitting *work, int32_t a, int32_t b)
{
    for (int32_t at = work->first[a]; at >= 0; at = work->next[at])
        for (int v = 0; v < 4; v++)
            if (work->corners[4 * (size_t)(at / 4) + (size_t)v] == b) return true;
    return false;
}

/* Return whether corners of two tetrahedra that are not on the stroke coincide or have an edge. The stroke does not
 * pass through this edge, so both tetrahedra are on the same side. */
static bool are_on_one_side(const cut_splitting *work, int32_t a, int32_t b)
{
    const int32_t *one = work->corners + 4 * (size_t)a, *other = work->corners + 4 * (size_t)b;
    for (int v = 0; v < 4; v++)
        for (int w = 0; w < 4; w++)
            if (!((work->on[one[v]] | work->on[other[w]]) & CUT_PASSED) && have_edge(work, one[v], other[w]))
                return true;
    return false;
}

/* Sever all faces on the stroke, with one exception. A tetrahedron with all four corners on the stroke stays attached
 * to the neighbors on one side: across the largest suitable face, and to those on the same side as this neighbor. */
static pliant_status sever(cut_splitting *work, face_list *list)
{
    int32_t *group = pliant_calloc((size_t)work->num_tets, sizeof *group);
    int32_t *holder = pliant_calloc((size_t)work->num_tets, sizeof *holder); /* of each group; -1: none yet */
    bool good = group && holder;
    for (int32_t t = 0; good && t < work->num_tets; t++) {
        group[t] = t;
        holder[t] = count_passed(work, t) < 4 ? t : -1;
    }
    qsort(list->faces, (size_t)list->count, sizeof *list->faces, by_area);
    for (int32_t f = 0; good && f < list->count; f++) {
        const int32_t *side = list->faces[f].side;
        if (list->faces[f].flat) {
            const int32_t a = pliant_set_root(group, side[0] / 4), b = pliant_set_root(group, side[1] / 4);
            if (a == b) continue;
            if (holder[a] < 0 || holder[b] < 0) {
                const int32_t either = holder[a] < 0 ? holder[b] : holder[a];
                pliant_set_join(group, a, b);
                holder[pliant_set_root(group, a)] = either;
                continue;
            }
            if (are_on_one_side(work, holder[a], holder[b])) continue;
        }
        for (int s = 0; s < 2; s++) work->severed[side[s]] = 1 + side[1 - s];
    }
    pliant_free(group);
    pliant_free(holder);
    return good ? PLIANT_OK : pliant_fail_memory("the faces that the blade splits");
}

/* Position of a copy within its own side of the cut, on the line to another node. */
typedef struct inset {
    int32_t towards; /* -1: none */
    double fraction, opening; /* opening: its distance from the faces of the cut [m] */
    double sine;              /* of the smallest angle between the line and these faces */
} inset;

/* Compute the vectors from a tetrahedron's corner to its other corners. */
static void look_from(const cut_splitting *work, int32_t tet, int corner, double to[3][3], int32_t other[3])
{
    const int32_t *nodes = work->corners + 4 * (size_t)tet;
    for (int c = 0, k = 0; c < 4; c++) {
        if (c == corner) continue;
        for (int d = 0; d < 3; d++)
            to[k][d] = work->rest[3 * (size_t)nodes[c] + d] - work->rest[3 * (size_t)nodes[corner] + d];
        other[k++] = c;
    }
}

/* Return the fraction of a vector by which the common corner of a group of tetrahedra can move. Each keeps half of
 * its volume. opening: distance of the vector's end from all severed faces at the corner [m] */
static double room_of(const cut_splitting *work, int32_t *part, int32_t root, const double along[3], double *opening)
{
    const double least = 0.5;
    double room = 0.5; /* the copy stays nearer to its source than to the other node */
    *opening = INFINITY;
    for (int32_t j = root; j < work->num_around; j++) {
        double to[3][3];
        int32_t other[3];
        if (pliant_set_root(part, j) != root) continue;
        const int32_t tet = work->around[j] / 4;
        look_from(work, tet, work->around[j] % 4, to, other);
        const double volume = pliant_triple3(to[0], to[1], to[2]);
        double lost = 0; /* fraction of the volume: the sum of the three barycentric coordinates */
        for (int k = 0; k < 3; k++) {
            const double *u = to[(k + 1) % 3], *w = to[(k + 2) % 3];
            double normal[3];
            lost += pliant_triple3(u, w, along) / volume;
            if (!work->severed[4 * (size_t)tet + (size_t)other[k]]) continue;
            pliant_cross3(u, w, normal);
            *opening = fmin(*opening, pliant_dot3(normal, along) / pliant_length3(normal) *
                                          (pliant_dot3(normal, to[k]) > 0 ? 1 : -1));
        }
        if (lost > 0) room = fmin(room, (1 - least) / lost);
    }
    return room;
}

/* Find the node towards which a group's copy of a node leaves the cut farthest, at the largest angle. Candidates are
 * the corners of the group, and of the tetrahedra across the opposite faces. */
static inset find_inset(const cut_splitting *work, int32_t *part, int32_t root, int32_t node)
{
    const pliant_subdivision *subdivision = work->body->subdivision;
    inset best = {.towards = -1};
    for (int32_t j = root; j < work->num_around && subdivision->kerf > 0; j++) {
        if (pliant_set_root(part, j) != root) continue;
        const int32_t tet = work->around[j] / 4, beyond = across(work, tet, work->around[j] % 4);
        for (int c = 0; c < 4; c++) {
            const bool is_own = c == work->around[j] % 4;
            double along[3], opening;
            if (is_own && beyond < 0) continue;
            const int32_t towards = work->corners[is_own ? beyond : 4 * tet + c];
            for (int d = 0; d < 3; d++)
                along[d] = work->rest[3 * (size_t)towards + d] - work->rest[3 * (size_t)node + d];
            const double room = room_of(work, part, root, along, &opening), length = pliant_length3(along),
                         most = PLIANT_COPY_DISTANCE * subdivision->min_edge / length,
                         fraction = fmin(fmin(room, subdivision->kerf / opening), most),
                         farther = fraction * opening - best.opening, same = 1e-9 * subdivision->kerf;
            if (opening > 0 && opening < INFINITY &&
                (farther > same || (farther > -same && opening / length > best.sine)))
                best = (inset){towards, fraction, fraction * opening, opening / length};
        }
    }
    return best;
}

/* Find the part that keeps the node: a part whose copy cannot leave the cut, or the part farthest along the stroke's
 * normal. Then all copies are on the same side of the stroke, and both sides are smooth. */
static int32_t find_keeper(const cut_splitting *work, int32_t *part, int32_t node)
{
    int32_t keeper = 0;
    double highest = -INFINITY;
    for (int32_t i = 0; i < work->num_around; i++) {
        double height = 0;
        if (part[i] != i) continue;
        if (find_inset(work, part, i, node).towards < 0) return i;
        for (int32_t j = i; j < work->num_around; j++) {
            double to[3][3];
            int32_t other[3];
            const int32_t tet = work->around[j] / 4;
            if (pliant_set_root(part, j) != i) continue;
            look_from(work, tet, work->around[j] % 4, to, other);
            for (int k = 0; k < 3; k++) {
                double normal[3];
                if (!work->severed[4 * (size_t)tet + (size_t)other[k]]) continue;
                pliant_cross3(to[(k + 1) % 3], to[(k + 2) % 3], normal);
                height += (pliant_dot3(normal, to[k]) > 0 ? 1 : -1) * pliant_dot3(normal, work->normal);
            }
        }
        if (height > highest) {
            highest = height;
            keeper = i;
        }
    }
    return keeper;
}

static pliant_status split_node(cut_splitting *work, int32_t node, int32_t **buffer, int32_t *buffer_size)
{
    pliant_status status = pliant_split_around(work, node);
    const int32_t count = work->num_around;
    if (status != PLIANT_OK || !pliant_split_has_severed(work)) return status;
    if (2 * count > *buffer_size) {
        if (!pliant_grow(buffer, 4 * (size_t)count, sizeof **buffer))
            return pliant_fail_memory("the nodes that the blade splits");
        *buffer_size = 4 * count;
    }
    int32_t *part = *buffer, *whole = *buffer + count;
    if (pliant_split_find_parts(work, part, whole) == 1) return PLIANT_OK;
    const int32_t keeper = work->body->subdivision->kerf > 0 ? find_keeper(work, part, node) : 0;
    for (int32_t i = 0; i < count && status == PLIANT_OK; i++) {
        if (part[i] != i || i == keeper) continue;
        const inset at = find_inset(work, part, i, node);
        const int32_t copy = work->num_nodes;
        status = pliant_split_add_node(
            work, (pliant_between){{node, at.towards < 0 ? node : at.towards}, at.fraction}, work->fixed[node]);
        if (status == PLIANT_OK) work->on[copy] = work->on[node];
        for (int32_t j = i; j < count && status == PLIANT_OK; j++)
            if (pliant_set_root(part, j) == i)
                pliant_split_set_corner(work, work->around[j] / 4, work->around[j] % 4, copy);
    }
    return status;
}

/* Report the area of the faces that the tetrahedra no longer share. In a trial, they would not share severed faces. */
static void report_separated_faces(const cut_splitting *work, const face_list *list, const pliant_cut_sweep *sweep,
                                   pliant_cut_report *report)
{
    for (int32_t f = 0; f < list->count; f++) {
        const int32_t *side = list->faces[f].side, *a = work->corners + 4 * (size_t)(side[0] / 4),
                      *b = work->corners + 4 * (size_t)(side[1] / 4);
        if (work->is_trial ? !work->severed[side[0]] : pliant_split_opposite(a, side[0] % 4, b) >= 0) continue;
        if (sweep->material_of_voxel) {
            pliant_split_report_voxels(work, side[0], sweep->material_of_voxel, list->faces[f].area, report);
            continue;
        }
        for (int s = 0; s < 2; s++)
            report->area += 0.5 * work->body->fine_material[work->source[side[s] / 4]].tissue * list->faces[f].area;
    }
}

/* List the faces on the stroke, and sever them. At the end of a stroke, bisect edges so that they open. */
static pliant_status sever_faces(cut_splitting *work, face_list *list)
{
    pliant_status status = PLIANT_OK;
    for (bool again = true; again && status == PLIANT_OK;) {
        again = false;
        list->count = 0;
        status = list_faces(work, list);
        if (status != PLIANT_OK || list->count == 0) return status;
        memset(work->severed, 0, 4 * (size_t)work->num_tets * sizeof *work->severed);
        status = sever(work, list);
        if (status == PLIANT_OK && work->has_border[CUT_END] && !work->is_trial)
            status = pliant_split_open_faces(work, &again);
    }
    return status;
}

pliant_status pliant_split_faces(cut_splitting *work, const pliant_cut_sweep *sweep, pliant_cut_report *report)
{
    face_list list = {0};
    int32_t *buffer = NULL, buffer_size = 0;
    for (int32_t n = 0; n < work->strip->count; n++)
        for (int d = 0; d < 3; d++) work->normal[d] += work->strip->triangles[n].normal[d];
    pliant_status status = sever_faces(work, &list);
    const int32_t nodes = work->first_copy = work->num_nodes;
    for (int32_t n = 0; n < nodes && list.count > 0 && !work->is_trial && status == PLIANT_OK; n++)
        if (work->on[n] & CUT_PASSED) status = split_node(work, n, &buffer, &buffer_size);
    if (status == PLIANT_OK) report_separated_faces(work, &list, sweep, report);
    pliant_free(list.faces);
    pliant_free(buffer);
    return status;
}
