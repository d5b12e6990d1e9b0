/* The part of a swept strip in a tetrahedron. */
#include "cut/subdivide.h"

#include "base/vector3.h"

#include <string.h>

enum { MAX_CORNERS = 16 }; /* of a triangle clipped by four planes, also if rounding makes it concave: 13 */

/* Clip a polygon by a half-space. Return its number of corners. */
static int clip(double polygon[][3], int count, const double normal[3], double offset)
{
    double kept[MAX_CORNERS][3], height[MAX_CORNERS];
    int number = 0;
    for (int i = 0; i < count; i++) height[i] = pliant_dot3(normal, polygon[i]) - offset;
    for (int i = 0; i < count; i++) {
        const int j = (i + 1) % count;
        if (height[i] >= 0) memcpy(kept[number++], polygon[i], sizeof kept[0]);
        if ((height[i] >= 0) == (height[j] >= 0)) continue;
        for (int d = 0; d < 3; d++)
            kept[number][d] = polygon[i][d] + height[i] / (height[i] - height[j]) * (polygon[j][d] - polygon[i][d]);
        number++;
    }
    memcpy(polygon, kept, (size_t)number * sizeof kept[0]);
    return number;
}

/* The half-spaces of a tetrahedron's faces, with inner unit normals. */
typedef struct half_spaces {
    double normal[4][3], offset[4];
} half_spaces;

static bool find_half_spaces(const double *corner[4], double slack, half_spaces *out)
{
    for (int c = 0; c < 4; c++) {
        const double *a = corner[(c + 1) % 4];
        double u[3], v[3], height;
        pliant_subtract3(corner[(c + 2) % 4], a, u);
        pliant_subtract3(corner[(c + 3) % 4], a, v);
        pliant_cross3(u, v, out->normal[c]);
        if (!(pliant_normalize3(out->normal[c]) > 0)) return false;
        height = pliant_dot3(out->normal[c], corner[c]) - pliant_dot3(out->normal[c], a);
        for (int d = 0; d < 3 && height < 0; d++) out->normal[c][d] = -out->normal[c][d];
        out->offset[c] = pliant_dot3(out->normal[c], a) - slack;
    }
    return true;
}

/* Return whether a segment has a part in a tetrahedron. */
static bool passes_inside(const half_spaces *inside, const double *from, const double *to)
{
    double first = 0, last = 1;
    for (int c = 0; c < 4 && first < last; c++) {
        const double a = pliant_dot3(inside->normal[c], from) - inside->offset[c],
                     b = pliant_dot3(inside->normal[c], to) - inside->offset[c];
        if (a < 0 && b < 0) return false;
        if (a < 0) first = fmax(first, a / (a - b));
        if (b < 0) last = fmin(last, a / (a - b));
    }
    return first < last;
}

int32_t pliant_split_border(const cut_splitting *work, int border, int32_t index, const double *end[2])
{
    const pliant_cut_sweep *sweep = work->sweep;
    const bool is_side = border == CUT_FIRST_SIDE || border == CUT_LAST_SIDE;
    const int32_t row = border == CUT_LAST_SIDE ? sweep->count - 1 : index;
    end[0] = (border == CUT_END ? sweep->to : sweep->from) + 3 * row;
    end[1] = is_side ? sweep->to + 3 * row : end[0] + 3;
    return is_side ? 1 : sweep->count - 1;
}

static bool contains_border(const cut_splitting *work, const half_spaces *inside)
{
    const double *end[2];
    for (int border = 0; border < CUT_NUM_BORDERS; border++)
        for (int32_t i = 0; work->has_border[border] && i < pliant_split_border(work, border, i, end); i++)
            if (passes_inside(inside, end[0], end[1])) return true;
    return false;
}

bool pliant_split_enters(const cut_splitting *work, int32_t tet, double distance[4], bool *at_border)
{
    const double *corner[4], minimum = work->body->subdivision->min_edge;
    double sum[3] = {0}, middle[3] = {0}, area = 0;
    half_spaces inside;
    for (int v = 0; v < 4; v++) corner[v] = work->positions + 3 * (size_t)work->corners[4 * (size_t)tet + (size_t)v];
    if (!find_half_spaces(corner, work->slack, &inside)) return false;
    for (int32_t n = 0; n < work->strip->count; n++) {
        double polygon[MAX_CORNERS][3];
        int count = 3;
        memcpy(polygon, work->strip->triangles[n].corner, sizeof work->strip->triangles[n].corner);
        for (int c = 0; c < 4 && count > 0; c++) count = clip(polygon, count, inside.normal[c], inside.offset[c]);
        for (int i = 2; i < count; i++) {
            double u[3], v[3], normal[3];
            pliant_subtract3(polygon[i - 1], polygon[0], u);
            pliant_subtract3(polygon[i], polygon[0], v);
            pliant_cross3(u, v, normal);
            const double part = 0.5 * pliant_length3(normal);
            area += part;
            for (int d = 0; d < 3; d++) {
                sum[d] += normal[d];
                middle[d] += part * (polygon[0][d] + polygon[i - 1][d] + polygon[i][d]) / 3;
            }
        }
    }
    if (!(area > 1e-3 * minimum * minimum) || !(pliant_normalize3(sum) > 0)) return false;
    *at_border = contains_border(work, &inside);
    for (int v = 0; v < 4; v++) distance[v] = pliant_dot3(sum, corner[v]) - pliant_dot3(sum, middle) / area;
    return true;
}

bool pliant_split_passes(const cut_splitting *work, int32_t node)
{
    const double *x = work->positions + 3 * (size_t)node;
    for (int32_t n = 0; n < work->strip->count; n++) {
        const cut_triangle *triangle = work->strip->triangles + n;
        double normal[3], from[3];
        memcpy(normal, triangle->normal, sizeof normal);
        pliant_normalize3(normal);
        pliant_subtract3(x, triangle->corner, from);
        /* between the planes of two triangles, a node next to the strip is in front of neither */
        const double margin = work->slack + 0.25 * fabs(pliant_dot3(normal, from));
        bool inside = true;
        for (int c = 0; c < 3 && inside; c++) {
            const double *a = triangle->corner + 3 * c, *b = triangle->corner + 3 * ((c + 1) % 3);
            double along[3], inner[3];
            pliant_subtract3(b, a, along);
            pliant_subtract3(x, a, from);
            pliant_cross3(normal, along, inner);
            inside = pliant_dot3(inner, from) >= -margin * pliant_length3(along);
        }
        if (inside) return true;
    }
    return false;
}
