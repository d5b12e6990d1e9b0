#include "tool/path.h"

#include "base/fail.h"
#include "base/rotate.h"
#include "scene/yaml.h"
#include "tool/shape_text.h"
#include "base/memory.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { MAX_KEYS = 1000000, REASON_SIZE = 512 };

/* The document as text, before its numbers are read. */
typedef struct text_key {
    char *time;
    char **offset, **force, **acceleration; /* only one of them is set */
} text_key;

typedef struct text_blade {
    char *name, **from, **to; /* name, or from and to */
} text_blade;

typedef struct text_pose {
    char *time, **position, **rotation, *jaw;
} text_pose;

typedef struct text_span {
    char *from, *to;
} text_span;

typedef struct text_tool {
    char *name, *drive, *release, *mass;
    char **grasp;
    text_key *motion;
    uint32_t num_motion;
    text_blade *blade;
    pliant_shape_text *shape;
    text_pose *poses;
    uint32_t num_poses;
    text_span *cut;
    uint32_t num_cut;
} text_tool;

typedef struct text_probe {
    char *name;
    char **at;
} text_probe;

typedef struct text_cut {
    char *time, **depth, ***points;
    uint32_t num_points;
} text_cut;

typedef struct text_path {
    text_tool *tools;
    uint32_t num_tools;
    text_cut *cuts;
    uint32_t num_cuts;
    text_key *gravity;
    uint32_t num_gravity;
    text_probe *probes;
    uint32_t num_probes;
} text_path;

static const cyaml_schema_value_t word = {CYAML_VALUE_STRING(CYAML_FLAG_POINTER, char, 0, CYAML_UNLIMITED)};
static const cyaml_schema_field_t key_fields[] = {
    CYAML_FIELD_STRING_PTR("time", CYAML_FLAG_POINTER, text_key, time, 0, CYAML_UNLIMITED),
    CYAML_FIELD_SEQUENCE_FIXED("offset", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_key, offset, &word, 3),
    CYAML_FIELD_SEQUENCE_FIXED("force", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_key, force, &word, 3),
    CYAML_FIELD_END,
};
static const cyaml_schema_value_t key_value = {CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, text_key, key_fields)};
static const cyaml_schema_field_t gravity_fields[] = {
    CYAML_FIELD_STRING_PTR("time", CYAML_FLAG_POINTER, text_key, time, 0, CYAML_UNLIMITED),
    CYAML_FIELD_SEQUENCE_FIXED("acceleration", CYAML_FLAG_POINTER, text_key, acceleration, &word, 3),
    CYAML_FIELD_END,
};
static const cyaml_schema_value_t gravity_value = {CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, text_key, gravity_fields)};
static const cyaml_schema_field_t blade_fields[] = {
    CYAML_FIELD_STRING_PTR("name", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_blade, name, 0, CYAML_UNLIMITED),
    CYAML_FIELD_SEQUENCE_FIXED("from", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_blade, from, &word, 3),
    CYAML_FIELD_SEQUENCE_FIXED("to", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_blade, to, &word, 3),
    CYAML_FIELD_END,
};
static const cyaml_schema_field_t pose_fields[] = {
    CYAML_FIELD_STRING_PTR("time", CYAML_FLAG_POINTER, text_pose, time, 0, CYAML_UNLIMITED),
    CYAML_FIELD_SEQUENCE_FIXED("position", CYAML_FLAG_POINTER, text_pose, position, &word, 3),
    CYAML_FIELD_SEQUENCE_FIXED("rotation", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_pose, rotation, &word, 4),
    CYAML_FIELD_STRING_PTR("jaw", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_pose, jaw, 0, CYAML_UNLIMITED),
    CYAML_FIELD_END,
};
static const cyaml_schema_value_t pose_value = {CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, text_pose, pose_fields)};
static const cyaml_schema_field_t span_fields[] = {
    CYAML_FIELD_STRING_PTR("from", CYAML_FLAG_POINTER, text_span, from, 0, CYAML_UNLIMITED),
    CYAML_FIELD_STRING_PTR("to", CYAML_FLAG_POINTER, text_span, to, 0, CYAML_UNLIMITED),
    CYAML_FIELD_END,
};
static const cyaml_schema_value_t span_value = {CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, text_span, span_fields)};
static const cyaml_schema_value_t point_value = {CYAML_VALUE_SEQUENCE_FIXED(CYAML_FLAG_POINTER, char *, &word, 3)};
static const cyaml_schema_field_t cut_fields[] = {
    CYAML_FIELD_STRING_PTR("time", CYAML_FLAG_POINTER, text_cut, time, 0, CYAML_UNLIMITED),
    CYAML_FIELD_SEQUENCE_COUNT("points", CYAML_FLAG_POINTER, text_cut, points, num_points, &point_value, 2, MAX_KEYS),
    CYAML_FIELD_SEQUENCE_FIXED("depth", CYAML_FLAG_POINTER, text_cut, depth, &word, 3),
    CYAML_FIELD_END,
};
static const cyaml_schema_value_t cut_value = {CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, text_cut, cut_fields)};
static const cyaml_schema_field_t tool_fields[] = {
    CYAML_FIELD_STRING_PTR("name", CYAML_FLAG_POINTER, text_tool, name, 0, CYAML_UNLIMITED),
    CYAML_FIELD_STRING_PTR("drive", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_tool, drive, 0, CYAML_UNLIMITED),
    CYAML_FIELD_STRING_PTR("release", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_tool, release, 0, CYAML_UNLIMITED),
    CYAML_FIELD_STRING_PTR("mass", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_tool, mass, 0, CYAML_UNLIMITED),
    CYAML_FIELD_SEQUENCE_FIXED("grasp", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_tool, grasp, &word, 3),
    CYAML_FIELD_SEQUENCE_COUNT("motion", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_tool, motion, num_motion,
                               &key_value, 1, MAX_KEYS),
    CYAML_FIELD_MAPPING_PTR("blade", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_tool, blade, blade_fields),
    CYAML_FIELD_MAPPING_PTR("shape", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_tool, shape, pliant_shape_fields),
    CYAML_FIELD_SEQUENCE_COUNT("poses", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_tool, poses, num_poses,
                               &pose_value, 1, MAX_KEYS),
    CYAML_FIELD_SEQUENCE_COUNT("cut", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_tool, cut, num_cut, &span_value, 1,
                               MAX_KEYS),
    CYAML_FIELD_END,
};
static const cyaml_schema_value_t tool_value = {CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, text_tool, tool_fields)};
static const cyaml_schema_field_t probe_fields[] = {
    CYAML_FIELD_STRING_PTR("name", CYAML_FLAG_POINTER, text_probe, name, 0, CYAML_UNLIMITED),
    CYAML_FIELD_SEQUENCE_FIXED("at", CYAML_FLAG_POINTER, text_probe, at, &word, 3),
    CYAML_FIELD_END,
};
static const cyaml_schema_value_t probe_value = {CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, text_probe, probe_fields)};
static const cyaml_schema_field_t path_fields[] = {
    CYAML_FIELD_SEQUENCE_COUNT("tools", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_path, tools, num_tools,
                               &tool_value, 1, PLIANT_MAX_TOOLS),
    CYAML_FIELD_SEQUENCE_COUNT("cuts", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_path, cuts, num_cuts, &cut_value,
                               1, MAX_KEYS),
    CYAML_FIELD_SEQUENCE_COUNT("gravity", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_path, gravity, num_gravity,
                               &gravity_value, 1, MAX_KEYS),
    CYAML_FIELD_SEQUENCE_COUNT("probes", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_path, probes, num_probes,
                               &probe_value, 1, MAX_KEYS),
    CYAML_FIELD_END,
};
static const cyaml_schema_value_t path_value = {CYAML_VALUE_MAPPING(CYAML_FLAG_POINTER, text_path, path_fields)};

/* Read a number, or write "field: 'text' is not a number" to reason. */
static bool read_number(const char *field, const char *text, double *out, char reason[REASON_SIZE])
{
    if (pliant_parse_real(text, out)) return true;
    snprintf(reason, REASON_SIZE, "%s: '%.64s' is not a number", field, text);
    return false;
}

static bool read_numbers(const char *field, char **text, int count, double *out, char reason[REASON_SIZE])
{
    for (int n = 0; n < count; ++n)
        if (!read_number(field, text[n], &out[n], reason)) return false;
    return true;
}

/* Maximum time. Times count from the start of a run; larger values are probably seconds, milliseconds or nanoseconds
 * since 1970. */
static const double latest = 1e8; /* three years [s] */

static bool is_unix_time(const char *field, double time, char reason[REASON_SIZE])
{
    if (!(time >= latest)) return false;
    snprintf(
        reason, REASON_SIZE,
        "%s is %.15g s, a time stamp of a clock (counted from 1970); times count from the start of the run: subtract "
        "the first time stamp from all",
        field, time);
    return true;
}

/* Check a time, or write "time: must be ..." to reason. */
static bool check_time(const char *field, double time, bool after, double before, char reason[REASON_SIZE])
{
    if (is_unix_time(field, time, reason)) return false;
    if (time >= 0.0 && (!after || time > before)) return true;
    snprintf(reason, REASON_SIZE, "%s: %g s must be at least 0 and more than the previous time", field, time);
    return false;
}

static bool read_drive(const char *text, pliant_drive *out, char reason[REASON_SIZE])
{
    static const char *const names[] = {"spring", "rigid", "force"};
    static_assert(sizeof names / sizeof *names == PLIANT_NUM_DRIVES, "each drive has a name");
    for (int n = 0; n < PLIANT_NUM_DRIVES; ++n)
        if (!text || strcmp(text, names[n]) == 0) {
            *out = (pliant_drive)n;
            return true;
        }
    snprintf(reason, REASON_SIZE, "drive: '%.64s' is neither spring, rigid nor force", text);
    return false;
}

/* Find the value of a key: return its name, and its three words in *words. Return NULL and a reason for an unsuitable
 * value. */
static const char *value_of(const text_key *key, bool gravity, bool by_force, char ***words, char reason[REASON_SIZE])
{
    *words = gravity ? key->acceleration : by_force ? key->force : key->offset;
    if (gravity) return "gravity/acceleration";
    if (by_force && !key->force)
        snprintf(reason, REASON_SIZE,
                 "motion: drive: force needs a force [N] at every time, as in {time: %.32s, force: [0, -5, 0]}%s",
                 key->time, key->offset ? " instead of offset" : "");
    else if (!by_force && key->force)
        snprintf(reason, REASON_SIZE, "motion/force: only a tool of drive: force has one; others have an offset [m]");
    else if (by_force && key->offset)
        snprintf(reason, REASON_SIZE, "motion/offset: a tool of drive: force has only a force");
    else if (!by_force && !key->offset)
        snprintf(reason, REASON_SIZE, "motion: an offset [m] is missing, as in {time: %.32s, offset: [0, -0.03, 0]}",
                 key->time);
    else return by_force ? "motion/force" : "motion/offset";
    return NULL;
}

/* Return false; an empty reason means that memory is exhausted. */
static bool read_keys(const text_key *text, uint32_t count, bool gravity, bool by_force, pliant_path_key **out,
                      char reason[REASON_SIZE])
{
    const char *time = gravity ? "gravity/time" : "motion/time";
    pliant_path_key *keys = *out = pliant_calloc(count, sizeof *keys);
    if (!keys) return false;
    for (uint32_t k = 0; k < count; ++k) {
        pliant_path_key *key = &keys[k];
        char **words;
        if (!read_number(time, text[k].time, &key->time, reason)) return false;
        const char *name = value_of(&text[k], gravity, by_force, &words, reason);
        if (!name || !read_numbers(name, words, 3, key->value, reason)) return false;
        if (!check_time(time, key->time, k > 0, k > 0 ? key[-1].time : 0, reason)) return false;
    }
    return true;
}

/* Warn about valid numbers that suggest another unit. Typical forces are newtons, typical displacements centimetres. */
static void hint_at_units(const char *file, const pliant_path_tool *tool)
{
    double largest = 0.0;
    for (uint32_t k = 0; k < tool->num_motion; ++k)
        for (int d = 0; d < 3; ++d) largest = fmax(largest, fabs(tool->motion[k].value[d]));
    if (tool->drive == PLIANT_DRIVE_FORCE && largest > 0.0 && largest < 0.1)
        pliant_log(
            PLIANT_LOG_WARNING,
            "%s: tool %s pulls with at most %g N: forces are in newtons; was a way in metres meant (drive: rigid or "
            "spring, with offset)?",
            file, tool->name, largest);
    if (tool->drive != PLIANT_DRIVE_FORCE && largest >= 1.0)
        pliant_log(PLIANT_LOG_WARNING, "%s: tool %s goes %g m far: offsets are in metres; were millimetres meant?",
                   file, tool->name, largest);
}

/* Warn about a late start. Nothing moves before the first time of all tools. */
static void hint_at_start(const char *file, const pliant_path *path)
{
    const double late = 600; /* [s] */
    double first = INFINITY;
    for (uint32_t n = 0; n < path->num_tools; ++n) {
        const pliant_path_tool *tool = &path->tools[n];
        if (tool->num_motion > 0) first = fmin(first, tool->motion[0].time);
        if (tool->num_poses > 0) first = fmin(first, tool->poses[0].time);
    }
    if (path->num_cuts > 0) first = fmin(first, path->cuts[0].time);
    if (path->num_gravity > 0) first = fmin(first, path->gravity[0].time);
    if (first < late || !isfinite(first)) return;
    pliant_log(
        PLIANT_LOG_WARNING,
        "%s: nothing moves before %.15g s: times count from the start of the run; if these are time stamps, subtract "
        "the first one from all",
        file, first);
}

/* ---- blades */

static bool read_poses(const text_tool *text, pliant_path_tool *out, char reason[REASON_SIZE])
{
    if (!(out->poses = pliant_calloc(text->num_poses, sizeof *out->poses))) return false;
    out->num_poses = text->num_poses;
    for (uint32_t p = 0; p < text->num_poses; ++p) {
        const text_pose *from = &text->poses[p];
        pliant_path_pose *pose = &out->poses[p];
        *pose = (pliant_path_pose){.rotation = {0, 0, 0, 1}};
        if (!read_number("poses/time", from->time, &pose->time, reason) ||
            !check_time("poses/time", pose->time, p > 0, p > 0 ? pose[-1].time : 0, reason) ||
            !read_numbers("poses/position", from->position, 3, pose->position, reason) ||
            (from->rotation && !read_numbers("poses/rotation", from->rotation, 4, pose->rotation, reason)) ||
            (from->jaw && !read_number("poses/jaw", from->jaw, &pose->jaw, reason)))
            return false;
        double size = 0;
        for (int d = 0; d < 4; ++d) size += pose->rotation[d] * pose->rotation[d];
        if (size == 0) {
            snprintf(reason, REASON_SIZE, "poses/rotation: is not a rotation; the identity is [0, 0, 0, 1]");
            return false;
        }
        for (int d = 0; d < 4; ++d) pose->rotation[d] /= sqrt(size);
    }
    return true;
}

static bool read_blade(const text_tool *text, pliant_path_tool *out, char reason[REASON_SIZE])
{
    const text_blade *blade = text->blade;
    if (!blade->name == !(blade->from && blade->to)) {
        snprintf(
            reason, REASON_SIZE,
            "blade: needs a name, as in {name: scalpel}, or from and to, as in {from: [0, 0, -0.03], to: [0, 0, 0]}");
        return false;
    }
    if (!blade->name)
        return read_numbers("blade/from", blade->from, 3, out->blade_from, reason) &&
               read_numbers("blade/to", blade->to, 3, out->blade_to, reason);
    if (pliant_blade_find(blade->name, out->blade_from, out->blade_to) == PLIANT_OK) return true;
    snprintf(reason, REASON_SIZE, "blade/name: %.200s", pliant_last_error());
    return false;
}

static bool read_spans(const text_tool *text, pliant_path_tool *out, char reason[REASON_SIZE])
{
    if (!(out->cut = pliant_calloc(text->num_cut, sizeof *out->cut))) return false;
    out->num_cut = text->num_cut;
    for (uint32_t n = 0; n < text->num_cut; ++n) {
        pliant_path_span *span = &out->cut[n];
        if (!read_number("cut/from", text->cut[n].from, &span->from, reason) ||
            !read_number("cut/to", text->cut[n].to, &span->to, reason))
            return false;
        if (is_unix_time("cut/from", span->from, reason)) return false;
        if (span->from >= 0 && span->to > span->from && (n == 0 || span->from > span[-1].to)) continue;
        snprintf(reason, REASON_SIZE, "cut: %g s to %g s must begin after 0 and after the previous cut, and end later",
                 span->from, span->to);
        return false;
    }
    return true;
}

/* Read a tool that moves from pose to pose. */
static bool read_posed(const text_tool *text, const char *file, pliant_path_tool *out, char reason[REASON_SIZE])
{
    if (text->grasp || text->motion || text->drive || text->release) {
        snprintf(reason, REASON_SIZE,
                 "poses: a tool with poses has no grasp, motion, drive or release; only a tool that grasps has these");
        return false;
    }
    if (text->cut && !text->blade) {
        snprintf(reason, REASON_SIZE, "cut: needs a blade, as in blade: {name: scalpel}");
        return false;
    }
    if (text->shape && !pliant_shape_from_text(text->shape, file, &out->shape, reason, REASON_SIZE)) return false;
    return read_poses(text, out, reason) && (!text->blade || read_blade(text, out, reason)) &&
           (!text->cut || read_spans(text, out, reason));
}

static bool read_cut(const text_cut *text, pliant_path_cut *out, char reason[REASON_SIZE])
{
    if (!(out->points = pliant_calloc(text->num_points, 3 * sizeof *out->points))) return false;
    out->num_points = text->num_points;
    if (!read_number("cuts/time", text->time, &out->time, reason) ||
        !read_numbers("cuts/depth", text->depth, 3, out->depth, reason))
        return false;
    for (uint32_t p = 0; p < text->num_points; ++p)
        if (!read_numbers("cuts/points", text->points[p], 3, out->points + 3 * p, reason)) return false;
    return true;
}

static bool read_name(const char *text, char *out, size_t size, char reason[REASON_SIZE])
{
    if (!*text || strlen(text) >= size) {
        snprintf(reason, REASON_SIZE, "name: must have 1 to %zu characters", size - 1);
        return false;
    }
    strcpy(out, text);
    return true;
}

static bool read_tool(const text_tool *text, const char *file, pliant_path_tool *out, char reason[REASON_SIZE])
{
    if (!read_name(text->name, out->name, sizeof out->name, reason)) return false;
    if (text->poses) return read_posed(text, file, out, reason);
    if (!text->grasp || !text->motion || text->blade || text->shape || text->cut) {
        snprintf(reason, REASON_SIZE,
                 "grasp: a tool needs grasp and motion, or poses; one with a blade or a shape has poses");
        return false;
    }
    if (!read_drive(text->drive, &out->drive, reason)) return false;
    for (int d = 0; d < 3; ++d)
        if (!read_number("grasp", text->grasp[d], &out->grasp[d], reason)) return false;
    if (text->release && (!read_number("release", text->release, &out->release, reason) ||
                          is_unix_time("release", out->release, reason)))
        return false;
    if (text->release && out->release <= 0.0) {
        snprintf(reason, REASON_SIZE, "release: %g s must be more than 0", out->release);
        return false;
    }
    if (text->mass && !read_number("mass", text->mass, &out->mass, reason)) return false;
    if (out->mass < 0.0) {
        snprintf(reason, REASON_SIZE, "mass: %g kg must be at least 0", out->mass);
        return false;
    }
    out->num_motion = text->num_motion;
    return read_keys(text->motion, text->num_motion, false, out->drive == PLIANT_DRIVE_FORCE, &out->motion, reason);
}

static pliant_status read_probes(const text_path *text, const char *yaml, const char *name, pliant_path *out)
{
    const int list = pliant_yaml_line(yaml, "probes", 0, 1);
    for (uint32_t n = 0; n < text->num_probes; ++n) {
        char reason[REASON_SIZE] = "";
        bool good = read_name(text->probes[n].name, out->probes[n].name, sizeof out->probes[n].name, reason);
        for (int d = 0; good && d < 3; ++d)
            good = read_number("at", text->probes[n].at[d], &out->probes[n].at[d], reason);
        if (!good)
            return pliant_fail(PLIANT_ERROR_FORMAT, "%s: line %d: probe %u: %s", name,
                               pliant_yaml_line(yaml, "at", (int)n, list), n + 1, reason);
    }
    return PLIANT_OK;
}

/* Return the number of names in the document before a tool: names of tools, blades and shapes. libcyaml has accepted
 * the document, and every tool starts with exactly one name. */
static int names_before(const text_path *text, uint32_t tool)
{
    int count = 0;
    for (uint32_t n = 0; n < tool; ++n)
        count += 1 + (text->tools[n].blade && text->tools[n].blade->name) +
                 (text->tools[n].shape && text->tools[n].shape->name);
    return count;
}

static pliant_status convert(const text_path *text, const char *yaml, const char *name, pliant_path *out)
{
    for (uint32_t n = 0; n < text->num_tools; ++n) {
        char reason[REASON_SIZE] = "";
        bool good = read_tool(&text->tools[n], name, &out->tools[n], reason);
        for (uint32_t k = 0; good && k < n; ++k)
            if (strcmp(out->tools[k].name, out->tools[n].name) == 0) {
                snprintf(reason, sizeof reason, "name: another tool has the same name");
                good = false;
            }
        if (good) continue;
        if (!reason[0]) return pliant_fail_memory("a tool path");
        return pliant_fail(PLIANT_ERROR_FORMAT, "%s: line %d: tool %u '%.48s': %s", name,
                           pliant_yaml_line(yaml, "name", names_before(text, n), 1), n + 1, text->tools[n].name,
                           reason);
    }
    for (uint32_t n = 0; n < text->num_cuts; ++n) {
        char wrong[REASON_SIZE] = "";
        bool good = read_cut(&text->cuts[n], &out->cuts[n], wrong);
        if (good && check_time("cuts/time", out->cuts[n].time, n > 0, n > 0 ? out->cuts[n - 1].time : 0, wrong))
            continue;
        if (!wrong[0]) return pliant_fail_memory("a tool path");
        return pliant_fail(PLIANT_ERROR_FORMAT, "%s: line %d: cut %u: %s", name, pliant_yaml_line(yaml, "cuts", 0, 1),
                           n + 1, wrong);
    }
    char reason[REASON_SIZE] = "";
    out->num_gravity = text->num_gravity;
    if (text->num_gravity == 0 ||
        read_keys(text->gravity, text->num_gravity, true, false, &out->gravity, reason))
        return PLIANT_OK;
    if (!reason[0]) return pliant_fail_memory("a tool path");
    return pliant_fail(PLIANT_ERROR_FORMAT, "%s: line %d: %s", name, pliant_yaml_line(yaml, "gravity", 0, 1), reason);
}

pliant_status pliant_path_read(const char *path, pliant_path *out)
{
    char *yaml = NULL;
    void *document = NULL;
    pliant_path result = {.tools = NULL};
    pliant_status status = pliant_text_read(path, &yaml);
    if (status == PLIANT_OK) status = pliant_yaml_load(yaml, path, &path_value, &document);
    if (status != PLIANT_OK) goto end;
    const text_path *text = document;
    if (!text || text->num_tools + text->num_cuts + text->num_gravity + text->num_probes == 0) {
        status = pliant_fail(PLIANT_ERROR_FORMAT,
                             "%s: is empty; a list named tools is needed, or cuts, gravity or probes", path);
        goto end;
    }
    if (text->num_tools > 0) result.tools = pliant_calloc(text->num_tools, sizeof *result.tools);
    if (text->num_cuts > 0) result.cuts = pliant_calloc(text->num_cuts, sizeof *result.cuts);
    if (text->num_probes > 0) result.probes = pliant_calloc(text->num_probes, sizeof *result.probes);
    if ((text->num_tools > 0 && !result.tools) || (text->num_cuts > 0 && !result.cuts) ||
        (text->num_probes > 0 && !result.probes)) {
        status = pliant_fail_memory("a tool path");
        goto end;
    }
    result.num_tools = text->num_tools;
    result.num_probes = text->num_probes;
    result.num_cuts = text->num_cuts;
    status = convert(text, yaml, path, &result);
    if (status == PLIANT_OK) status = read_probes(text, yaml, path, &result);
    if (status == PLIANT_OK) {
        for (uint32_t n = 0; n < result.num_tools; ++n) hint_at_units(path, &result.tools[n]);
        hint_at_start(path, &result);
        *out = result;
        result = (pliant_path){.tools = NULL};
    }
end:
    pliant_path_free(&result);
    pliant_yaml_free(&path_value, document);
    pliant_free(yaml);
    return status;
}

void pliant_path_free(pliant_path *path)
{
    if (!path) return;
    for (uint32_t n = 0; path->tools && n < path->num_tools; ++n) {
        PLIANT_FREE(path->tools[n].motion, path->tools[n].poses, path->tools[n].cut);
        pliant_tool_shape_free(&path->tools[n].shape);
    }
    for (uint32_t n = 0; path->cuts && n < path->num_cuts; ++n) pliant_free(path->cuts[n].points);
    PLIANT_FREE(path->tools, path->cuts, path->gravity, path->probes);
    memset(path, 0, sizeof *path);
}

static void between(const pliant_path_key *key, uint32_t count, double time, double value[3])
{
    uint32_t after = 0;
    while (after < count && key[after].time <= time) ++after;
    uint32_t before = after > 0 ? after - 1 : 0;
    if (after == count) after = before;
    double span = key[after].time - key[before].time;
    double part = span > 0.0 ? (time - key[before].time) / span : 0.0;
    for (int d = 0; d < 3; ++d)
        value[d] = key[before].value[d] + part * (key[after].value[d] - key[before].value[d]);
}

bool pliant_path_gravity(const pliant_path *path, double time, double gravity[3])
{
    if (path->num_gravity > 0) between(path->gravity, path->num_gravity, time, gravity);
    return path->num_gravity > 0;
}

bool pliant_path_at(const pliant_path_tool *tool, double time, double value[3])
{
    if (tool->num_motion == 0) return false;
    between(tool->motion, tool->num_motion, time, value);
    return tool->release <= 0.0 || time < tool->release;
}

/* Find the poses before and after a time. Return the interpolation fraction between them. */
static double find_poses(const pliant_path_tool *tool, double time, const pliant_path_pose **before,
                         const pliant_path_pose **after)
{
    uint32_t next = 0;
    while (next < tool->num_poses && tool->poses[next].time <= time) ++next;
    *before = tool->poses + (next > 0 ? next - 1 : 0);
    *after = next < tool->num_poses ? tool->poses + next : *before;
    return (*after)->time > (*before)->time ? fmax((time - (*before)->time) / ((*after)->time - (*before)->time), 0)
                                            : 0;
}

bool pliant_path_pose_at(const pliant_path_tool *tool, double time, double position[3], double rotation[4])
{
    if (tool->num_poses == 0) return false;
    const pliant_path_pose *a, *b;
    const double part = find_poses(tool, time, &a, &b);
    for (int d = 0; d < 3; ++d) position[d] = a->position[d] + part * (b->position[d] - a->position[d]);
    pliant_rotation_between(a->rotation, b->rotation, part, rotation);
    return true;
}

double pliant_path_jaw_at(const pliant_path_tool *tool, double time)
{
    if (tool->num_poses == 0) return 0;
    const pliant_path_pose *a, *b;
    const double part = find_poses(tool, time, &a, &b);
    return a->jaw + part * (b->jaw - a->jaw);
}

bool pliant_path_cuts(const pliant_path_tool *tool, double time)
{
    const double rounding = 1e-9; /* tolerance [s]: times are multiples of the step length */
    for (uint32_t n = 0; n < tool->num_cut; ++n)
        if (time >= tool->cut[n].from - rounding && time <= tool->cut[n].to + rounding) return true;
    return false;
}

double pliant_path_end(const pliant_path *path)
{
    double end = path->num_gravity > 0 ? path->gravity[path->num_gravity - 1].time : 0.0;
    if (path->num_cuts > 0) end = fmax(end, path->cuts[path->num_cuts - 1].time);
    for (uint32_t n = 0; n < path->num_tools; ++n) {
        const pliant_path_tool *tool = &path->tools[n];
        if (tool->num_motion > 0) end = fmax(end, tool->motion[tool->num_motion - 1].time);
        if (tool->num_poses > 0) end = fmax(end, tool->poses[tool->num_poses - 1].time);
        if (tool->num_cut > 0) end = fmax(end, tool->cut[tool->num_cut - 1].to);
        end = fmax(end, tool->release);
    }
    return end;
}
