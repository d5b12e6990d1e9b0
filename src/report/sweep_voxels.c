/* Per-voxel error of a run's last frame: histogram and slices. */
#include "base/fail.h"
#include "model_data/data.h"
#include "base/memory.h"
#include "report/sweep.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { BINS = 40 };
static const double mm = 1e3;

static pliant_status write_histogram_rows(const sweep_result *result, const pliant_volume *error, report_row *key,
                                          pliant_error *summary)
{
    uint64_t counts[BINS];
    double width = result->ground->same[result->index].largest / BINS;
    pliant_results *table = result->ground->tables->histogram;
    pliant_status status = pliant_error_histogram(error, BINS, width > 0 ? width : 1e-3, counts, summary);
    for (int b = 0; status >= 0 && b < BINS; b++) {
        row_integer(key, b);
        bool known = row_is_stored(key, table);
        row_number(key, mm * width * b);
        row_number(key, b == BINS - 1 ? mm * fmax(summary->max, width * BINS) : mm * width * (b + 1));
        row_integer(key, (int64_t)counts[b]);
        if (!known) status = row_add(key, table);
        row_truncate(key, RUN_KEYS);
    }
    return status;
}

/* Build "ratio_method_submesh_..." from the key, for file names. */
static void name_of(const report_row *key, char *out, size_t size)
{
    size_t used = 0;
    for (int c = 1; c < RUN_KEYS; c++) {
        const char *text = key->text + key->start[c];
        if (!*text) continue;
        if (used && used + 1 < size) out[used++] = '_';
        for (; *text && used + 1 < size; text++) out[used++] = isalnum((unsigned char)*text) ? *text : '-';
    }
    out[used] = '\0';
}

static pliant_status write_plane(const pliant_volume *volume, int axis, const double at[3], const char *folder,
                                 const char *file, double spacing[2])
{
    char path[4096];
    int32_t size[2];
    float *values;
    if (snprintf(path, sizeof path, "%s/%s", folder, file) >= (int)sizeof path)
        return pliant_fail(PLIANT_ERROR_FILE, "%s: the name is too long", folder);
    pliant_status status = pliant_volume_plane(volume, axis, at, size, spacing, &values);
    if (status < 0) return status;
    status = report_write_npy(path, size, values);
    pliant_free(values);
    return status;
}

/* Choose the slice position: the grasped point, or the centre of the body, clamped to the volume. */
static void cut_point(const sweep_result *result, const pliant_geometry *geometry, double out[3])
{
    const double *last = result->run->positions + 3 * (size_t)(result->run->frames - 1) * (size_t)result->run->points;
    double index[3];
    memcpy(out, result->run->held_point, 3 * sizeof *out);
    if (!report_case_pulls(result->ground->cases[result->index].kind))
        for (int32_t p = 0; p < 3 * result->run->points; p++) out[p % 3] += last[p] / result->run->points;
    pliant_geometry_to_index(geometry, out, index);
    for (int d = 0; d < 3; d++) index[d] = fmin(fmax(index[d], 0), geometry->size[d] - 1);
    pliant_geometry_to_world(geometry, index, out);
}

static pliant_status write_slice_rows(const sweep_result *result, const pliant_volume *error, report_row *key)
{
    static const char *const planes[3] = {"sagittal", "coronal", "axial"};
    pliant_results *table = result->ground->tables->slices;
    char name[160], error_file[224], image_file[224];
    double at[3], spacing[2];
    cut_point(result, &error->geometry, at);
    name_of(key, name, sizeof name);
    for (int axis = 0; axis < 3; axis++) {
        snprintf(error_file, sizeof error_file, "error_%s_%s.npy", name, planes[axis]);
        snprintf(image_file, sizeof image_file, "image_%s_%s.npy", name, planes[axis]);
        pliant_status status = write_plane(error, axis, at, result->ground->folder, error_file, spacing);
        if (status >= 0)
            status = write_plane(pliant_warp_volume(result->run->data->warp), axis, at, result->ground->folder,
                                 image_file, spacing);
        if (status < 0) return status;
        row_text(key, planes[axis]);
        bool known = row_is_stored(key, table);
        row_number(key, mm * spacing[0]);
        row_number(key, mm * spacing[1]);
        row_number(key, mm * result->ground->same[result->index].largest);
        row_text(key, error_file);
        row_text(key, image_file);
        if (!known) status = row_add(key, table);
        row_truncate(key, RUN_KEYS);
        if (status < 0) return status;
    }
    return PLIANT_OK;
}

pliant_status sweep_write_voxel_rows(const sweep_result *result, report_row *key, pliant_error *summary)
{
    const sweep_ground *ground = result->ground;
    pliant_volume error;
    *summary = (pliant_error){.worst = -1};
    if (!result->run->data->warp) return PLIANT_OK;
    pliant_status status = pliant_error_voxels(result->model, result->run->data->positions, &ground->fine->body->fine,
                                               ground->same[result->index].last, &ground->target, &error);
    if (status < 0) return status;
    status = write_histogram_rows(result, &error, key, summary);
    if (status >= 0) status = write_slice_rows(result, &error, key);
    pliant_volume_free(&error);
    return status;
}
