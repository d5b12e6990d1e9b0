/* Integrates the voxels' materials over tetrahedra ([H] 2.1). Every voxel belongs to the tetrahedron that contains its
 * centre; ties go to the central tetrahedron. No voxel is counted twice.
 *
 * [H] writes Ke = v Be' (sum Ei) Be with the voxel volume v. It equals V Be' (mean Ei) Be if the voxels' volumes sum to
 * the volume of the tetrahedron. On a real grid they do so only approximately, and the patch test fails by the
 * difference. Therefore this file computes the mean, and the element uses its exact volume. */
#include "base/fail.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <string.h>

typedef struct axis_map {
    int32_t *first; /* (cells + 1) first voxel of each cell */
    double *local;  /* (voxels) coordinate in its cell, 0 to 1 */
} axis_map;

static void axis_free(axis_map *map)
{
    pliant_free(map->first);
    pliant_free(map->local);
}

static pliant_status axis_create(int32_t voxels, int32_t cells, axis_map *map)
{
    map->first = pliant_calloc((size_t)cells + 1, sizeof *map->first);
    map->local = pliant_calloc((size_t)voxels, sizeof *map->local);
    if (!map->first || !map->local) return pliant_fail_memory("the voxels of a cell");
    int32_t last = -1;
    for (int32_t i = 0; i < voxels; i++) {
        double at = (i + 0.5) * cells / voxels;
        int32_t cell = (int32_t)at;
        map->local[i] = at - cell;
        while (last < cell) map->first[++last] = i;
    }
    while (last < cells) map->first[++last] = voxels;
    return PLIANT_OK;
}

static void add_voxel(const pliant_material *material, double fraction, pliant_tet_material *out)
{
    double young = material->young_modulus, poisson = material->poisson_ratio;
    out->lambda += fraction * young * poisson / ((1 + poisson) * (1 - 2 * poisson));
    out->mu += fraction * young / (2 * (1 + poisson));
    out->density += fraction * material->density;
    if (!material->empty) out->tissue += (float)fraction;
}

void pliant_material_of_voxel(const pliant_material_table *table, uint8_t material, pliant_tet_material *out)
{
    memset(out, 0, sizeof *out);
    out->material = material;
    out->num_voxels = 1;
    add_voxel(table->materials + material, 1, out);
}

static void mean_of(const pliant_material_table *table, const uint32_t *count, pliant_tet_material *out)
{
    memset(out, 0, sizeof *out);
    for (uint32_t m = 0; m < table->num_materials; m++) {
        out->num_voxels += count[m];
        if (count[m] > count[out->material]) out->material = (uint16_t)m;
    }
    for (uint32_t m = 0; m < table->num_materials; m++)
        if (count[m]) add_voxel(table->materials + m, (double)count[m] / out->num_voxels, out);
    if (out->tissue > 1) out->tissue = 1;
}

/* Use the voxel at the centroid if the tetrahedron is smaller than a voxel. */
static void nearest_of(const pliant_geometry *geometry, const int32_t cells[3], const int32_t cell[3], int slot,
                       const uint8_t *material_of_voxel, const pliant_material_table *table, pliant_tet_material *out)
{
    int corners[4];
    size_t voxel[3];
    pliant_mesh_slot_corners((cell[0] + cell[1] + cell[2]) & 1, slot, corners);
    for (int d = 0; d < 3; d++) {
        double centroid = cell[d];
        for (int v = 0; v < 4; v++) centroid += 0.25 * (corners[v] >> d & 1);
        voxel[d] = (size_t)(centroid * geometry->size[d] / cells[d]);
        if (voxel[d] >= (size_t)geometry->size[d]) voxel[d] = (size_t)geometry->size[d] - 1;
    }
    uint8_t material =
        material_of_voxel[voxel[0] + (size_t)geometry->size[0] * (voxel[1] + (size_t)geometry->size[1] * voxel[2])];
    pliant_material_of_voxel(table, material, out);
    out->num_voxels = 0;
}

static void count_cell(const pliant_geometry *geometry, const axis_map maps[3], const int32_t cell[3],
                       const uint8_t *material_of_voxel, uint32_t count[5][PLIANT_MAX_MATERIALS])
{
    int parity = (cell[0] + cell[1] + cell[2]) & 1;
    for (int32_t k = maps[2].first[cell[2]]; k < maps[2].first[cell[2] + 1]; k++)
        for (int32_t j = maps[1].first[cell[1]]; j < maps[1].first[cell[1] + 1]; j++) {
            const uint8_t *row =
                material_of_voxel + (size_t)geometry->size[0] * ((size_t)j + (size_t)geometry->size[1] * (size_t)k);
            for (int32_t i = maps[0].first[cell[0]]; i < maps[0].first[cell[0] + 1]; i++) {
                double local[3] = {maps[0].local[i], maps[1].local[j], maps[2].local[k]};
                count[pliant_mesh_slot_of(parity, local)][row[i]]++;
            }
        }
}

pliant_status pliant_lattice_integrate(const pliant_geometry *geometry, const int32_t cells[3],
                                       const uint8_t *material_of_voxel, const pliant_material_table *table,
                                       pliant_tet_material *out)
{
    axis_map maps[3] = {{0}};
    pliant_status status = PLIANT_OK;
    for (int d = 0; d < 3 && status == PLIANT_OK; d++) status = axis_create(geometry->size[d], cells[d], maps + d);
    if (status != PLIANT_OK) goto done;
    int32_t num_cells = cells[0] * cells[1] * cells[2];
#pragma omp parallel for schedule(dynamic, 16)
    for (int32_t flat = 0; flat < num_cells; flat++) {
        uint32_t count[5][PLIANT_MAX_MATERIALS];
        int32_t cell[3] = {flat % cells[0], flat / cells[0] % cells[1], flat / cells[0] / cells[1]};
        memset(count, 0, sizeof count);
        count_cell(geometry, maps, cell, material_of_voxel, count);
        for (int slot = 0; slot < 5; slot++) {
            pliant_tet_material *tet = out + 5 * flat + slot;
            mean_of(table, count[slot], tet);
            if (tet->num_voxels == 0) nearest_of(geometry, cells, cell, slot, material_of_voxel, table, tet);
        }
    }
done:
    for (int d = 0; d < 3; d++) axis_free(maps + d);
    return status;
}

pliant_status pliant_lattice_owners(const pliant_geometry *geometry, const int32_t cells[3], int32_t *owner)
{
    axis_map maps[3] = {{0}};
    pliant_status status = PLIANT_OK;
    for (int d = 0; d < 3 && status == PLIANT_OK; d++) status = axis_create(geometry->size[d], cells[d], maps + d);
    const int32_t num_cells = status == PLIANT_OK ? cells[0] * cells[1] * cells[2] : 0;
#pragma omp parallel for schedule(static)
    for (int32_t flat = 0; flat < num_cells; flat++) {
        const int32_t cell[3] = {flat % cells[0], flat / cells[0] % cells[1], flat / cells[0] / cells[1]};
        const int parity = (cell[0] + cell[1] + cell[2]) & 1;
        for (int32_t k = maps[2].first[cell[2]]; k < maps[2].first[cell[2] + 1]; k++)
            for (int32_t j = maps[1].first[cell[1]]; j < maps[1].first[cell[1] + 1]; j++)
                for (int32_t i = maps[0].first[cell[0]]; i < maps[0].first[cell[0] + 1]; i++) {
                    const double local[3] = {maps[0].local[i], maps[1].local[j], maps[2].local[k]};
                    const size_t voxel =
                        (size_t)i + (size_t)geometry->size[0] * ((size_t)j + (size_t)geometry->size[1] * (size_t)k);
                    owner[voxel] = 5 * flat + pliant_mesh_slot_of(parity, local);
                }
    }
    for (int d = 0; d < 3; d++) axis_free(maps + d);
    return status;
}

/* Tetrahedra with a node on bone, numbered, and the cells that contain them. */
typedef struct touched {
    int32_t count;
    int32_t *number; /* (num_tets) or -1 */
    uint8_t *cell;   /* (cells) */
} touched;

static pliant_status touch(const pliant_mesh *mesh, touched *out)
{
    size_t cells = (size_t)mesh->cells[0] * (size_t)mesh->cells[1] * (size_t)mesh->cells[2];
    out->number = pliant_calloc((size_t)mesh->num_tets, sizeof *out->number);
    out->cell = pliant_calloc(cells, 1);
    uint8_t *leaf = mesh->num_leaves > 0 ? pliant_calloc((size_t)mesh->num_leaves, 1) : NULL;
    if (!out->number || !out->cell || (mesh->num_leaves > 0 && !leaf)) {
        pliant_free(leaf);
        return pliant_fail_memory("the tetrahedra on bone");
    }
    int32_t at = 0; /* leaf of the tetrahedron */
    for (int32_t t = 0; t < mesh->num_tets; t++) {
        bool surface = false;
        for (int v = 0; v < 4; v++)
            surface = surface || mesh->place_of_node[mesh->tets[4 * t + v]] == PLIANT_BONE_SURFACE;
        out->number[t] = surface ? out->count++ : -1;
        while (leaf && t >= mesh->leaf_start[at + 1]) at++;
        if (surface && leaf) leaf[at] = 1;
        if (surface && !leaf) out->cell[mesh->lattice_of_tet[t] / 5] = 1;
    }
    for (size_t c = 0; leaf && c < cells; c++) out->cell[c] = leaf[mesh->leaf_of_cell[c]];
    pliant_free(leaf);
    return PLIANT_OK;
}

/* Count the voxels of a cell by material, for the tetrahedra that contain their centres. */
static void count_moved(const pliant_mesh *mesh, const pliant_geometry *geometry, const axis_map maps[3],
                        const int32_t cell[3], const uint8_t *material_of_voxel, const int32_t *number,
                        uint32_t num_materials, uint32_t *count)
{
    for (int32_t k = maps[2].first[cell[2]]; k < maps[2].first[cell[2] + 1]; k++)
        for (int32_t j = maps[1].first[cell[1]]; j < maps[1].first[cell[1] + 1]; j++)
            for (int32_t i = maps[0].first[cell[0]]; i < maps[0].first[cell[0] + 1]; i++) {
                double world[3], weights[4];
                pliant_geometry_to_world(geometry, (const double[3]){i, j, k}, world);
                int32_t tet = pliant_mesh_locate(mesh, world, weights);
                if (tet < 0 || number[tet] < 0) continue;
                size_t voxel =
                    (size_t)i + (size_t)geometry->size[0] * ((size_t)j + (size_t)geometry->size[1] * (size_t)k);
                uint32_t *one = count + (size_t)number[tet] * num_materials + material_of_voxel[voxel];
#pragma omp atomic
                (*one)++;
            }
}

pliant_status pliant_mesh_integrate_moved(const pliant_mesh *mesh, const pliant_geometry *geometry,
                                          const uint8_t *material_of_voxel, bool leave_out_fixed,
                                          const pliant_material_table *table, pliant_tet_material *out)
{
    axis_map maps[3] = {{0}};
    touched list = {0};
    uint32_t *count = NULL;
    pliant_status status = touch(mesh, &list);
    for (int d = 0; d < 3 && status == PLIANT_OK; d++)
        status = axis_create(geometry->size[d], mesh->cells[d], maps + d);
    if (status != PLIANT_OK || list.count == 0) goto done;
    if (!(count = pliant_calloc((size_t)list.count * table->num_materials, sizeof *count))) {
        status = pliant_fail_memory("the tetrahedra on bone");
        goto done;
    }
    int32_t num_cells = mesh->cells[0] * mesh->cells[1] * mesh->cells[2];
#pragma omp parallel for schedule(dynamic, 16)
    for (int32_t flat = 0; flat < num_cells; flat++) {
        int32_t cell[3] = {flat % mesh->cells[0], flat / mesh->cells[0] % mesh->cells[1],
                           flat / mesh->cells[0] / mesh->cells[1]};
        if (list.cell[flat])
            count_moved(mesh, geometry, maps, cell, material_of_voxel, list.number, table->num_materials, count);
    }
    for (int32_t t = 0; t < mesh->num_tets; t++) {
        if (list.number[t] < 0) continue;
        uint32_t *own = count + (size_t)list.number[t] * table->num_materials, moving = 0, all = 0;
        bool outside = false;
        for (int v = 0; v < 4; v++)
            outside = outside || mesh->place_of_node[mesh->tets[4 * t + v]] == PLIANT_BONE_OUTSIDE;
        for (uint32_t m = 0; m < table->num_materials; m++) {
            all += own[m];
            moving += table->materials[m].fixed ? 0 : own[m];
        }
        for (uint32_t m = 0; outside && leave_out_fixed && moving > 0 && m < table->num_materials; m++)
            if (table->materials[m].fixed) own[m] = 0;
        if (all > 0) mean_of(table, own, out + t); /* without any voxel: keeps the lattice tetrahedron's material */
    }
done:
    for (int d = 0; d < 3; d++) axis_free(maps + d);
    PLIANT_FREE(list.number, list.cell, count);
    return status;
}
