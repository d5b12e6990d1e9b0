/* Cut a body along the sweep of a blade, and build the next body. */
#include "cut/cut_stages.h"

#include "base/fail.h"
#include "base/memory.h"

#include <string.h>

/* ---- the report */

static uint8_t material_of(const cut_work *work, int32_t voxel)
{
    const pliant_voxels *voxels = work->voxels;
    const int32_t tet = voxels->owner[voxel];
    return voxels->material[voxels->start[tet] + pliant_voxel_in(voxels, tet, voxel)];
}

static void report_severed_links(const cut_work *work, const pliant_cut_sweep *sweep, pliant_cut_report *report)
{
    const pliant_voxels *voxels = work->voxels;
    report->num_links = work->num_links;
    report->num_bridges = work->num_bridges;
    for (int32_t i = 0; i < work->num_links; i++) {
        const int32_t ends[2] = {(int32_t)(work->link[i] / 4),
                                 (int32_t)(work->link[i] / 4) + pliant_stride_of(voxels, work->link[i] % 4)};
        bool tissue = true;
        for (int end = 0; end < 2; end++)
            tissue = tissue && voxels->of_material[material_of(work, ends[end])].tissue > 0;
        if (!tissue) continue;
        report->area += work->link_area[i];
        for (int end = 0; end < 2 && sweep->material_of_voxel; end++)
            report->area_of[sweep->material_of_voxel[ends[end]]] += 0.5 * work->link_area[i];
    }
}

/* ---- the next body */

static pliant_status divide(cut_work *work, uint64_t revision, pliant_body **out)
{
    const pliant_division division = {.num_tets = work->num_tets,
                                      .tet_source = work->tet_source,
                                      .num_changed = work->num_changed,
                                      .changed = work->changed,
                                      .corners = work->corners,
                                      .material = work->material,
                                      .copy_fixed = work->copy_fixed,
                                      .num_touched = work->num_touched,
                                      .touched = work->touched,
                                      .same_pieces = work->is_still_connected,
                                      .num_joints = work->num_joints,
                                      .joint = work->joint,
                                      .cuts = work->next};
    pliant_status status = pliant_body_divide(work->body, revision, &division, out);
    if (status == PLIANT_OK) work->next = NULL; /* owned by the next body */
    return status;
}

static pliant_status find_state(cut_work *work)
{
    const pliant_cuts *cuts = work->cuts;
    bool good = cut_sparse_create(work->voxels->num_tets, &work->state);
    for (int32_t i = 0; cuts && i < cuts->num_tets && good; i++)
        good = cut_sparse_set(&work->state, cuts->tet[i], -i - 1);
    return good ? PLIANT_OK : pliant_fail_memory("the elements near the blade");
}

/* Append the links and bridges that this cut severs to the log of earlier cuts. */
static pliant_status append_to_cut_log(cut_work *work)
{
    const pliant_cuts *cuts = work->cuts;
    pliant_cuts *next = work->next;
    const int32_t before = cuts ? cuts->num_cuts : 0, old = before > 0 ? cuts->cut_end[before - 1] : 0;
    next->cut_end = pliant_calloc((size_t)before + 1, sizeof *next->cut_end);
    next->stroke = pliant_calloc((size_t)before + 1, 2 * sizeof *next->stroke);
    next->severed =
        pliant_calloc((size_t)old + (size_t)work->num_links + (size_t)work->num_bridges, sizeof *next->severed);
    if (!next->cut_end || !next->stroke || !next->severed) return pliant_fail_memory("the severed links and bridges");
    if (before > 0) memcpy(next->cut_end, cuts->cut_end, (size_t)before * sizeof *next->cut_end);
    if (before > 0) memcpy(next->stroke, cuts->stroke, (size_t)before * 2 * sizeof *next->stroke);
    memcpy(next->stroke + 2 * before, work->stroke, sizeof work->stroke);
    if (old > 0) memcpy(next->severed, cuts->severed, (size_t)old * sizeof *next->severed);
    uint32_t *severed = next->severed + old;
    for (int32_t i = 0; i < work->num_links; i++) *severed++ = work->link[i];
    for (int32_t i = 0; i < work->num_bridges; i++) *severed++ = 4 * (uint32_t)work->bridge[i] + 3;
    next->num_cuts = before + 1;
    next->cut_end[before] = old + work->num_links + work->num_bridges;
    return PLIANT_OK;
}

/* Free everything except the newly severed links and bridges. */
static void forget(cut_work *work)
{
    PLIANT_FREE(work->touched, work->start, work->first, work->voxel, work->part, work->fragment, work->edge,
                work->table, work->changed, work->corners, work->tet_source, work->copy_fixed, work->material,
                work->place, work->is_near_severed_link, work->links.severed, work->joint);
    cut_sparse_free(&work->state);
    pliant_cuts_free(work->next);
    *work = (cut_work){.body = work->body,
                       .voxels = work->voxels,
                       .cuts = work->cuts,
                       .positions = work->positions,
                       .num_links = work->num_links,
                       .num_bridges = work->num_bridges,
                       .link_capacity = work->link_capacity,
                       .bridge_capacity = work->bridge_capacity,
                       .link = work->link,
                       .link_area = work->link_area,
                       .bridge = work->bridge};
}

static pliant_status find_corners(cut_work *work)
{
    for (bool again = true; again;) {
        pliant_status status = pliant_cut_assign_chips(work);
        if (status == PLIANT_OK) status = pliant_cut_corners(work);
        if (status == PLIANT_OK) status = pliant_cut_sever_unrepresentable(work, &again);
        if (status != PLIANT_OK || !again) return status;
        forget(work);
        status = find_state(work);
        if (status == PLIANT_OK) status = pliant_cut_find_touched(work);
        if (status == PLIANT_OK) status = pliant_cut_find_edges(work);
        if (status != PLIANT_OK) return status;
    }
    return PLIANT_OK;
}

/* Build the next body; call after pliant_cut_find_edges. */
static pliant_status make_next(cut_work *work, uint64_t revision, pliant_body **out)
{
    pliant_status status = find_corners(work);
    if (status == PLIANT_OK) status = pliant_cut_materials(work);
    if (status == PLIANT_OK) status = pliant_cut_gather(work);
    if (status == PLIANT_OK) status = append_to_cut_log(work);
    if (status == PLIANT_OK) status = divide(work, revision, out);
    if (status != PLIANT_OK) return status;
    /* the next body is not shared yet, so its cuts may still be written */
    if (work->is_still_connected && work->cuts) (*out)->cuts->num_pieces = work->cuts->num_pieces;
    else status = pliant_cut_count_pieces(*out, &(*out)->cuts->num_pieces);
    if (status == PLIANT_OK) return PLIANT_OK;
    pliant_body_release(*out);
    *out = NULL;
    return status;
}

/* Find the fragments and the edges between them. */
static pliant_status find_fragments(cut_work *work)
{
    for (bool again = true; again;) {
        pliant_status status = pliant_cut_find_touched(work);
        if (status == PLIANT_OK) status = pliant_cut_find_edges(work);
        if (status == PLIANT_OK) status = pliant_cut_restore_small_components(work, &again);
        if (status != PLIANT_OK) return status;
        if (!again) break;
        forget(work);
        status = find_state(work);
        if (status != PLIANT_OK || (work->num_links == 0 && work->num_bridges == 0)) return status;
    }
    return PLIANT_OK;
}

static pliant_status cut(cut_work *work, uint64_t revision, const pliant_cut_sweep *sweep, pliant_body **out,
                         pliant_cut_report *report)
{
    pliant_status status = find_state(work);
    if (status == PLIANT_OK) status = pliant_cut_sever(work, sweep);
    if (status == PLIANT_OK && sweep->stroke > 0) status = pliant_cut_close_seam(work);
    if (status != PLIANT_OK || (work->num_links == 0 && work->num_bridges == 0)) return status;
    status = out ? find_fragments(work) : pliant_cut_find_touched(work);
    if (status != PLIANT_OK || (work->num_links == 0 && work->num_bridges == 0)) return status;
    report_severed_links(work, sweep, report);
    report->touched = work->num_touched;
    if (out) status = make_next(work, revision, out);
    if (status == PLIANT_OK && out) report->pieces = (*out)->cuts->num_pieces;
    return status;
}

static void free_work(cut_work *work)
{
    forget(work);
    PLIANT_FREE(work->link, work->link_area, work->bridge);
}

static pliant_status fail_without_voxels(void)
{
    return pliant_fail(PLIANT_ERROR_ARGUMENT, "the mesh has no voxels to cut: set cut/kind to sever in the scene");
}

pliant_status pliant_body_cut(const pliant_body *body, uint64_t revision, const double *positions,
                              const pliant_cut_sweep *sweep, pliant_body **out, pliant_cut_report *report)
{
    if (!pliant_body_is_cuttable(body)) return fail_without_voxels();
    cut_work work = {.body = body,
                     .voxels = body->voxels,
                     .cuts = body->cuts,
                     .positions = positions,
                     .stroke = {sweep->blade, sweep->stroke}};
    pliant_cut_report result = {0};
    pliant_body *next = NULL;
    pliant_status status;
    if (body->subdivision) {
        status = pliant_cut_subdivide(body, revision, positions, sweep, out ? &next : NULL, &result);
    } else {
        status = cut(&work, revision, sweep, out ? &next : NULL, &result);
        free_work(&work);
    }
    if (status != PLIANT_OK) return status;
    if (out) *out = next;
    if (report) *report = result;
    return PLIANT_OK;
}

/* ---- repeat a recorded cut */

static bool is_there(const pliant_voxels *voxels, const pliant_cuts *cuts, uint32_t code)
{
    const int32_t *size = voxels->geometry.size;
    const int64_t number = code / 4;
    const int axis = (int)(code % 4);
    if (axis == 3) return number < voxels->num_bridges && !(cuts && pliant_bridge_severed(cuts, (int32_t)number));
    if (number >= (int64_t)size[0] * size[1] * size[2]) return false;
    int32_t at[3];
    pliant_place_of(voxels, (int32_t)number, at);
    if (at[axis] + 1 >= size[axis]) return false;
    if (voxels->owner[number] < 0 || voxels->owner[number + pliant_stride_of(voxels, axis)] < 0) return false;
    const int32_t first = cuts ? pliant_lower_bound(cuts->link, cuts->num_links, code) : 0;
    return !cuts || first == cuts->num_links || cuts->link[first] != code;
}

static pliant_status split_severed_links(cut_work *work, int32_t count, const uint32_t *severed)
{
    work->link = pliant_calloc((size_t)count, sizeof *work->link);
    work->bridge = pliant_calloc((size_t)count, sizeof *work->bridge);
    if (!work->link || !work->bridge) return pliant_fail_memory("the severed links and bridges");
    for (int32_t i = 0; i < count; i++) {
        const bool bridge = severed[i] % 4 == 3,
                   ascending = i == 0 || severed[i] > severed[i - 1] || (bridge && severed[i - 1] % 4 != 3);
        if (!ascending || (!bridge && work->num_bridges > 0) || !is_there(work->voxels, work->cuts, severed[i]))
            return pliant_fail(PLIANT_ERROR_ARGUMENT,
                               "%u is not a link or bridge of this mesh: the cut belongs to another scan or mesh",
                               (unsigned)severed[i]);
        if (bridge) work->bridge[work->num_bridges++] = (int32_t)(severed[i] / 4);
        else work->link[work->num_links++] = severed[i];
    }
    return PLIANT_OK;
}

pliant_status pliant_body_sever(const pliant_body *body, uint64_t revision, int32_t count, const uint32_t *severed,
                                pliant_body **out)
{
    if (!body->voxels) return fail_without_voxels();
    if (count < 1) return pliant_fail(PLIANT_ERROR_ARGUMENT, "the cut names no link and no bridge: name at least one");
    cut_work work = {.body = body, .voxels = body->voxels, .cuts = body->cuts};
    pliant_body *next = NULL;
    pliant_status status = find_state(&work);
    if (status == PLIANT_OK) status = split_severed_links(&work, count, severed);
    if (status == PLIANT_OK) status = pliant_cut_find_touched(&work);
    if (status == PLIANT_OK) status = pliant_cut_find_edges(&work);
    if (status == PLIANT_OK) status = make_next(&work, revision, &next);
    free_work(&work);
    if (status == PLIANT_OK) *out = next;
    return status;
}
