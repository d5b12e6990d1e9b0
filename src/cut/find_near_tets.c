/* Find the tetrahedra that a blade may touch. The bounding box of the nodes of some lattice cubes contains all
 * tetrahedra between them. */
#include "cut/cut_stages.h"

#include "base/fail.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

/* number of cubes along each axis that share a bounding box */
enum { GROUP = 2 };

typedef struct node_box {
    double low[3], high[3];
} node_box;

typedef struct node_groups {
    const pliant_mesh *mesh;
    const int32_t *load;       /* (num_nodes) node of the initial mesh; NULL: the node itself */
    int32_t count[3];
    node_box *box;
} node_groups;

static int32_t group_at(const node_groups *groups, const int32_t at[3])
{
    return at[0] + groups->count[0] * (at[1] + groups->count[1] * at[2]);
}

static inline double lesser(double a, double b) { return a < b ? a : b; }
static inline double greater(double a, double b) { return a > b ? a : b; }

static inline void extend_box(const node_box *one, node_box *all)
{
    for (int d = 0; d < 3; d++) {
        all->low[d] = lesser(one->low[d], all->low[d]);
        all->high[d] = greater(one->high[d], all->high[d]);
    }
}

static const node_box nothing = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

/* Extend each box by the boxes that follow along all axes. It then contains all nodes of the tetrahedra between
 * them. */
static void extend_boxes_by_next(node_groups *groups)
{
    const int32_t *count = groups->count, stride[3] = {1, count[0], count[0] * count[1]};
    for (int axis = 0; axis < 3; axis++)
        for (int32_t g = 0; g + stride[axis] < count[0] * count[1] * count[2]; g++)
            if (g / stride[axis] % count[axis] + 1 < count[axis])
                extend_box(groups->box + g + stride[axis], groups->box + g);
}

/* Compute the boxes. A copy of a node belongs to the lattice position of its source; nodes are numbered along the
 * lattice's rows. */
static void find_boxes(node_groups *groups, int32_t load, const double *positions)
{
    const pliant_mesh *mesh = groups->mesh;
    const int32_t row = mesh->cells[0] + 1, rows = mesh->cells[1] + 1;
    int32_t begin = 0, first = 0; /* first lattice number and first group of the row of the last node */
    for (int32_t g = 0; g < groups->count[0] * groups->count[1] * groups->count[2]; g++) groups->box[g] = nothing;
    for (int32_t n = 0; n < mesh->num_nodes; n++) {
        const int32_t node = mesh->lattice_of_node[n >= load && groups->load ? groups->load[n] : n];
        if (node < begin || node >= begin + row) {
            const int32_t at[3] = {0, node / row % rows / GROUP, node / row / rows / GROUP};
            begin = node / row * row;
            first = group_at(groups, at);
        }
        const double *x = positions + 3 * (size_t)n;
        node_box *box = groups->box + first + (node - begin) / GROUP;
        for (int d = 0; d < 3; d++) {
            box->low[d] = lesser(x[d], box->low[d]);
            box->high[d] = greater(x[d], box->high[d]);
        }
    }
    extend_boxes_by_next(groups);
}

/* Return whether the strip may touch a group's tetrahedra. Each tetrahedron's box grows by a fraction of its size,
 * which is at most the size of the group's box. */
static bool may_be_near(const node_box *all, const cut_strip *strip, double reach, double slack)
{
    for (int d = 0; d < 3; d++) {
        const double more = reach * (all->high[d] - all->low[d]) + slack;
        if (!(all->low[d] - more <= strip->high[d] && all->high[d] + more >= strip->low[d])) return false;
    }
    return true;
}

static void mark(const node_groups *groups, const int32_t at[3], uint8_t *near)
{
    const pliant_mesh *mesh = groups->mesh;
    int32_t cell[3], last[3];
    for (int d = 0; d < 3; d++) last[d] = GROUP * (at[d] + 1) < mesh->cells[d] ? GROUP * (at[d] + 1) : mesh->cells[d];
    for (cell[2] = GROUP * at[2]; cell[2] < last[2]; cell[2]++)
        for (cell[1] = GROUP * at[1]; cell[1] < last[1]; cell[1]++)
            for (cell[0] = GROUP * at[0]; cell[0] < last[0]; cell[0]++) {
                const int32_t *tets =
                    mesh->tet_of_lattice +
                    5 * ((size_t)cell[0] +
                         (size_t)mesh->cells[0] * ((size_t)cell[1] + (size_t)mesh->cells[1] * (size_t)cell[2]));
                for (int slot = 0; slot < 5; slot++)
                    if (tets[slot] >= 0) near[tets[slot]] = 1;
            }
}

pliant_status pliant_cut_find_near_tets(const pliant_body *body, const double *positions, const cut_strip *strip,
                                        double reach, double slack, uint8_t **out)
{
    const pliant_mesh *mesh = &body->fine;
    const int32_t load = body->voxels->num_tets;
    node_groups groups = {.mesh = mesh, .load = body->node_parent};
    uint8_t *near = *out = pliant_calloc((size_t)mesh->num_tets, 1);
    if (!near) return pliant_fail_memory("the elements near the blade");
    if (!mesh->tet_of_lattice || !mesh->lattice_of_node) { /* the leaves of an octree have no lattice */
        memset(near, 1, (size_t)mesh->num_tets);
        return PLIANT_OK;
    }
    memset(near + load, 1, (size_t)(mesh->num_tets - load)); /* fragments are few, so all are candidates */
    for (int d = 0; d < 3; d++) groups.count[d] = mesh->cells[d] / GROUP + 1;
    groups.box =
        pliant_calloc((size_t)groups.count[0] * (size_t)groups.count[1] * (size_t)groups.count[2], sizeof *groups.box);
    if (!groups.box) return pliant_fail_memory("the elements near the blade");
    find_boxes(&groups, body->voxels->num_nodes, positions);
    int32_t at[3];
    for (at[2] = 0; at[2] < groups.count[2]; at[2]++)
        for (at[1] = 0; at[1] < groups.count[1]; at[1]++)
            for (at[0] = 0; at[0] < groups.count[0]; at[0]++)
                if (may_be_near(groups.box + group_at(&groups, at), strip, reach, slack)) mark(&groups, at, near);
    pliant_free(groups.box);
    return PLIANT_OK;
}
