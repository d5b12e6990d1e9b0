/* How far a tool's tip is from the tissue. */
#include "contact/shapes/solid.h"
#include "pliant/cut.h"
#include "state/data.h"

#include <math.h>

static double squared_distance(const double p[3], const double *a, const double *b, const double *c)
{
    double nearest[3], sum = 0;
    pliant_triangle_nearest(a, b, c, p, nearest);
    for (int d = 0; d < 3; d++) sum += (p[d] - nearest[d]) * (p[d] - nearest[d]);
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
