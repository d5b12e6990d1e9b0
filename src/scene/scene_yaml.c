#include "pliant/scene.h"

#include "base/fail.h"
#include "scene/options.h"
#include "scene/yaml.h"
#include "base/memory.h"

#include <stdio.h>
#include <string.h>

#define COUNT_OPTION(kind, name, value, low, high, unit, text) +1
#define COUNT_OPTIONS(group, list) list(COUNT_OPTION)
#define COUNT_GROUP(group, list) +1
enum {
    NUM_OPTIONS = 0 PLIANT_SCENE_GROUPS(COUNT_OPTIONS),
    NUM_GROUPS = 0 PLIANT_SCENE_GROUPS(COUNT_GROUP),
    REASON_SIZE = 320
};

/* The document as text. An option is a char * (one word), a char ** to three words, or NULL (missing). */
typedef struct text_box { char **low, **high; } text_box;
typedef struct text_plane { char **point, **normal; } text_plane;
typedef struct text_regions {
    text_box *boxes;
    uint32_t num_boxes;
    text_plane *planes;
    uint32_t num_planes;
} text_regions;
typedef struct text_scene {
    void *options[NUM_OPTIONS];
    text_regions fixed, obstacles;
} text_scene;

static const cyaml_schema_value_t word = {CYAML_VALUE_STRING(CYAML_FLAG_POINTER, char, 0, CYAML_UNLIMITED)};

#define VECTOR_FIELD(type, name) CYAML_FIELD_SEQUENCE_FIXED(#name, CYAML_FLAG_POINTER, type, name, &word, 3)
static const cyaml_schema_field_t box_fields[] = {VECTOR_FIELD(text_box, low), VECTOR_FIELD(text_box, high),
                                                  CYAML_FIELD_END};
static const cyaml_schema_field_t plane_fields[] = {VECTOR_FIELD(text_plane, point), VECTOR_FIELD(text_plane, normal),
                                                    CYAML_FIELD_END};
#undef VECTOR_FIELD
static const cyaml_schema_value_t box_value = {CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, text_box, box_fields)};
static const cyaml_schema_value_t plane_value = {CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, text_plane, plane_fields)};
static const cyaml_schema_field_t region_fields[] = {
    CYAML_FIELD_SEQUENCE_COUNT("boxes", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_regions, boxes, num_boxes,
                               &box_value, 0, PLIANT_MAX_FIXED),
    CYAML_FIELD_SEQUENCE_COUNT("planes", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_regions, planes, num_planes,
                               &plane_value, 0, PLIANT_MAX_FIXED),
    CYAML_FIELD_END,
};

/* Schema of a scene for libcyaml, generated from the table of options. */
typedef struct scene_schema {
    cyaml_schema_field_t groups[NUM_GROUPS + 3]; /* including fixed, obstacles, and the terminator */
    cyaml_schema_field_t options[NUM_OPTIONS + NUM_GROUPS];
    cyaml_schema_value_t value;
} scene_schema;

static cyaml_schema_field_t option_field(const pliant_option *option, size_t offset)
{
    bool three = option->kind == PLIANT_OPTION_INT3 || option->kind == PLIANT_OPTION_REAL3;
    cyaml_schema_value_t one_word = {
        CYAML_VALUE_STRING(CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, char, 0, CYAML_UNLIMITED)};
    cyaml_schema_value_t three_words = {
        CYAML_VALUE_SEQUENCE_FIXED(CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, char *, &word, 3)};
    return (cyaml_schema_field_t){
        .key = option->name, .data_offset = (uint32_t)offset, .value = three ? three_words : one_word};
}

static void make_schema(scene_schema *schema)
{
    size_t count, used = 0, groups = 0, first = 0;
    const pliant_option *options = pliant_option_table(&count);
    memset(schema, 0, sizeof *schema);
    for (size_t i = 0; i < count; ++i) {
        if (i == 0 || strcmp(options[i].group, options[i - 1].group) != 0) {
            cyaml_schema_value_t group = {CYAML_VALUE_MAPPING(CYAML_FLAG_OPTIONAL, void *, &schema->options[used])};
            first = i;
            schema->groups[groups++] = (cyaml_schema_field_t){
                .key = options[i].group, .data_offset = (uint32_t)(i * sizeof(void *)), .value = group};
        }
        schema->options[used++] = option_field(&options[i], (i - first) * sizeof(void *));
        /* a zeroed field ends a group */
        if (i + 1 == count || strcmp(options[i].group, options[i + 1].group) != 0) ++used;
    }
    schema->groups[groups++] =
        (cyaml_schema_field_t)CYAML_FIELD_MAPPING("fixed", CYAML_FLAG_OPTIONAL, text_scene, fixed, region_fields);
    schema->groups[groups] = (cyaml_schema_field_t)CYAML_FIELD_MAPPING("obstacles", CYAML_FLAG_OPTIONAL, text_scene,
                                                                       obstacles, region_fields);
    schema->value = (cyaml_schema_value_t){CYAML_VALUE_MAPPING(CYAML_FLAG_POINTER, text_scene, schema->groups)};
}

static pliant_status refuse(const char *text, const char *name, const char *group, const char *key, int occurrence,
                            const char *reason)
{
    char line[32] = "";
    int group_line = pliant_yaml_line(text, group, 0, 1);
    int number = group_line ? pliant_yaml_line(text, key, occurrence, group_line) : 0;
    if (number) snprintf(line, sizeof line, "line %d: ", number);
    return pliant_fail(PLIANT_ERROR_SCENE, "%s: %s%s/%s: %s", name, line, group, key, reason);
}

/* Make the path of a file in a scene relative to the scene file. */
static bool make_relative(const char *base, char path[256])
{
    char joined[512];
    if (!base || !base[0] || !path[0] || path[0] == '/') return true;
    int length = snprintf(joined, sizeof joined, "%s%s%s", base, base[strlen(base) - 1] == '/' ? "" : "/", path);
    if (length < 0 || length >= 256) return false;
    memcpy(path, joined, (size_t)length + 1);
    return true;
}

static pliant_status read_options(const text_scene *document, const char *text, const char *name, const char *base,
                                  pliant_scene *scene)
{
    size_t count;
    char reason[REASON_SIZE];
    const pliant_option *options = pliant_option_table(&count);
    for (size_t i = 0; i < count; ++i) {
        const char *words[3] = {NULL, NULL, NULL};
        bool three = options[i].kind == PLIANT_OPTION_INT3 || options[i].kind == PLIANT_OPTION_REAL3;
        if (!document->options[i]) continue;
        if (three) memcpy(words, document->options[i], sizeof words);
        else words[0] = document->options[i];
        if (pliant_option_read(&options[i], words, three ? 3 : 1, scene, reason, sizeof reason))
            return refuse(text, name, options[i].group, options[i].name, 0, reason);
    }
    if (document->options[pliant_option_find("material/file") - options] && !make_relative(base, scene->material.file))
        return refuse(text, name, "material", "file", 0, "the whole path is longer than 255 characters");
    if (document->options[pliant_option_find("material/labels") - options] &&
        !make_relative(base, scene->material.labels))
        return refuse(text, name, "material", "labels", 0, "the whole path is longer than 255 characters");
    if (document->options[pliant_option_find("mesh/file") - options] && !make_relative(base, scene->mesh.file))
        return refuse(text, name, "mesh", "file", 0, "the whole path is longer than 255 characters");
    if (document->options[pliant_option_find("contact/obstacles") - options] &&
        !make_relative(base, scene->contact.obstacles))
        return refuse(text, name, "contact", "obstacles", 0, "the whole path is longer than 255 characters");
    return PLIANT_OK;
}

static bool read_vector(char *const *words, double out[3], char *reason)
{
    for (int d = 0; d < 3; ++d)
        if (!pliant_parse_real(words[d], &out[d])) {
            snprintf(reason, REASON_SIZE, "'%.80s' is not a number", words[d]);
            return false;
        }
    return true;
}

/* Report an error in an entry of a group's list. */
static pliant_status refuse_region(const char *text, const char *name, const char *group, const char *list,
                                   const char *key, uint32_t region, const char *reason)
{
    char path[48];
    snprintf(path, sizeof path, "%s/%s", group, list);
    int line = pliant_yaml_line(text, group, 0, 1);
    if (line) line = pliant_yaml_line(text, list, 0, line);
    if (line) line = pliant_yaml_line(text, key, (int)region, line);
    return line ? pliant_fail(PLIANT_ERROR_SCENE, "%s: line %d: %s/%s: %s", name, line, path, key, reason)
                : pliant_fail(PLIANT_ERROR_SCENE, "%s: %s/%s: %s", name, path, key, reason);
}

static pliant_status read_regions(const text_regions *document, const char *text, const char *name, const char *group,
                                  pliant_regions *out)
{
    char reason[REASON_SIZE];
    out->num_boxes = document->num_boxes;
    for (uint32_t i = 0; i < document->num_boxes; ++i) {
        pliant_fixed_box *box = &out->boxes[i];
        if (!read_vector(document->boxes[i].low, box->low, reason))
            return refuse_region(text, name, group, "boxes", "low", i, reason);
        if (!read_vector(document->boxes[i].high, box->high, reason))
            return refuse_region(text, name, group, "boxes", "high", i, reason);
        if (pliant_fixed_box_check(box, reason, sizeof reason))
            return refuse_region(text, name, group, "boxes", "low", i, reason);
    }
    out->num_planes = document->num_planes;
    for (uint32_t i = 0; i < document->num_planes; ++i) {
        pliant_fixed_plane *plane = &out->planes[i];
        if (!read_vector(document->planes[i].point, plane->point, reason))
            return refuse_region(text, name, group, "planes", "point", i, reason);
        if (!read_vector(document->planes[i].normal, plane->normal, reason))
            return refuse_region(text, name, group, "planes", "normal", i, reason);
        if (pliant_fixed_plane_check(plane, reason, sizeof reason))
            return refuse_region(text, name, group, "planes", "normal", i, reason);
    }
    return PLIANT_OK;
}

pliant_status pliant_scene_parse(const char *yaml, const char *name_for_messages, const char *base, pliant_scene *out)
{
    scene_schema schema;
    pliant_scene scene;
    void *loaded = NULL;
    make_schema(&schema);
    pliant_scene_defaults(&scene);
    pliant_status status = pliant_yaml_load(yaml, name_for_messages, &schema.value, &loaded);
    if (status < 0) return status;
    const text_scene *document = loaded;
    if (document) {
        status = read_options(document, yaml, name_for_messages, base, &scene);
        if (status == PLIANT_OK)
            status = read_regions(&document->fixed, yaml, name_for_messages, "fixed", &scene.fixed);
        if (status == PLIANT_OK)
            status = read_regions(&document->obstacles, yaml, name_for_messages, "obstacles", &scene.obstacles);
    }
    if (status == PLIANT_OK) *out = scene;
    pliant_yaml_free(&schema.value, loaded);
    return status;
}

pliant_status pliant_scene_read(const char *path, pliant_scene *out)
{
    char *text = NULL, *base = NULL;
    const char *slash = strrchr(path, '/');
    size_t length = slash ? (size_t)(slash - path) + 1 : 0;
    pliant_status status = pliant_text_read(path, &text);
    if (status < 0) return status;
    base = pliant_calloc(length + 1, 1);
    if (base) {
        memcpy(base, path, length);
        status = pliant_scene_parse(text, path, base, out);
    } else {
        status = pliant_fail_memory(path);
    }
    pliant_free(base);
    pliant_free(text);
    return status;
}
