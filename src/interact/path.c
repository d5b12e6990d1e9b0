#include "pliant/path.h"

#include "base/fail.h"
#include "scene/yaml.h"
#include "pliant/memory.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { MOST_KEYS = 1000000, REASON_SIZE = 256 };

/* The document as it stands, before its numbers are read. */
typedef struct text_key {
    char *time;
    char **offset, **force, **acceleration; /* one of them */
} text_key;

typedef struct text_tool {
    char *name, *drive, *release;
    char **grasp;
    text_key *motion;
    uint32_t num_motion;
} text_tool;

typedef struct text_probe {
    char *name;
    char **at;
} text_probe;

typedef struct text_path {
    text_tool *tools;
    uint32_t num_tools;
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
static const cyaml_schema_field_t tool_fields[] = {
    CYAML_FIELD_STRING_PTR("name", CYAML_FLAG_POINTER, text_tool, name, 0, CYAML_UNLIMITED),
    CYAML_FIELD_STRING_PTR("drive", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_tool, drive, 0, CYAML_UNLIMITED),
    CYAML_FIELD_STRING_PTR("release", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_tool, release, 0, CYAML_UNLIMITED),
    CYAML_FIELD_SEQUENCE_FIXED("grasp", CYAML_FLAG_POINTER, text_tool, grasp, &word, 3),
    CYAML_FIELD_SEQUENCE_COUNT("motion", CYAML_FLAG_POINTER, text_tool, motion, num_motion, &key_value, 1, MOST_KEYS),
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
    CYAML_FIELD_SEQUENCE_COUNT("tools", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_path, tools, num_tools, &tool_value, 1,
                               PLIANT_MAX_TOOLS),
    CYAML_FIELD_SEQUENCE_COUNT("gravity", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_path, gravity, num_gravity, &gravity_value, 1,
                               MOST_KEYS),
    CYAML_FIELD_SEQUENCE_COUNT("probes", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_path, probes, num_probes, &probe_value, 1, MOST_KEYS),
    CYAML_FIELD_END,
};
static const cyaml_schema_value_t path_value = {CYAML_VALUE_MAPPING(CYAML_FLAG_POINTER, text_path, path_fields)};

/* One number; says "field: 'text' is not a number" in reason. */
static bool read_number(const char *field, const char *text, double *out, char reason[REASON_SIZE])
{
    if (pliant_parse_real(text, out)) return true;
    snprintf(reason, REASON_SIZE, "%s: '%.64s' is not a number", field, text);
    return false;
}

static bool read_drive(const char *text, pliant_drive *out, char reason[REASON_SIZE])
{
    static const char *const names[] = {"spring", "rigid", "force"};
    for (int n = 0; n < 3; ++n)
        if (!text || strcmp(text, names[n]) == 0) {
            *out = (pliant_drive)n;
            return true;
        }
    snprintf(reason, REASON_SIZE, "drive: '%.64s' is neither spring, rigid nor force", text);
    return false;
}

/* The words of one kind of value. Gives their name, and in *words the three of them; NULL and a reason where there is another. */
static const char *value_of(const text_key *key, bool gravity, bool by_force, char ***words, char reason[REASON_SIZE])
{
    *words = gravity ? key->acceleration : by_force ? key->force : key->offset;
    if (gravity) return "gravity/acceleration";
    if (by_force && !key->force)
        snprintf(reason, REASON_SIZE, "motion: drive: force needs a force [N] at every time, as in {time: %.32s, force: [0, -5, 0]}%s", key->time,
                 key->offset ? ", in place of offset" : "");
    else if (!by_force && key->force)
        snprintf(reason, REASON_SIZE, "motion/force: only a tool of drive: force has one; others have an offset [m]");
    else if (by_force && key->offset)
        snprintf(reason, REASON_SIZE, "motion/offset: a tool of drive: force has a force alone");
    else if (!by_force && !key->offset)
        snprintf(reason, REASON_SIZE, "motion: an offset [m] is missing, as in {time: %.32s, offset: [0, -0.03, 0]}", key->time);
    else return by_force ? "motion/force" : "motion/offset";
    return NULL;
}

/* false without a reason: out of memory */
static bool read_keys(const text_key *text, uint32_t count, bool gravity, bool by_force, pliant_path_key **out, char reason[REASON_SIZE])
{
    const char *time = gravity ? "gravity/time" : "motion/time";
    pliant_path_key *keys = *out = pliant_calloc(count, sizeof *keys);
    if (!keys) return false;
    for (uint32_t k = 0; k < count; ++k) {
        pliant_path_key *key = &keys[k];
        char **words;
        if (!read_number(time, text[k].time, &key->time, reason)) return false;
        const char *name = value_of(&text[k], gravity, by_force, &words, reason);
        for (int d = 0; d < 3; ++d)
            if (!name || !read_number(name, words[d], &key->value[d], reason)) return false;
        if (key->time < 0.0 || (k > 0 && key->time <= key[-1].time)) {
            snprintf(reason, REASON_SIZE, "%s: %g s must be at least 0 and more than the one before", time, key->time);
            return false;
        }
    }
    return true;
}

/* Numbers that are right by themselves and look like another unit. Forces that move tissue are newtons, ways centimetres. */
static void hint_at_units(const char *file, const pliant_path_tool *tool)
{
    double largest = 0.0;
    for (uint32_t k = 0; k < tool->num_motion; ++k)
        for (int d = 0; d < 3; ++d) largest = fmax(largest, fabs(tool->motion[k].value[d]));
    if (tool->drive == PLIANT_DRIVE_FORCE && largest > 0.0 && largest < 0.1)
        pliant_log(PLIANT_LOG_WARNING, "%s: tool %s pulls with at most %g N: forces are in newtons; was a way in metres meant (drive: rigid or spring, "
                   "with offset)?", file, tool->name, largest);
    if (tool->drive != PLIANT_DRIVE_FORCE && largest >= 1.0)
        pliant_log(PLIANT_LOG_WARNING, "%s: tool %s goes %g m far: offsets are in metres; were millimetres meant?", file, tool->name, largest);
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

static bool read_tool(const text_tool *text, pliant_path_tool *out, char reason[REASON_SIZE])
{
    if (!read_name(text->name, out->name, sizeof out->name, reason)) return false;
    if (!read_drive(text->drive, &out->drive, reason)) return false;
    for (int d = 0; d < 3; ++d)
        if (!read_number("grasp", text->grasp[d], &out->grasp[d], reason)) return false;
    if (text->release && !read_number("release", text->release, &out->release, reason)) return false;
    if (text->release && out->release <= 0.0) {
        snprintf(reason, REASON_SIZE, "release: %g s must be more than 0", out->release);
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
        for (int d = 0; good && d < 3; ++d) good = read_number("at", text->probes[n].at[d], &out->probes[n].at[d], reason);
        if (!good) return pliant_fail(PLIANT_ERROR_FORMAT, "%s: line %d: probe %u: %s", name, pliant_yaml_line(yaml, "at", (int)n, list), n + 1, reason);
    }
    return PLIANT_OK;
}

static pliant_status convert(const text_path *text, const char *yaml, const char *name, pliant_path *out)
{
    for (uint32_t n = 0; n < text->num_tools; ++n) {
        char reason[REASON_SIZE] = "";
        bool good = read_tool(&text->tools[n], &out->tools[n], reason);
        for (uint32_t k = 0; good && k < n; ++k)
            if (strcmp(out->tools[k].name, out->tools[n].name) == 0) {
                snprintf(reason, sizeof reason, "name: another tool has it too");
                good = false;
            }
        if (good) continue;
        if (!reason[0]) return pliant_fail_memory("a tool path");
        /* the line of the tool: libcyaml has accepted the document, and every tool has one name */
        return pliant_fail(PLIANT_ERROR_FORMAT, "%s: line %d: tool %u '%.48s': %s", name,
                           pliant_yaml_line(yaml, "name", (int)n, 1), n + 1, text->tools[n].name, reason);
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
    if (!text || text->num_tools + text->num_gravity + text->num_probes == 0) {
        status = pliant_fail(PLIANT_ERROR_FORMAT, "%s: is empty; a list named tools is needed, or gravity, or probes", path);
        goto end;
    }
    if (text->num_tools > 0) result.tools = pliant_calloc(text->num_tools, sizeof *result.tools);
    if (text->num_probes > 0) result.probes = pliant_calloc(text->num_probes, sizeof *result.probes);
    if ((text->num_tools > 0 && !result.tools) || (text->num_probes > 0 && !result.probes)) {
        status = pliant_fail_memory("a tool path");
        goto end;
    }
    result.num_tools = text->num_tools;
    result.num_probes = text->num_probes;
    status = convert(text, yaml, path, &result);
    if (status == PLIANT_OK) status = read_probes(text, yaml, path, &result);
    if (status == PLIANT_OK) {
        for (uint32_t n = 0; n < result.num_tools; ++n) hint_at_units(path, &result.tools[n]);
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
    for (uint32_t n = 0; n < path->num_tools; ++n) pliant_free(path->tools[n].motion);
    pliant_free(path->tools);
    pliant_free(path->gravity);
    pliant_free(path->probes);
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
    between(tool->motion, tool->num_motion, time, value);
    return tool->release <= 0.0 || time < tool->release;
}

double pliant_path_end(const pliant_path *path)
{
    double end = path->num_gravity > 0 ? path->gravity[path->num_gravity - 1].time : 0.0;
    for (uint32_t n = 0; n < path->num_tools; ++n) {
        const pliant_path_tool *tool = &path->tools[n];
        if (tool->num_motion > 0) end = fmax(end, tool->motion[tool->num_motion - 1].time);
        end = fmax(end, tool->release);
    }
    return end;
}
