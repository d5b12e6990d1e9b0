/* Nearest of many triangles, and winding numbers, by a tree of boxes. Each box is split at the median of its
 * longest side.
 * Winding numbers follow Jacobson, Kavan, Sorkine-Hornung, Robust Inside-Outside Segmentation using Generalized
 * Winding Numbers, ACM Trans. Graph. 32(4), 2013, eq. 5. Distant boxes are approximated by one dipole (Barill,
 * Dickson, Schmidt, Levin, Jacobson, Fast Winding Numbers for Soups and Clouds, ACM Trans. Graph. 37(4), 2018). */
#include "contact/shapes/solid.h"

#include "base/fail.h"
#include "base/median.h"
#include "base/memory.h"
#include "base/vector3.h"

#include <math.h>
#include <string.h>

enum { LEAF = 4, DEEPEST = 64 };
static const double far = 3; /* distance in radii of a box's triangles beyond which they are a dipole */
static const double pi = 3.14159265358979323846;

typedef struct tree_box {
    double low[3], high[3];
    double area[3], middle[3], radius; /* dipole: sum of the triangles' area vectors, and its position */
    int32_t first, count;              /* leaf: range in order */
    int32_t child;                     /* first of two consecutive children; leaf: -1 */
} tree_box;

struct pliant_triangle_tree {
    const double *points;
    const int32_t *triangles;
    int32_t *order, num_boxes;
    tree_box *box;
};

static const double *corner(const pliant_triangle_tree *tree, int32_t triangle, int k)
{
    return tree->points + 3 * (size_t)tree->triangles[3 * (size_t)triangle + (size_t)k];
}

/* ---- construction */

static void fill_box(const pliant_triangle_tree *tree, const pliant_numbered_point *centers, tree_box *box)
{
    double whole = 0;
    for (int d = 0; d < 3; d++) {
        box->low[d] = INFINITY;
        box->high[d] = -INFINITY;
    }
    for (int32_t n = 0; n < box->count; n++) {
        const int32_t t = centers[box->first + n].number;
        double edge[2][3], normal[3];
        for (int d = 0; d < 3; d++) {
            for (int k = 0; k < 3; k++) {
                box->low[d] = fmin(box->low[d], corner(tree, t, k)[d]);
                box->high[d] = fmax(box->high[d], corner(tree, t, k)[d]);
            }
            for (int e = 0; e < 2; e++) edge[e][d] = corner(tree, t, e + 1)[d] - corner(tree, t, 0)[d];
        }
        pliant_cross3(edge[0], edge[1], normal);
        const double size = pliant_length3(normal);
        for (int d = 0; d < 3; d++) {
            box->area[d] += 0.5 * normal[d];
            box->middle[d] += size * centers[box->first + n].at[d];
        }
        whole += size;
    }
    double square = 0;
    for (int d = 0; d < 3; d++) {
        box->middle[d] = whole > 0 ? box->middle[d] / whole : 0.5 * (box->low[d] + box->high[d]);
        square += pow(fmax(box->high[d] - box->middle[d], box->middle[d] - box->low[d]), 2);
    }
    box->radius = sqrt(square);
}

/* centers: of all triangles; sorted */
static void build(pliant_triangle_tree *tree, int32_t count, pliant_numbered_point *centers)
{
    tree->num_boxes = 1;
    tree->box[0] = (tree_box){.first = 0, .count = count, .child = -1};
    for (int32_t b = 0; b < tree->num_boxes; b++) {
        tree_box *box = tree->box + b;
        int axis = 0;
        fill_box(tree, centers, box);
        if (box->count <= LEAF) continue;
        for (int d = 1; d < 3; d++)
            if (box->high[d] - box->low[d] > box->high[axis] - box->low[axis]) axis = d;
        const int32_t half = box->count / 2;
        pliant_split_at_median(centers, box->first, box->first + box->count - 1, box->first + half, axis);
        box->child = tree->num_boxes;
        tree->box[tree->num_boxes++] = (tree_box){.first = box->first, .count = half, .child = -1};
        tree->box[tree->num_boxes++] = (tree_box){.first = box->first + half, .count = box->count - half, .child = -1};
    }
}

pliant_status pliant_triangle_tree_create(const double *points, int32_t count, const int32_t *triangles,
                                          pliant_triangle_tree **out)
{
    pliant_triangle_tree *tree = pliant_calloc(1, sizeof *tree);
    if (!tree) return pliant_fail_memory("a solid");
    tree->points = points;
    tree->triangles = triangles;
    tree->order = pliant_calloc((size_t)count, sizeof *tree->order);
    tree->box = pliant_calloc((size_t)count, 2 * sizeof *tree->box);
    pliant_numbered_point *centers = pliant_calloc((size_t)count, sizeof *centers);
    if (!tree->order || !tree->box || !centers) {
        pliant_free(centers);
        pliant_triangle_tree_free(tree);
        return pliant_fail_memory("a solid");
    }
    for (int32_t t = 0; t < count; t++) {
        centers[t].number = t;
        for (int d = 0; d < 3; d++)
            centers[t].at[d] = (corner(tree, t, 0)[d] + corner(tree, t, 1)[d] + corner(tree, t, 2)[d]) / 3;
    }
    build(tree, count, centers);
    for (int32_t n = 0; n < count; n++) tree->order[n] = centers[n].number;
    pliant_free(centers);
    *out = tree;
    return PLIANT_OK;
}

void pliant_triangle_tree_free(pliant_triangle_tree *tree)
{
    if (!tree) return;
    PLIANT_FREE(tree->order, tree->box, tree);
}

/* ---- nearest triangle */

/* By the Voronoi regions of corners, edges and the inside: C. Ericson, Real-Time Collision Detection, 2005, 5.1.5. */
void pliant_triangle_nearest_weights(const double a[3], const double b[3], const double c[3], const double p[3],
                                     double out[3])
{
    double ab[3], ac[3], ap[3], bp[3], cp[3], v = 0, w = 0;
    for (int d = 0; d < 3; d++) {
        ab[d] = b[d] - a[d];
        ac[d] = c[d] - a[d];
        ap[d] = p[d] - a[d];
        bp[d] = p[d] - b[d];
        cp[d] = p[d] - c[d];
    }
    const double d1 = pliant_dot3(ab, ap), d2 = pliant_dot3(ac, ap), d3 = pliant_dot3(ab, bp), d4 = pliant_dot3(ac, bp),
                 d5 = pliant_dot3(ab, cp), d6 = pliant_dot3(ac, cp);
    const double of_c = d1 * d4 - d3 * d2, of_b = d5 * d2 - d1 * d6, of_a = d3 * d6 - d5 * d4,
                 whole = of_a + of_b + of_c;
    if (d1 <= 0 && d2 <= 0) v = w = 0;
    else if (d3 >= 0 && d4 <= d3) v = 1;
    else if (of_c <= 0 && d1 >= 0 && d3 <= 0) v = d1 > d3 ? d1 / (d1 - d3) : 0;
    else if (d6 >= 0 && d5 <= d6) w = 1;
    else if (of_b <= 0 && d2 >= 0 && d6 <= 0) w = d2 > d6 ? d2 / (d2 - d6) : 0;
    else if (of_a <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) {
        const double sum = d4 - d3 + d5 - d6;
        w = sum > 0 ? (d4 - d3) / sum : 0;
        v = 1 - w;
    } else if (whole > 0) {
        v = of_b / whole;
        w = of_c / whole;
    }
    out[0] = 1 - v - w;
    out[1] = v;
    out[2] = w;
}

void pliant_triangle_nearest(const double a[3], const double b[3], const double c[3], const double p[3], double out[3])
{
    double weight[3];
    pliant_triangle_nearest_weights(a, b, c, p, weight);
    for (int d = 0; d < 3; d++) out[d] = a[d] + weight[1] * (b[d] - a[d]) + weight[2] * (c[d] - a[d]);
}

static double square_from(const tree_box *box, const double p[3])
{
    double square = 0;
    for (int d = 0; d < 3; d++) {
        const double beyond = fmax(fmax(box->low[d] - p[d], p[d] - box->high[d]), 0);
        square += beyond * beyond;
    }
    return square;
}

double pliant_triangle_tree_distance(const pliant_triangle_tree *tree, const double p[3], double maximum)
{
    int32_t stack[DEEPEST];
    double from[DEEPEST], minimum = maximum * maximum;
    int depth = 1;
    stack[0] = 0;
    from[0] = square_from(tree->box, p);
    while (depth > 0) {
        const tree_box *box = tree->box + stack[--depth];
        if (from[depth] >= minimum) continue;
        for (int32_t n = 0; box->child < 0 && n < box->count; n++) {
            const int32_t t = tree->order[box->first + n];
            double foot[3], square = 0;
            pliant_triangle_nearest(corner(tree, t, 0), corner(tree, t, 1), corner(tree, t, 2), p, foot);
            for (int d = 0; d < 3; d++) square += (p[d] - foot[d]) * (p[d] - foot[d]);
            minimum = fmin(minimum, square);
        }
        if (box->child < 0) continue;
        const double first = square_from(tree->box + box->child, p),
                     second = square_from(tree->box + box->child + 1, p);
        const int nearer = second < first; /* the nearer child is last on the stack, so it is visited first */
        stack[depth] = box->child + !nearer;
        from[depth++] = nearer ? first : second;
        stack[depth] = box->child + nearer;
        from[depth++] = nearer ? second : first;
    }
    return sqrt(minimum);
}

/* ---- winding numbers */

/* Return the solid angle of a triangle (van Oosterom and Strackee, The Solid Angle of a Plane Triangle, IEEE Trans.
 * Biomed. Eng. 30:125, 1983, eq. 8). */
static double solid_angle(const double *const corners[3], const double p[3])
{
    double to[3][3], length[3], normal[3];
    for (int k = 0; k < 3; k++) {
        for (int d = 0; d < 3; d++) to[k][d] = corners[k][d] - p[d];
        length[k] = pliant_length3(to[k]);
    }
    pliant_cross3(to[1], to[2], normal);
    return 2 * atan2(pliant_dot3(to[0], normal),
                     length[0] * length[1] * length[2] + pliant_dot3(to[0], to[1]) * length[2] +
                         pliant_dot3(to[1], to[2]) * length[0] + pliant_dot3(to[2], to[0]) * length[1]);
}

double pliant_triangle_tree_winding(const pliant_triangle_tree *tree, const double p[3])
{
    int32_t stack[DEEPEST];
    double sum = 0;
    int depth = 1;
    stack[0] = 0;
    while (depth > 0) {
        const tree_box *box = tree->box + stack[--depth];
        const double to[3] = {box->middle[0] - p[0], box->middle[1] - p[1], box->middle[2] - p[2]},
                     distance = pliant_length3(to);
        if (distance > far * box->radius) sum += pliant_dot3(box->area, to) / (distance * distance * distance);
        else if (box->child >= 0) {
            stack[depth++] = box->child;
            stack[depth++] = box->child + 1;
        } else
            for (int32_t n = 0; n < box->count; n++) {
                const int32_t t = tree->order[box->first + n];
                const double *const corners[3] = {corner(tree, t, 0), corner(tree, t, 1), corner(tree, t, 2)};
                sum += solid_angle(corners, p);
            }
    }
    return sum / (4 * pi);
}
