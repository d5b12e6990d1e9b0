#include "scene/yaml.h"

#include "base/fail.h"
#include "base/open.h"
#include "base/memory.h"
#include "scene/scene.h"

#include <ctype.h>
#include <errno.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MESSAGE_SIZE = 512, PATH_DEPTH = 8, KEY_SIZE = 64, MAX_TEXT = 64 << 20 };

/* libcyaml's messages about one failure: the first line is the reason; the others give the location, innermost
 * first. */
typedef struct yaml_failure {
    char reason[MESSAGE_SIZE];
    char where[PATH_DEPTH][KEY_SIZE]; /* names of mapping fields, innermost first */
    int depth;
    int line; /* 0: unknown */
} yaml_failure;

/* Skip the byte order mark that some editors write before UTF-8. */
static void skip_byte_order_mark(char *text, size_t size)
{
    static const char mark[] = "\xEF\xBB\xBF";
    const size_t length = sizeof mark - 1;
    if (size >= length && memcmp(text, mark, length) == 0) memmove(text, text + length, size + 1 - length);
}

pliant_status pliant_text_read(const char *path, char **out)
{
    pliant_status status = PLIANT_OK;
    char *text = NULL;
    size_t size = 0, capacity = 4096;
    pliant_opening opening;
    FILE *file = pliant_opening_begin(path, &opening) ? fopen(opening.name, "rb") : NULL;
    pliant_opening_end(&opening);
    if (opening.refused) return pliant_fail(PLIANT_ERROR_FILE, "%s: may not be read: %s", path, opening.refused);
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: cannot be opened: %s", path, strerror(errno));
    do {
        char *larger = pliant_resize(text, capacity + 1, 1);
        if (!larger) {
            status = pliant_fail_memory(path);
            goto end;
        }
        text = larger;
        size += fread(text + size, 1, capacity - size, file);
        capacity *= 2;
    } while (size == capacity / 2 && size < MAX_TEXT);
    if (size >= MAX_TEXT) {
        status = pliant_fail(PLIANT_ERROR_FORMAT,
                             "%s: does not end within %d MiB: no text file of options, materials or tool paths", path,
                             MAX_TEXT >> 20);
    } else if (ferror(file)) {
        status = pliant_fail(PLIANT_ERROR_FILE, "%s: cannot be read: %s", path, strerror(errno));
    } else if (memchr(text, 0, size)) {
        const bool wide = memcmp(text, "\xFF\xFE", 2) == 0 || memcmp(text, "\xFE\xFF", 2) == 0;
        status = pliant_fail(PLIANT_ERROR_FORMAT, "%s: is not a text file (it holds zero bytes)%s", path,
                             wide ? ": it is UTF-16; save it as UTF-8" : "");
    } else {
        skip_byte_order_mark(text, size);
        *out = text;
        text = NULL;
    }
end:
    pliant_free(text);
    fclose(file);
    return status;
}

static void *resize(void *context, void *block, size_t size)
{
    (void)context;
    if (size) return pliant_resize(block, size, 1);
    pliant_free(block);
    return NULL;
}

static void listen(cyaml_log_t level, void *context, const char *format, va_list arguments)
{
    yaml_failure *c = context;
    char text[MESSAGE_SIZE];
    if (level < CYAML_LOG_ERROR) return;
    vsnprintf(text, sizeof text, format, arguments);
    text[strcspn(text, "\n")] = 0;
    const char *line = strstr(text, "(line: "), *field = strstr(text, "in mapping field '");
    if (strstr(text, "Load: Backtrace")) return;
    if (!c->reason[0]) {
        const char *start = strncmp(text, "Load: ", 6) ? text : text + 6;
        snprintf(c->reason, sizeof c->reason, "%s", start);
        return;
    }
    if (line && !c->line) c->line = atoi(line + 7);
    if (field && c->depth < PATH_DEPTH) {
        field += strlen("in mapping field '");
        int length = (int)strcspn(field, "'");
        snprintf(c->where[c->depth++], KEY_SIZE, "%.*s", length, field);
    }
}

/* Return the schema value at the location of the failure; NULL: unknown. */
static const cyaml_schema_value_t *value_at(const yaml_failure *c, const cyaml_schema_value_t *value)
{
    for (int level = c->depth; level > 0; --level) {
        while (value->type == CYAML_SEQUENCE || value->type == CYAML_SEQUENCE_FIXED) value = value->sequence.entry;
        if (value->type != CYAML_MAPPING) return NULL;
        const cyaml_schema_field_t *field = value->mapping.fields;
        while (field->key && strcmp(field->key, c->where[level - 1]) != 0) ++field;
        if (!field->key) return NULL;
        value = &field->value;
    }
    return value;
}

/* List the keys that the mapping at the location may have; "" if it is not a mapping. */
static void list_keys(const yaml_failure *c, const cyaml_schema_value_t *value, char *out, size_t size)
{
    size_t used = 0;
    out[0] = 0;
    value = value_at(c, value);
    while (value && (value->type == CYAML_SEQUENCE || value->type == CYAML_SEQUENCE_FIXED))
        value = value->sequence.entry;
    if (!value || value->type != CYAML_MAPPING) return;
    for (const cyaml_schema_field_t *field = value->mapping.fields; field->key && used < size; ++field)
        used += (size_t)snprintf(out + used, size - used, "%s%s", used ? ", " : "; it may be ", field->key);
}

/* Describe how a value of the schema is written in a file. */
static void describe(const cyaml_schema_value_t *value, char *out, size_t size)
{
    const bool words = value->type == CYAML_SEQUENCE_FIXED && value->sequence.entry->type == CYAML_STRING;
    if (words && value->sequence.max == 3) snprintf(out, size, "use a list of 3 values, as [1, 2, 3]");
    else if (words) snprintf(out, size, "use a list of %u values", (unsigned)value->sequence.max);
    else if (value->type == CYAML_SEQUENCE || value->type == CYAML_SEQUENCE_FIXED)
        snprintf(out, size, "use a list, as [..., ...] or with a - before each entry");
    else if (value->type == CYAML_MAPPING) snprintf(out, size, "use keys with values, as {key: value}");
    else snprintf(out, size, "use one value, without brackets; several names are one text with commas between");
}

/* Translate libcyaml's message about the type or length of a value: " is '7'; use a list ...". Return false for another
 * message. */
static bool describe_wrong_type(const yaml_failure *c, const char *text, const cyaml_schema_value_t *schema, char *out,
                                size_t size)
{
    static const char expecting[] = "Expecting ", few[] = "Insufficient entries (", many[] = "Excessive entries (";
    const cyaml_schema_value_t *value = value_at(c, schema);
    const char *event = strstr(c->reason, "got event: "), *line = text;
    char use[MESSAGE_SIZE], given[64] = "";
    if (!value || c->depth == 0) return false;
    describe(value, use, sizeof use);
    if (strncmp(c->reason, few, sizeof few - 1) == 0)
        return snprintf(out, size, " has %d values; %s", atoi(c->reason + sizeof few - 1), use) > 0;
    if (strncmp(c->reason, many, sizeof many - 1) == 0)
        return snprintf(out, size, " has more than %d values; %s", atoi(c->reason + sizeof many - 1), use) > 0;
    if (strncmp(c->reason, expecting, sizeof expecting - 1) != 0 || !event) return false;
    event += strlen("got event: ");
    for (int n = 1; line && n < c->line; ++n) line = (line = strchr(line, '\n')) ? line + 1 : NULL;
    if (c->line && line && strncmp(event, "SCALAR", 6) == 0) { /* the text after the key */
        const char *key = strstr(line, c->where[0]), *end = line + strcspn(line, "\n");
        const char *from =
            key && key < end ? key + strlen(c->where[0]) + strspn(key + strlen(c->where[0]), "'\": ") : end;
        size_t length = strcspn(from, "\r\n#,}]");
        while (length > 0 && from[length - 1] == ' ') --length;
        if (length == 0) return snprintf(out, size, " is empty; %s", use) > 0;
        snprintf(given, sizeof given, " '%.*s'", (int)length, from);
    }
    return snprintf(out, size, " is %s%s; %s",
                    strncmp(event, "SEQ", 3) == 0   ? "a list"
                    : strncmp(event, "MAP", 3) == 0 ? "a group of keys"
                                                    : "one value",
                    given, use) > 0;
}

static pliant_status fail_with_yaml_message(yaml_failure *c, const char *text, const char *name,
                                            const cyaml_schema_value_t *schema)
{
    static const char unknown[] = "Unexpected key: ";
    char line[32] = "", keys[MESSAGE_SIZE] = "", place[MESSAGE_SIZE] = "", kind[2 * MESSAGE_SIZE];
    const char *removed = NULL;
    size_t used = 0;
    for (int level = c->depth - 1; level >= 0 && used < sizeof place; --level)
        used += (size_t)snprintf(place + used, sizeof place - used, "%s%s", used ? "/" : "", c->where[level]);
    if (strncmp(c->reason, unknown, sizeof unknown - 1) == 0) {
        /* libcyaml reports the line of the previous key */
        int exact = pliant_yaml_line(text, c->reason + sizeof unknown - 1, 0, c->line ? c->line : 1);
        if (exact) c->line = exact;
        list_keys(c, schema, keys, sizeof keys);
        snprintf(kind, sizeof kind, "%s/%s", place, c->reason + sizeof unknown - 1);
        removed = pliant_scene_removed_option(kind);
    }
    if (c->line) snprintf(line, sizeof line, "line %d: ", c->line);
    if (removed) return pliant_fail(PLIANT_ERROR_FORMAT, "%s: %s%s: %s", name, line, kind, removed);
    if (describe_wrong_type(c, text, schema, kind, sizeof kind))
        return pliant_fail(PLIANT_ERROR_FORMAT, "%s: %s%s%s", name, line, place, kind);
    return pliant_fail(PLIANT_ERROR_FORMAT, "%s: %s%s%s%s%s", name, line, c->reason, used ? " in " : "", place, keys);
}

pliant_status pliant_yaml_load(const char *text, const char *name, const cyaml_schema_value_t *schema, void **out)
{
    yaml_failure c = {.depth = 0};
    cyaml_config_t config = {
        .log_fn = listen, .log_ctx = &c, .mem_fn = resize, .log_level = CYAML_LOG_ERROR, .flags = CYAML_CFG_DEFAULT};
    cyaml_data_t *data = NULL;
    cyaml_err_t error = cyaml_load_data((const uint8_t *)text, strlen(text), &config, schema, &data, NULL);
    if (error == CYAML_ERR_OOM) return pliant_fail_memory(name);
    if (error != CYAML_OK) {
        if (!c.reason[0]) snprintf(c.reason, sizeof c.reason, "%s", cyaml_strerror(error));
        return fail_with_yaml_message(&c, text, name, schema);
    }
    *out = data;
    return PLIANT_OK;
}

void pliant_yaml_free(const cyaml_schema_value_t *schema, void *data)
{
    cyaml_config_t config = {.mem_fn = resize, .log_level = CYAML_LOG_ERROR};
    if (data) cyaml_free(&config, schema, data, 0);
}

int pliant_yaml_line(const char *text, const char *key, int occurrence, int from)
{
    size_t length = strlen(key);
    int line = 1;
    char before = '\n';
    for (const char *c = text; *c; before = *c++) {
        if (*c == '\n') ++line;
        bool starts = isspace((unsigned char)before) || strchr("{,'\"", before);
        if (*c == '#' && isspace((unsigned char)before)) {
            /* skip to the last character of the comment */
            while (c[1] && c[1] != '\n') ++c;
        } else if (line >= from && starts && strncmp(c, key, length) == 0) {
            const char *after = c + length;
            if (*after == '\'' || *after == '"') ++after;
            while (*after == ' ') ++after;
            if (*after == ':' && occurrence-- == 0) return line;
        }
    }
    return 0;
}

bool pliant_parse_real(const char *text, double *out)
{
    /* the host program may use a locale with a decimal comma */
    locale_t plain = newlocale(LC_NUMERIC_MASK, "C", (locale_t)0);
    if (!plain) return false;
    locale_t old = uselocale(plain);
    char *end;
    double value = strtod(text, &end);
    uselocale(old);
    freelocale(plain);
    while (isspace((unsigned char)*end)) ++end;
    if (end == text || *end || !isfinite(value)) return false;
    *out = value;
    return true;
}

bool pliant_parse_integer(const char *text, int64_t *out)
{
    char *end;
    errno = 0;
    long long value = strtoll(text, &end, 10);
    while (isspace((unsigned char)*end)) ++end;
    if (end == text || *end || errno) return false;
    *out = value;
    return true;
}

bool pliant_parse_bool(const char *text, bool *out)
{
    static const char *const words[2][4] = {{"false", "no", "off", "0"}, {"true", "yes", "on", "1"}};
    for (int value = 0; value < 2; ++value)
        for (int i = 0; i < 4; ++i)
            if (strcmp(text, words[value][i]) == 0) {
                *out = value == 1;
                return true;
            }
    return false;
}
