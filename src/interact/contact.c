/* How far a tool's tip is from the tissue. */
#include "pliant/cut.h"
#include "state/data.h"

#include <math.h>

static double dot3(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* squared distance from p to a triangle, by the region of the plane that p projects into (Ericson, Real-Time Collision
 * Detection, 5.1.5) */
static double squared_distance(const double p[3], const double *a, const double *b, const double *c)
{
    double ab[3], ac[3], ap[3], bp[3], cp[3];
    for (int d = 0; d < 3; d++) {
        ab[d] = b[d] - a[d];
        ac[d] = c[d] - a[d];
        ap[d] = p[d] - a[d];
        bp[d] = p[d] - b[d];
        cp[d] = p[d] - c[d];
    }
    double d1 = dot3(ab, ap), d2 = dot3(ac, ap), d3 = dot3(ab, bp), d4 = dot3(ac, bp), d5 = dot3(ab, cp), d6 = dot3(ac, cp);
    double va = d3 * d6 - d5 * d4, vb = d5 * d2 - d1 * d6, vc = d1 * d4 - d3 * d2, v = 0, w = 0;
    if (d1 <= 0 && d2 <= 0) {
        v = w = 0;
    } else if (d3 >= 0 && d4 <= d3) {
        v = 1;
    } else if (d6 >= 0 && d5 <= d6) {
        w = 1;
    } else if (vc <= 0 && d1 >= 0 && d3 <= 0) {
        v = d1 > d3 ? d1 / (d1 - d3) : 0;
    } else if (vb <= 0 && d2 >= 0 && d6 <= 0) {
        w = d2 > d6 ? d2 / (d2 - d6) : 0;
    } else if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) {
        double along = d4 - d3 + d5 - d6;
        w = along > 0 ? (d4 - d3) / along : 0;
        v = 1 - w;
    } else {
        double area = va + vb + vc;
        v = vb / area;
        w = vc / area;
    }
    double sum = 0;
    for (int d = 0; d < 3; d++) {
        double apart = ap[d] - v * ab[d] - w * ac[d];
        sum += apart * apart;
    }
    return sum;
}

double pliant_tool_clearance(const pliant_model *model, const pliant_data *data, int tool)
{
    (void)model;
    if (tool < 0 || tool >= data->num_tools || !data->tools[tool].present) return INFINITY;
    const double *tip = data->tools[tool].tip;
    double nearest = INFINITY, barycentric[4];
    for (int32_t t = 0; t < data->body->num_triangles; t++) {
        const int32_t *nodes = data->body->triangles + 3 * t;
        nearest = fmin(nearest, squared_distance(tip, data->positions + 3 * nodes[0], data->positions + 3 * nodes[1],
                                                 data->positions + 3 * nodes[2]));
    }
    int32_t tet;
    bool inside = data->body->cuts ? pliant_body_locate(data->body, data->positions, tip, &tet, barycentric)
                                   : pliant_mesh_locate_deformed(&data->body->fine, data->positions, tip, barycentric) >= 0;
    return inside ? -sqrt(nearest) : sqrt(nearest);
}
