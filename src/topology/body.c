#include "topology/divide.h"

#include "base/fail.h"
#include "base/buffer.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <stdatomic.h>
#include <string.h>

struct pliant_body_holders {
    atomic_int count;
};

/* Clear the lattice tables before freeing a mesh. They never change, so later bodies share the tables of the first
 * body. */
static void forget_tables(pliant_mesh *mesh)
{
    mesh->tet_of_lattice = mesh->node_of_lattice = mesh->leaf_of_cell = mesh->leaf_start = NULL;
}

static void free_body(pliant_body *body)
{
    if (body->lender) {
        forget_tables(&body->fine);
        forget_tables(&body->coarse);
        pliant_body_release(body->lender);
    }
    pliant_mesh_free(&body->fine);
    pliant_mesh_free(&body->coarse);
    PLIANT_FREE(body->node_parent, body->tet_parent, body->coarse_of_fine, body->fine_of_coarse, body->across,
                body->triangles, body->outside, body->fine_material, body->coarse_material, body->node_mass,
                body->fine_fixed, body->coarse_fixed);
    pliant_voxels_release(body->voxels);
    pliant_cuts_free(body->cuts);
    pliant_subdivision_free(body->subdivision);
    pliant_pieces_free(body->pieces);
    PLIANT_FREE(body->changes.touched, body->changes.node_source, body->changes.tet_source, body->holders, body);
}

pliant_status pliant_body_create(uint64_t revision, pliant_body **out)
{
    pliant_body *body = pliant_calloc(1, sizeof *body);
    if (!body) return pliant_fail_memory("the body");
    body->holders = pliant_calloc(1, sizeof *body->holders);
    if (!body->holders) {
        pliant_free(body);
        return pliant_fail_memory("the body");
    }
    atomic_init(&body->holders->count, 1);
    body->revision = revision;
    *out = body;
    return PLIANT_OK;
}

const pliant_body *pliant_body_retain(const pliant_body *body)
{
    atomic_fetch_add_explicit(&body->holders->count, 1, memory_order_relaxed);
    return body;
}

void pliant_body_release(const pliant_body *body)
{
    if (body && atomic_fetch_sub_explicit(&body->holders->count, 1, memory_order_acq_rel) == 1)
        free_body((pliant_body *)body);
}

bool pliant_body_is_cuttable(const pliant_body *body) { return body->voxels || body->subdivision; }

/* copies an array (Nullable) and stores the new pointer at `to`; false: out of memory */
typedef bool (*copying)(const void *from, size_t count, size_t size, void *to);

/* Copy count elements to *to; NULL stays NULL. */
static bool copy(const void *from, size_t count, size_t size, void *to)
{
    if (!from) return true;
    void *made = pliant_copy_block(from, count, size);
    if (made) memcpy(to, &made, sizeof made);
    return made != NULL;
}

/* Copy an array of which a cut changes a few elements, with change tracking (buffer.h). */
static bool copy_tracked(const void *from, size_t count, size_t size, void *to)
{
    if (!from) return true;
    void *made = pliant_next_version(from, count, count, size);
    if (made) memcpy(to, &made, sizeof made);
    return made != NULL;
}

/* Copy a mesh except the lattice tables, which are shared. */
static bool copy_mesh(const pliant_mesh *from, copying how, pliant_mesh *to)
{
    *to = *from; /* sizes and shared tables */
    to->rest = NULL;
    to->tets = to->lattice_of_node = to->lattice_of_tet = NULL;
    to->place_of_node = NULL;
    const size_t nodes = (size_t)from->num_nodes, tets = (size_t)from->num_tets;
    return how(from->rest, nodes, 3 * sizeof *from->rest, &to->rest) &&
           how(from->tets, tets, 4 * sizeof *from->tets, &to->tets) &&
           how(from->lattice_of_node, nodes, sizeof *from->lattice_of_node, &to->lattice_of_node) &&
           how(from->lattice_of_tet, tets, sizeof *from->lattice_of_tet, &to->lattice_of_tet) &&
           how(from->place_of_node, nodes, sizeof *from->place_of_node, &to->place_of_node);
}

static bool copy_fine(const pliant_body *body, copying how, pliant_body *next)
{
    const size_t nodes = (size_t)body->fine.num_nodes, tets = (size_t)body->fine.num_tets;
    return copy_mesh(&body->fine, how, &next->fine) &&
           how(body->node_parent, nodes, sizeof *body->node_parent, &next->node_parent) &&
           how(body->tet_parent, tets, sizeof *body->tet_parent, &next->tet_parent) &&
           how(body->fine_material, tets, sizeof *body->fine_material, &next->fine_material) &&
           how(body->node_mass, nodes, sizeof *body->node_mass, &next->node_mass);
}

pliant_status pliant_body_begin(const pliant_body *body, uint64_t revision, bool with_cuts, pliant_body **out)
{
    pliant_body *next = NULL;
    if (revision <= body->revision)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "the revision of a next body must be above %llu, not %llu",
                           (unsigned long long)body->revision, (unsigned long long)revision);
    pliant_status status = pliant_body_create(revision, &next);
    if (status != PLIANT_OK) return status;
    const size_t nodes = (size_t)body->fine.num_nodes, tets = (size_t)body->fine.num_tets;
    const size_t coarse_nodes = (size_t)body->coarse.num_nodes, coarse_tets = (size_t)body->coarse.num_tets;
    next->num_held_pieces = body->num_held_pieces;
    next->falls = body->falls;
    next->has_inertia = body->has_inertia;
    next->changes = (pliant_body_changes){
        .since = body->revision, .nodes_before = body->fine.num_nodes, .tets_before = body->fine.num_tets};
    next->lender = pliant_body_retain(body->lender ? body->lender : body);
    bool good = copy_fine(body, with_cuts ? copy : copy_tracked, next) &&
                copy_mesh(&body->coarse, copy, &next->coarse) &&
                copy(body->coarse_of_fine, tets, sizeof *body->coarse_of_fine, &next->coarse_of_fine) &&
                copy(body->fine_of_coarse, coarse_nodes, sizeof *body->fine_of_coarse, &next->fine_of_coarse) &&
                copy(body->coarse_material, coarse_tets, sizeof *body->coarse_material, &next->coarse_material) &&
                copy(body->fine_fixed, nodes, sizeof *body->fine_fixed, &next->fine_fixed) &&
                copy(body->coarse_fixed, coarse_nodes, sizeof *body->coarse_fixed, &next->coarse_fixed);
    status = good ? PLIANT_OK : pliant_fail_memory("the next body");
    if (body->voxels) next->voxels = pliant_voxels_retain(body->voxels);
    if (status == PLIANT_OK && with_cuts && body->cuts) status = pliant_cuts_copy(body->cuts, &next->cuts);
    if (status == PLIANT_OK && body->subdivision)
        status = pliant_subdivision_copy(body->subdivision, body->fine.num_nodes, &next->subdivision);
    if (status == PLIANT_OK && body->pieces) status = pliant_pieces_copy(body->pieces, &next->pieces);
    if (status != PLIANT_OK) {
        pliant_body_release(next);
        return status;
    }
    *out = next;
    return PLIANT_OK;
}

pliant_status pliant_body_next(const pliant_body *body, uint64_t revision, pliant_body **out)
{
    pliant_body *next = NULL;
    pliant_status status = pliant_body_begin(body, revision, true, &next);
    if (status != PLIANT_OK) return status;
    next->num_triangles = body->num_triangles;
    if (!copy(body->outside, (size_t)body->num_triangles, sizeof *body->outside, &next->outside) ||
        !copy(body->across, (size_t)body->fine.num_tets, 4 * sizeof *body->across, &next->across) ||
        !copy(body->triangles, (size_t)body->num_triangles, 3 * sizeof *body->triangles, &next->triangles)) {
        pliant_body_release(next);
        return pliant_fail_memory("the next body");
    }
    *out = next;
    return PLIANT_OK;
}
