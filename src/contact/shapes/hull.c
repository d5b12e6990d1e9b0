/* Convex hull of points by Quickhull (Barber, Dobkin and Huhdanpaa, The Quickhull Algorithm for Convex Hulls, ACM
 * Trans. Math. Softw. 22:469, 1996). The next point is the farthest one beyond a triangle, so every added point is
 * a corner of the hull. Therefore the number of triangles never decreases, and the limit can be tested at any time.
 * Triangles that face the point are removed, and adjacent triangles in one plane with it too. The point is then
 * joined to the border of the hole. */
#include "contact/shapes/solid.h"

#include "base/fail.h"
#include "base/memory.h"
#include "base/vector3.h"

#include <math.h>
#include <string.h>

/* relative to the size: points that are no higher above a triangle lie in its plane */
static const double in_plane = 1e-7;
enum { MAX_FACETS = 2 * PLIANT_HULL_TRIANGLES };

typedef struct facet {
    int32_t node[3];
    double normal[3], along;
    int32_t first, furthest;  /* list of points beyond the triangle, and its farthest point; -1: no point */
    double height;            /* of the farthest point */
    bool is_visible;
} facet;

typedef struct hull {
    const double *points;
    int32_t *next;            /* (points) next point in a list */
    int32_t count, horizon;
    double tolerance;
    facet face[MAX_FACETS];
    int32_t edge[3 * MAX_FACETS][2];
} hull;

static const double *place(const hull *of, int32_t point) { return of->points + 3 * (size_t)point; }

static bool add_face(hull *of, int32_t a, int32_t b, int32_t c)
{
    facet *face = of->face + of->count;
    double u[3], w[3];
    if (of->count == MAX_FACETS) return false;
    *face = (facet){.node = {a, b, c}, .first = -1, .furthest = -1};
    for (int d = 0; d < 3; d++) {
        u[d] = place(of, b)[d] - place(of, a)[d];
        w[d] = place(of, c)[d] - place(of, a)[d];
    }
    for (int d = 0; d < 3; d++) face->normal[d] = u[(d + 1) % 3] * w[(d + 2) % 3] - u[(d + 2) % 3] * w[(d + 1) % 3];
    const double size = pliant_length3(face->normal);
    for (int d = 0; d < 3; d++) face->normal[d] = size > 0 ? face->normal[d] / size : 0;
    face->along = pliant_dot3(face->normal, place(of, a));
    of->count++;
    return true;
}

/* Return the squared distance of a point from the span of 1, 2 or 3 points. */
static double beyond(const hull *of, const int32_t *base, int count, int32_t point)
{
    double to[3], along[2][3];
    for (int d = 0; d < 3; d++) {
        to[d] = place(of, point)[d] - place(of, base[0])[d];
        for (int k = 0; k < count - 1; k++) along[k][d] = place(of, base[k + 1])[d] - place(of, base[0])[d];
    }
    for (int k = 0; k < count - 1; k++) { /* Gram-Schmidt orthogonalization */
        if (k == 1) {
            const double fraction = pliant_dot3(along[1], along[0]) / pliant_dot3(along[0], along[0]);
            for (int d = 0; d < 3; d++) along[1][d] -= fraction * along[0][d];
        }
        const double fraction = pliant_dot3(to, along[k]) / pliant_dot3(along[k], along[k]);
        for (int d = 0; d < 3; d++) to[d] -= fraction * along[k][d];
    }
    return pliant_dot3(to, to);
}

/* Choose four points that are far from coplanar. Return false if there are no such points. */
static bool begin(hull *of, int32_t num_points)
{
    int32_t base[4] = {0, 0, 0, 0};
    for (int k = 1; k < 4; k++) {
        double maximum = -1;
        for (int32_t p = 0; p < num_points; p++) {
            const double square = beyond(of, base, k, p);
            if (square > maximum) {
                maximum = square;
                base[k] = p;
            }
        }
        if (k == 1) of->tolerance = in_plane * sqrt(maximum);
        if (!(maximum > of->tolerance * of->tolerance) || maximum == 0) return false;
    }
    add_face(of, base[0], base[1], base[2]);
    const bool above = pliant_dot3(of->face[0].normal, place(of, base[3])) > of->face[0].along;
    of->count = 0;
    const int32_t b = base[above ? 2 : 1], c = base[above ? 1 : 2];
    add_face(of, base[0], b, c);
    add_face(of, base[0], c, base[3]);
    add_face(of, c, b, base[3]);
    add_face(of, b, base[0], base[3]);
    return true;
}

/* Add an edge to the border of the hole. An edge that two removed triangles share is not on the border. */
static void add_border_edge(hull *of, int32_t a, int32_t b)
{
    for (int32_t e = 0; e < of->horizon; e++)
        if (of->edge[e][0] == b && of->edge[e][1] == a) {
            memcpy(of->edge[e], of->edge[--of->horizon], sizeof of->edge[e]);
            return;
        }
    of->edge[of->horizon][0] = a;
    of->edge[of->horizon++][1] = b;
}

static double height_over(const hull *of, const facet *face, int32_t point)
{
    return pliant_dot3(face->normal, place(of, point)) - face->along;
}

static void mark_visible(hull *of, facet *face)
{
    face->is_visible = true;
    for (int k = 0; k < 3; k++) add_border_edge(of, face->node[k], face->node[(k + 1) % 3]);
}

/* Return whether a triangle has an edge of the border. */
static bool borders(const hull *of, const facet *face)
{
    for (int32_t e = 0; e < of->horizon; e++)
        for (int k = 0; k < 3; k++)
            if (of->edge[e][0] == face->node[(k + 1) % 3] && of->edge[e][1] == face->node[k]) return true;
    return false;
}

/* Remove all triangles that face the point. Also remove adjacent triangles in one plane with it: otherwise the new
 * triangle at the common edge could have area 0. */
static void remove_visible_faces(hull *of, int32_t point)
{
    of->horizon = 0;
    for (int32_t f = 0; f < of->count; f++) of->face[f].is_visible = false;
    for (int32_t f = 0; f < of->count; f++)
        if (height_over(of, of->face + f, point) > of->tolerance) mark_visible(of, of->face + f);
    for (bool more = true; more;) {
        more = false;
        for (int32_t f = 0; f < of->count; f++) {
            facet *face = of->face + f;
            if (face->is_visible || !(height_over(of, face, point) > -of->tolerance) || !borders(of, face)) continue;
            mark_visible(of, face);
            more = true;
        }
    }
}

/* Assign a point to the first triangle that it is beyond. A point beyond none is inside. */
static void assign_to_face(hull *of, int32_t from, int32_t point)
{
    for (int32_t f = from; f < of->count; f++) {
        facet *face = of->face + f;
        const double height = height_over(of, face, point);
        if (!(height > of->tolerance)) continue;
        of->next[point] = face->first;
        face->first = point;
        if (face->furthest < 0 || height > face->height) {
            face->furthest = point;
            face->height = height;
        }
        return;
    }
}

static bool add_point(hull *of, int32_t point)
{
    int32_t left = 0, orphans = -1;
    remove_visible_faces(of, point);
    for (int32_t f = 0; f < of->count; f++) {
        const facet face = of->face[f];
        if (!face.is_visible) of->face[left++] = face;
        for (int32_t p = face.is_visible ? face.first : -1, after; p >= 0; p = after) {
            after = of->next[p];
            of->next[p] = orphans;
            orphans = p;
        }
    }
    of->count = left;
    for (int32_t e = 0; e < of->horizon; e++)
        if (!add_face(of, of->edge[e][0], of->edge[e][1], point)) return false;
    for (int32_t p = orphans, after; p >= 0; p = after) {
        after = of->next[p];
        if (p != point) assign_to_face(of, left, p);
    }
    return of->count <= PLIANT_HULL_TRIANGLES;
}

/* Return false if there are too many triangles. */
static bool add_points(hull *of, int32_t num_points)
{
    for (int32_t p = 0; p < num_points; p++) assign_to_face(of, 0, p);
    for (bool more = true; more;) {
        more = false;
        for (int32_t f = 0; f < of->count && !more; f++) {
            if (of->face[f].furthest < 0) continue;
            if (!add_point(of, of->face[f].furthest)) return false;
            more = true;
        }
    }
    return true;
}

pliant_status pliant_hull_find(int32_t num_points, const double *points, const char *name, int32_t *num_triangles,
                               int32_t **triangles)
{
    hull *of = pliant_calloc(1, sizeof *of);
    int32_t *next = num_points > 0 ? pliant_calloc((size_t)num_points, sizeof *next) : NULL, *made = NULL;
    pliant_status status = of && (next || num_points <= 0) ? PLIANT_OK : pliant_fail_memory(name);
    if (status == PLIANT_OK) {
        of->points = points;
        of->next = next;
        if (num_points < 4 || !begin(of, num_points))
            status =
                pliant_fail(PLIANT_ERROR_FORMAT,
                            "%s: its points lie in a plane: a solid needs four points that are not coplanar", name);
        else if (!add_points(of, num_points))
            status = pliant_fail(PLIANT_ERROR_FORMAT,
                                 "%s: its convex hull has more than %d triangles; as a mesh it may have %d", name,
                                 PLIANT_HULL_TRIANGLES, PLIANT_SOLID_TRIANGLES);
    }
    if (status == PLIANT_OK && !(made = pliant_calloc((size_t)of->count, 3 * sizeof *made)))
        status = pliant_fail_memory(name);
    if (status == PLIANT_OK) {
        for (int32_t f = 0; f < of->count; f++) memcpy(made + 3 * f, of->face[f].node, sizeof of->face[f].node);
        *num_triangles = of->count;
        *triangles = made;
    }
    pliant_free(next);
    pliant_free(of);
    return status;
}
