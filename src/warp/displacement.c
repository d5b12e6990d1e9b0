/* Compute the displacement of every voxel. */
#include "pliant/displacement.h"

#include "base/fail.h"
#include "base/free_memory.h"
#include "base/threads.h"
#include "base/memory.h"
#include "mesh/mesh.h"
#include "scan/write.h"
#include "model_data/model.h"
#include "warp/near_cut.h"
#include "warp/warp.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

static const float no_tissue = -1; /* a scan index that no voxel has */

void pliant_displacement_free(pliant_displacement *displacement)
{
    if (!displacement) return;
    pliant_free(displacement->vectors);
    pliant_free(displacement->mask);
    memset(displacement, 0, sizeof *displacement);
}

static pliant_status allocate(const pliant_geometry *grid, pliant_displacement *out)
{
    const size_t count = pliant_geometry_voxels(grid);
    pliant_status status =
        pliant_memory_check((double)count * (3.0 * sizeof *out->vectors + 1), "the displacement field");
    if (status != PLIANT_OK) return status;
    *out = (pliant_displacement){
        .geometry = *grid, .vectors = pliant_calloc(count, 3 * sizeof *out->vectors), .mask = pliant_calloc(count, 1)};
    if (out->vectors && out->mask) return PLIANT_OK;
    pliant_displacement_free(out);
    return pliant_fail_memory("the displacement field");
}

/* --- sense RESAMPLE: the warp of a volume whose values are its own voxel indices --- */

static void fill_with_index(int axis, pliant_volume *volume)
{
    const int32_t *size = volume->geometry.size;
    float *voxel = volume->voxels;
    for (int32_t k = 0; k < size[2]; k++)
        for (int32_t j = 0; j < size[1]; j++)
            for (int32_t i = 0; i < size[0]; i++) *voxel++ = (float)(axis == 0 ? i : axis == 1 ? j : k);
}

/* Find the index in the scan, along one axis, of the tissue that every voxel of the target shows. */
static pliant_status find_rest_index(const pliant_model *model, const pliant_body *body, const double *positions,
                                     int axis, const pliant_volume *index_of_voxel, pliant_displacement *out)
{
    pliant_warp *warp;
    pliant_status status = pliant_warp_create(index_of_voxel, &body->fine, &out->geometry,
                                              pliant_threads_or_cores(model->scene.solver.threads), &warp);
    if (status != PLIANT_OK) return status;
    if (body->cuts) status = pliant_warp_set_body(warp, body);
    if (status == PLIANT_OK && model->scene.warp.kind == PLIANT_FIT)
        status = pliant_warp_fit(warp, PLIANT_FIT_STEP);
    if (status == PLIANT_OK) status = pliant_warp_update(warp, positions);
    if (status == PLIANT_OK) {
        const float *index = pliant_warp_volume(warp)->voxels;
        const size_t count = pliant_geometry_voxels(&out->geometry);
        for (size_t v = 0; v < count; v++) out->vectors[3 * v + (size_t)axis] = index[v];
    }
    pliant_warp_free(warp);
    return status;
}

static pliant_status find_rest_indices(const pliant_model *model, const pliant_body *body, const double *positions,
                                       pliant_displacement *out)
{
    pliant_volume index;
    pliant_status status = pliant_volume_create(&model->scan->geometry, PLIANT_FLOAT32, &index);
    if (status != PLIANT_OK) return status;
    index.slope = 1;
    index.background = no_tissue;
    for (int axis = 0; status == PLIANT_OK && axis < 3; axis++) {
        fill_with_index(axis, &index);
        status = find_rest_index(model, body, positions, axis, &index, out);
    }
    pliant_volume_free(&index);
    return status;
}

static void find_voxel(const pliant_geometry *grid, size_t voxel, double index[3])
{
    const size_t across = (size_t)grid->size[0], down = (size_t)grid->size[1];
    index[0] = (double)(voxel % across);
    index[1] = (double)(voxel / across % down);
    index[2] = (double)(voxel / across / down);
}

/* Convert indices in the scan to vectors. near_cut: (voxels of the scan) */
static void indices_to_vectors(const pliant_geometry *scan, const uint8_t *near_cut, int num_threads,
                               pliant_displacement *out)
{
    const size_t count = pliant_geometry_voxels(&out->geometry);
#pragma omp parallel for num_threads(num_threads) schedule(static)
    for (size_t v = 0; v < count; v++) {
        float *vector = out->vectors + 3 * v;
        if (vector[0] == no_tissue) continue;
        double here[3], rest[3], index[3] = {vector[0], vector[1], vector[2]};
        const size_t i = (size_t)lrint(index[0]), j = (size_t)lrint(index[1]), k = (size_t)lrint(index[2]);
        out->mask[v] = near_cut[i + (size_t)scan->size[0] * (j + (size_t)scan->size[1] * k)] ? PLIANT_MASK_CUT
                                                                                             : PLIANT_MASK_TISSUE;
        pliant_geometry_to_world(scan, index, rest);
        find_voxel(&out->geometry, v, index);
        pliant_geometry_to_world(&out->geometry, index, here);
        for (int d = 0; d < 3; d++) vector[d] = (float)(rest[d] - here[d]);
    }
}

/* --- sense TISSUE: every voxel moves with the fine tetrahedron that owns it --- */

static bool is_inside(const double barycentric[4])
{
    const double rounding = 1e-9;
    return barycentric[0] >= -rounding && barycentric[1] >= -rounding && barycentric[2] >= -rounding &&
           barycentric[3] >= -rounding;
}

/* The first tetrahedron that holds a voxel at rest owns it, as in the warp. */
static void claim_voxels(const pliant_mesh *mesh, int32_t tet, const pliant_geometry *grid, int32_t *owner)
{
    int32_t low[3], high[3];
    for (int d = 0; d < 3; d++) low[d] = INT32_MAX, high[d] = -1;
    for (int v = 0; v < 4; v++) {
        double index[3];
        pliant_geometry_to_index(grid, mesh->rest + 3 * (size_t)mesh->tets[4 * (size_t)tet + (size_t)v], index);
        for (int d = 0; d < 3; d++) {
            const double last = grid->size[d] - 1.0;
            const int32_t below = (int32_t)fmax(fmin(floor(index[d]), last), 0),
                          above = (int32_t)fmax(fmin(ceil(index[d]), last), 0);
            low[d] = below < low[d] ? below : low[d];
            high[d] = above > high[d] ? above : high[d];
        }
    }
    for (int32_t k = low[2]; k <= high[2]; k++)
        for (int32_t j = low[1]; j <= high[1]; j++)
            for (int32_t i = low[0]; i <= high[0]; i++) {
                const size_t v = (size_t)i + (size_t)grid->size[0] * ((size_t)j + (size_t)grid->size[1] * (size_t)k);
                double world[3], barycentric[4];
                if (owner[v] >= 0) continue;
                pliant_geometry_to_world(grid, (const double[3]){i, j, k}, world);
                pliant_mesh_barycentric(mesh, tet, world, barycentric);
                if (is_inside(barycentric)) owner[v] = tet;
            }
}

/* The voxel of the scan that is nearest to a voxel of the grid. */
static int32_t nearest_in_scan(const pliant_geometry *scan, const pliant_geometry *grid, size_t voxel)
{
    double index[3], world[3];
    int32_t at[3];
    find_voxel(grid, voxel, index);
    pliant_geometry_to_world(grid, index, world);
    pliant_geometry_to_index(scan, world, index);
    for (int d = 0; d < 3; d++) at[d] = (int32_t)lrint(fmax(fmin(index[d], scan->size[d] - 1.0), 0));
    return at[0] + scan->size[0] * (at[1] + scan->size[1] * at[2]);
}

/* Fragments of a cut tetrahedron have its whole shape: a voxel of the scan belongs to one of them. */
static void find_owners(const pliant_body *body, const pliant_geometry *scan, const pliant_geometry *grid,
                        int32_t *owner)
{
    const size_t count = pliant_geometry_voxels(grid);
    for (size_t v = 0; v < count; v++) owner[v] = -1;
    for (int32_t t = 0; t < body->fine.num_tets; t++) claim_voxels(&body->fine, t, grid, owner);
    for (size_t v = 0; body->cuts && v < count; v++)
        if (owner[v] >= 0) owner[v] = pliant_voxels_fragment(body->voxels, body->cuts, nearest_in_scan(scan, grid, v));
}

static pliant_status move_voxels(const pliant_model *model, const pliant_body *body, const double *positions,
                                 const uint8_t *near_cut, int num_threads, pliant_displacement *out)
{
    const pliant_mesh *mesh = &body->fine;
    const size_t count = pliant_geometry_voxels(&out->geometry);
    int32_t *owner = pliant_calloc(count, sizeof *owner);
    if (!owner) return pliant_fail_memory("the displacement field");
    find_owners(body, &model->scan->geometry, &out->geometry, owner);
#pragma omp parallel for num_threads(num_threads) schedule(static)
    for (size_t v = 0; v < count; v++) {
        if (owner[v] < 0) continue;
        const int32_t *node = mesh->tets + 4 * (size_t)owner[v];
        double index[3], world[3], barycentric[4];
        find_voxel(&out->geometry, v, index);
        pliant_geometry_to_world(&out->geometry, index, world);
        pliant_mesh_barycentric(mesh, owner[v], world, barycentric);
        for (int d = 0; d < 3; d++) {
            double there = 0;
            for (int c = 0; c < 4; c++) there += barycentric[c] * positions[3 * (size_t)node[c] + (size_t)d];
            out->vectors[3 * v + (size_t)d] = (float)(there - world[d]);
        }
        out->mask[v] = near_cut[v] ? PLIANT_MASK_CUT : PLIANT_MASK_TISSUE;
    }
    pliant_free(owner);
    return PLIANT_OK;
}

/* --- both --- */

/* Voxels without tissue take the vector of the nearest tissue, in steps along the axes. Without tissue at all, vectors
 * are zero. */
static pliant_status extend(pliant_displacement *out)
{
    const int32_t *size = out->geometry.size;
    const size_t count = pliant_geometry_voxels(&out->geometry),
                 step[3] = {1, (size_t)size[0], (size_t)size[0] * (size_t)size[1]};
    size_t *queue = pliant_calloc(count, sizeof *queue), queued = 0;
    uint8_t *done = pliant_calloc(count, 1);
    const bool good = queue && done;
    for (size_t v = 0; good && v < count; v++) {
        done[v] = out->mask[v] != PLIANT_MASK_NO_TISSUE;
        if (done[v]) queue[queued++] = v;
        else memset(out->vectors + 3 * v, 0, 3 * sizeof *out->vectors);
    }
    for (size_t n = 0; good && n < queued; n++) {
        const size_t v = queue[n];
        const int32_t at[3] = {(int32_t)(v % step[1]), (int32_t)(v / step[1] % (size_t)size[1]),
                               (int32_t)(v / step[2])};
        for (int side = 0; side < 6; side++) {
            const int d = side / 2;
            if (side % 2 ? at[d] + 1 >= size[d] : at[d] == 0) continue;
            const size_t next = side % 2 ? v + step[d] : v - step[d];
            if (done[next]) continue;
            done[next] = 1;
            memcpy(out->vectors + 3 * next, out->vectors + 3 * v, 3 * sizeof *out->vectors);
            queue[queued++] = next;
        }
    }
    pliant_free(queue);
    pliant_free(done);
    return good ? PLIANT_OK : pliant_fail_memory("the displacement field");
}

static pliant_status fill(const pliant_model *model, const pliant_body *body, const double *positions,
                          pliant_displacement_sense sense, pliant_displacement *out)
{
    /* In voxels. Interpolation mixes voxels that are one voxel apart; a rest point is up to half a voxel from the
     * nearest voxel of the scan. */
    const double near_field = 1, near_rest = 1.5;
    const pliant_geometry *scan = &model->scan->geometry;
    const int num_threads = pliant_threads_or_cores(model->scene.solver.threads);
    const bool resample = sense == PLIANT_DISPLACEMENT_RESAMPLE;
    pliant_surface *surface = NULL;
    const pliant_geometry *at_rest = resample ? scan : &out->geometry;
    uint8_t *near_cut = pliant_calloc(pliant_geometry_voxels(at_rest), 1);
    pliant_status status = near_cut ? PLIANT_OK : pliant_fail_memory("the displacement field");
    if (status == PLIANT_OK) status = pliant_surface_create(body, NULL, &surface);
    if (status == PLIANT_OK)
        status =
            pliant_near_cut_mark(surface, body->fine.rest, at_rest, resample ? near_rest : near_field, near_cut, 1);
    if (status == PLIANT_OK && resample) {
        status = find_rest_indices(model, body, positions, out);
        if (status == PLIANT_OK) indices_to_vectors(scan, near_cut, num_threads, out);
    } else if (status == PLIANT_OK) {
        status = move_voxels(model, body, positions, near_cut, num_threads, out);
    }
    if (status == PLIANT_OK) status = extend(out);
    if (status == PLIANT_OK && resample)
        status = pliant_near_cut_mark(surface, positions, &out->geometry, near_field, out->mask, PLIANT_MASK_CUT);
    pliant_surface_free(surface);
    pliant_free(near_cut);
    return status;
}

pliant_status pliant_displacement_create(const pliant_model *model, const pliant_body *body, const double *positions,
                                         pliant_displacement_sense sense, const pliant_geometry *target,
                                         pliant_displacement *out)
{
    const pliant_mesh *rest = &model->body->fine;
    pliant_geometry grid = model->scan->geometry;
    pliant_displacement field = {0};
    for (size_t n = 0; n < 3 * (size_t)body->fine.num_nodes; n++)
        if (!isfinite(positions[n]))
            return pliant_fail(PLIANT_ERROR_ARGUMENT,
                               "the position of node %zu is not finite: there is no displacement field of it", n / 3);
    pliant_status status = PLIANT_OK;
    if (target) grid = *target;
    else if (sense == PLIANT_DISPLACEMENT_RESAMPLE)
        status = pliant_warp_target(&model->scan->geometry, rest->rest, rest->num_nodes, model->scene.warp.margin,
                                    SIZE_MAX, &grid);
    if (status == PLIANT_OK) status = allocate(&grid, &field);
    if (status == PLIANT_OK) status = fill(model, body, positions, sense, &field);
    if (status == PLIANT_OK) *out = field;
    else pliant_displacement_free(&field);
    return status;
}

/* u.nii.gz: u_mask.nii.gz; false: too long */
static bool find_mask_path(const char *path, char out[PATH_MAX])
{
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path, *dot = strrchr(name, '.');
    size_t stem = dot ? (size_t)(dot - path) : strlen(path);
    if (dot && dot - name > 4 && strcasecmp(dot - 4, ".nii.gz") == 0) stem -= 4;
    return snprintf(out, PATH_MAX, "%.*s_mask%s", (int)stem, path, path + stem) < PATH_MAX;
}

pliant_status pliant_displacement_write(const char *path, const pliant_displacement *displacement)
{
    const double millimetres = 1e3;
    char mask_path[PATH_MAX];
    pliant_status status = pliant_vectors_write(path, &displacement->geometry, millimetres, displacement->vectors);
    if (status != PLIANT_OK) return status;
    if (!find_mask_path(path, mask_path))
        return pliant_fail(PLIANT_ERROR_FILE, "%s: the path of its mask is too long; use a shorter path", path);
    pliant_volume mask = {
        .geometry = displacement->geometry, .encoding = PLIANT_UINT8, .slope = 1, .voxels = displacement->mask};
    return pliant_volume_write(mask_path, &mask);
}
