#include "tool/shape_text.h"

#include "base/fail.h"
#include "contact/shapes/shapes.h"
#include "base/memory.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>

enum { MAX_POINTS = 1000, PATH_SIZE = 1024 };

static const cyaml_schema_value_t word = {CYAML_VALUE_STRING(CYAML_FLAG_POINTER, char, 0, CYAML_UNLIMITED)};
#define OPTIONAL (CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL)
#define WORD_FIELD(type, name, flags) CYAML_FIELD_STRING_PTR(#name, flags, type, name, 0, CYAML_UNLIMITED)
#define VECTOR_FIELD(type, name, flags) CYAML_FIELD_SEQUENCE_FIXED(#name, flags, type, name, &word, 3)
static const cyaml_schema_value_t point_value = {CYAML_VALUE_SEQUENCE_FIXED(CYAML_FLAG_POINTER, char *, &word, 3)};
static const cyaml_schema_field_t part_fields[] = {
    WORD_FIELD(pliant_part_text, kind, CYAML_FLAG_POINTER),
    WORD_FIELD(pliant_part_text, moves, OPTIONAL),
    WORD_FIELD(pliant_part_text, radius, OPTIONAL),
    WORD_FIELD(pliant_part_text, cuts, OPTIONAL),
    VECTOR_FIELD(pliant_part_text, from, OPTIONAL),
    VECTOR_FIELD(pliant_part_text, to, OPTIONAL),
    WORD_FIELD(pliant_part_text, file, OPTIONAL),
    WORD_FIELD(pliant_part_text, unit, OPTIONAL),
    WORD_FIELD(pliant_part_text, resolution, OPTIONAL),
    VECTOR_FIELD(pliant_part_text, rpy, OPTIONAL),
    CYAML_FIELD_SEQUENCE_COUNT("points", OPTIONAL, pliant_part_text, points, num_points, &point_value, 4, MAX_POINTS),
    CYAML_FIELD_END,
};
static const cyaml_schema_value_t part_value = {CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, pliant_part_text, part_fields)};
const cyaml_schema_field_t pliant_shape_fields[] = {
    WORD_FIELD(pliant_shape_text, name, OPTIONAL),
    VECTOR_FIELD(pliant_shape_text, offset, OPTIONAL),
    CYAML_FIELD_SEQUENCE_COUNT("parts", OPTIONAL, pliant_shape_text, parts, num_parts, &part_value, 1,
                               PLIANT_MAX_PARTS),
    VECTOR_FIELD(pliant_shape_text, joint, OPTIONAL),
    VECTOR_FIELD(pliant_shape_text, axis, OPTIONAL),
    CYAML_FIELD_END,
};
static const cyaml_schema_value_t shape_value = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_POINTER, pliant_shape_text, pliant_shape_fields)};

static bool read_number(const char *field, const char *text, double *out, char *reason, size_t size)
{
    if (pliant_parse_real(text, out)) return true;
    snprintf(reason, size, "shape/%s: '%.64s' is not a number", field, text);
    return false;
}

static bool read_vector(const char *field, char *const *text, double out[3], char *reason, size_t size)
{
    for (int d = 0; text && d < 3; d++)
        if (!read_number(field, text[d], &out[d], reason, size)) return false;
    return true;
}

/* Return the index of a name; a NULL text is index 0; -1: unknown. */
static int choose(const char *text, const char *const *names, int count)
{
    for (int n = 0; n < count; n++)
        if (!text || strcmp(text, names[n]) == 0) return n;
    return -1;
}

/* Build the path of a file. A relative path starts at the folder of another file.
 * @param base_file that other file */
static bool find_file(const char *file, const char *base_file, char path[PATH_SIZE])
{
    const char *slash = strrchr(base_file, '/');
    const int folder = file[0] == '/' || !slash ? 0 : (int)(slash - base_file) + 1,
              length = snprintf(path, PATH_SIZE, "%.*s%s", folder, base_file, file);
    return length > 0 && length < PATH_SIZE;
}

static bool read_solid(const pliant_part_text *text, const char *base_file, pliant_part *out, char *reason, size_t size)
{
    static const char *const units[] = {"m", "mm"};
    const int unit = choose(text->unit, units, 2);
    char path[PATH_SIZE];
    double point[3 * MAX_POINTS];
    pliant_solid_options options = {.unit = unit == 1 ? 1e-3 : 1, .convex = !strcmp(text->kind, "convex")};
    pliant_solid *solid = NULL;
    if (unit < 0) {
        snprintf(reason, size, "shape/parts/unit: '%.64s' is neither m nor mm", text->unit);
        return false;
    }
    if (!text->file == !text->points || (text->points && !options.convex)) {
        snprintf(
            reason, size,
            options.convex
                ? "shape/parts: a convex part needs a file (STL) or points, as in points: [[0, 0, 0], ...], "
                  "four or more of them"
                : "shape/parts: a mesh needs a file (STL)");
        return false;
    }
    if (!read_vector("parts/rpy", text->rpy, options.turn, reason, size)) return false;
    if (text->resolution && !read_number("parts/resolution", text->resolution, &options.resolution, reason, size))
        return false;
    for (uint32_t p = 0; p < text->num_points; p++)
        if (!read_vector("parts/points", text->points[p], point + 3 * p, reason, size)) return false;
    if (text->file && !find_file(text->file, base_file, path)) {
        snprintf(reason, size, "shape/parts/file: the whole path is longer than %d characters", PATH_SIZE - 1);
        return false;
    }
    const pliant_status status =
        text->file ? pliant_solid_read(path, &options, &solid)
                   : pliant_solid_create((int32_t)text->num_points, point, 0, NULL, &options, "its points", &solid);
    if (status == PLIANT_ERROR_MEMORY) reason[0] = 0; /* the text is not the cause */
    else if (status != PLIANT_OK) snprintf(reason, size, "shape/parts: %.400s", pliant_last_error());
    out->solid = solid;
    return status == PLIANT_OK;
}

static bool read_part(const pliant_part_text *text, const char *base_file, pliant_part *out, char *reason, size_t size)
{
    static const char *const kinds[] = {"sphere", "capsule", "box", "convex", "mesh"}, *const frames[] = {"tip",
                                                                                                          "jaw_plus",
                                                                                                          "jaw_minus"};
    static_assert(PLIANT_PART_SPHERE == 0 && PLIANT_PART_CAPSULE == 1 && PLIANT_PART_BOX == 2 &&
                      PLIANT_NUM_PART_KINDS == 5,
                  "kinds by their names");
    static_assert(sizeof frames / sizeof *frames == PLIANT_NUM_PART_FRAMES, "each frame has a name");
    const int kind = choose(text->kind, kinds, 5), frame = choose(text->moves, frames, 3);
    const bool is_solid = kind >= 3,
               told_solid = text->file || text->unit || text->resolution || text->rpy || text->points;
    if (kind < 0)
        snprintf(reason, size, "shape/parts/kind: '%.64s' is neither sphere, capsule, box, convex nor mesh",
                 text->kind);
    else if (frame < 0)
        snprintf(reason, size, "shape/parts/moves: '%.64s' is neither tip, jaw_plus nor jaw_minus", text->moves);
    else if (!is_solid && told_solid)
        snprintf(reason, size,
                 "shape/parts: file, unit, resolution, rpy and points belong to kinds convex and mesh, not to a %s",
                 kinds[kind]);
    else if (!is_solid && !text->from) snprintf(reason, size, "shape/parts: a %s needs from", kinds[kind]);
    else if (is_solid ? text->to != NULL : !text->to != (kind == PLIANT_PART_SPHERE))
        snprintf(reason, size,
                 kind == PLIANT_PART_SPHERE ? "shape/parts/to: a sphere has only its centre, from"
                 : is_solid                 ? "shape/parts/to: a %s has only the position of its origin, from"
                                            : "shape/parts: a %s needs from and to",
                 kinds[kind]);
    else if (!text->radius && (kind == PLIANT_PART_SPHERE || kind == PLIANT_PART_CAPSULE))
        snprintf(reason, size, "shape/parts: a %s needs a radius [m]", kinds[kind]);
    else if (text->cuts && !pliant_parse_bool(text->cuts, &out->cuts))
        snprintf(reason, size, "shape/parts/cuts: '%.64s' is neither true nor false", text->cuts);
    else {
        out->kind = is_solid ? PLIANT_PART_SOLID : (pliant_part_kind)kind;
        out->frame = (pliant_part_frame)frame;
        return read_vector("parts/from", text->from, out->from, reason, size) &&
               read_vector("parts/to", text->to, out->to, reason, size) &&
               (!text->radius || read_number("parts/radius", text->radius, &out->radius, reason, size)) &&
               (!is_solid || read_solid(text, base_file, out, reason, size));
    }
    return false;
}

static bool read_parts(const pliant_shape_text *text, const char *base_file, pliant_tool_shape *out, char *reason,
                       size_t size)
{
    char why[160];
    bool turns = false;
    out->num_parts = (int32_t)text->num_parts;
    for (uint32_t p = 0; p < text->num_parts; p++) {
        if (!read_part(text->parts + p, base_file, out->part + p, reason, size)) return false;
        turns = turns || out->part[p].frame != PLIANT_FRAME_TIP;
        if (!pliant_part_check(out->part + p, true, why, sizeof why)) continue;
        snprintf(reason, size, "shape/parts: number %u: %s", p + 1, why);
        return false;
    }
    if (turns && (!text->joint || !text->axis)) {
        snprintf(reason, size,
                 "shape: jaws turn about a joint and an axis, as in joint: [0, 0, -0.01], axis: [1, 0, 0]");
        return false;
    }
    return read_vector("joint", text->joint, out->joint, reason, size) &&
           read_vector("axis", text->axis, out->axis, reason, size);
}

bool pliant_shape_from_text(const pliant_shape_text *text, const char *base_file, pliant_tool_shape *out, char *reason,
                            size_t size)
{
    pliant_tool_shape shape = {.num_parts = 0};
    double offset[3] = {0, 0, 0};
    if (!text->name == !text->parts || (text->name && (text->joint || text->axis))) {
        snprintf(
            reason, size,
            "shape: needs a name, as in {name: probe}, or parts, as in {parts: [{kind: sphere, from: [0, 0, 0], "
            "radius: 0.004}]}");
        return false;
    }
    if (text->name && pliant_tool_shape_find(text->name, &shape) != PLIANT_OK) {
        snprintf(reason, size, "shape/name: %.230s", pliant_last_error());
        return false;
    }
    if ((!text->name && !read_parts(text, base_file, &shape, reason, size)) ||
        !read_vector("offset", text->offset, offset, reason, size)) {
        pliant_tool_shape_free(&shape);
        return false;
    }
    pliant_tool_shape_move(&shape, offset);
    *out = shape;
    return true;
}

pliant_status pliant_tool_shape_read(const char *path, pliant_tool_shape *out)
{
    char *yaml = NULL, reason[512];
    void *document = NULL;
    pliant_status status = pliant_text_read(path, &yaml);
    if (status == PLIANT_OK) status = pliant_yaml_load(yaml, path, &shape_value, &document);
    if (status == PLIANT_OK && !document)
        status = pliant_fail(PLIANT_ERROR_FORMAT, "%s: is empty; a name or parts are needed", path);
    if (status == PLIANT_OK && !pliant_shape_from_text(document, path, out, reason, sizeof reason))
        status = reason[0] ? pliant_fail(PLIANT_ERROR_FORMAT, "%s: %s", path, reason) : pliant_fail_memory(path);
    pliant_yaml_free(&shape_value, document);
    pliant_free(yaml);
    return status;
}
