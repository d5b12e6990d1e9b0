/* Voxels of a body at load: their tetrahedra and materials. */
#include "topology/links.h"

#include "base/fail.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <stdatomic.h>
#include <string.h>

struct pliant_voxels_holders {
    atomic_int count;
};

const pliant_voxels *pliant_voxels_retain(const pliant_voxels *voxels)
{
    atomic_fetch_add_explicit(&voxels->holders->count, 1, memory_order_relaxed);
    return voxels;
}

static void free_voxels(pliant_voxels *voxels)
{
    PLIANT_FREE(voxels->owner, voxels->start, voxels->voxel, voxels->material, voxels->of_material, voxels->bridge,
                voxels->fixed_material, voxels->bridge_start, voxels->adjacent_start, voxels->adjacent, voxels->across,
                voxels->around_start, voxels->around, voxels->holders, voxels->load);
    pliant_free(voxels);
}

void pliant_voxels_release(const pliant_voxels *voxels)
{
    if (voxels && atomic_fetch_sub_explicit(&voxels->holders->count, 1, memory_order_acq_rel) == 1)
        free_voxels((pliant_voxels *)voxels);
}

/* Find the owner of each voxel, with the lattice's rule for ties. If nodes were moved, and in an octree, the tetrahedra
 * themselves are searched. */
static pliant_status find_owners(const pliant_mesh *fine, pliant_voxels *voxels)
{
    const pliant_geometry *geometry = &voxels->geometry;
    const int64_t count = (int64_t)pliant_geometry_voxels(geometry);
    if (fine->num_moved == 0 && fine->num_leaves == 0) {
        pliant_status status = pliant_lattice_owners(geometry, fine->cells, voxels->owner);
        for (int64_t v = 0; status == PLIANT_OK && v < count; v++)
            voxels->owner[v] = fine->tet_of_lattice[voxels->owner[v]];
        return status;
    }
#pragma omp parallel for schedule(static)
    for (int64_t v = 0; v < count; v++) {
        int32_t at[3];
        double world[3], barycentric[4];
        pliant_place_of(voxels, (int32_t)v, at);
        pliant_geometry_to_world(geometry, (const double[3]){at[0], at[1], at[2]}, world);
        voxels->owner[v] = pliant_mesh_locate(fine, world, barycentric);
    }
    return PLIANT_OK;
}

static pliant_status list_owned(pliant_voxels *voxels)
{
    const int32_t count = (int32_t)pliant_geometry_voxels(&voxels->geometry);
    int32_t *start = voxels->start, owned = 0;
    for (int32_t v = 0; v < count; v++)
        if (voxels->owner[v] >= 0) {
            start[voxels->owner[v] + 1]++;
            owned++;
        }
    for (int32_t t = 0; t < voxels->num_tets; t++) start[t + 1] += start[t];
    if (!(voxels->voxel = pliant_calloc((size_t)owned + 1, sizeof *voxels->voxel)))
        return pliant_fail_memory("the voxels of the mesh");
    /* fill from the back: start[t + 1] then is the first index of tetrahedron t, which is shifted below */
    for (int32_t v = count - 1; v >= 0; v--)
        if (voxels->owner[v] >= 0) voxels->voxel[--start[voxels->owner[v] + 1]] = v;
    for (int32_t t = 0; t < voxels->num_tets; t++) start[t] = start[t + 1];
    start[voxels->num_tets] = owned;
    return PLIANT_OK;
}

static pliant_status list_materials(const uint8_t *material_of_voxel, const pliant_material_table *table,
                                    pliant_voxels *voxels)
{
    const int32_t owned = voxels->start[voxels->num_tets];
    voxels->num_materials = (int32_t)table->num_materials;
    voxels->material = pliant_calloc((size_t)owned + 1, 1);
    voxels->of_material = pliant_calloc(table->num_materials, sizeof *voxels->of_material);
    voxels->fixed_material = pliant_calloc(table->num_materials, 1);
    if (!voxels->material || !voxels->of_material || !voxels->fixed_material)
        return pliant_fail_memory("the voxels of the mesh");
    for (int32_t v = 0; v < owned; v++) voxels->material[v] = material_of_voxel[voxels->voxel[v]];
    for (uint32_t m = 0; m < table->num_materials; m++) {
        pliant_material_of_voxel(table, (uint8_t)m, voxels->of_material + m);
        voxels->fixed_material[m] = table->materials[m].fixed;
    }
    return PLIANT_OK;
}

static pliant_status list_around(const pliant_mesh *fine, pliant_voxels *voxels)
{
    const int32_t nodes = fine->num_nodes, corners = 4 * fine->num_tets;
    int32_t *start = voxels->around_start = pliant_calloc((size_t)nodes + 2, sizeof *start);
    voxels->around = pliant_calloc((size_t)corners, sizeof *voxels->around);
    voxels->across = pliant_calloc((size_t)corners, sizeof *voxels->across);
    if (!start || !voxels->around || !voxels->across) return pliant_fail_memory("the voxels of the mesh");
    for (int32_t v = 0; v < corners; v++) start[fine->tets[v] + 2]++;
    for (int32_t n = 0; n < nodes; n++) start[n + 2] += start[n + 1];
    for (int32_t v = 0; v < corners; v++) voxels->around[start[fine->tets[v] + 1]++] = v;
    return pliant_mesh_neighbours(fine, voxels->across);
}

static pliant_status create(const pliant_body *body, const pliant_geometry *geometry, const uint8_t *material_of_voxel,
                            const pliant_material_table *table, pliant_voxels *voxels)
{
    const pliant_mesh *fine = &body->fine;
    voxels->geometry = *geometry;
    voxels->num_tets = fine->num_tets;
    voxels->num_nodes = fine->num_nodes;
    voxels->owner = pliant_calloc(pliant_geometry_voxels(geometry), sizeof *voxels->owner);
    voxels->start = pliant_calloc((size_t)fine->num_tets + 1, sizeof *voxels->start);
    voxels->bridge_start = pliant_calloc((size_t)fine->num_tets + 1, sizeof *voxels->bridge_start);
    voxels->load = pliant_calloc((size_t)fine->num_tets, sizeof *voxels->load);
    bool good = voxels->owner && voxels->start && voxels->bridge_start && voxels->load;
    if (good) memcpy(voxels->load, body->fine_material, (size_t)fine->num_tets * sizeof *voxels->load);
    pliant_status status = good ? find_owners(fine, voxels) : pliant_fail_memory("the voxels of the mesh");
    if (status == PLIANT_OK) status = list_owned(voxels);
    if (status == PLIANT_OK) status = list_materials(material_of_voxel, table, voxels);
    if (status == PLIANT_OK) status = list_around(fine, voxels);
    return status == PLIANT_OK ? pliant_bridges_build(fine, voxels) : status;
}

pliant_status pliant_voxels_create(const pliant_body *body, const pliant_geometry *geometry,
                                   const uint8_t *material_of_voxel, const pliant_material_table *table,
                                   const pliant_voxels **out)
{
    if (pliant_geometry_voxels(geometry) > (size_t)1 << 30)
        return pliant_fail(PLIANT_ERROR_SCENE, "a scan of %zu voxels is too large to be cut: at most 2^30; resample it",
                           pliant_geometry_voxels(geometry));
    pliant_voxels *voxels = pliant_calloc(1, sizeof *voxels);
    if (voxels) voxels->holders = pliant_calloc(1, sizeof *voxels->holders);
    if (!voxels || !voxels->holders) {
        pliant_free(voxels);
        return pliant_fail_memory("the voxels of the mesh");
    }
    atomic_init(&voxels->holders->count, 1);
    pliant_status status = create(body, geometry, material_of_voxel, table, voxels);
    if (status != PLIANT_OK) {
        free_voxels(voxels);
        return status;
    }
    *out = voxels;
    return PLIANT_OK;
}
