#include "base/fail.h"
#include "fem/coarse/submesh.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <string.h>

void pliant_submesh_lists_free(pliant_submesh_lists *lists)
{
    pliant_free(lists->start);
    pliant_free(lists->tets);
    memset(lists, 0, sizeof *lists);
}

/* List the coarse tetrahedra of fine tetrahedron t: its own, and with `neighbours` also those across its faces. */
static int owners_of(const int32_t *coarse_of_fine, const int32_t *neighbours, int32_t t, int32_t owners[5])
{
    int count = 0;
    owners[count++] = coarse_of_fine[t];
    for (int c = 0; neighbours && c < 4; c++) {
        int32_t across = neighbours[4 * t + c];
        if (across < 0) continue;
        bool known = false;
        for (int o = 0; o < count; o++) known = known || owners[o] == coarse_of_fine[across];
        if (!known) owners[count++] = coarse_of_fine[across];
    }
    return count;
}

pliant_status pliant_submesh_list(const pliant_mesh *fine, const int32_t *coarse_of_fine, int32_t num_coarse,
                                  pliant_submesh_extent extent, pliant_submesh_lists *out)
{
    pliant_status status = PLIANT_OK;
    pliant_submesh_lists lists = {0};
    int32_t *neighbours = NULL, owners[5], total = 0;
    if (extent == PLIANT_SUBMESH_FACE) {
        neighbours = pliant_calloc((size_t)fine->num_tets, 4 * sizeof *neighbours);
        if (!neighbours) {
            status = pliant_fail_memory("the submeshes");
            goto done;
        }
        if ((status = pliant_mesh_neighbours(fine, neighbours)) != PLIANT_OK) goto done;
    }
    lists.start = pliant_calloc((size_t)num_coarse + 2, sizeof *lists.start);
    if (!lists.start) {
        status = pliant_fail_memory("the submeshes");
        goto done;
    }
    for (int32_t t = 0; t < fine->num_tets; t++) {
        int count = owners_of(coarse_of_fine, neighbours, t, owners);
        total += count;
        for (int o = 0; o < count; o++) lists.start[owners[o] + 2]++;
    }
    for (int32_t c = 0; c < num_coarse; c++) {
        if (lists.start[c + 2] > lists.largest) lists.largest = lists.start[c + 2];
        lists.start[c + 2] += lists.start[c + 1];
    }
    if (!(lists.tets = pliant_calloc((size_t)total, sizeof *lists.tets))) {
        status = pliant_fail_memory("the submeshes");
        goto done;
    }
    for (int32_t t = 0; t < fine->num_tets; t++) {
        int count = owners_of(coarse_of_fine, neighbours, t, owners);
        for (int o = 0; o < count; o++) lists.tets[lists.start[owners[o] + 1]++] = t;
    }
    *out = lists;
    memset(&lists, 0, sizeof lists);
done:
    pliant_free(neighbours);
    pliant_submesh_lists_free(&lists);
    return status;
}

pliant_status pliant_submesh_create(const pliant_mesh *fine, const pliant_mesh *coarse, const uint8_t *fixed,
                                    const pliant_tet_material *material, int32_t max_tets, pliant_submesh **out)
{
    pliant_submesh *submesh = pliant_calloc(1, sizeof *submesh);
    if (!submesh) return pliant_fail_memory("a submesh");
    int32_t maximum = 4 * max_tets < fine->num_nodes ? 4 * max_tets : fine->num_nodes;
    submesh->fine = fine;
    submesh->coarse = coarse;
    submesh->fixed = fixed;
    submesh->material = material;
    submesh->node = pliant_calloc((size_t)maximum, sizeof *submesh->node);
    submesh->local_of = pliant_calloc((size_t)fine->num_nodes, sizeof *submesh->local_of);
    submesh->slot = pliant_calloc((size_t)maximum, sizeof *submesh->slot);
    if (!submesh->node || !submesh->local_of || !submesh->slot) {
        pliant_submesh_free(submesh);
        return pliant_fail_memory("a submesh");
    }
    memset(submesh->local_of, 0xff, (size_t)fine->num_nodes * sizeof *submesh->local_of);
    *out = submesh;
    return PLIANT_OK;
}

void pliant_submesh_free(pliant_submesh *submesh)
{
    if (!submesh) return;
    PLIANT_FREE(submesh->node, submesh->local_of, submesh->slot, submesh->stiffness, submesh->work, submesh->square,
                submesh);
}

static pliant_status reserve_capacity(pliant_submesh *submesh)
{
    if (submesh->num_nodes <= submesh->capacity) return PLIANT_OK;
    size_t size = 3 * (size_t)submesh->num_nodes;
    PLIANT_FREE(submesh->stiffness, submesh->work, submesh->square);
    submesh->stiffness = pliant_calloc(size * size, sizeof *submesh->stiffness);
    submesh->work = pliant_calloc(size * PLIANT_SUBMESH_COLUMNS, sizeof *submesh->work);
    submesh->square = pliant_calloc(size * size, sizeof *submesh->square);
    submesh->capacity = submesh->stiffness && submesh->work && submesh->square ? submesh->num_nodes : 0;
    return submesh->capacity ? PLIANT_OK : pliant_fail_memory("a submesh");
}

const pliant_cube_shape *pliant_submesh_shape(const pliant_submesh *submesh, const pliant_cube *cube,
                                              pliant_cube_shape *buffer)
{
    const pliant_mesh *fine = submesh->fine;
    int parity = pliant_cell_parity(fine, fine->lattice_of_tet[cube->tet[0]] / 5);
    if (fine->num_moved == 0) return submesh->shapes + parity;
    pliant_cube_integrate(fine, cube, parity, buffer);
    return buffer;
}

static void assemble_cube(pliant_submesh *submesh, const pliant_cube *cube)
{
    const size_t size = 3 * (size_t)submesh->num_nodes;
    double k[576];
    pliant_cube_shape buffer;
    const pliant_cube_shape *shape = pliant_submesh_shape(submesh, cube, &buffer);
    double bulk = pliant_cube_deviatoric(shape, cube, submesh->material, 0, k);
    for (int a = 0; a < 24; a++)
        for (int b = 0; b < 24; b++) {
            size_t row = 3 * (size_t)submesh->local_of[cube->node[a / 3]] + (size_t)(a % 3);
            submesh->stiffness[size * row + 3 * (size_t)submesh->local_of[cube->node[b / 3]] + (size_t)(b % 3)] +=
                k[24 * a + b] + bulk * shape->mean[a] * shape->mean[b];
        }
}

static void assemble(pliant_submesh *submesh)
{
    const pliant_mesh *fine = submesh->fine;
    size_t size = 3 * (size_t)submesh->num_nodes;
    memset(submesh->stiffness, 0, size * size * sizeof *submesh->stiffness);
    for (int32_t t = 0; t < submesh->num_tets; t++) {
        const int32_t *nodes = fine->tets + 4 * submesh->tets[t];
        double element[144];
        if (submesh->cubes && submesh->cube_of_tet[submesh->tets[t]] >= 0) {
            const pliant_cube *cube = submesh->cubes + submesh->cube_of_tet[submesh->tets[t]];
            if (cube->tet[0] == submesh->tets[t]) assemble_cube(submesh, cube);
            continue;
        }
        pliant_tet_stiffness(fine, submesh->tets[t], submesh->material + submesh->tets[t], element);
        for (int a = 0; a < 12; a++)
            for (int b = 0; b < 12; b++) {
                size_t row = 3 * (size_t)submesh->local_of[nodes[a / 3]] + (size_t)(a % 3);
                submesh->stiffness[size * row + 3 * (size_t)submesh->local_of[nodes[b / 3]] + (size_t)(b % 3)] +=
                    element[12 * a + b];
            }
    }
}

pliant_status pliant_submesh_load(pliant_submesh *submesh, int32_t num_tets, const int32_t *tets)
{
    const pliant_mesh *fine = submesh->fine;
    for (int32_t n = 0; n < submesh->num_nodes; n++) submesh->local_of[submesh->node[n]] = -1;
    submesh->num_nodes = 0;
    submesh->num_tets = num_tets;
    submesh->tets = tets;
    for (int32_t t = 0; t < num_tets; t++)
        for (int v = 0; v < 4; v++) {
            int32_t node = fine->tets[4 * tets[t] + v];
            if (submesh->local_of[node] >= 0) continue;
            submesh->local_of[node] = submesh->num_nodes;
            submesh->node[submesh->num_nodes++] = node;
        }
    pliant_status status = reserve_capacity(submesh);
    if (status == PLIANT_OK) assemble(submesh);
    return status;
}

int32_t pliant_submesh_corner(const pliant_submesh *submesh, int32_t coarse_node)
{
    int32_t at = pliant_mesh_lattice_in(submesh->fine, submesh->coarse, coarse_node);
    for (int32_t n = 0; n < submesh->num_nodes; n++)
        if (submesh->fine->lattice_of_node[submesh->node[n]] == at) return n;
    return -1;
}

bool pliant_submesh_has_fixed(const pliant_submesh *submesh)
{
    for (int32_t n = 0; n < submesh->num_nodes; n++)
        if (submesh->fixed[submesh->node[n]]) return true;
    return false;
}
