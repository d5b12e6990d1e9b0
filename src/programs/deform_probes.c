#include "deform_probes.h"

#include "base/fail.h"
#include "base/memory.h"

#include <errno.h>
#include <string.h>

/* Update the probes for the current mesh after a cut. */
static pliant_status follow(deform_probes *probes, const pliant_path *path, const pliant_body *body)
{
    pliant_points points;
    double *at = pliant_calloc(path->num_probes, 3 * sizeof *at);
    if (!at) return pliant_fail_memory("the probes");
    for (uint32_t n = 0; n < path->num_probes; ++n) memcpy(at + 3 * n, path->probes[n].at, 3 * sizeof *at);
    pliant_status status = pliant_points_create(&body->fine, (int32_t)path->num_probes, at, &points);
    pliant_free(at);
    if (status < 0) return status;
    pliant_points_free(&probes->points);
    probes->points = points;
    probes->revision = body->revision;
    return PLIANT_OK;
}

pliant_status deform_probes_add(deform_probes *probes, const pliant_path *path, const pliant_data *data, double time)
{
    const pliant_body *body = pliant_data_get_body(data);
    if (!probes->file) return PLIANT_OK;
    pliant_status status = body->revision == probes->revision ? PLIANT_OK : follow(probes, path, body);
    double *now = status < 0 ? NULL : pliant_calloc(path->num_probes, 3 * sizeof *now);
    if (!now) return status < 0 ? status : pliant_fail_memory("the probes");
    pliant_points_move(&probes->points, pliant_data_get_positions(data, NULL), now);
    for (uint32_t n = 0; n < path->num_probes; ++n) {
        const double *rest = path->probes[n].at, *to = now + 3 * n;
        fprintf(probes->file, "%.9g,%s,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g\n", time, path->probes[n].name, to[0], to[1],
                to[2], to[0] - rest[0], to[1] - rest[1], to[2] - rest[2]);
    }
    pliant_free(now);
    return PLIANT_OK;
}

pliant_status deform_probes_start(const char *folder, const pliant_path *path, const pliant_data *data,
                                  deform_probes *out)
{
    char name[4096];
    *out = (deform_probes){.file = NULL};
    if (path->num_probes == 0) return PLIANT_OK;
    deform_probes probes = *out;
    pliant_status status = follow(&probes, path, pliant_data_get_body(data));
    for (uint32_t n = 0; status >= 0 && n < path->num_probes; ++n) {
        const double *at = path->probes[n].at;
        if (!probes.points.found[n])
            status = pliant_fail(PLIANT_ERROR_ARGUMENT, "probe %s: there is no tissue at (%.4f %.4f %.4f) m",
                                 path->probes[n].name, at[0], at[1], at[2]);
    }
    snprintf(name, sizeof name, "%s/probes.csv", folder);
    if (status >= 0 && !(probes.file = fopen(name, "w")))
        status = pliant_fail(PLIANT_ERROR_FILE, "%s: %s", name, strerror(errno));
    if (status >= 0) {
        fputs("time_s,probe,x_m,y_m,z_m,moved_x_m,moved_y_m,moved_z_m\n", probes.file);
        status = deform_probes_add(&probes, path, data, 0.0);
    }
    *out = probes;
    return status;
}

pliant_status deform_probes_end(deform_probes *probes)
{
    FILE *file = probes->file;
    pliant_points_free(&probes->points);
    probes->file = NULL;
    if (!file) return PLIANT_OK;
    int failed = ferror(file) | fclose(file);
    return failed ? pliant_fail(PLIANT_ERROR_FILE, "probes.csv could not be written completely: %s", strerror(errno))
                  : PLIANT_OK;
}
