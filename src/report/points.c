/* Locate the same tissue points in different meshes. */
#include "base/fail.h"
#include "mesh/mesh.h"
#include "model_data/data.h"
#include "base/memory.h"
#include "report/report.h"

#include <math.h>

pliant_status pliant_body_points(const pliant_model *model, int32_t *count, double **rest)
{
    const pliant_mesh *fine = &model->body->fine;
    uint8_t *body = pliant_calloc((size_t)fine->num_nodes, 1);
    double *points = NULL;
    int32_t number = 0;
    if (!body) return pliant_fail_memory("the points of the mesh");
    for (int32_t t = 0; t < fine->num_tets; t++)
        if (model->body->fine_material[t].tissue > 0)
            for (int v = 0; v < 4; v++) body[fine->tets[4 * t + v]] = 1;
    for (int32_t n = 0; n < fine->num_nodes; n++) number += body[n];
    pliant_status status =
        number > 0 ? PLIANT_OK : pliant_fail(PLIANT_ERROR_SCENE, "the mesh has no tissue: there is nothing to compare");
    if (status == PLIANT_OK) {
        points = pliant_calloc((size_t)number, 3 * sizeof *points);
        if (!points) status = pliant_fail_memory("the points of the mesh");
    }
    if (status == PLIANT_OK) {
        int32_t next = 0;
        for (int32_t n = 0; n < fine->num_nodes; n++)
            if (body[n])
                for (int d = 0; d < 3; d++) points[next++] = fine->rest[3 * n + d];
        *count = number;
        *rest = points;
    }
    pliant_free(body);
    return status;
}

/* Return the node at a lattice point; -1: none. */
static int32_t node_at(const pliant_mesh *mesh, const double point[3])
{
    int32_t at[3];
    for (int d = 0; d < 3; d++) {
        double along = 0;
        for (int r = 0; r < 3; r++) along += mesh->direction[3 * r + d] * (point[r] - mesh->corner[r]);
        along /= mesh->cell_size[d];
        double nearest = floor(along + 0.5);
        if (!(fabs(along - nearest) < 1e-6) || nearest < 0 || nearest > mesh->cells[d]) return -1;
        at[d] = (int32_t)nearest;
    }
    int32_t node = mesh->node_of_lattice[at[0] + (mesh->cells[0] + 1) * (at[1] + (mesh->cells[1] + 1) * at[2])];
    for (int d = 0; node >= 0 && d < 3; d++) /* the node may have been moved onto bone */
        if (!(fabs(mesh->rest[3 * node + d] - point[d]) < 1e-6 * mesh->cell_size[d])) return -1;
    return node;
}

pliant_status pliant_points_create(const pliant_mesh *mesh, int32_t count, const double *rest, pliant_points *out)
{
    if (count < 1) return pliant_fail(PLIANT_ERROR_ARGUMENT, "there are no points to follow");
    pliant_points points = {.count = count};
    points.nodes = pliant_calloc((size_t)count, 4 * sizeof *points.nodes);
    points.weights = pliant_calloc((size_t)count, 4 * sizeof *points.weights);
    points.found = pliant_calloc((size_t)count, 1);
    if (!points.nodes || !points.weights || !points.found) {
        pliant_points_free(&points);
        return pliant_fail_memory("the points of the mesh");
    }
    for (int32_t p = 0; p < count; p++) {
        double barycentric[4];
        int32_t node = node_at(mesh, rest + 3 * p),
                tet = node < 0 ? pliant_mesh_locate(mesh, rest + 3 * p, barycentric) : -1;
        if (node < 0 && tet < 0) continue;
        for (int v = 0; v < 4; v++) {
            points.nodes[4 * p + v] = node < 0 ? mesh->tets[4 * tet + v] : node;
            points.weights[4 * p + v] = node < 0 ? barycentric[v] : v == 0;
        }
        points.found[p] = 1;
        points.num_found++;
    }
    *out = points;
    return PLIANT_OK;
}

void pliant_points_free(pliant_points *points)
{
    if (!points) return;
    pliant_free(points->nodes);
    pliant_free(points->weights);
    pliant_free(points->found);
    *points = (pliant_points){0};
}

void pliant_points_move(const pliant_points *points, const double *positions, double *out)
{
    for (int32_t p = 0; p < points->count; p++)
        for (int d = 0; d < 3; d++) {
            double sum = 0;
            for (int v = 0; v < 4; v++) sum += points->weights[4 * p + v] * positions[3 * points->nodes[4 * p + v] + d];
            out[3 * p + d] = sum;
        }
}
