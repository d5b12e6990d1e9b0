/* STL files (3D Systems, StereoLithography Interface Specification, 1989). */
#include "contact/shapes/solid.h"

#include "base/fail.h"
#include "base/open.h"
#include "base/memory.h"
#include "scene/yaml.h"

#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { HEADER = 84, RECORD = 50, MAX_BYTES = 320 << 20 };

/* Read a whole file and append a 0. */
static pliant_status read_bytes(const char *path, uint8_t **out, size_t *size)
{
    size_t capacity = 1 << 16, length = 0;
    uint8_t *bytes = NULL;
    pliant_status status = PLIANT_OK;
    pliant_opening opening;
    FILE *file = pliant_opening_begin(path, &opening) ? fopen(opening.name, "rb") : NULL;
    pliant_opening_end(&opening);
    if (opening.refused) return pliant_fail(PLIANT_ERROR_FILE, "%s: may not be read: %s", path, opening.refused);
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: cannot be opened: %s", path, strerror(errno));
    for (bool more = true; more && status == PLIANT_OK; capacity *= 2) {
        uint8_t *larger = pliant_resize(bytes, capacity + 1, 1);
        if (!larger) {
            status = pliant_fail_memory(path);
            break;
        }
        bytes = larger;
        length += fread(bytes + length, 1, capacity - length, file);
        more = length == capacity;
        if (length > MAX_BYTES)
            status = pliant_fail(PLIANT_ERROR_FORMAT, "%s: is longer than %d MiB", path, MAX_BYTES >> 20);
        else if (ferror(file)) status = pliant_fail(PLIANT_ERROR_FILE, "%s: cannot be read: %s", path, strerror(errno));
    }
    fclose(file);
    if (status == PLIANT_OK) {
        *out = bytes;
        *size = length;
    } else pliant_free(bytes);
    return status;
}

/* ---- binary */

static uint32_t word_at(const uint8_t *bytes)
{
    return bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

static pliant_status read_binary(const char *path, const uint8_t *bytes, int32_t count, double *points)
{
    for (int32_t t = 0; t < count; t++)
        for (int k = 0; k < 9; k++) { /* after the normal, which follows from the corners */
            const uint32_t word = word_at(bytes + HEADER + (size_t)RECORD * (size_t)t + 12 + 4 * k);
            float value;
            memcpy(&value, &word, sizeof value);
            if (!isfinite(value))
                return pliant_fail(PLIANT_ERROR_FORMAT, "%s: triangle %d has a corner that is not finite", path, t + 1);
            points[9 * (size_t)t + (size_t)k] = value;
        }
    return PLIANT_OK;
}

/* ---- text */

typedef struct text_reader { const char *path, *at; int line; char word[64]; } text_reader;

/* Read the next word. Return false at the end of the text. */
static bool next_word(text_reader *reader)
{
    size_t length = 0;
    for (; isspace((unsigned char)*reader->at); reader->at++) reader->line += *reader->at == '\n';
    for (; *reader->at && !isspace((unsigned char)*reader->at); reader->at++)
        if (length + 1 < sizeof reader->word) reader->word[length++] = (char)tolower((unsigned char)*reader->at);
    reader->word[length] = 0;
    return length > 0;
}

static pliant_status read_corner(text_reader *reader, double out[3])
{
    for (int d = 0; d < 3; d++)
        if (!next_word(reader) || !pliant_parse_real(reader->word, &out[d]))
            return pliant_fail(PLIANT_ERROR_FORMAT, "%s: line %d: 'vertex' needs three numbers; '%s' is not a number",
                               reader->path, reader->line, reader->word);
    return PLIANT_OK;
}

/* points: NULL: count triangles only */
static pliant_status read_text(const char *path, const char *text, int32_t *count, double *points)
{
    text_reader reader = {.path = path, .at = text, .line = 1};
    int corners = 0;
    bool ends = false, open = false;
    double facet[12]; /* space for one corner too many */
    *count = 0;
    while (next_word(&reader)) {
        const bool ends_facet = !strcmp(reader.word, "endfacet");
        if (open && (!strcmp(reader.word, "facet") || !strcmp(reader.word, "endsolid")))
            return pliant_fail(PLIANT_ERROR_FORMAT, "%s: line %d: the previous facet has no 'endfacet'", path,
                               reader.line);
        if (!strcmp(reader.word, "facet")) {
            corners = 0;
            open = true;
        } else if (!strcmp(reader.word, "vertex") && corners < 4) {
            pliant_status status = read_corner(&reader, facet + 3 * corners);
            if (status != PLIANT_OK) return status;
            corners++;
        } else if (ends_facet) {
            if (!open || corners != 3)
                return pliant_fail(PLIANT_ERROR_FORMAT, "%s: line %d: a facet needs 3 corners ('vertex x y z')", path,
                                   reader.line);
            if (points) memcpy(points + 9 * (size_t)*count, facet, 9 * sizeof *facet);
            open = false;
            if (++*count > PLIANT_SOLID_TRIANGLES) return PLIANT_OK;
        } else if (!strcmp(reader.word, "solid") || !strcmp(reader.word, "endsolid")) {
            /* the rest of the line is an optional name */
            ends = reader.word[0] == 'e';
            reader.at += strcspn(reader.at, "\n");
        }
    }
    return ends ? PLIANT_OK
                : pliant_fail(PLIANT_ERROR_FORMAT, "%s: ends at line %d without 'endsolid': it is truncated", path,
                              reader.line);
}

/* ---- both formats */

static pliant_status check_count(const char *path, uint32_t count)
{
    if (count == 0) return pliant_fail(PLIANT_ERROR_FORMAT, "%s: has no triangle", path);
    if (count > PLIANT_SOLID_TRIANGLES)
        return pliant_fail(PLIANT_ERROR_FORMAT, "%s: has more than %d triangles: make them fewer first", path,
                           PLIANT_SOLID_TRIANGLES);
    return PLIANT_OK;
}

static bool is_text(const uint8_t *bytes, size_t size)
{
    return size >= 5 && !memcmp(bytes, "solid", 5) && !memchr(bytes, 0, size) && strstr((const char *)bytes, "facet");
}

static pliant_status parse(const char *path, const uint8_t *bytes, size_t size, pliant_triangle_soup *out)
{
    int32_t count = 0;
    const uint32_t said = size >= HEADER ? word_at(bytes + HEADER - 4) : 0;
    const uint64_t needed = HEADER + (uint64_t)RECORD * said;
    const bool text = is_text(bytes, size) && size != needed;
    pliant_status status = PLIANT_OK;
    if (size == 0) return pliant_fail(PLIANT_ERROR_FORMAT, "%s: is empty", path);
    if (text) status = read_text(path, (const char *)bytes, &count, NULL);
    else if (size < HEADER)
        return pliant_fail(PLIANT_ERROR_FORMAT,
                           "%s: is not STL: neither 'solid' and facets, nor as long as a binary header of 84 bytes",
                           path);
    else if (size != needed)
        return pliant_fail(
            PLIANT_ERROR_FORMAT,
            "%s: as binary STL it says that it has %u triangles, which take %llu bytes, and has %zu: it is truncated, "
            "or not STL",
            path, said, (unsigned long long)needed, size);
    if (status == PLIANT_OK) status = check_count(path, text ? (uint32_t)count : said);
    if (status != PLIANT_OK) return status;
    if (!text) count = (int32_t)said;
    double *points = pliant_calloc((size_t)count, 9 * sizeof *points);
    if (!points) return pliant_fail_memory(path);
    status = text ? read_text(path, (const char *)bytes, &count, points) : read_binary(path, bytes, count, points);
    if (status == PLIANT_OK) *out = (pliant_triangle_soup){count, points};
    else pliant_free(points);
    return status;
}

pliant_status pliant_stl_read(const char *path, pliant_triangle_soup *out)
{
    uint8_t *bytes = NULL;
    size_t size = 0;
    pliant_status status = read_bytes(path, &bytes, &size);
    if (status == PLIANT_OK) status = parse(path, bytes, size, out);
    pliant_free(bytes);
    return status;
}
