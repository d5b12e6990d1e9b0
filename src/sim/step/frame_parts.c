#include "sim/step/frame_parts.h"

#include "backend/backend.h"
#include "fem/dynamics/tled.h"
#include "pliant/memory.h"
#include "sim/step/contact.h"

#include <math.h>
#include <string.h>

enum { MOST = 8 /* parts of a frame that are run again */ };
static const double each = 0.5; /* of a tool's part's depth: so far it and the tissue may go in a part of a frame, together */

/* Where held points are and were, and are pulled to (fem/dynamics/tled.h). */
typedef struct holds {
    double target[PLIANT_MAX_TOOLS][3], passed[PLIANT_MAX_TOOLS][3], passed_target[PLIANT_MAX_TOOLS][3], passed_step;
} holds;

/* What a part began with; what it was run with is kept by who runs it. */
typedef struct part_begin {
    bool kept;
    int32_t made, substeps;
    double *positions;               /* (nodes x 3) [m] */
    holds held;
    pliant_tool tools[PLIANT_MAX_TOOLS];
    double error;
    pliant_contacts points;          /* with those of what has got by since */
} part_begin;

/* As it has ended, before it is run again. */
typedef struct part_end {
    double *u, *d;                   /* (nodes x 3) [m] */
    float (*memory)[6 * PLIANT_PRONY_TERMS][LANES]; /* (blocks) */
    holds held;
    pliant_tool tools[PLIANT_MAX_TOOLS];
    pliant_contacts points;
    pliant_statistics told;
    int32_t made;
} part_end;

/* What a frame began with, of the stages from contact to upsample; and what its parts have told. */
struct pliant_frame_begin {
    bool kept;                       /* the frame is run in parts */
    int32_t again;                   /* so many of them were run again */
    int32_t room_nodes, room_blocks;
    double *positions, *u, *d;       /* (nodes x 3) */
    float (*memory)[6 * PLIANT_PRONY_TERMS][LANES]; /* (blocks) */
    holds held;
    int32_t substeps;
    pliant_contact_kept contact;
    pliant_contacts told, merged;    /* forces times the share of the frame [N]; room for the next ones */
    part_begin part;
    part_end end;
};

static void take_holds(const pliant_tled *tled, holds *out)
{
    memcpy(out->target, tled->target, sizeof out->target);
    memcpy(out->passed, tled->passed, sizeof out->passed);
    memcpy(out->passed_target, tled->passed_target, sizeof out->passed_target);
    out->passed_step = tled->passed_step;
}

static void put_holds(const holds *from, pliant_tled *tled)
{
    memcpy(tled->target, from->target, sizeof tled->target);
    memcpy(tled->passed, from->passed, sizeof tled->passed);
    memcpy(tled->passed_target, from->passed_target, sizeof tled->passed_target);
    tled->passed_step = from->passed_step;
}

/* false: there is no memory for it */
static bool reserve(struct pliant_frame_begin *begin, int32_t nodes, int32_t blocks)
{
    double **const rooms[] = {&begin->positions, &begin->u, &begin->d, &begin->part.positions, &begin->end.u, &begin->end.d};
    for (int r = 0; r < 6 && nodes > begin->room_nodes; r++) {
        double *made = pliant_resize(*rooms[r], (size_t)nodes, 3 * sizeof *made);
        if (!made) return false;
        *rooms[r] = made;
    }
    if (nodes > begin->room_nodes) begin->room_nodes = nodes;
    if (blocks <= begin->room_blocks) return true;
    void *made = pliant_resize(begin->memory, (size_t)blocks, sizeof *begin->memory);
    if (!made) return false;
    begin->memory = made;
    if (!(made = pliant_resize(begin->end.memory, (size_t)blocks, sizeof *begin->end.memory))) return false;
    begin->end.memory = made;
    begin->room_blocks = blocks;
    return true;
}

/* false: there is no memory for it */
static bool keep(pliant_data *data)
{
    const pliant_tled *tled = data->tled;
    const size_t nodes = (size_t)data->body->fine.num_nodes, blocks = tled->memory ? (size_t)pliant_tled_blocks(tled->system) : 0;
    if (!data->frame_begin && !(data->frame_begin = pliant_calloc(1, sizeof *data->frame_begin))) return false;
    struct pliant_frame_begin *begin = data->frame_begin;
    if (!reserve(begin, (int32_t)nodes, (int32_t)blocks) || pliant_contact_keep(data, &begin->contact) != PLIANT_OK) return false;
    memcpy(begin->positions, data->positions, 3 * nodes * sizeof *data->positions);
    memcpy(begin->u, tled->u, 3 * nodes * sizeof *tled->u);
    memcpy(begin->d, tled->d, 3 * nodes * sizeof *tled->d);
    if (blocks > 0) memcpy(begin->memory, tled->memory, blocks * sizeof *tled->memory);
    take_holds(tled, &begin->held);
    begin->substeps = tled->substeps;
    begin->told.count = 0;
    begin->again = 0;
    return true;
}

/* The next frame begins, and is run as a whole unless it is said otherwise. */
static void begin_anew(pliant_tled *tled)
{
    tled->made = tled->part = 0;
    memset(tled->later, 0, sizeof tled->later);
}

void pliant_frame_undo(const pliant_model *model, pliant_data *data)
{
    struct pliant_frame_begin *begin = data->frame_begin;
    pliant_tled *tled = data->tled;
    data->parts = 1;
    if (!begin || !begin->kept) return;
    const size_t nodes = (size_t)data->body->fine.num_nodes;
    begin->kept = false;
    memcpy(data->positions, begin->positions, 3 * nodes * sizeof *data->positions);
    memcpy(tled->u, begin->u, 3 * nodes * sizeof *tled->u);
    memcpy(tled->d, begin->d, 3 * nodes * sizeof *tled->d);
    if (tled->memory) memcpy(tled->memory, begin->memory, (size_t)pliant_tled_blocks(tled->system) * sizeof *tled->memory);
    put_holds(&begin->held, tled);
    begin_anew(tled);
    for (size_t n = 0; n < 3 * nodes; n++) tled->d[n] *= (double)begin->substeps / tled->substeps; /* sub-steps may have been halved on the way */
    pliant_contact_undo(&begin->contact, data);
    (void)pliant_backend_restart(model, data);
}

/* Tools to where they are after so many sub-steps of the frame. Those that have jumped are there at once, but what they hold is pulled there over the frame. */
static void go(const pliant_model *model, pliant_data *data, int32_t done)
{
    const double share = (double)done / data->tled->substeps;
    for (int t = 0; t < data->num_tools; t++) {
        const pliant_tool *end = data->frame_begin->contact.tools + t; /* where it was set to, and from where */
        pliant_contact_go(model, end, share, data->tools + t);
        data->tled->later[t] = end->holding && !pliant_contact_goes_on(model, end) ? data->tled->substeps - done : 0;
    }
}

/* Of what is left of the frame: how many sub-steps may be run with one set of points. */
static int32_t choose_part(const pliant_model *model, pliant_data *data)
{
    const pliant_tled *tled = data->tled;
    const int32_t left = tled->substeps - tled->made;
    const double deeps = pliant_contact_deeps(model, data, tled->d, left);
    return deeps > each ? (int32_t)fmax(floor(left * each / deeps), 1) : left;
}

void pliant_frame_part_begin(const pliant_model *model, pliant_data *data)
{
    pliant_tled *tled = data->tled;
    if (!tled || tled->system->quasi_static) return;
    struct pliant_frame_begin *begin = data->frame_begin;
    const bool first = tled->made == 0;
    if (first && begin) begin->kept = false;
    if (!first) go(model, data, tled->substeps); /* how far it is from where it is now to the end */
    tled->part = choose_part(model, data);
    if (first && tled->part < tled->substeps && keep(data)) data->frame_begin->kept = true;
    else if (first) begin_anew(tled);
    data->parts = (int32_t)fmax(1, round((double)tled->substeps / pliant_tled_part_steps(tled)));
    if (pliant_tled_in_parts(tled)) go(model, data, tled->made + tled->part);
}

void pliant_frame_part_found(pliant_data *data)
{
    struct pliant_frame_begin *begin = data->frame_begin;
    if (data->tled) data->tled->firm = false;
    if (!data->tled || !begin) return;
    part_begin *part = &begin->part;
    part->kept = begin->kept && begin->again < MOST && pliant_contacts_copy(&data->contacts, &part->points) == PLIANT_OK;
    if (!part->kept) return;
    memcpy(part->positions, data->positions, 3 * (size_t)data->body->fine.num_nodes * sizeof *part->positions);
    memcpy(part->tools, data->tools, sizeof part->tools);
    take_holds(data->tled, &part->held);
    part->made = data->tled->made;
    part->substeps = data->tled->substeps;
    part->error = data->statistics.error;
}

/* false: there is no memory for it */
static bool keep_end(const pliant_data *data, part_end *end)
{
    const pliant_tled *tled = data->tled;
    const size_t nodes = (size_t)data->body->fine.num_nodes;
    if (pliant_contacts_copy(&data->contacts, &end->points) != PLIANT_OK) return false;
    memcpy(end->u, tled->u, 3 * nodes * sizeof *tled->u);
    memcpy(end->d, tled->d, 3 * nodes * sizeof *tled->d);
    if (tled->memory) memcpy(end->memory, tled->memory, (size_t)pliant_tled_blocks(tled->system) * sizeof *tled->memory);
    take_holds(tled, &end->held);
    memcpy(end->tools, data->tools, sizeof end->tools);
    end->told = data->statistics;
    end->made = tled->made;
    return true;
}

/* As it had ended before it was run again. Errors: of a backend that cannot go on from there. */
static pliant_status go_to_end(const pliant_model *model, pliant_data *data)
{
    struct pliant_frame_begin *begin = data->frame_begin;
    part_end *end = &begin->end;
    pliant_tled *tled = data->tled;
    const size_t nodes = (size_t)data->body->fine.num_nodes;
    memcpy(tled->u, end->u, 3 * nodes * sizeof *tled->u);
    memcpy(tled->d, end->d, 3 * nodes * sizeof *tled->d);
    if (tled->memory) memcpy(tled->memory, end->memory, (size_t)pliant_tled_blocks(tled->system) * sizeof *tled->memory);
    put_holds(&end->held, tled);
    memcpy(data->tools, end->tools, sizeof end->tools);
    pliant_contacts_exchange(&data->contacts, &end->points);
    pliant_statistics *now = &data->statistics;
    now->error = end->told.error;
    now->error_before = end->told.error_before;
    now->residual = end->told.residual;
    now->contacts = end->told.contacts;
    now->penetration = end->told.penetration;
    tled->made = end->made;
    tled->firm = begin->part.kept = false;
    pliant_contact_forget_passed(data);
    return pliant_backend_restart(model, data);
}

/* As it began, with points of what has got by. */
static pliant_status go_to_begin(const pliant_model *model, pliant_data *data)
{
    part_begin *part = &data->frame_begin->part;
    pliant_tled *tled = data->tled;
    pliant_tled_back(tled);
    put_holds(&part->held, tled);
    tled->made = part->made * (tled->substeps / part->substeps); /* they may have been halved on the way */
    tled->firm = true;
    memcpy(data->positions, part->positions, 3 * (size_t)data->body->fine.num_nodes * sizeof *part->positions);
    memcpy(data->tools, part->tools, sizeof part->tools);
    data->statistics.error = part->error;
    return pliant_backend_restart(model, data);
}

pliant_status pliant_frame_part_gets_by(const pliant_model *model, pliant_data *data, bool *again)
{
    const double helps = 0.25, slips = 1.25, out = 0.25; /* of a part's depth: further in, or where it was in before, tissue has not just slipped off, but has no way out */
    struct pliant_frame_begin *begin = data->frame_begin;
    *again = false;
    if (!data->tled || !begin || !begin->part.kept) return PLIANT_OK;
    part_begin *part = &begin->part;
    if (data->tled->firm) {
        part->kept = false;
        if (!(pliant_contact_deepest(data, &data->contacts, data->positions, false) > helps)) return PLIANT_OK;
        const pliant_status status = go_to_end(model, data);
        return status == PLIANT_OK ? data->backend->upsample(model, data) : status;
    }
    const pliant_contact_start start = {.positions = part->positions, .points = &part->points};
    const double before = pliant_contact_deepest(data, &part->points, part->positions, true), by = pliant_contact_passed(model, data, &start) ? pliant_contact_passed_by(data) : 0;
    if (!(by > 0 && by < slips && before < out) || !keep_end(data, &begin->end) || pliant_contacts_copy(&part->points, &data->contacts) != PLIANT_OK) {
        pliant_contact_forget_passed(data);
        return PLIANT_OK;
    }
    begin->again++;
    *again = true;
    return go_to_begin(model, data);
}

bool pliant_frame_part_stays(const pliant_model *model, pliant_data *data)
{
    return data->tled && data->tled->firm && go_to_end(model, data) == PLIANT_OK;
}

/* The points of a part, to those that are told; each as it was last. */
static pliant_status add_up(const pliant_data *data, double share)
{
    struct pliant_frame_begin *begin = data->frame_begin;
    const pliant_contacts *told = &begin->told, *now = &data->contacts;
    pliant_contacts *out = &begin->merged;
    if (told->count + now->count > 0) {
        const pliant_status status = pliant_contacts_reserve(out, told->count + now->count);
        if (status != PLIANT_OK) return status;
    }
    out->count = 0;
    for (int32_t a = 0, b = 0; a < told->count || b < now->count;) {
        const int order = a == told->count ? 1 : b == now->count ? -1 : pliant_contact_compare(told->point + a, now->point + b);
        pliant_contact_point *point = out->point + out->count++;
        *point = order < 0 ? told->point[a] : now->point[b];
        for (int d = 0; d < 3; d++) point->force[d] = (order <= 0 ? told->point[a].force[d] : 0) + (order >= 0 ? share * now->point[b].force[d] : 0);
        if (order < 0) point->begun = false;
        a += order <= 0;
        b += order >= 0;
    }
    pliant_contacts_exchange(&begin->told, &begin->merged);
    return PLIANT_OK;
}

/* What has let go is where the tissue's point is: no depth is told of it. */
static void place_at_tissue(const pliant_data *data, pliant_contact_point *point)
{
    for (int d = 0; d < 3; d++) {
        point->place[d] = 0;
        for (int32_t k = 0; k < point->count; k++) point->place[d] += point->weight[k] * data->positions[3 * (size_t)point->node[k] + (size_t)d];
    }
}

/* The frame's own points: forces are means over it. */
static void tell(pliant_data *data)
{
    struct pliant_frame_begin *begin = data->frame_begin;
    const pliant_contacts now = data->contacts;
    int32_t n = 0;
    data->contacts = begin->told;
    begin->told = now;
    data->statistics.contacts = 0;
    for (int32_t p = 0; p < data->contacts.count; p++) {
        pliant_contact_point *point = data->contacts.point + p;
        while (n < now.count && now.point[n].feature < point->feature) n++;
        if (n == now.count || now.point[n].feature != point->feature) place_at_tissue(data, point);
        data->statistics.contacts += point->force[0] != 0 || point->force[1] != 0 || point->force[2] != 0;
    }
}

pliant_status pliant_frame_part_end(pliant_data *data, bool *more)
{
    struct pliant_frame_begin *begin = data->frame_begin;
    *more = false;
    if (!data->tled || !begin || !begin->kept) return PLIANT_OK;
    *more = data->tled->made > 0;
    const pliant_status status = add_up(data, (double)data->tled->part / data->tled->substeps);
    if (status != PLIANT_OK) return status;
    if (*more) {
        pliant_contact_end(data);
        return PLIANT_OK;
    }
    tell(data);
    begin_anew(data->tled);
    return PLIANT_OK;
}

void pliant_frame_parts_free(pliant_data *data)
{
    struct pliant_frame_begin *begin = data->frame_begin;
    if (!begin) return;
    pliant_contact_kept_free(&begin->contact);
    pliant_free(begin->part.points.point);
    pliant_free(begin->part.positions);
    pliant_free(begin->end.points.point);
    pliant_free(begin->end.u);
    pliant_free(begin->end.d);
    pliant_free(begin->end.memory);
    pliant_free(begin->told.point);
    pliant_free(begin->merged.point);
    pliant_free(begin->positions);
    pliant_free(begin->u);
    pliant_free(begin->d);
    pliant_free(begin->memory);
    pliant_free(begin);
}
