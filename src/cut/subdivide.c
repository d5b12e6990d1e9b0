/* Build the next body of a body whose tetrahedra are subdivided by cuts. */
#include "cut/subdivide.h"

#include "base/fail.h"
#include "base/memory.h"

#include <string.h>

static pliant_status no_memory(void) { return pliant_fail_memory("the subdivided elements"); }

/* ---- strokes */

static bool continues_stroke(const pliant_cut_mark *mark, const pliant_cut_sweep *sweep)
{
    return sweep->stroke > 0 && mark->blade == sweep->blade && mark->stroke == sweep->stroke;
}

/* Return whether the stroke has marks. */
static bool restore_marks(cut_splitting *work, const pliant_cut_sweep *sweep)
{
    const pliant_subdivision *subdivision = work->body->subdivision;
    bool any = false;
    for (int32_t m = 0; m < subdivision->num_marks; m++) {
        const pliant_cut_mark *mark = subdivision->mark + m;
        if (!continues_stroke(mark, sweep)) continue;
        work->on[mark->node] = CUT_ON_SURFACE | (mark->passed ? CUT_PASSED | CUT_ON_SWEEP : 0);
        any = true;
    }
    return any;
}

/* Return whether the stroke's marks change. */
static bool have_marks_changed(const cut_splitting *work, const pliant_cut_sweep *sweep)
{
    int32_t before = 0, now = 0;
    for (int32_t m = 0; m < work->body->subdivision->num_marks; m++) {
        const pliant_cut_mark *mark = work->body->subdivision->mark + m;
        if (!continues_stroke(mark, sweep)) continue;
        before++;
        if (!work->on[mark->node] || mark->passed != ((work->on[mark->node] & CUT_PASSED) != 0)) return true;
    }
    for (int32_t n = 0; n < work->num_nodes; n++) now += work->on[n] != 0;
    return sweep->stroke > 0 && now != before;
}

/* Store the marks of other blades and of this stroke.
 * next: not shared yet */
static pliant_status write_marks(const cut_splitting *work, const pliant_cut_sweep *sweep, pliant_subdivision *next)
{
    int32_t count = 0;
    if (sweep->stroke == 0) return PLIANT_OK;
    pliant_cut_mark *marks = pliant_calloc((size_t)next->num_marks + (size_t)work->num_nodes, sizeof *marks);
    if (!marks) return no_memory();
    for (int32_t m = 0; m < next->num_marks; m++)
        if (next->mark[m].blade != sweep->blade) marks[count++] = next->mark[m];
    for (int32_t n = 0; n < work->num_nodes; n++)
        if (work->on[n])
            marks[count++] = (pliant_cut_mark){sweep->blade, sweep->stroke, n, (work->on[n] & CUT_PASSED) != 0};
    pliant_free(next->mark);
    next->mark = marks;
    next->num_marks = count;
    return PLIANT_OK;
}

/* ---- the next body */

/* Return the volume that a tetrahedron had before copies of its nodes left the cut, over its volume. */
static double volume_ratio(const cut_splitting *work, int32_t tet)
{
    const double *corner[4], *before[4];
    for (int v = 0; v < 4; v++) {
        const int32_t node = work->corners[4 * (size_t)tet + (size_t)v];
        const bool is_copy = node >= work->first_copy;
        corner[v] = work->rest + 3 * (size_t)node;
        before[v] = is_copy ? work->rest + 3 * (size_t)work->between[node].end[0] : corner[v];
    }
    return pliant_split_volume(before[0], before[1], before[2], before[3]) /
           pliant_split_volume(corner[0], corner[1], corner[2], corner[3]);
}

static pliant_status divide(const cut_splitting *work, uint64_t revision, pliant_body **out)
{
    const pliant_body *body = work->body;
    const int32_t tets = body->fine.num_tets, nodes = body->fine.num_nodes;
    pliant_tet_material *material = pliant_calloc((size_t)work->num_tets, sizeof *material);
    if (!material) return no_memory();
    /* mass and stiffness are distributed by volume */
    for (int32_t t = 0; t < work->num_tets; t++) {
        material[t] = body->fine_material[work->source[t]];
        if (body->subdivision->kerf > 0) material[t].density *= volume_ratio(work, t); /* the kerf takes no mass */
    }
    const pliant_division division = {.num_tets = work->num_tets,
                                      .tet_source = work->source + tets,
                                      .corners = work->corners,
                                      .material = material,
                                      .copy_fixed = work->fixed + nodes,
                                      .between = work->between + nodes};
    pliant_status status = pliant_body_divide(body, revision, &division, out);
    pliant_free(material);
    return status;
}

static pliant_status make_next(const cut_splitting *work, uint64_t revision, const pliant_cut_sweep *sweep,
                               pliant_body **out, int32_t *pieces)
{
    const pliant_body *body = work->body;
    const bool same_mesh = work->num_nodes == body->fine.num_nodes;
    pliant_body *next = NULL;
    pliant_status status = same_mesh ? pliant_body_next(body, revision, &next) : divide(work, revision, &next);
    if (status == PLIANT_OK) status = write_marks(work, sweep, next->subdivision);
    if (status == PLIANT_OK) status = pliant_cut_count_pieces(next, pieces);
    if (status == PLIANT_OK) *out = next;
    else pliant_body_release(next);
    return status;
}

static pliant_status subdivide(cut_splitting *work, uint64_t revision, const pliant_cut_sweep *sweep, pliant_body **out,
                               pliant_cut_report *report)
{
    const pliant_mesh *fine = &work->body->fine;
    work->has_border[CUT_BEGINNING] = !restore_marks(work, sweep);
    work->has_border[CUT_END] = sweep->stroke == 0 || sweep->ends;
    work->is_trial = !out;
    work->has_border[CUT_FIRST_SIDE] = work->has_border[CUT_LAST_SIDE] = true;
    pliant_status status = pliant_split_edges(work);
    if (status == PLIANT_OK) status = pliant_split_trim(work);
    if (status == PLIANT_OK) status = pliant_split_faces(work, sweep, report);
    if (status != PLIANT_OK) return status;
    for (int32_t t = 0; t < fine->num_tets; t++)
        report->touched +=
            memcmp(fine->tets + 4 * (size_t)t, work->corners + 4 * (size_t)t, 4 * sizeof *fine->tets) != 0;
    const bool has_severed = work->num_nodes > work->first_copy;
    if (!out || (sweep->stroke > 0 ? !have_marks_changed(work, sweep) : !has_severed)) return PLIANT_OK;
    return make_next(work, revision, sweep, out, &report->pieces);
}

pliant_status pliant_cut_subdivide(const pliant_body *body, uint64_t revision, const double *positions,
                                   const pliant_cut_sweep *sweep, pliant_body **out, pliant_cut_report *report)
{
    cut_strip strip;
    cut_splitting work = {0};
    const double aside[3] = {0};
    pliant_status status = pliant_cut_strip(sweep, aside, &strip);
    if (status == PLIANT_OK && strip.count > 0) {
        status = pliant_split_begin(body, positions, sweep, &strip, &work);
        if (status == PLIANT_OK) status = subdivide(&work, revision, sweep, out, report);
        pliant_split_end(&work);
    }
    pliant_free(strip.triangles);
    return status;
}
