#include "scene/yaml.h"

#include "base/fail.h"
#include "base/open.h"
#include "pliant/memory.h"

#include <ctype.h>
#include <errno.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MESSAGE_SIZE = 512, PATH_DEPTH = 8, KEY_SIZE = 64, MOST_TEXT = 64 << 20 };

/* What libcyaml says about one failure: the first line is the reason, the others tell where, innermost first. */
typedef struct complaint {
    char reason[MESSAGE_SIZE];
    char where[PATH_DEPTH][KEY_SIZE]; /* names of mapping fields, innermost first */
    int depth;
    int line; /* 0: not known */
} complaint;

pliant_status pliant_text_read(const char *path, char **out)
{
    pliant_status status = PLIANT_OK;
    char *text = NULL;
    size_t size = 0, room = 4096;
    pliant_opening opening;
    FILE *file = pliant_opening_begin(path, &opening) ? fopen(opening.name, "rb") : NULL;
    pliant_opening_end(&opening);
    if (opening.refused) return pliant_fail(PLIANT_ERROR_FILE, "%s: may not be read: %s", path, opening.refused);
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: cannot be opened: %s", path, strerror(errno));
    do {
        char *larger = pliant_resize(text, room + 1, 1);
        if (!larger) {
            status = pliant_fail_memory(path);
            goto end;
        }
        text = larger;
        size += fread(text + size, 1, room - size, file);
        room *= 2;
    } while (size == room / 2 && size < MOST_TEXT);
    if (size >= MOST_TEXT) {
        status = pliant_fail(PLIANT_ERROR_FORMAT, "%s: does not end within %d MiB: no text file of options, materials or tool paths", path, MOST_TEXT >> 20);
    } else if (ferror(file)) {
        status = pliant_fail(PLIANT_ERROR_FILE, "%s: cannot be read: %s", path, strerror(errno));
    } else if (memchr(text, 0, size)) {
        status = pliant_fail(PLIANT_ERROR_FORMAT, "%s: is not a text file (it holds zero bytes)", path);
    } else {
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
    complaint *c = context;
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

/* The keys that the mapping at the place of the complaint may hold, "" when it is not a mapping. */
static void list_keys(const complaint *c, const cyaml_schema_value_t *value, char *out, size_t size)
{
    out[0] = 0;
    for (int level = c->depth; level >= 0; --level) {
        while (value->type == CYAML_SEQUENCE || value->type == CYAML_SEQUENCE_FIXED) value = value->sequence.entry;
        if (value->type != CYAML_MAPPING) return;
        if (level == 0) break;
        const cyaml_schema_field_t *field = value->mapping.fields;
        while (field->key && strcmp(field->key, c->where[level - 1]) != 0) ++field;
        if (!field->key) return;
        value = &field->value;
    }
    size_t used = 0;
    for (const cyaml_schema_field_t *field = value->mapping.fields; field->key && used < size; ++field)
        used += (size_t)snprintf(out + used, size - used, "%s%s", used ? ", " : "; it may be ", field->key);
}

static pliant_status explain(complaint *c, const char *text, const char *name, const cyaml_schema_value_t *schema)
{
    static const char unknown[] = "Unexpected key: ";
    char line[32] = "", keys[MESSAGE_SIZE] = "", place[MESSAGE_SIZE] = "";
    if (strncmp(c->reason, unknown, sizeof unknown - 1) == 0) {
        /* libcyaml's line is the one of the key before */
        int exact = pliant_yaml_line(text, c->reason + sizeof unknown - 1, 0, c->line ? c->line : 1);
        if (exact) c->line = exact;
        list_keys(c, schema, keys, sizeof keys);
    }
    if (strstr(c->reason, "Expecting STRING, got event: SEQUENCE_START")) snprintf(keys, sizeof keys, "; it is not a list: one text, without brackets, what it names with commas between");
    if (c->line) snprintf(line, sizeof line, "line %d: ", c->line);
    size_t used = 0;
    for (int level = c->depth - 1; level >= 0 && used < sizeof place; --level)
        used += (size_t)snprintf(place + used, sizeof place - used, "%s%s", used ? "/" : " in ", c->where[level]);
    return pliant_fail(PLIANT_ERROR_FORMAT, "%s: %s%s%s%s", name, line, c->reason, place, keys);
}

pliant_status pliant_yaml_load(const char *text, const char *name, const cyaml_schema_value_t *schema, void **out)
{
    complaint c = {.depth = 0};
    cyaml_config_t config = {
        .log_fn = listen, .log_ctx = &c, .mem_fn = resize, .log_level = CYAML_LOG_ERROR, .flags = CYAML_CFG_DEFAULT};
    cyaml_data_t *data = NULL;
    cyaml_err_t error = cyaml_load_data((const uint8_t *)text, strlen(text), &config, schema, &data, NULL);
    if (error == CYAML_ERR_OOM) return pliant_fail_memory(name);
    if (error != CYAML_OK) {
        if (!c.reason[0]) snprintf(c.reason, sizeof c.reason, "%s", cyaml_strerror(error));
        return explain(&c, text, name, schema);
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
            /* on to the last character of the comment */
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
    /* a host program may have set a locale with a decimal comma */
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
