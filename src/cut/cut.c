/* A stroke of a blade, from what it passes through to the next body. */
#include "body/parts.h"
#include "cut/work.h"

#include "base/fail.h"
#include "pliant/memory.h"

#include <string.h>

/* ---- the report */

static uint8_t material_of(const cut_work *work, int32_t voxel)
{
    const pliant_voxels *voxels = work->voxels;
    const int32_t tet = voxels->owner[voxel];
    return voxels->material[voxels->start[tet] + pliant_voxel_in(voxels, tet, voxel)];
}

static void tell_severed(const cut_work *work, const pliant_cut_sweep *sweep, pliant_cut_report *report)
{
    const pliant_voxels *voxels = work->voxels;
    report->num_links = work->num_links;
    report->num_bridges = work->num_bridges;
    for (int32_t i = 0; i < work->num_links; i++) {
        const int32_t ends[2] = {(int32_t)(work->link[i] / 4), (int32_t)(work->link[i] / 4) + pliant_stride_of(voxels, work->link[i] % 4)};
        bool tissue = true;
        for (int end = 0; end < 2; end++) tissue = tissue && voxels->of_material[material_of(work, ends[end])].tissue > 0;
        if (!tissue) continue;
        report->area += work->link_area[i];
        for (int end = 0; end < 2 && sweep->material_of_voxel; end++)
            report->area_of[sweep->material_of_voxel[ends[end]]] += 0.5 * work->link_area[i];
    }
}

/* Pieces with tissue; they hang together where they have nodes in common, or joints. */
static pliant_status count_pieces(const pliant_body *body, int32_t *pieces)
{
    const pliant_mesh *fine = &body->fine;
    int32_t *piece = pliant_calloc((size_t)fine->num_nodes, sizeof *piece);
    uint8_t *counted = pliant_calloc((size_t)fine->num_nodes, 1);
    pliant_status status = piece && counted ? PLIANT_OK : pliant_fail_memory("the pieces of a body");
    if (status != PLIANT_OK) goto done;
    for (int32_t n = 0; n < fine->num_nodes; n++) piece[n] = n;
    for (int32_t j = 0; body->pieces && j < body->pieces->num_joints; j++) join(piece, body->pieces->joint[2 * j], body->pieces->joint[2 * j + 1]);
    for (int32_t t = 0; t < fine->num_tets; t++)
        for (int v = 1; v < 4; v++) join(piece, fine->tets[4 * (size_t)t], fine->tets[4 * (size_t)t + v]);
    *pieces = 0;
    for (int32_t t = 0; t < fine->num_tets; t++) {
        const int32_t first = first_of(piece, fine->tets[4 * (size_t)t]);
        if (!(body->fine_material[t].tissue > 0) || counted[first]) continue;
        (*pieces)++;
        counted[first] = 1;
    }
done:
    pliant_free(piece);
    pliant_free(counted);
    return status;
}

/* ---- the next body */

static pliant_status divide(cut_work *work, uint64_t revision, pliant_body **out)
{
    const pliant_division division = {.num_tets = work->num_tets,
                                      .tet_source = work->tet_source,
                                      .corners = work->corners,
                                      .material = work->material,
                                      .copy_fixed = work->copy_fixed,
                                      .num_touched = work->num_touched,
                                      .touched = work->touched,
                                      .cuts = work->next};
    pliant_status status = pliant_body_divide(work->body, revision, &division, out);
    if (status == PLIANT_OK) work->next = NULL; /* taken */
    return status;
}

static pliant_status find_state(cut_work *work)
{
    const pliant_cuts *cuts = work->cuts;
    work->state = pliant_calloc((size_t)work->voxels->num_tets, sizeof *work->state);
    if (!work->state) return pliant_fail_memory("what a blade touches");
    for (int32_t i = 0; cuts && i < cuts->num_tets; i++) work->state[cuts->tet[i]] = -i - 1;
    return PLIANT_OK;
}

static pliant_status cut(cut_work *work, uint64_t revision, const pliant_cut_sweep *sweep, pliant_body **out, pliant_cut_report *report)
{
    pliant_status status = find_state(work);
    if (status == PLIANT_OK) status = pliant_cut_sever(work, sweep);
    if (status != PLIANT_OK || (work->num_links == 0 && work->num_bridges == 0)) return status;
    tell_severed(work, sweep, report);
    if (status == PLIANT_OK) status = pliant_cut_touch(work);
    report->touched = work->num_touched;
    if (status != PLIANT_OK || !out) return status;
    status = pliant_cut_join(work);
    if (status == PLIANT_OK) status = pliant_cut_corners(work);
    if (status == PLIANT_OK) status = pliant_cut_materials(work);
    if (status == PLIANT_OK) status = pliant_cut_gather(work);
    if (status == PLIANT_OK) status = divide(work, revision, out);
    if (status != PLIANT_OK) return status;
    status = count_pieces(*out, &report->pieces);
    if (status != PLIANT_OK) {
        pliant_body_release(*out);
        *out = NULL;
    }
    return status;
}

pliant_status pliant_body_cut(const pliant_body *body, uint64_t revision, const double *positions, const pliant_cut_sweep *sweep, pliant_body **out,
                              pliant_cut_report *report)
{
    if (!body->voxels) return pliant_fail(PLIANT_ERROR_ARGUMENT, "this body has no voxels to cut: set cut/kind to sever in the scene");
    cut_work work = {.body = body, .voxels = body->voxels, .cuts = body->cuts, .positions = positions};
    pliant_cut_report told = {0};
    pliant_body *next = NULL;
    pliant_status status = cut(&work, revision, sweep, out ? &next : NULL, &told);
    void *blocks[] = {work.link, work.link_area, work.bridge,  work.state,      work.touched,    work.start,   work.first, work.voxel,   work.part,
                      work.edge, work.table,     work.corners, work.tet_source, work.copy_fixed, work.material, work.place, work.fragment, work.links.severed};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
    pliant_cuts_free(work.next);
    if (status != PLIANT_OK) return status;
    if (out) *out = next;
    if (report) *report = told;
    return PLIANT_OK;
}
