/* [H] 1 to 7 on eight corners: the fine elements of a coarse cube are condensed on its corners. Fine nodes follow the
 * shape functions of all coarse elements whose submesh contains them. */
#include "fem/coarse/cubes.h"

#include "base/fail.h"
#include "base/dense.h"
#include "base/memory.h"
#include "topology/sorted_numbers.h"

#include <stdlib.h>
#include <string.h>

enum { CORNERS = 8, UNKNOWNS = 24 };

static bool is_cube(const pliant_cube_work *work, int32_t element)
{
    const int32_t *start = work->system->macros->start + element;
    return start[1] - start[0] == CORNERS;
}

/* Copy an element's list and complete all fine hexahedra that have a tetrahedron in it. last_element: (hexahedra) last
 * element that had each, + 1. Return the number of tetrahedra. */
static int32_t complete(const pliant_cube_work *work, int32_t element, int32_t *last_element, int32_t *out)
{
    int32_t count = 0;
    for (int32_t i = work->lists.start[element]; i < work->lists.start[element + 1]; i++) {
        const int32_t tet = work->lists.tets[i], cube = is_cube(work, element) ? work->cube_of_tet[tet] : -1;
        if (cube < 0) out[count++] = tet;
        if (cube < 0 || last_element[cube] == element + 1) continue;
        last_element[cube] = element + 1;
        for (int slot = 0; slot < 5; slot++) out[count++] = work->cubes[cube].tet[slot];
    }
    qsort(out, (size_t)count, sizeof *out, by_number);
    return count;
}

static pliant_status complete_all(pliant_cube_work *work)
{
    const int32_t elements = work->system->macros->count, maximum = 5 * work->lists.start[elements];
    pliant_submesh_lists lists = {.start = pliant_calloc((size_t)elements + 1, sizeof *lists.start),
                                  .tets = pliant_calloc((size_t)maximum, sizeof *lists.tets)};
    int32_t *last_element = pliant_calloc((size_t)work->system->fine->num_tets, sizeof *last_element);
    const bool good = lists.start && lists.tets && last_element;
    for (int32_t e = 0; good && e < elements; e++) {
        const int32_t count = complete(work, e, last_element, lists.tets + lists.start[e]);
        lists.start[e + 1] = lists.start[e] + count;
        if (count > lists.largest) lists.largest = count;
    }
    pliant_free(last_element);
    if (!good) {
        pliant_submesh_lists_free(&lists);
        return pliant_fail_memory("the submeshes");
    }
    pliant_submesh_lists_free(&work->lists);
    work->lists = lists;
    return PLIANT_OK;
}

pliant_status pliant_cubes_schur_begin(pliant_cube_work *work, pliant_submesh_extent extent)
{
    const pliant_system *system = work->system;
    const pliant_mesh *fine = system->fine;
    const int32_t elements = system->macros->count;
    pliant_status status = pliant_submesh_list(fine, work->element_of_fine, elements, extent, &work->lists);
    if (status == PLIANT_OK && extent == PLIANT_SUBMESH_FACE) status = complete_all(work);
    if (status == PLIANT_OK && !(work->schur = pliant_calloc((size_t)elements, sizeof *work->schur)))
        status = pliant_fail_memory("the shape functions");
    for (int32_t e = 0; status == PLIANT_OK && e < elements; e++)
        for (int32_t v = 4 * work->lists.start[e]; v < 4 * work->lists.start[e + 1]; v++)
            if (work->fixed[fine->tets[4 * work->lists.tets[v / 4] + v % 4]]) system->macros->grounded[e] = 1;
    return status;
}

/* Make nodes follow the corners with the weights in `buffers`. */
static void linear_shapes(const pliant_submesh *submesh, const pliant_cube_buffers *buffers, double *shape)
{
    for (int32_t n = 0; n < submesh->num_nodes; n++)
        for (int i = 0; i < 3; i++)
            for (int m = 0; m < UNKNOWNS; m++)
                shape[3 * UNKNOWNS * (size_t)n + (size_t)(UNKNOWNS * i + m)] =
                    m % 3 == i ? buffers->weights[CORNERS * (size_t)n + (size_t)(m / 3)] : 0;
}

static void condense_cube(pliant_cube_work *work, pliant_submesh *submesh, pliant_cube_buffers *buffers,
                          int32_t element, double *k)
{
    double *shape = work->schur[element].shape;
    int32_t corner[CORNERS];
    bool whole = true;
    for (int v = 0; v < CORNERS; v++) {
        corner[v] = pliant_submesh_corner(submesh, work->system->macros->own[CORNERS * (size_t)element + (size_t)v]);
        whole = whole && corner[v] >= 0;
    }
    if (whole && pliant_submesh_condense(submesh, CORNERS, corner, k, shape)) return;
    for (int32_t n = 0; n < submesh->num_nodes; n++)
        if (work->fixed[submesh->node[n]])
            memset(buffers->weights + CORNERS * (size_t)n, 0, CORNERS * sizeof *buffers->weights);
    linear_shapes(submesh, buffers, shape);
    pliant_cube_galerkin(submesh, buffers, k);
#pragma omp atomic
    work->linear++;
}

pliant_status pliant_cubes_schur(pliant_cube_work *work, pliant_submesh *submesh, pliant_cube_buffers *buffers,
                                 int32_t element)
{
    const bool whole = is_cube(work, element);
    const int32_t unknowns = whole ? UNKNOWNS : 12;
    double k[UNKNOWNS * UNKNOWNS], root[UNKNOWNS * UNKNOWNS];
    pliant_status status = pliant_shapes_of(submesh, whole ? CORNERS : 4, work->schur + element);
    if (status == PLIANT_OK && whole) condense_cube(work, submesh, buffers, element, k);
    else if (status == PLIANT_OK)
        status = pliant_schur_tet(submesh, work->tet_of_element[element], k, work->schur[element].shape);
    if (status != PLIANT_OK) return status;
    return pliant_cube_keep_root(work->system->macros, element, unknowns, pliant_dense_root(unknowns, k, root), root);
}
