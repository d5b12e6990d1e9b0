/* Collect the points of a surface for output files. */
#include "topology/surface_points.h"

#include "base/fail.h"
#include "base/memory.h"

#include <string.h>

void pliant_surface_points_free(surface_points *points)
{
    PLIANT_FREE(points->row, points->at, points->rest, points->value, points->material);
}

/* Interpolate vectors at nodes to the vertices. */
static void extend(const pliant_surface *surface, const double *nodes, double *out)
{
    const size_t count = 3 * (size_t)surface->body->fine.num_nodes;
    memcpy(out, nodes, count * sizeof *out);
    pliant_surface_at_vertices(surface, 3, out, out + count);
}

pliant_status pliant_surface_points_find(const pliant_surface *surface, const double *positions, int num_values,
                                         const float *values, surface_points *out)
{
    const pliant_body *body = surface->body;
    const size_t nodes = (size_t)body->fine.num_nodes;
    out->count = nodes + (size_t)surface->num_vertices;
    out->row = pliant_calloc(out->count, sizeof *out->row);
    out->at = pliant_calloc(out->count, 3 * sizeof *out->at);
    out->rest = pliant_calloc(out->count, 3 * sizeof *out->rest);
    out->material = pliant_calloc(out->count, sizeof *out->material);
    if (num_values > 0) out->value = pliant_calloc(out->count, (size_t)num_values * sizeof *out->value);
    if (!out->row || !out->at || !out->rest || !out->material || (num_values > 0 && !out->value))
        return pliant_fail_memory("the surface");
    extend(surface, positions, out->at);
    extend(surface, body->fine.rest, out->rest);
    for (size_t n = 0; num_values > 0 && n < nodes; n++)
        for (size_t v = 0; v < (size_t)num_values; v++)
            out->value[(size_t)num_values * n + v] = (double)values[v * nodes + n];
    if (num_values > 0)
        pliant_surface_at_vertices(surface, num_values, out->value, out->value + (size_t)num_values * nodes);
    /* in descending order, so that the first tetrahedron of each node is used */
    for (int32_t t = body->fine.num_tets; t-- > 0;)
        for (int v = 0; v < 4; v++)
            out->material[body->fine.tets[4 * (size_t)t + (size_t)v]] = body->fine_material[t].material;
    if (surface->num_vertices > 0)
        memcpy(out->material + nodes, surface->material, (size_t)surface->num_vertices * sizeof *out->material);
    for (int32_t v = 0; v < 3 * surface->num_triangles; v++) out->row[surface->triangle[v]] = 1;
    for (size_t n = 0; n < out->count; n++) out->row[n] = out->row[n] ? out->num_rows++ : -1;
    return PLIANT_OK;
}
