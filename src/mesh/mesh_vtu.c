/* Reader of VTK's .vtu: tetrahedra, with arrays as text, base64 or raw, optionally compressed by zlib. */
#include "mesh/mesh_file.h"

#include "base/fail.h"
#include "base/memory.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

enum { ATTRIBUTE = 96 };

/* The text of a tag, between < and >. */
typedef struct tag { const char *begin, *end; } tag;

/* Properties from the head of a file. */
typedef struct vtu_file {
    const file_text *text;
    const char *end;             /* end of the tags: start of the appended data */
    const char *appended;        /* Nullable: after its _ */
    bool raw, compressed;        /* raw: appended data are not base64; compressed: arrays are compressed */
    size_t header;               /* bytes of a number before an array */
} vtu_file;

static pliant_status refuse(const vtu_file *file, const char *reason)
{
    return pliant_fail(PLIANT_ERROR_FORMAT, "%s: %s", file->text->path, reason);
}

/* Find the next tag with this name after a position. */
static bool find_tag(const char *from, const char *end, const char *name, tag *out)
{
    const size_t length = strlen(name);
    while (from < end && (from = memchr(from, '<', (size_t)(end - from)))) {
        from++;
        if ((size_t)(end - from) <= length || memcmp(from, name, length) != 0 || !strchr(" \t\r\n>/", from[length]))
            continue;
        const char *last = memchr(from, '>', (size_t)(end - from));
        if (!last) return false;
        *out = (tag){from, last};
        return true;
    }
    return false;
}

/* Read an attribute. Return false if it is missing. */
static bool attribute(const tag *of, const char *name, char out[ATTRIBUTE])
{
    const size_t length = strlen(name);
    for (const char *at = of->begin; at + length + 2 < of->end; at++) {
        if (!strchr(" \t\r\n", *at) || memcmp(at + 1, name, length) != 0 || at[1 + length] != '=' ||
            (at[2 + length] != '"' && at[2 + length] != '\''))
            continue;
        const char *begin = at + length + 3,
                   *last = begin < of->end ? memchr(begin, at[2 + length], (size_t)(of->end - begin)) : NULL;
        if (!last || last - begin >= ATTRIBUTE) return false;
        memcpy(out, begin, (size_t)(last - begin));
        out[last - begin] = 0;
        return true;
    }
    return false;
}

static bool is(const tag *of, const char *name, const char *value)
{
    char text[ATTRIBUTE];
    return attribute(of, name, text) && strcmp(text, value) == 0;
}

static pliant_status read_head(const file_text *text, vtu_file *out)
{
    tag vtk, appended;
    char value[ATTRIBUTE];
    *out = (vtu_file){.text = text, .end = text->data + text->size};
    if (!find_tag(text->data, out->end, "VTKFile", &vtk) || !is(&vtk, "type", "UnstructuredGrid"))
        return refuse(out, "is no VTK file of an unstructured grid; save it as .vtu");
    if (is(&vtk, "byte_order", "BigEndian")) return refuse(out, "is big-endian; save it as little-endian or as text");
    out->header = is(&vtk, "header_type", "UInt64") ? 8 : 4;
    out->compressed = attribute(&vtk, "compressor", value);
    if (out->compressed && strcmp(value, "vtkZLibDataCompressor") != 0)
        return refuse(out, "is compressed by another method than zlib; save it with zlib or uncompressed");
    if (find_tag(vtk.end, out->end, "AppendedData", &appended)) {
        out->raw = is(&appended, "encoding", "raw");
        out->appended = memchr(appended.end, '_', (size_t)(out->end - appended.end));
        if (out->appended) out->appended++;
        out->end = appended.begin;
    }
    return PLIANT_OK;
}

/* Bytes in memory: borrowed or owned. */
typedef struct bytes { const uint8_t *data; size_t size; uint8_t *owned; } bytes;

static int base64_value(char c)
{
    if (c >= 'A' && c <= 'Z') return c - 'A';
    if (c >= 'a' && c <= 'z') return c - 'a' + 26;
    if (c >= '0' && c <= '9') return c - '0' + 52;
    return c == '+' ? 62 : c == '/' ? 63 : -1;
}

/* Decode base64 up to the first other character. Padding can occur in the middle, after a separate header. Return false
 * if out of memory. */
static bool decode(const char *from, const char *end, bytes *out)
{
    int group[4], count = 0, padding = 0;
    out->owned = pliant_calloc((size_t)(end - from) / 4 * 3 + 4, 1);
    if (!out->owned) return false;
    for (; from < end; from++) {
        const int value = *from == '=' ? 0 : base64_value(*from);
        if (strchr(" \t\r\n", *from)) continue;
        if (value < 0) break;
        padding += *from == '=';
        group[count++] = value;
        if (count < 4) continue;
        const uint32_t all =
            (uint32_t)group[0] << 18 | (uint32_t)group[1] << 12 | (uint32_t)group[2] << 6 | (uint32_t)group[3];
        for (int b = 0; b < 3 - (padding < 3 ? padding : 2); b++)
            out->owned[out->size++] = (uint8_t)(all >> (16 - 8 * b));
        count = padding = 0;
    }
    out->data = out->owned;
    return true;
}

static uint64_t number_at(const vtu_file *file, const bytes *in, size_t index)
{
    uint64_t value = 0;
    memcpy(&value, in->data + index * file->header, file->header);
    return value;
}

/* Decompress zlib blocks, which follow their sizes, to `wanted` bytes. */
static bool inflate_blocks(const vtu_file *file, const bytes *in, size_t wanted, uint8_t *out)
{
    if (in->size < 3 * file->header) return false;
    const uint64_t blocks = number_at(file, in, 0), size = number_at(file, in, 1), last = number_at(file, in, 2);
    if (blocks > in->size / file->header || in->size / file->header < 3 + blocks) return false;
    size_t from = (size_t)(3 + blocks) * file->header, to = 0;
    for (uint64_t b = 0; b < blocks; b++) {
        const uint64_t stored = number_at(file, in, (size_t)(3 + b)), plain = b + 1 < blocks || last == 0 ? size : last;
        uLongf made = (uLongf)(wanted - to);
        if (stored > in->size - from || plain > wanted - to ||
            uncompress(out + to, &made, in->data + from, (uLong)stored) != Z_OK || made != plain)
            return false;
        from += (size_t)stored;
        to += (size_t)plain;
    }
    return to == wanted;
}

/* Read the `wanted` bytes of a binary array. Return false if the data is damaged, or if out of memory. */
static bool read_bytes(const vtu_file *file, const bytes *in, size_t wanted, uint8_t *out)
{
    if (file->compressed) return inflate_blocks(file, in, wanted, out);
    if (in->size < file->header || number_at(file, in, 0) != wanted || in->size - file->header < wanted) return false;
    memcpy(out, in->data + file->header, wanted);
    return true;
}

static const struct vtu_type { const char *name; size_t size; char kind; } types[] = {
    {"Int8", 1, 'i'}, {"UInt8", 1, 'u'}, {"Int16", 2, 'i'}, {"UInt16", 2, 'u'}, {"Int32", 4, 'i'}, {"UInt32", 4, 'u'},
    {"Int64", 8, 'i'}, {"UInt64", 8, 'u'}, {"Float32", 4, 'f'}, {"Float64", 8, 'f'}};

static double value_of(const struct vtu_type *type, const uint8_t *at)
{
    float single;
    double twice;
    int64_t number = 0;
    if (type->kind == 'f' && type->size == 4) return memcpy(&single, at, 4), single;
    if (type->kind == 'f') return memcpy(&twice, at, 8), twice;
    memcpy(&number, at, type->size);
    if (type->kind == 'i' && type->size < 8 && number >> (8 * type->size - 1) & 1)
        number -= (int64_t)1 << 8 * type->size;
    return (double)number;
}

static bool read_text_numbers(const char *from, const char *end, size_t count, double *out)
{
    for (size_t n = 0; n < count; n++) {
        char *next;
        if (from >= end) return false;
        out[n] = strtod(from, &next);
        if (next == from || next > end) return false;
        from = next;
    }
    return true;
}

/* Read an array of `count` numbers. name: for messages. */
static pliant_status read_array(const vtu_file *file, const tag *array, const char *name, size_t count, double *out)
{
    char kind[ATTRIBUTE] = "", offset[ATTRIBUTE] = "0", reason[192];
    const struct vtu_type *type = NULL;
    const char *limit = file->text->data + file->text->size;
    bytes in = {0};
    for (size_t t = 0; t < sizeof types / sizeof *types; t++)
        if (is(array, "type", types[t].name)) type = types + t;
    bool good = type && count > 0 && attribute(array, "format", kind);
    if (good && strcmp(kind, "ascii") == 0) {
        good = read_text_numbers(array->end + 1, file->end, count, out);
    } else if (good) {
        const size_t wanted = count * type->size;
        uint8_t *plain = pliant_calloc(wanted, 1);
        if (!plain) return pliant_fail_memory("a mesh file");
        if (strcmp(kind, "binary") == 0) {
            good = decode(array->end + 1, file->end, &in);
        } else {
            const uint64_t from = attribute(array, "offset", offset) ? strtoull(offset, NULL, 10) : UINT64_MAX;
            good = strcmp(kind, "appended") == 0 && file->appended && from < (uint64_t)(limit - file->appended);
            if (good && file->raw)
                in = (bytes){(const uint8_t *)file->appended + from, (size_t)(limit - file->appended) - (size_t)from,
                             NULL};
            else if (good) good = decode(file->appended + from, limit, &in);
        }
        good = good && read_bytes(file, &in, wanted, plain);
        for (size_t n = 0; good && n < count; n++) out[n] = value_of(type, plain + n * type->size);
        pliant_free(plain);
        pliant_free(in.owned);
    }
    if (good) return PLIANT_OK;
    snprintf(reason, sizeof reason,
             "its array %.60s is damaged, of an unknown type, or has another length than the grid says", name);
    return refuse(file, reason);
}

/* Find an array by its name in a section of the piece. */
static bool find_array(const vtu_file *file, const char *section, const char *name, tag *out)
{
    tag begin, end;
    char close[32];
    snprintf(close, sizeof close, "/%s", section);
    if (!find_tag(file->text->data, file->end, section, &begin)) return false;
    const char *last = find_tag(begin.end, file->end, close, &end) ? end.begin : file->end;
    for (const char *at = begin.end; find_tag(at, last, "DataArray", out); at = out->end)
        if (!name || is(out, "Name", name)) return true;
    return false;
}

static pliant_status read_section_array(const vtu_file *file, const char *section, const char *name, size_t count,
                                        double **out)
{
    tag array;
    char reason[128];
    snprintf(reason, sizeof reason, "has no array %s in section %s", name ? name : "of points", section);
    if (!find_array(file, section, name, &array)) return refuse(file, reason);
    *out = pliant_calloc(count, sizeof **out);
    return *out ? read_array(file, &array, name ? name : section, count, *out) : pliant_fail_memory("a mesh file");
}

static pliant_status read_cells(const vtu_file *file, size_t cells, mesh_file *out)
{
    const double vtk_tetra = 10;
    double *type = NULL, *corner = NULL;
    pliant_status status = read_section_array(file, "Cells", "types", cells, &type);
    for (size_t c = 0; status == PLIANT_OK && c < cells; c++)
        if (type[c] != vtk_tetra)
            status = pliant_fail(
                PLIANT_ERROR_FORMAT,
                "%s: cell %zu is of VTK's type %g; only linear tetrahedra (10) are read: extract them, or divide other "
                "cells (ParaView: Tetrahedralize)",
                file->text->path, c, type[c]);
    if (status == PLIANT_OK) status = read_section_array(file, "Cells", "connectivity", 4 * cells, &corner);
    if (status == PLIANT_OK && !(out->tets = pliant_calloc(cells, 4 * sizeof *out->tets)))
        status = pliant_fail_memory("a mesh file");
    for (size_t v = 0; status == PLIANT_OK && v < 4 * cells; v++)
        out->tets[v] = corner[v] >= 0 && corner[v] < INT32_MAX ? (int32_t)corner[v] : -1;
    if (status == PLIANT_OK) out->num_tets = (int32_t)cells;
    pliant_free(type);
    pliant_free(corner);
    return status;
}

/* Read the first of the arrays in which programs store regions. */
static pliant_status read_regions(const vtu_file *file, mesh_file *out)
{
    static const char *const names[] = {"material", "label",     "region",        "gmsh:physical",
                                        "physical", "medit:ref", "CellEntityIds", "Region"};
    tag array;
    for (size_t n = 0; n < sizeof names / sizeof *names; n++) {
        if (!find_array(file, "CellData", names[n], &array)) continue;
        double *value = pliant_calloc((size_t)out->num_tets, sizeof *value);
        out->region = pliant_calloc((size_t)out->num_tets, sizeof *out->region);
        pliant_status status = value && out->region ? read_array(file, &array, names[n], (size_t)out->num_tets, value)
                                                    : pliant_fail_memory("a mesh file");
        for (int32_t t = 0; status == PLIANT_OK && t < out->num_tets; t++)
            out->region[t] = value[t] >= -1e9 && value[t] <= 1e9 ? (int64_t)value[t] : -1;
        pliant_free(value);
        out->regions = n == 0 ? MESH_REGIONS_MATERIALS : MESH_REGIONS_NUMBERED;
        return status;
    }
    return PLIANT_OK;
}

pliant_status pliant_mesh_parse_vtu(const file_text *text, mesh_file *out)
{
    vtu_file file;
    tag piece, second;
    char points[ATTRIBUTE], cells[ATTRIBUTE];
    pliant_status status = read_head(text, &file);
    if (status != PLIANT_OK) return status;
    if (!find_tag(text->data, file.end, "Piece", &piece) || !attribute(&piece, "NumberOfPoints", points) ||
        !attribute(&piece, "NumberOfCells", cells))
        return refuse(&file, "has no piece with points and cells");
    if (find_tag(piece.end, file.end, "Piece", &second))
        return refuse(&file, "has several pieces; merge them into one");
    const uint64_t num_points = strtoull(points, NULL, 10), num_cells = strtoull(cells, NULL, 10);
    if (num_cells == 0) return refuse(&file, "has no cells");
    if (num_points == 0 || num_points > INT32_MAX / 4 || num_cells > INT32_MAX / 4 ||
        num_points > 1000 * (uint64_t)text->size || num_cells > 1000 * (uint64_t)text->size)
        return refuse(&file, "names more points or cells than it can hold");
    status = read_section_array(&file, "Points", NULL, 3 * (size_t)num_points, &out->nodes);
    if (status == PLIANT_OK) out->num_nodes = (int32_t)num_points;
    if (status == PLIANT_OK) status = read_cells(&file, (size_t)num_cells, out);
    return status == PLIANT_OK ? read_regions(&file, out) : status;
}
