#include "base/fail.h"
#include "base/memory.h"
#include "scan/phantom_anatomy.h"
#include "scan/volume.h"

#include <math.h>
#include <omp.h>
#include <string.h>

enum { SMALLEST = 16, LOWEST = -1024, HIGHEST = 3071, FLOAT_ARRAYS = 8 };

const char *pliant_phantom_label_name(int label)
{
    switch (label) {
#define NAME_CASE(id, name) \
    case id: return #name;
        PLIANT_PHANTOM_LIST(NAME_CASE)
#undef NAME_CASE
    }
    return "";
}

static pliant_geometry box_of(const int32_t size[3])
{
    const double box[3] = {PHANTOM_BOX_X * 1e-3, PHANTOM_BOX_Y * 1e-3, PHANTOM_BOX_Z * 1e-3};
    pliant_geometry geometry = {.direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    for (int d = 0; d < 3; ++d) {
        geometry.size[d] = size[d];
        geometry.spacing[d] = box[d] / size[d];
        geometry.origin[d] = 0.5 * (geometry.spacing[d] - box[d]);
    }
    return geometry;
}

static float cube_root(double volume)
{
    double edge = 1; /* edge^4 = volume edge */
    for (int n = 0; n < 40; ++n) edge = sqrt(sqrt(volume * edge));
    return (float)edge;
}

/* Allocate the arrays of a row in one block, which row->x owns. */
static bool row_create(phantom_row *row, const pliant_geometry *geometry)
{
    const int n = geometry->size[0];
    size_t length = (size_t)n;
    float *block = pliant_calloc(length * (FLOAT_ARRAYS + 2), sizeof(float));
    if (!block) return false;
    float **arrays[FLOAT_ARRAYS] = {&row->x, &row->position_x, &row->position_y, &row->position_z,
                                    &row->near, &row->second, &row->grain, &row->clump};
    for (size_t a = 0; a < FLOAT_ARRAYS; ++a) *arrays[a] = block + a * length;
    row->nearest = (int32_t *)(void *)(block + FLOAT_ARRAYS * length);
    row->tissue = (uint8_t *)(void *)(block + (FLOAT_ARRAYS + 1) * length);
    row->n = n;
    row->voxel = cube_root(1e9 * geometry->spacing[0] * geometry->spacing[1] * geometry->spacing[2]);
    return true;
}

static void row_place(phantom_row *row, const pliant_geometry *geometry, int j, int k)
{
    row->x_step = (float)(1e3 * geometry->spacing[0]);
    row->x_first = (float)(1e3 * geometry->origin[0]);
    row->y = (float)(1e3 * (geometry->origin[1] + geometry->spacing[1] * j));
    row->z = (float)(1e3 * (geometry->origin[2] + geometry->spacing[2] * k));
    for (int n = 0; n < row->n; ++n) {
        row->x[n] = row->position_x[n] = row->x_first + row->x_step * (float)n;
        row->position_y[n] = row->y;
        row->position_z[n] = row->z;
        row->grain[n] = row->clump[n] = 0;
    }
    /* The sum of the distortions is less than PHANTOM_BEND. */
    phantom_add_noise(row, 46, 1, 4.0f, row->position_x);
    phantom_add_noise(row, 46, 2, 4.0f, row->position_y);
    phantom_add_noise(row, 46, 3, 4.0f, row->position_z);
    phantom_add_noise(row, 14, 4, 1.2f, row->position_x);
    phantom_add_noise(row, 14, 5, 1.2f, row->position_y);
    phantom_add_noise(row, 2.5f, 6, 1, row->grain);
    phantom_add_noise(row, 9, 7, 1, row->clump);
}

/* Return approximately normal noise, the sum of four bytes. Its standard deviation is 24, and 11 after the blur. */
static int noise(int i, int j, int k, uint32_t seed)
{
    uint32_t bits = phantom_hash((uint32_t)i, (uint32_t)j, (uint32_t)k, seed ^ 0x5ca9u);
    int sum = (int)(bits & 255) + (int)(bits >> 8 & 255) + (int)(bits >> 16 & 255) + (int)(bits >> 24) - 510;
    return sum * 84 / 512;
}

/* Apply a scanner's blur, (1, 6, 1) / 8 along each axis. The offset keeps the dividend positive. */
static int16_t blurred(int before, int here, int after)
{
    return (int16_t)((before + 6 * here + after + 4 + 8 * 4096) / 8 - 4096);
}

static void blur_along(int16_t *line, int n)
{
    int before = line[0];
    for (int i = 0; i < n; ++i) {
        int here = line[i], after = i + 1 < n ? line[i + 1] : here;
        line[i] = blurred(before, here, after);
        before = here;
    }
}

/* Blur across `rows` rows of n voxels that are `stride` apart. scratch: (n). */
static void blur_across(int16_t *first, int n, ptrdiff_t stride, int rows, int16_t *scratch)
{
    memcpy(scratch, first, (size_t)n * sizeof *scratch);
    for (int r = 0; r < rows; ++r) {
        int16_t *row = first + r * stride, *next = r + 1 < rows ? row + stride : row;
        for (int i = 0; i < n; ++i) {
            int16_t here = row[i];
            row[i] = blurred(scratch[i], here, next[i]);
            scratch[i] = here;
        }
    }
}

static void clamp_row(int16_t *row, int n)
{
    for (int i = 0; i < n; ++i) row[i] = row[i] < LOWEST ? LOWEST : row[i] > HIGHEST ? HIGHEST : row[i];
}

static void draw(const phantom_anatomy *anatomy, const pliant_geometry *geometry, uint32_t seed, phantom_row *rows,
                 int16_t *values, uint16_t *labels)
{
    const int ni = geometry->size[0], nj = geometry->size[1], nk = geometry->size[2];
    const ptrdiff_t slice = (ptrdiff_t)ni * nj;
#pragma omp parallel for schedule(dynamic)
    for (int k = 0; k < nk; ++k) {
        phantom_row *row = &rows[omp_get_thread_num()];
        for (int j = 0; j < nj; ++j) {
            ptrdiff_t first = k * slice + (ptrdiff_t)j * ni;
            row->value = values + first;
            row_place(row, geometry, j, k);
            phantom_paint(anatomy, row);
            for (int i = 0; labels && i < ni; ++i) labels[first + i] = row->tissue[i];
            for (int i = 0; i < ni; ++i) row->value[i] = (int16_t)(row->value[i] + noise(i, j, k, seed));
            blur_along(row->value, ni);
        }
        blur_across(values + k * slice, ni, ni, nj, (int16_t *)(void *)row->near);
    }
#pragma omp parallel for schedule(static)
    for (int j = 0; j < nj; ++j) {
        phantom_row *row = &rows[omp_get_thread_num()];
        blur_across(values + (ptrdiff_t)j * ni, ni, slice, nk, (int16_t *)(void *)row->near);
        for (int k = 0; k < nk; ++k) clamp_row(values + k * slice + (ptrdiff_t)j * ni, ni);
    }
}

pliant_status pliant_phantom(const int32_t size[3], uint32_t seed, pliant_volume *scan, pliant_labels *labels)
{
    pliant_status status = PLIANT_OK;
    pliant_volume volume = {.voxels = NULL};
    pliant_labels map = {.voxels = NULL};
    phantom_row *rows = NULL;
    for (int d = 0; d < 3; ++d)
        if (size[d] < SMALLEST)
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "phantom: size %d x %d x %d: each must be at least %d", size[0],
                               size[1], size[2], SMALLEST);
    const pliant_geometry geometry = box_of(size);
    const int threads = omp_get_max_threads();
    phantom_anatomy *anatomy = pliant_calloc(1, sizeof *anatomy);
    rows = pliant_calloc((size_t)threads, sizeof *rows);
    bool good = anatomy && rows;
    for (int t = 0; good && t < threads; ++t) good = row_create(&rows[t], &geometry);
    if (!good) {
        status = pliant_fail_memory("the phantom's anatomy");
        goto end;
    }
    if (!phantom_anatomy_make(anatomy)) {
        status = pliant_fail(PLIANT_ERROR_ARGUMENT, "phantom: too many tubes; use fewer");
        goto end;
    }
    status = pliant_volume_create(&geometry, PLIANT_INT16, &volume);
    if (status == PLIANT_OK && labels) status = pliant_labels_create(&geometry, &map);
    if (status < 0) goto end;

    draw(anatomy, &geometry, seed, rows, volume.voxels, map.voxels);
    volume.slope = 1;
    volume.background = PHANTOM_AIR_VALUE;
    volume.modality = PLIANT_MODALITY_CT;
    strcpy(volume.id, "phantom");
    *scan = volume;
    volume.voxels = NULL;
    if (labels) *labels = map;
    map.voxels = NULL;
end:
    for (int t = 0; rows && t < threads; ++t) pliant_free(rows[t].x);
    pliant_free(rows);
    pliant_free(anatomy);
    pliant_volume_free(&volume);
    pliant_labels_free(&map);
    return status;
}
