/* Data of a body whose tetrahedra are subdivided by cuts. */
#include "topology/divide.h"

#include "base/fail.h"
#include "base/memory.h"
#include "base/vector3.h"
#include "mesh/mesh.h"

#include <math.h>
#include <string.h>

static pliant_status no_memory(void) { return pliant_fail_memory("the subdivision of the mesh"); }

pliant_status pliant_subdivision_create(const pliant_mesh *fine, bool kerf, const pliant_geometry *scan,
                                        const pliant_material_table *table, pliant_subdivision **out)
{
    /* Smaller fractions give smaller elements, and so shorter explicit time steps. */
    const double edge_fraction = 0.2, height_fraction = 0.1;
    double edge = INFINITY, volume = INFINITY, height = INFINITY, gradients[12];
    for (int32_t t = 0; t < fine->num_tets; t++) {
        volume = fmin(volume, pliant_mesh_gradients(fine, t, gradients));
        for (int v = 0; v < 4; v++) height = fmin(height, 1 / pliant_length3(gradients + 3 * v));
        for (int a = 0; a < 4; a++)
            for (int b = 0; b < a; b++) {
                double squares = 0;
                for (int d = 0; d < 3; d++)
                    squares +=
                        pow(fine->rest[3 * fine->tets[4 * t + a] + d] - fine->rest[3 * fine->tets[4 * t + b] + d], 2);
                edge = fmin(edge, sqrt(squares));
            }
    }
    pliant_subdivision *made = pliant_calloc(1, sizeof *made);
    if (!made) return no_memory();
    made->load_nodes = fine->num_nodes;
    made->min_edge = edge_fraction * edge;
    made->kerf = kerf ? 0.25 * made->min_edge : 0;
    made->min_height = height_fraction * height;
    made->min_volume = 0.001 * volume;
    made->scan = *scan;
    for (uint32_t m = 0; m < table->num_materials; m++) made->is_empty[m] = table->materials[m].empty;
    *out = made;
    return PLIANT_OK;
}

void pliant_subdivision_free(pliant_subdivision *subdivision)
{
    if (!subdivision) return;
    PLIANT_FREE(subdivision->between, subdivision->mark, subdivision);
}

pliant_status pliant_subdivision_copy(const pliant_subdivision *from, int32_t nodes, pliant_subdivision **out)
{
    const size_t appended = (size_t)(nodes - from->load_nodes), marks = (size_t)from->num_marks;
    pliant_subdivision *made = pliant_calloc(1, sizeof *made);
    if (!made) return no_memory();
    *made = *from;
    made->between = NULL;
    made->mark = NULL;
    bool good = (appended == 0 || (made->between = pliant_calloc(appended, sizeof *made->between))) &&
                (marks == 0 || (made->mark = pliant_calloc(marks, sizeof *made->mark)));
    if (!good) {
        pliant_subdivision_free(made);
        return no_memory();
    }
    if (appended > 0) memcpy(made->between, from->between, appended * sizeof *made->between);
    if (marks > 0) memcpy(made->mark, from->mark, marks * sizeof *made->mark);
    *out = made;
    return PLIANT_OK;
}

pliant_status pliant_subdivision_append(pliant_subdivision *subdivision, int32_t nodes, int32_t appended,
                                        const int32_t *source)
{
    if (appended == 0) return PLIANT_OK;
    pliant_between *longer =
        pliant_resize(subdivision->between, (size_t)(nodes - subdivision->load_nodes + appended), sizeof *longer);
    if (!longer) return no_memory();
    subdivision->between = longer;
    for (int32_t n = 0; n < appended; n++)
        longer[nodes - subdivision->load_nodes + n] = (pliant_between){.end = {source[n], source[n]}};
    return PLIANT_OK;
}
