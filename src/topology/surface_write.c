/* A surface as a file. */
#include "base/fail.h"
#include "pliant/memory.h"
#include "pliant/surface.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

/* What is written of the points: nodes, then vertices. */
typedef struct surface_points {
    size_t count;
    int32_t *row;              /* (count) its row in the file; -1: it has none */
    int32_t num_rows;
    double *at, *rest, *value; /* (count x 3), (count x 3), (count x values) */
    uint16_t *material;        /* (count) */
} surface_points;

static void free_points(surface_points *points)
{
    pliant_free(points->row);
    pliant_free(points->at);
    pliant_free(points->rest);
    pliant_free(points->value);
    pliant_free(points->material);
}

/* numbers at nodes, and from them at vertices */
static void extend(const pliant_surface *surface, int size, const double *nodes, double *out)
{
    const size_t count = (size_t)size * (size_t)surface->body->fine.num_nodes;
    memcpy(out, nodes, count * sizeof *out);
    pliant_surface_at_vertices(surface, size, out, out + count);
}

static pliant_status find_points(const pliant_surface *surface, const double *positions, int num_values, const float *values, surface_points *out)
{
    const pliant_body *body = surface->body;
    const size_t nodes = (size_t)body->fine.num_nodes;
    out->count = nodes + (size_t)surface->num_vertices;
    out->row = pliant_calloc(out->count, sizeof *out->row);
    out->at = pliant_calloc(out->count, 3 * sizeof *out->at);
    out->rest = pliant_calloc(out->count, 3 * sizeof *out->rest);
    out->material = pliant_calloc(out->count, sizeof *out->material);
    if (num_values > 0) out->value = pliant_calloc(out->count, (size_t)num_values * sizeof *out->value);
    if (!out->row || !out->at || !out->rest || !out->material || (num_values > 0 && !out->value)) return pliant_fail_memory("the surface");
    extend(surface, 3, positions, out->at);
    extend(surface, 3, body->fine.rest, out->rest);
    for (size_t n = 0; num_values > 0 && n < nodes; n++)
        for (size_t v = 0; v < (size_t)num_values; v++) out->value[(size_t)num_values * n + v] = (double)values[v * nodes + n];
    if (num_values > 0) pliant_surface_at_vertices(surface, num_values, out->value, out->value + (size_t)num_values * nodes);
    for (int32_t t = body->fine.num_tets; t-- > 0;) /* of the first tetrahedron of every node */
        for (int v = 0; v < 4; v++) out->material[body->fine.tets[4 * (size_t)t + (size_t)v]] = body->fine_material[t].material;
    if (surface->num_vertices > 0) memcpy(out->material + nodes, surface->material, (size_t)surface->num_vertices * sizeof *out->material);
    for (int32_t v = 0; v < 3 * surface->num_triangles; v++) out->row[surface->triangle[v]] = 1;
    for (size_t n = 0; n < out->count; n++) out->row[n] = out->row[n] ? out->num_rows++ : -1;
    return PLIANT_OK;
}

static void write_header(FILE *file, const pliant_surface *surface, int32_t num_rows, int num_values, const char *const *names)
{
    static const char *const numbers[] = {"x", "y", "z", "rest_x", "rest_y", "rest_z"};
    fprintf(file, "ply\nformat ascii 1.0\ncomment metres, LPS\nelement vertex %d\n", (int)num_rows);
    for (size_t n = 0; n < sizeof numbers / sizeof *numbers; n++) fprintf(file, "property double %s\n", numbers[n]);
    fputs("property ushort material\n", file);
    for (int v = 0; v < num_values; v++) fprintf(file, "property float %s\n", names[v]);
    fprintf(file, "element face %d\nproperty list uchar int vertex_indices\nproperty uchar cut\nend_header\n", (int)surface->num_triangles);
}

pliant_status pliant_surface_write(const char *path, const pliant_surface *surface, const double *positions, int num_values,
                                   const char *const *names, const float *values)
{
    surface_points points = {0};
    pliant_status status = find_points(surface, positions, num_values, values, &points);
    FILE *file = status == PLIANT_OK ? fopen(path, "w") : NULL;
    if (status == PLIANT_OK && !file) status = pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    if (status == PLIANT_OK) {
        write_header(file, surface, points.num_rows, num_values, names);
        for (size_t n = 0; n < points.count; n++) {
            if (points.row[n] < 0) continue;
            const double *at = points.at + 3 * n, *rest = points.rest + 3 * n;
            fprintf(file, "%.9g %.9g %.9g %.9g %.9g %.9g %d", at[0], at[1], at[2], rest[0], rest[1], rest[2], (int)points.material[n]);
            for (size_t v = 0; v < (size_t)num_values; v++) fprintf(file, " %.6g", points.value[(size_t)num_values * n + v]);
            fputc('\n', file);
        }
        for (int32_t t = 0; t < surface->num_triangles; t++) {
            const int32_t *corner = surface->triangle + 3 * (size_t)t;
            fprintf(file, "3 %d %d %d %d\n", (int)points.row[corner[0]], (int)points.row[corner[1]], (int)points.row[corner[2]],
                    t >= surface->first_cut);
        }
        const int failed = ferror(file) | fclose(file);
        if (failed) status = pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    }
    free_points(&points);
    return status;
}
