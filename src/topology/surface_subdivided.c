/* Find the cut faces of subdivided tetrahedra: faces that lie in no outer face of the initial mesh. */
#include "topology/sorted_numbers.h"
#include "topology/surface.h"

#include "base/memory.h"
#include "base/vector3.h"

#include <string.h>

/* Minimal set of initial nodes, ascending, whose simplex contains a point. */
typedef struct carrier { int32_t count, node[4]; } carrier;

/* A surface triangle that lies in a face of the initial mesh. */
typedef struct outer_face {
    int32_t node[3], tet; /* of the initial mesh */
    int32_t triangle;
} outer_face;

typedef struct face_work {
    const pliant_body *body;
    carrier *of_node;     /* (fine.num_nodes) */
    uint8_t *touched;     /* (fine.num_nodes) appended, or an initial node of an edge with appended nodes */
    uint8_t *is_cut;      /* (num_triangles) */
    outer_face *face;     /* (num_triangles) */
    int32_t num_faces;
} face_work;

static void add(carrier *to, const carrier *from)
{
    int32_t all[8];
    memcpy(all, to->node, (size_t)to->count * sizeof *all);
    memcpy(all + to->count, from->node, (size_t)from->count * sizeof *all);
    const int32_t count = sort_once(all, to->count + from->count);
    to->count = count < 4 ? count : 4;
    memcpy(to->node, all, (size_t)to->count * sizeof *all);
}

static carrier carrier_of(const face_work *work, const int32_t *node, int count)
{
    carrier all = {0};
    for (int v = 0; v < count; v++) add(&all, work->of_node + node[v]);
    return all;
}

static int32_t tet_at_load(const pliant_body *body, int32_t tet)
{
    return body->tet_parent ? body->tet_parent[tet] : tet;
}

static void find_carriers(face_work *work)
{
    const pliant_subdivision *subdivision = work->body->subdivision;
    for (int32_t n = 0; n < subdivision->load_nodes; n++) work->of_node[n] = (carrier){1, {n, 0, 0, 0}};
    const double *rest = work->body->fine.rest;
    for (int32_t n = subdivision->load_nodes; n < work->body->fine.num_nodes; n++) {
        const int32_t *end = subdivision->between[n - subdivision->load_nodes].end;
        /* a copy belongs to the outer faces of its source; both ends have lower numbers */
        const bool is_copy = pliant_distance3(rest + 3 * (size_t)n, rest + 3 * (size_t)end[0]) <
                             1.01 * PLIANT_COPY_DISTANCE * subdivision->min_edge;
        work->of_node[n] = carrier_of(work, end, is_copy ? 1 : 2);
        work->touched[n] = 1;
        for (int32_t c = 0; c < work->of_node[n].count; c++) work->touched[work->of_node[n].node[c]] = 1;
    }
}

static int by_nodes(const void *a, const void *b)
{
    const outer_face *i = a, *j = b;
    for (int v = 0; v < 3; v++)
        if (i->node[v] != j->node[v]) return i->node[v] < j->node[v] ? -1 : 1;
    return i->triangle < j->triangle ? -1 : i->triangle > j->triangle;
}

/* List the triangles that lie in faces of the initial mesh. All others are faces of cuts. */
static void list_faces(face_work *work)
{
    const pliant_body *body = work->body;
    int32_t triangle = -1;
    for (int32_t f = 0; f < 4 * body->fine.num_tets; f++) {
        if (body->across[f] >= 0) continue;
        const int32_t *node = body->triangles + 3 * (size_t)++triangle;
        if (!(work->touched[node[0]] || work->touched[node[1]] || work->touched[node[2]])) continue;
        const carrier at = carrier_of(work, node, 3);
        work->is_cut[triangle] = at.count == 4;
        if (at.count == 3)
            work->face[work->num_faces++] =
                (outer_face){{at.node[0], at.node[1], at.node[2]}, tet_at_load(body, f / 4), triangle};
    }
    qsort(work->face, (size_t)work->num_faces, sizeof *work->face, by_nodes);
}

/* Mark triangles in an inner face of the initial mesh, which is listed for the tetrahedron on its other side. */
static void mark_shared(face_work *work, const carrier *tet, int corner, int32_t load)
{
    outer_face wanted = {.triangle = -1};
    int32_t low = 0, high = work->num_faces;
    for (int v = 0, w = 0; v < 4; v++)
        if (v != corner) wanted.node[w++] = tet->node[v];
    while (low < high) {
        const int32_t middle = low + (high - low) / 2;
        if (by_nodes(work->face + middle, &wanted) < 0) low = middle + 1;
        else high = middle;
    }
    for (; low < work->num_faces && memcmp(work->face[low].node, wanted.node, sizeof wanted.node) == 0; low++)
        if (work->face[low].tet != load) work->is_cut[work->face[low].triangle] = 1;
}

static void mark_all_shared(face_work *work)
{
    const pliant_mesh *fine = &work->body->fine;
    for (int32_t t = 0; t < fine->num_tets; t++) {
        const int32_t *node = fine->tets + 4 * (size_t)t;
        if (!(work->touched[node[0]] || work->touched[node[1]] || work->touched[node[2]] || work->touched[node[3]]))
            continue;
        const carrier at = carrier_of(work, node, 4);
        for (int c = 0; c < 4 && at.count == 4; c++) mark_shared(work, &at, c, tet_at_load(work->body, t));
    }
}

pliant_status pliant_surface_part_subdivided(pliant_surface *surface)
{
    const pliant_body *body = surface->body;
    const size_t nodes = (size_t)body->fine.num_nodes, triangles = (size_t)body->num_triangles + 1;
    face_work work = {.body = body};
    work.of_node = pliant_calloc(nodes, sizeof *work.of_node);
    work.touched = pliant_calloc(nodes, 1);
    work.is_cut = pliant_calloc(triangles, 1);
    work.face = pliant_calloc(triangles, sizeof *work.face);
    const bool good = work.of_node && work.touched && work.is_cut && work.face;
    if (good) {
        find_carriers(&work);
        list_faces(&work);
        mark_all_shared(&work);
        surface->num_triangles = 0;
        for (int cut = 0; cut < 2; cut++) {
            surface->first_cut = surface->num_triangles;
            for (int32_t t = 0; t < body->num_triangles; t++)
                if (work.is_cut[t] == cut)
                    memcpy(surface->triangle + 3 * (size_t)surface->num_triangles++, body->triangles + 3 * (size_t)t,
                           3 * sizeof *body->triangles);
        }
    }
    PLIANT_FREE(work.of_node, work.touched, work.is_cut, work.face);
    return good ? PLIANT_OK : pliant_surface_no_memory();
}
