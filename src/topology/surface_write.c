/* Write a surface to a file. */
#include "base/fail.h"
#include "topology/surface_points.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

static void write_header(FILE *file, const pliant_surface *surface, double unit, int32_t num_rows, int num_values,
                         const char *const *names)
{
    static const char *const numbers[] = {"x", "y", "z", "rest_x", "rest_y", "rest_z"};
    fprintf(file, "ply\nformat ascii 1.0\ncomment %s, LPS\nelement vertex %d\n",
            unit == 1e-3 ? "millimetres" : "metres", (int)num_rows);
    for (size_t n = 0; n < sizeof numbers / sizeof *numbers; n++) fprintf(file, "property double %s\n", numbers[n]);
    fputs("property ushort material\n", file);
    for (int v = 0; v < num_values; v++) fprintf(file, "property float %s\n", names[v]);
    fprintf(file, "element face %d\nproperty list uchar int vertex_indices\nproperty uchar cut\nend_header\n",
            (int)surface->num_triangles);
}

pliant_status pliant_surface_write(const char *path, const pliant_surface *surface, const double *positions,
                                   double unit, int num_values, const char *const *names, const float *values)
{
    surface_points points = {0};
    if (!(unit == 1 || unit == 1e-3))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "%s: its unit is %g m; use 1 (metres) or 1e-3 (millimetres)", path,
                           unit);
    pliant_status status = pliant_surface_points_find(surface, positions, num_values, values, &points);
    FILE *file = status == PLIANT_OK ? fopen(path, "w") : NULL;
    if (status == PLIANT_OK && !file) status = pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    if (status == PLIANT_OK) {
        write_header(file, surface, unit, points.num_rows, num_values, names);
        for (size_t n = 0; n < points.count; n++) {
            if (points.row[n] < 0) continue;
            const double *at = points.at + 3 * n, *rest = points.rest + 3 * n;
            fprintf(file, "%.9g %.9g %.9g %.9g %.9g %.9g %d", at[0] / unit, at[1] / unit, at[2] / unit,
                    rest[0] / unit, rest[1] / unit, rest[2] / unit, (int)points.material[n]);
            for (size_t v = 0; v < (size_t)num_values; v++)
                fprintf(file, " %.6g", points.value[(size_t)num_values * n + v]);
            fputc('\n', file);
        }
        for (int32_t t = 0; t < surface->num_triangles; t++) {
            const int32_t *corner = surface->triangle + 3 * (size_t)t;
            fprintf(file, "3 %d %d %d %d\n", (int)points.row[corner[0]], (int)points.row[corner[1]],
                    (int)points.row[corner[2]], t >= surface->first_cut);
        }
        const int failed = ferror(file) | fclose(file);
        if (failed) status = pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    }
    pliant_surface_points_free(&points);
    return status;
}
