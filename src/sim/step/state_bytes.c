/* Convert a simulation state to bytes for a file, and back. The bytes are a header, the struct without its
 * pointers, the arrays, and the contact points. */
#include "sim/step/state.h"

#include "base/fail.h"
#include "contact/detect/part_contacts.h"
#include "contact/shapes/shapes.h"
#include "base/memory.h"
#include "sim/step/contact.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum {
    FORMAT = 7 /* increment when the meaning of the bytes changes; the header also stores the size of the struct */
};

typedef struct header {
    char magic[8];
    uint32_t format, scalars; /* FORMAT; sizeof(pliant_state) */
    char version[16];         /* PLIANT_VERSION of the writer */
    uint64_t mesh;            /* checksum of the fine mesh */
    uint64_t bytes, checksum; /* of the data after the header */
} header;

static const char magic[8] = "pliantst";

/* FNV-1a over 64-bit words and the remaining bytes. */
static uint64_t add_sum(uint64_t sum, const void *bytes, size_t count)
{
    const unsigned char *at = bytes;
    for (; count >= sizeof(uint64_t); count -= sizeof(uint64_t), at += sizeof(uint64_t)) {
        uint64_t word;
        memcpy(&word, at, sizeof word);
        sum = (sum ^ word) * 0x100000001b3u;
    }
    for (; count > 0; count--) sum = (sum ^ *at++) * 0x100000001b3u;
    return sum;
}
static const uint64_t no_sum = 0xcbf29ce484222325u;

static uint64_t mesh_sum(const pliant_body *body)
{
    const uint64_t sum = add_sum(no_sum, body->fine.rest, 3 * (size_t)body->fine.num_nodes * sizeof *body->fine.rest);
    return add_sum(sum, body->fine.tets, 4 * (size_t)body->fine.num_tets * sizeof *body->fine.tets);
}

/* ---- writing */

static size_t size_of(const pliant_state *state)
{
    size_t size =
        sizeof(header) + sizeof *state + (size_t)state->contact[0].points.count * sizeof(pliant_contact_point);
#define ADD_SIZE(type, name) size += state->name.count * sizeof *state->name.at;
    PLIANT_STATE_ARRAYS(ADD_SIZE)
#undef ADD_SIZE
    return size - state->undo.count * sizeof *state->undo.at;
}

static void put(char **out, const void *bytes, size_t size)
{
    if (size > 0) memcpy(*out, bytes, size);
    *out += size;
}

/* Copy the struct without its pointers. */
static void take_scalars(const pliant_state *state, pliant_state *out)
{
    memcpy(out, state, sizeof *out);
    out->model = NULL;
    out->body = NULL;
    out->undo.count = 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) memset(&out->tools[t].shape, 0, sizeof out->tools[t].shape);
    for (int c = 0; c < 2; c++)
        out->contact[c] = (pliant_state_contact){.points = {.count = c == 0 ? state->contact[0].points.count : 0}};
#define FORGET_ARRAY(type, name) out->name.at = NULL;
    PLIANT_STATE_ARRAYS(FORGET_ARRAY)
#undef FORGET_ARRAY
}

size_t pliant_state_write(const pliant_state *state, size_t size, void *out)
{
    const size_t needed = state->body ? size_of(state) : 0;
    if (needed == 0 || size < needed) return needed;
    pliant_state scalars;
    take_scalars(state, &scalars);
    char *at = (char *)out + sizeof(header), *const begin = at;
    put(&at, &scalars, sizeof scalars);
#define PUT_ARRAY(type, name) put(&at, state->name.at, scalars.name.count * sizeof *state->name.at);
    PLIANT_STATE_ARRAYS(PUT_ARRAY)
#undef PUT_ARRAY
    put(&at, state->contact[0].points.point, (size_t)state->contact[0].points.count * sizeof(pliant_contact_point));
    header head = {.format = FORMAT,
                   .scalars = sizeof *state,
                   .version = PLIANT_VERSION,
                   .mesh = mesh_sum(state->body),
                   .bytes = (uint64_t)(at - begin)};
    memcpy(head.magic, magic, sizeof head.magic);
    head.checksum = add_sum(no_sum, begin, (size_t)head.bytes);
    memcpy(out, &head, sizeof head);
    return needed;
}

/* ---- reading */

static pliant_status check_header(size_t size, const void *bytes, const pliant_body *body)
{
    header head;
    if (size < sizeof head || memcmp(bytes, magic, sizeof magic) != 0)
        return pliant_fail(PLIANT_ERROR_FORMAT, "the %zu bytes are not a simulation state", size);
    memcpy(&head, bytes, sizeof head);
    head.version[sizeof head.version - 1] = 0;
    if (head.format != FORMAT || head.scalars != sizeof(pliant_state))
        return pliant_fail(PLIANT_ERROR_FORMAT,
                           "the simulation state was written by Pliant %s in format %u (%u bytes); Pliant %s "
                           "reads format %d (%zu bytes): read it with the version that wrote it",
                           head.version, head.format, head.scalars, PLIANT_VERSION, FORMAT, sizeof(pliant_state));
    if (head.bytes != size - sizeof head ||
        head.checksum != add_sum(no_sum, (const char *)bytes + sizeof head, size - sizeof head))
        return pliant_fail(PLIANT_ERROR_FORMAT, "the simulation state is damaged: %zu bytes", size);
    if (head.mesh != mesh_sum(body))
        return pliant_fail(
            PLIANT_ERROR_FORMAT,
            "the simulation state belongs to another mesh: build the model from the scene, the scan and the cuts that "
            "it was saved with");
    return PLIANT_OK;
}

/* Return false if the data are too short. */
static bool get(const char **from, size_t *left, size_t size, size_t count, void *out)
{
    if (count > *left / size) return false;
    if (count > 0) memcpy(out, *from, count * size);
    *from += count * size;
    *left -= count * size;
    return true;
}

/* Read the arrays and the contact points. scalars: contains their sizes */
static pliant_status read_arrays(const char *from, size_t left, const pliant_state *scalars, pliant_state *out)
{
#define READ_ARRAY(type, name) \
    if (scalars->name.count > left / sizeof *out->name.at) \
        return pliant_fail(PLIANT_ERROR_FORMAT, "the simulation state is truncated"); \
    if (scalars->name.count > 0 && !(out->name.at = pliant_calloc(scalars->name.count, sizeof *out->name.at))) \
        return pliant_fail_memory("the simulation state"); \
    out->name.count = out->name.capacity = scalars->name.count; \
    if (!get(&from, &left, sizeof *out->name.at, out->name.count, (void *)out->name.at)) return PLIANT_ERROR_FORMAT;
    PLIANT_STATE_ARRAYS(READ_ARRAY)
#undef READ_ARRAY
    const int32_t points = scalars->contact[0].points.count;
    if (points < 0 || (size_t)points != left / sizeof(pliant_contact_point) || left % sizeof(pliant_contact_point) != 0)
        return pliant_fail(PLIANT_ERROR_FORMAT,
                           "the simulation state has %zu bytes of contact points, but should have %d points", left,
                           points);
    pliant_status status = pliant_contacts_reserve(&out->contact[0].points, points);
    if (status != PLIANT_OK) return status;
    out->contact[0].points.count = points;
    return get(&from, &left, sizeof(pliant_contact_point), (size_t)points, out->contact[0].points.point)
               ? PLIANT_OK
               : PLIANT_ERROR_FORMAT;
}

static bool are_below(const int32_t *numbers, size_t count, int32_t low, int32_t end)
{
    for (size_t n = 0; n < count; n++)
        if (numbers[n] < low || numbers[n] >= end) return false;
    return true;
}

static bool are_finite(const double *numbers, size_t count)
{
    for (size_t n = 0; n < count; n++)
        if (!isfinite(numbers[n])) return false;
    return true;
}

static bool points_are_sound(const pliant_state *state, int32_t nodes)
{
    for (int32_t p = 0; p < state->contact[0].points.count; p++) {
        const pliant_contact_point *point = state->contact[0].points.point + p;
        const bool of_tool = point->kind == PLIANT_OBSTACLE_TOOL;
        if (point->count < 0 || point->count > PLIANT_CONTACT_NODES ||
            !are_below(point->node, (size_t)point->count, 0, nodes))
            return false;
        if (of_tool &&
            (point->tool < 0 || point->tool >= state->num_tools || point->part < 0 || point->part >= PLIANT_MAX_PARTS))
            return false;
    }
    return true;
}

/* Return whether all nodes, tetrahedra, pieces and tools exist that the state refers to. */
static bool is_sound(const pliant_state *state, const pliant_body *body)
{
    const int32_t nodes = body->fine.num_nodes, pieces = body->pieces ? body->pieces->count : 0;
    size_t held = 0, points = 0;
    if (state->num_tools < 0 || state->num_tools > PLIANT_MAX_TOOLS || state->iterations < 1 || !(state->tolerance > 0))
        return false;
    for (int t = 0; t < state->num_tools; t++) {
        if (state->tools[t].num_held < 0 || state->tools[t].blade.edge.count < 0) return false;
        held += (size_t)state->tools[t].num_held;
        points += (size_t)state->tools[t].blade.edge.count;
    }
    for (size_t g = 0; g < state->grips.count; g++)
        if (state->grips.at[g].tool < 0 || state->grips.at[g].tool >= state->num_tools ||
            state->grips.at[g].piece < 0 || state->grips.at[g].piece >= pieces)
            return false;
    return state->held.count == held && state->held_weight.count == held && state->edge_tet.count == points &&
           state->edge_carrier.count == points && state->edge_place.count == 3 * points &&
           state->edge_now.count == 3 * points && state->edge_carrier_offset.count == 3 * points &&
           state->edge_weight.count == 4 * points && are_below(state->held.at, held, 0, nodes) &&
           are_below(state->edge_tet.at, points, -1, body->fine.num_tets) &&
           are_below(state->edge_carrier.at, points, -1, nodes) &&
           are_finite(state->positions.at, state->positions.count) &&
           are_finite(state->solved.at, state->solved.count) &&
           are_finite(state->displacement.at, state->displacement.count) &&
           are_finite(state->increment.at, state->increment.count) &&
           are_finite(state->piece_positions.at, state->piece_positions.count) && points_are_sound(state, nodes);
}

static bool has_same_tools(const pliant_state *state, const pliant_data *data)
{
    bool same = state->num_tools == data->num_tools;
    for (int t = 0; same && t < data->num_tools; t++) {
        const pliant_tool *saved = state->tools + t, *now = data->tools + t;
        same = strncmp(saved->name, now->name, sizeof now->name) == 0 &&
               memcmp(saved->blade.from, now->blade.from, sizeof now->blade.from) == 0 &&
               memcmp(saved->blade.to, now->blade.to, sizeof now->blade.to) == 0;
    }
    return same;
}

/* Discard grasps and contacts if the simulation has other tools. */
static void drop_tools(pliant_state *state, const pliant_data *data)
{
    int32_t left = 0;
    pliant_contacts *points = &state->contact[0].points;
    for (int32_t p = 0; p < points->count; p++)
        if (points->point[p].kind != PLIANT_OBSTACLE_TOOL) points->point[left++] = points->point[p];
    points->count = left;
    state->grips.count = state->held.count = state->held_weight.count = 0;
    state->edge_place.count = state->edge_now.count = state->edge_carrier_offset.count = state->edge_weight.count =
        state->edge_tet.count = state->edge_carrier.count = 0;
    state->num_tools = data->num_tools;
    for (int t = 0; t < data->num_tools; t++) {
        pliant_tool *tool = state->tools + t;
        *tool = data->tools[t];
        tool->held = NULL;
        tool->weight = NULL;
        tool->num_held = 0;
        tool->holding = tool->attached = false;
        tool->blade.edge = (pliant_edge){.count = 0};
        tool->blade.is_in_stroke = tool->blade.is_dragging = tool->blade.is_ending = false;
    }
}

static pliant_status read_state(const pliant_model *model, const pliant_data *data, const pliant_body *body,
                                const char *bytes, size_t size, pliant_state *out)
{
    const char *from = bytes + sizeof(header) + sizeof *out;
    if (size < sizeof(header) + sizeof *out)
        return pliant_fail(PLIANT_ERROR_FORMAT, "the simulation state is truncated");
    pliant_state *scalars = pliant_calloc(1, sizeof *scalars);
    if (!scalars) return pliant_fail_memory("the simulation state");
    memcpy(scalars, bytes + sizeof(header), sizeof *scalars);
    memcpy(out, scalars, sizeof *out);
    out->model = NULL;
    out->body = NULL;
    memset(out->contact, 0, sizeof out->contact);
#define NO_ARRAY(type, name) memset(&out->name, 0, sizeof out->name);
    PLIANT_STATE_ARRAYS(NO_ARRAY)
#undef NO_ARRAY
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) memset(&out->tools[t].shape, 0, sizeof out->tools[t].shape);
    pliant_status status =
        scalars->undo.count == 0 ? read_arrays(from, size - (size_t)(from - bytes), scalars, out) : PLIANT_ERROR_FORMAT;
    pliant_free(scalars);
    if (status == PLIANT_OK && !is_sound(out, body))
        status = pliant_fail(PLIANT_ERROR_FORMAT, "the simulation state refers to nodes or tools that do not exist");
    if (status != PLIANT_OK) out->num_tools = 0; /* the state retains nothing yet */
    if (status != PLIANT_OK) return status;
    if (!has_same_tools(out, data)) drop_tools(out, data);
    for (int t = 0; t < out->num_tools; t++) {
        out->tools[t].shape = data->tools[t].shape;
        pliant_tool_shape_retain(&out->tools[t].shape);
    }
    out->model = model;
    out->body = pliant_body_retain(body);
    out->last_revision = body->revision;
    out->undo_tool = -1;
    return PLIANT_OK;
}

pliant_status pliant_state_read(const pliant_model *model, const pliant_data *data, const pliant_body *body,
                                size_t size, const void *bytes, pliant_state *state)
{
    pliant_status status = check_header(size, bytes, body);
    if (status != PLIANT_OK) return status;
    pliant_state *read = pliant_calloc(1, sizeof *read);
    if (!read) return pliant_fail_memory("the simulation state");
    pliant_account *before = pliant_account_use(NULL);
    status = read_state(model, data, body, bytes, size, read);
    pliant_account_use(before);
    if (status == PLIANT_OK) {
        pliant_state_clear(state);
        memcpy(state, read, sizeof *state);
        pliant_free(read);
    } else {
        pliant_state_free(read);
    }
    return status;
}
