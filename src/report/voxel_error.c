/* Compute the error in the warped image voxel by voxel ([H] figure 2). */
#include "base/fail.h"
#include "base/threads.h"
#include "mesh/mesh.h"
#include "model_data/data.h"
#include "base/memory.h"
#include "report/report.h"

#include <math.h>
#include <string.h>

typedef struct voxel_job {
    const pliant_model *model;
    const double *positions; /* positions of the displayed mesh */
    const pliant_mesh *reference_mesh;
    const double *reference;
    const pliant_geometry *target;
    float *out;
    uint8_t *drawn; /* (voxels) */
} voxel_job;

/* Return whether the scan's voxel nearest to a rest point is tissue. */
static bool is_tissue(const pliant_model *model, const double rest[3])
{
    const pliant_geometry *scan = &model->scan->geometry;
    double index[3];
    size_t at[3];
    pliant_geometry_to_index(scan, rest, index);
    for (int d = 0; d < 3; d++) at[d] = (size_t)fmin(fmax(floor(index[d] + 0.5), 0), scan->size[d] - 1);
    size_t voxel = at[0] + (size_t)scan->size[0] * (at[1] + (size_t)scan->size[1] * at[2]);
    return !model->materials.materials[model->material_of_voxel[voxel]].empty;
}

/* Find the position of a rest point in the reference; false: no tissue there. */
static bool reference_place(const voxel_job *job, const double rest[3], double out[3])
{
    double weight[4];
    int32_t tet = pliant_mesh_locate(job->reference_mesh, rest, weight);
    if (tet < 0) return false;
    for (int d = 0; d < 3; d++) {
        out[d] = 0;
        for (int v = 0; v < 4; v++)
            out[d] += weight[v] * job->reference[3 * job->reference_mesh->tets[4 * tet + v] + d];
    }
    return true;
}

/* Return the distance between the two positions of the tissue at barycentric coordinates of a tetrahedron; negative: no
 * tissue. */
static float distance(const voxel_job *job, const int32_t nodes[4], const double weight[4])
{
    double here[3] = {0, 0, 0}, rest[3] = {0, 0, 0}, there[3], squares = 0;
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++) {
            here[d] += weight[v] * job->positions[3 * nodes[v] + d];
            rest[d] += weight[v] * job->model->body->fine.rest[3 * nodes[v] + d];
        }
    if (!is_tissue(job->model, rest) || !reference_place(job, rest, there)) return -1;
    for (int d = 0; d < 3; d++) squares += (here[d] - there[d]) * (here[d] - there[d]);
    return (float)sqrt(squares);
}

/* Draw the voxels of one tetrahedron in the slices k0 <= k < k1. */
static void draw(const voxel_job *job, int32_t tet, int32_t k0, int32_t k1)
{
    const pliant_mesh *mesh = &job->model->body->fine;
    const int32_t *nodes = mesh->tets + 4 * tet, *size = job->target->size;
    double corner[4][3], low[3], high[3], gradients[12];
    for (int v = 0; v < 4; v++) {
        pliant_geometry_to_index(job->target, job->positions + 3 * nodes[v], corner[v]);
        for (int d = 0; d < 3; d++) {
            low[d] = v ? fmin(low[d], corner[v][d]) : corner[v][d];
            high[d] = v ? fmax(high[d], corner[v][d]) : corner[v][d];
        }
    }
    int32_t first[3], last[3];
    for (int d = 0; d < 3; d++) {
        first[d] = (int32_t)fmin(fmax(ceil(low[d] - 1e-9), d == 2 ? k0 : 0), size[d]);
        last[d] = (int32_t)fmax(fmin(floor(high[d] + 1e-9), d == 2 ? k1 - 1 : size[d] - 1), -1);
        if (first[d] > last[d]) return;
    }
    double volume = pliant_tet_gradients(corner[0], corner[1], corner[2], corner[3], gradients);
    double world_volume =
        pliant_tet_gradients(job->positions + 3 * nodes[0], job->positions + 3 * nodes[1],
                             job->positions + 3 * nodes[2], job->positions + 3 * nodes[3], (double[12]){0});
    if (volume == 0 || !(world_volume > 0)) return; /* a flat or inverted tetrahedron draws nothing, as in the warp */
    for (int32_t k = first[2]; k <= last[2]; k++)
        for (int32_t j = first[1]; j <= last[1]; j++)
            for (int32_t i = first[0]; i <= last[0]; i++) {
                size_t voxel = (size_t)i + (size_t)size[0] * ((size_t)j + (size_t)size[1] * (size_t)k);
                if (job->drawn[voxel]) continue;
                double weight[4] = {1, 0, 0, 0}, at[3] = {i - corner[0][0], j - corner[0][1], k - corner[0][2]};
                for (int v = 1; v < 4; v++) {
                    weight[v] = gradients[3 * v] * at[0] + gradients[3 * v + 1] * at[1] + gradients[3 * v + 2] * at[2];
                    weight[0] -= weight[v];
                }
                if (!(weight[0] >= -1e-9 && weight[1] >= -1e-9 && weight[2] >= -1e-9 && weight[3] >= -1e-9)) continue;
                job->drawn[voxel] = 1;
                job->out[voxel] = distance(job, nodes, weight);
            }
}

pliant_status pliant_error_voxels(const pliant_model *model, const double *positions, const pliant_mesh *reference_mesh,
                                  const double *reference, const pliant_geometry *target, pliant_volume *out)
{
    const pliant_mesh *mesh = &model->body->fine;
    pliant_volume volume = {0};
    uint8_t *drawn = pliant_calloc(pliant_geometry_voxels(target), 1);
    pliant_status status = drawn ? PLIANT_OK : pliant_fail_memory("the errors of the voxels");
    if (status == PLIANT_OK) status = pliant_volume_create(target, PLIANT_FLOAT32, &volume);
    if (status != PLIANT_OK) goto done;
    volume.slope = 1;
    volume.background = -1;
    memcpy(volume.id, "error", sizeof "error");
    float *voxels = volume.voxels;
    size_t size = pliant_geometry_voxels(target);
    for (size_t v = 0; v < size; v++) voxels[v] = -1;
    voxel_job job = {model, positions, reference_mesh, reference, target, voxels, drawn};
    /* the lowest tetrahedron wins in each slab, independently of the number of threads */
    enum { SLAB = 8 };
    const int threads = pliant_threads_or_cores(model->scene.solver.threads);
    int32_t slabs = (target->size[2] + SLAB - 1) / SLAB;
#pragma omp parallel for schedule(dynamic) num_threads(threads)
    for (int32_t s = 0; s < slabs; s++)
        for (int32_t t = 0; t < mesh->num_tets; t++)
            if (model->body->fine_material[t].tissue > 0)
                draw(&job, t, SLAB * s, SLAB * (s + 1) < target->size[2] ? SLAB * (s + 1) : target->size[2]);
    *out = volume;
done:
    pliant_free(drawn);
    return status;
}
