#include "material/material.h"

#include "base/fail.h"
#include "scene/yaml.h"
#include "material/default_table.h"
#include "material/names.h"
#include "base/memory.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* The document before its numbers are parsed. */
typedef struct text_material {
    char *name, *young_modulus, *poisson_ratio, *density, *toughness, *fixed, *empty;
    char **range;
    char **labels;
    uint32_t num_labels;
    char **segments;
    uint32_t num_segments;
} text_material;

typedef struct text_table {
    text_material *materials;
    uint32_t num_materials;
} text_table;

static const cyaml_schema_value_t word = {CYAML_VALUE_STRING(CYAML_FLAG_POINTER, char, 0, CYAML_UNLIMITED)};

#define WORD_FIELD(name, flags) \
    CYAML_FIELD_STRING_PTR(#name, CYAML_FLAG_POINTER | (flags), text_material, name, 0, CYAML_UNLIMITED)
static const cyaml_schema_field_t material_fields[] = {
    WORD_FIELD(name, 0),
    WORD_FIELD(young_modulus, 0),
    WORD_FIELD(poisson_ratio, 0),
    WORD_FIELD(density, 0),
    WORD_FIELD(toughness, CYAML_FLAG_OPTIONAL),
    WORD_FIELD(fixed, CYAML_FLAG_OPTIONAL),
    WORD_FIELD(empty, CYAML_FLAG_OPTIONAL),
    CYAML_FIELD_SEQUENCE_FIXED("range", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_material, range, &word, 2),
    CYAML_FIELD_SEQUENCE_COUNT("labels", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_material, labels, num_labels,
                               &word, 0, PLIANT_MAX_MATERIAL_LABELS),
    CYAML_FIELD_SEQUENCE_COUNT("segments", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, text_material, segments,
                               num_segments, &word, 0, PLIANT_MAX_MATERIAL_SEGMENTS),
    CYAML_FIELD_END,
};
#undef WORD_FIELD

static const cyaml_schema_value_t material_value = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, text_material, material_fields)};
static const cyaml_schema_field_t table_fields[] = {
    CYAML_FIELD_SEQUENCE_COUNT("materials", CYAML_FLAG_POINTER, text_table, materials, num_materials, &material_value,
                               1, PLIANT_MAX_MATERIALS),
    CYAML_FIELD_END,
};
static const cyaml_schema_value_t table_value = {CYAML_VALUE_MAPPING(CYAML_FLAG_POINTER, text_table, table_fields)};

/* Origin of a table, for messages. */
typedef struct origin {
    const char *name; /* file name */
    const char *text; /* Nullable: not read from text */
} origin;

static pliant_status refuse(const origin *from, uint32_t index, const char *material, const char *reason)
{
    char line[32] = "";
    int number = from->text ? pliant_yaml_line(from->text, "name", (int)index, 1) : 0;
    if (number) snprintf(line, sizeof line, "line %d: ", number);
    return pliant_fail(PLIANT_ERROR_FORMAT, "%s: %smaterial %u '%s': %s", from->name, line, index + 1, material,
                       reason);
}

/* Read a number of a material. After an error, reason is "field: 'text' is not a number". */
static bool read_number(const char *field, const char *text, double *out, char *reason, size_t size)
{
    if (pliant_parse_real(text, out)) return true;
    snprintf(reason, size, "%s: '%s' is not a number", field, text);
    return false;
}

static bool read_flag(const char *field, const char *text, bool *out, char *reason, size_t size)
{
    if (!text || pliant_parse_bool(text, out)) return true;
    snprintf(reason, size, "%s: '%s' is neither true nor false", field, text);
    return false;
}

static bool read_material(const text_material *text, pliant_material *out, char *reason, size_t size)
{
    if (strlen(text->name) >= sizeof out->name) {
        snprintf(reason, size, "name: longer than %zu characters", sizeof out->name - 1);
        return false;
    }
    strcpy(out->name, text->name);
    out->toughness = PLIANT_DEFAULT_TOUGHNESS;
    if (!read_number("young_modulus", text->young_modulus, &out->young_modulus, reason, size) ||
        !read_number("poisson_ratio", text->poisson_ratio, &out->poisson_ratio, reason, size) ||
        !read_number("density", text->density, &out->density, reason, size) ||
        (text->toughness && !read_number("toughness", text->toughness, &out->toughness, reason, size)) ||
        !read_flag("fixed", text->fixed, &out->fixed, reason, size) ||
        !read_flag("empty", text->empty, &out->empty, reason, size))
        return false;
    for (uint32_t i = 0; text->range && i < 2; ++i) {
        if (!read_number("range", text->range[i], &out->range[i], reason, size)) return false;
        out->num_range = 2;
    }
    for (uint32_t i = 0; i < text->num_labels; ++i) {
        int64_t label;
        if (!pliant_parse_integer(text->labels[i], &label) || label < 1 || label > UINT16_MAX) {
            snprintf(reason, size, "labels: '%s' is not an integer from 1 to 65535 (0 is \"no label\")",
                     text->labels[i]);
            return false;
        }
        out->labels[i] = (uint32_t)label;
    }
    out->num_labels = text->num_labels;
    for (uint32_t i = 0; i < text->num_segments; ++i) {
        if (!text->segments[i][0] || strlen(text->segments[i]) >= sizeof out->segments[i]) {
            snprintf(reason, size, "segments: '%.60s': a name must have 1 to %zu characters", text->segments[i],
                     sizeof out->segments[i] - 1);
            return false;
        }
        strcpy(out->segments[i], text->segments[i]);
    }
    out->num_segments = text->num_segments;
    return true;
}

/* Elements are tested up to this value (verification_test). */
static const double max_poisson_ratio = 0.4999, max_coarse_poisson_ratio = 0.499;

/* Check a material alone, and describe an error in reason. */
static bool check_material(const pliant_material *m, char *reason, size_t size)
{
    reason[0] = 0;
    if (!memchr(m->name, 0, sizeof m->name) || !m->name[0])
        snprintf(reason, size, "name: must have 1 to %zu characters", sizeof m->name - 1);
    else if (!(m->young_modulus > 0 && m->young_modulus <= 1e12))
        snprintf(reason, size, "young_modulus: %g Pa is not in (0, 1e12]", m->young_modulus);
    else if (!(m->poisson_ratio >= 0 && m->poisson_ratio <= max_poisson_ratio))
        snprintf(reason, size, "poisson_ratio: %.9g is not in [0, %g]", m->poisson_ratio, max_poisson_ratio);
    else if (!(m->density >= 0 && m->density <= 1e5))
        snprintf(reason, size, "density: %g kg/m^3 is not in [0, 1e5]", m->density);
    else if (!(m->toughness >= 0 && m->toughness <= 1e9))
        snprintf(reason, size, "toughness: %g J/m^2 is not in [0, 1e9]", m->toughness);
    else if (m->fixed && m->empty)
        snprintf(reason, size, "fixed and empty exclude each other");
    else if (m->num_range != 0 && m->num_range != 2)
        snprintf(reason, size, "range: needs two numbers, low and high");
    else if (m->num_range && !(isfinite(m->range[0]) && isfinite(m->range[1]) && m->range[0] < m->range[1]))
        snprintf(reason, size, "range: low %g must be less than high %g", m->range[0], m->range[1]);
    else if (m->num_labels > PLIANT_MAX_MATERIAL_LABELS)
        snprintf(reason, size, "labels: more than %d", PLIANT_MAX_MATERIAL_LABELS);
    else if (m->num_segments > PLIANT_MAX_MATERIAL_SEGMENTS)
        snprintf(reason, size, "segments: more than %d", PLIANT_MAX_MATERIAL_SEGMENTS);
    for (uint32_t i = 0; !reason[0] && i < m->num_segments; ++i)
        if (!memchr(m->segments[i], 0, sizeof m->segments[i]) || !m->segments[i][0])
            snprintf(reason, size, "segments: name %u must have 1 to %zu characters", i + 1, sizeof m->segments[i] - 1);
    for (uint32_t i = 0; !reason[0] && i < m->num_labels; ++i)
        if (m->labels[i] < 1 || m->labels[i] > UINT16_MAX)
            snprintf(reason, size, "labels: %u is not in 1..65535 (0 is \"no label\")", m->labels[i]);
    return !reason[0];
}

/* Return whether a segment name of a material is the name of a later material. */
static bool names_segment(const pliant_material *m, const char *name, char *reason, size_t size)
{
    for (uint32_t i = 0; i < m->num_segments; ++i)
        if (pliant_same_name(m->segments[i], name)) {
            snprintf(reason, size, "name: it is also the name of a segment of '%s'", m->name);
            return true;
        }
    return false;
}

/* Check a material against an earlier one, or for labels against itself. */
static bool check_pair(const pliant_material *a, const pliant_material *b, char *reason, size_t size)
{
    if (a != b && strcmp(a->name, b->name) == 0) {
        snprintf(reason, size, "name: another material has the same name");
        return false;
    }
    if (a != b && a->num_range && b->num_range && a->range[0] < b->range[1] && b->range[0] < a->range[1]) {
        snprintf(reason, size, "range: [%g, %g) overlaps [%g, %g) of '%s'", a->range[0], a->range[1], b->range[0],
                 b->range[1], b->name);
        return false;
    }
    for (uint32_t i = 0; i < a->num_labels; ++i)
        for (uint32_t k = 0; k < (a == b ? i : b->num_labels); ++k)
            if (a->labels[i] == b->labels[k]) {
                snprintf(reason, size, "labels: %u is named twice, also in '%s'", a->labels[i], b->name);
                return false;
            }
    for (uint32_t i = 0; i < a->num_segments; ++i) {
        bool twice = a != b && pliant_same_name(a->segments[i], b->name);
        for (uint32_t k = 0; !twice && k < (a == b ? i : b->num_segments); ++k)
            twice = pliant_same_name(a->segments[i], b->segments[k]);
        if (twice) {
            snprintf(reason, size, "segments: '%s' is named twice, also by '%s'", a->segments[i], b->name);
            return false;
        }
    }
    return true;
}

static pliant_status check(const pliant_material_table *table, const origin *from)
{
    char reason[320];
    if (!table->materials || table->num_materials < 1 || table->num_materials > PLIANT_MAX_MATERIALS)
        return pliant_fail(PLIANT_ERROR_FORMAT, "%s: materials: %u of them; 1 to %d are needed", from->name,
                           table->materials ? table->num_materials : 0, PLIANT_MAX_MATERIALS);
    for (uint32_t i = 0; i < table->num_materials; ++i) {
        const pliant_material *m = &table->materials[i];
        bool good = check_material(m, reason, sizeof reason);
        for (uint32_t k = 0; good && k < i; ++k)
            good = !names_segment(&table->materials[k], m->name, reason, sizeof reason);
        for (uint32_t k = 0; good && k <= i; ++k) good = check_pair(m, &table->materials[k], reason, sizeof reason);
        if (!good) return refuse(from, i, memchr(m->name, 0, sizeof m->name) ? m->name : "", reason);
    }
    return PLIANT_OK;
}

pliant_status pliant_material_table_check(const pliant_material_table *table)
{
    origin from = {"material table", NULL};
    return check(table, &from);
}

static pliant_status check_coarse(const pliant_material_table *table, const char *name)
{
    for (uint32_t i = 0; i < table->num_materials; ++i) {
        const pliant_material *m = table->materials + i;
        if (m->poisson_ratio <= max_coarse_poisson_ratio) continue;
        return pliant_fail(PLIANT_ERROR_SCENE,
                           "%s: material %u '%s': poisson_ratio is %g, and coarse methods solve up to %g; use a "
                           "smaller one, or set model/method to fine",
                           name, i + 1, m->name, m->poisson_ratio, max_coarse_poisson_ratio);
    }
    return PLIANT_OK;
}

pliant_status pliant_material_table_check_scene(const pliant_material_table *table, const pliant_scene *scene,
                                                const char *name)
{
    if (scene->model.method != PLIANT_FINE) return check_coarse(table, name);
    if (scene->solver.kind != PLIANT_TLED || scene->tled.quasi_static) return PLIANT_OK;
    for (uint32_t i = 0; i < table->num_materials; ++i) {
        const pliant_material *m = table->materials + i;
        const bool moves = (!m->fixed || scene->material.deformable_bone) && (!m->empty || scene->mesh.keep_air);
        if (m->density > 0 || !moves) continue;
        return pliant_fail(PLIANT_ERROR_SCENE,
                           "%s: material %u '%s': density is %g kg/m^3, and solver/kind: tled cannot move tissue "
                           "without mass; set its density (about 1000), or set tled/quasi_static to true",
                           name, i + 1, m->name, m->density);
    }
    return PLIANT_OK;
}

pliant_status pliant_material_table_parse(const char *yaml, const char *name_for_messages, pliant_material_table *out)
{
    origin from = {name_for_messages, yaml};
    pliant_material_table table = {NULL, 0};
    void *document = NULL;
    pliant_status status = pliant_yaml_load(yaml, name_for_messages, &table_value, &document);
    if (status < 0) return status;
    const text_table *text = document;
    if (!text)
        return pliant_fail(PLIANT_ERROR_FORMAT, "%s: is empty; a list named materials is needed", name_for_messages);

    table.num_materials = text->num_materials;
    table.materials = pliant_calloc(table.num_materials, sizeof *table.materials);
    if (!table.materials) {
        status = pliant_fail_memory("the material table");
        goto end;
    }
    for (uint32_t i = 0; i < table.num_materials; ++i) {
        char reason[320];
        if (read_material(&text->materials[i], &table.materials[i], reason, sizeof reason)) continue;
        status = refuse(&from, i, text->materials[i].name, reason);
        goto end;
    }
    status = check(&table, &from);
    if (status == PLIANT_OK) {
        *out = table;
        table.materials = NULL;
    }
end:
    pliant_free(table.materials);
    pliant_yaml_free(&table_value, document);
    return status;
}

pliant_status pliant_material_table_read(const char *path, pliant_material_table *out)
{
    char *text = NULL;
    pliant_status status = pliant_text_read(path, &text);
    if (status == PLIANT_OK) status = pliant_material_table_parse(text, path, out);
    pliant_free(text);
    return status;
}

pliant_status pliant_material_table_default(pliant_material_table *out)
{
    return pliant_material_table_parse(pliant_default_materials, "built-in materials", out);
}

pliant_status pliant_material_table_copy(const pliant_material_table *table, pliant_material_table *out)
{
    pliant_material *materials = pliant_calloc(table->num_materials, sizeof *materials);
    if (!materials && table->num_materials) return pliant_fail_memory("a copy of the material table");
    if (table->num_materials) memcpy(materials, table->materials, table->num_materials * sizeof *materials);
    out->materials = materials;
    out->num_materials = table->num_materials;
    return PLIANT_OK;
}

void pliant_material_table_free(pliant_material_table *table)
{
    if (!table) return;
    pliant_free(table->materials);
    table->materials = NULL;
    table->num_materials = 0;
}
