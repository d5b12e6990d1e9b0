/* Reader of Gmsh's .msh 4.1, text and binary: tetrahedra, and physical groups of their volumes. */
#include "mesh/mesh_file.h"

#include "base/fail.h"
#include "base/memory.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The reading position. */
typedef struct msh_reader {
    const file_text *text;
    size_t at;
    bool binary, failed;
} msh_reader;

static int64_t read_whole(msh_reader *reader, size_t bytes)
{
    const char *from = reader->text->data + reader->at;
    if (reader->failed) return 0;
    if (reader->binary) {
        int64_t value = 0;
        int32_t number;
        if (reader->text->size - reader->at < bytes) {
            reader->failed = true;
            return 0;
        }
        memcpy(bytes == 4 ? (void *)&number : (void *)&value, from, bytes);
        reader->at += bytes;
        return bytes == 4 ? number : value;
    }
    char *end;
    const long long value = strtoll(from, &end, 10);
    reader->failed = end == from;
    reader->at = (size_t)(end - reader->text->data);
    return value;
}

static int64_t read_int(msh_reader *reader) { return read_whole(reader, 4); }

/* Read a count or a tag, which must not be negative. */
static int64_t read_size(msh_reader *reader)
{
    const int64_t value = read_whole(reader, 8);
    if (value < 0) reader->failed = true;
    return reader->failed ? 0 : value;
}

/* Read a count of items that each occupy at least `minimum` bytes of the file. */
static int64_t read_count(msh_reader *reader, size_t minimum)
{
    const int64_t count = read_size(reader);
    if ((uint64_t)count > (reader->text->size - reader->at) / minimum + 1) reader->failed = true;
    return reader->failed ? 0 : count;
}

static double read_real(msh_reader *reader)
{
    const char *from = reader->text->data + reader->at;
    double value = 0;
    if (reader->failed) return 0;
    if (reader->binary) {
        if (reader->text->size - reader->at < sizeof value) {
            reader->failed = true;
            return 0;
        }
        memcpy(&value, from, sizeof value);
        reader->at += sizeof value;
        return value;
    }
    char *end;
    value = strtod(from, &end);
    reader->failed = end == from;
    reader->at = (size_t)(end - reader->text->data);
    return value;
}

/* Move to the line after the start of a section. Return false if the section is missing. */
static bool find_section(msh_reader *reader, const char *name)
{
    const size_t length = strlen(name);
    for (size_t at = 0; at + length < reader->text->size; at++) {
        const char *here = memchr(reader->text->data + at, '$', reader->text->size - at);
        if (!here) return false;
        at = (size_t)(here - reader->text->data);
        if ((at > 0 && here[-1] != '\n') || reader->text->size - at <= length || memcmp(here, name, length) != 0)
            continue;
        if (here[length] != '\n' && here[length] != '\r') continue;
        const char *line = memchr(here, '\n', reader->text->size - at);
        if (!line) return false;
        reader->at = (size_t)(line + 1 - reader->text->data);
        reader->failed = false;
        return true;
    }
    return false;
}

static pliant_status damaged(const msh_reader *reader, const char *section)
{
    return pliant_fail(PLIANT_ERROR_FORMAT, "%s: section %s is damaged or ends too early", reader->text->path, section);
}

static pliant_status read_format(msh_reader *reader)
{
    const char *path = reader->text->path;
    if (!find_section(reader, "$MeshFormat"))
        return pliant_fail(PLIANT_ERROR_FORMAT, "%s: has no section $MeshFormat: it is not a Gmsh file", path);
    const double version = read_real(reader);
    const int64_t kind = read_whole(reader, 4), size = read_whole(reader, 4);
    if (reader->failed) return damaged(reader, "$MeshFormat");
    if (!(version > 4.05 && version < 4.95))
        return pliant_fail(
            PLIANT_ERROR_FORMAT,
            "%s: is of version %.3g of the format; save it as 4.1: gmsh -save -format msh41 -o new.msh old.msh", path,
            version);
    if (kind != 0 && kind != 1) return damaged(reader, "$MeshFormat");
    if (kind == 1) {
        int32_t one = 0;
        if (size != 8)
            return pliant_fail(PLIANT_ERROR_FORMAT,
                               "%s: has numbers of %d bytes; save it again with Gmsh on a 64-bit machine", path,
                               (int)size);
        if (reader->text->size - reader->at > 1 + sizeof one)
            memcpy(&one, reader->text->data + reader->at + 1, sizeof one);
        if (one != 1)
            return pliant_fail(PLIANT_ERROR_FORMAT,
                               "%s: is big-endian; save it as text: gmsh -save -format msh41 (Mesh.Binary=0)", path);
    }
    reader->binary = kind == 1;
    return PLIANT_OK;
}

/* Read names of volume groups, which are text in binary files as well. */
static pliant_status read_names(msh_reader *reader, mesh_file *out)
{
    const bool binary = reader->binary;
    if (!find_section(reader, "$PhysicalNames")) return PLIANT_OK;
    reader->binary = false;
    const int64_t count = read_count(reader, 4);
    out->name = reader->failed ? NULL : pliant_calloc((size_t)count + 1, sizeof *out->name);
    if (!reader->failed && !out->name) return pliant_fail_memory("a mesh file");
    for (int64_t n = 0; n < count && !reader->failed; n++) {
        const int64_t dimension = read_int(reader), tag = read_int(reader);
        const char *data = reader->text->data,
                   *begin = reader->failed ? NULL : memchr(data + reader->at, '"', reader->text->size - reader->at);
        const char *end = begin ? memchr(begin + 1, '"', (size_t)(data + reader->text->size - begin) - 1) : NULL;
        if (!end) {
            reader->failed = true;
            break;
        }
        reader->at = (size_t)(end + 1 - data);
        if (dimension != 3) continue;
        mesh_region_name *name = out->name + out->num_names++;
        name->number = tag;
        snprintf(name->name, sizeof name->name, "%.*s", (int)(end - begin - 1 < 63 ? end - begin - 1 : 63), begin + 1);
    }
    reader->binary = binary;
    return reader->failed ? damaged(reader, "$PhysicalNames") : PLIANT_OK;
}

/* The physical group of each volume. */
typedef struct volume_groups {
    int64_t count;
    struct { int64_t volume, group; } *of;
} volume_groups;

static pliant_status read_entities(msh_reader *reader, volume_groups *out)
{
    int64_t count[4];
    if (!find_section(reader, "$Entities")) return PLIANT_OK;
    for (int d = 0; d < 4; d++) count[d] = read_count(reader, 4);
    out->of = reader->failed ? NULL : pliant_calloc((size_t)count[3] + 1, sizeof *out->of);
    if (!reader->failed && !out->of) return pliant_fail_memory("a mesh file");
    for (int d = 0; d < 4; d++)
        for (int64_t n = 0; n < count[d] && !reader->failed; n++) {
            const int64_t tag = read_int(reader);
            int64_t group = 0;
            for (int c = 0; c < (d == 0 ? 3 : 6); c++) read_real(reader);
            const int64_t groups = read_count(reader, 2);
            for (int64_t g = 0; g < groups && !reader->failed; g++) {
                const int64_t one = read_int(reader);
                if (g == 0) group = one;
            }
            const int64_t bounds = d > 0 ? read_count(reader, 2) : 0;
            for (int64_t b = 0; b < bounds && !reader->failed; b++) read_int(reader);
            if (d < 3 || reader->failed) continue;
            out->of[out->count].volume = tag;
            out->of[out->count++].group = group;
        }
    return reader->failed ? damaged(reader, "$Entities") : PLIANT_OK;
}

/* A node's tag, and its row. */
typedef struct tagged { int64_t tag; int32_t row; } tagged;

static int by_tag(const void *a, const void *b)
{
    const tagged *i = a, *j = b;
    return i->tag < j->tag ? -1 : i->tag > j->tag;
}

static pliant_status read_nodes(msh_reader *reader, tagged **tags, mesh_file *out)
{
    if (!find_section(reader, "$Nodes"))
        return pliant_fail(PLIANT_ERROR_FORMAT, "%s: has no section $Nodes", reader->text->path);
    const int64_t blocks = read_count(reader, 4), total = read_count(reader, 6);
    read_size(reader);
    read_size(reader);
    if (reader->failed || total > INT32_MAX / 4) return damaged(reader, "$Nodes");
    out->nodes = pliant_calloc((size_t)total + 1, 3 * sizeof *out->nodes);
    *tags = pliant_calloc((size_t)total + 1, sizeof **tags);
    if (!out->nodes || !*tags) return pliant_fail_memory("a mesh file");
    for (int64_t b = 0; b < blocks && !reader->failed; b++) {
        const int64_t dimension = read_int(reader);
        read_int(reader);
        const int64_t parametric = read_int(reader), count = read_count(reader, 6);
        if (reader->failed || count > total - out->num_nodes || dimension < 0 || dimension > 3)
            return damaged(reader, "$Nodes");
        for (int64_t n = 0; n < count; n++)
            (*tags)[out->num_nodes + n] = (tagged){read_size(reader), out->num_nodes + (int32_t)n};
        for (int64_t n = 0; n < count && !reader->failed; n++) {
            for (int64_t d = 0; d < 3; d++) out->nodes[3 * (out->num_nodes + n) + d] = read_real(reader);
            for (int64_t d = 0; parametric && d < dimension; d++) read_real(reader);
        }
        out->num_nodes += (int32_t)count;
    }
    if (reader->failed) return damaged(reader, "$Nodes");
    qsort(*tags, (size_t)out->num_nodes, sizeof **tags, by_tag);
    return PLIANT_OK;
}

/* Return the number of nodes of an element type; 0: unknown type. */
static int nodes_of_type(int64_t type)
{
    static const uint8_t nodes[32] = {0, 2,  3,  4,  4, 8,  6,  5,  3,  6,  9, 10, 27, 18, 14, 1,
                                      8, 20, 15, 13, 9, 10, 12, 15, 15, 21, 4, 5,  6,  20, 35, 56};
    return type > 0 && type < 32 ? nodes[type] : 0;
}

static int64_t group_of(const volume_groups *groups, int64_t volume)
{
    for (int64_t n = 0; n < groups->count; n++)
        if (groups->of[n].volume == volume) return groups->of[n].group ? groups->of[n].group : volume;
    return volume;
}

static pliant_status read_elements(msh_reader *reader, const tagged *tags, const volume_groups *groups, mesh_file *out)
{
    enum { GMSH_TETRAHEDRON = 4 };
    const char *path = reader->text->path;
    if (!find_section(reader, "$Elements"))
        return pliant_fail(PLIANT_ERROR_FORMAT, "%s: has no section $Elements", path);
    const int64_t blocks = read_count(reader, 4), total = read_count(reader, 4);
    read_size(reader);
    read_size(reader);
    if (reader->failed || total > INT32_MAX / 4) return damaged(reader, "$Elements");
    out->tets = pliant_calloc((size_t)total + 1, 4 * sizeof *out->tets);
    out->region = pliant_calloc((size_t)total + 1, sizeof *out->region);
    if (!out->tets || !out->region) return pliant_fail_memory("a mesh file");
    for (int64_t b = 0; b < blocks && !reader->failed; b++) {
        const int64_t dimension = read_int(reader), entity = read_int(reader), type = read_int(reader),
                      count = read_count(reader, 4);
        const int nodes = nodes_of_type(type);
        const int64_t region = group_of(groups, entity);
        if (reader->failed || count > total) return damaged(reader, "$Elements");
        if (nodes == 0 || (dimension == 3 && type != GMSH_TETRAHEDRON))
            return pliant_fail(
                PLIANT_ERROR_FORMAT,
                "%s: has elements of Gmsh's type %d; only linear tetrahedra (4) are read: gmsh -3 -order 1, "
                "without recombination",
                path, (int)type);
        if (dimension == 3 && count > total - out->num_tets) return damaged(reader, "$Elements");
        for (int64_t n = 0; n < count && !reader->failed; n++) {
            read_size(reader);
            for (int v = 0; v < nodes; v++) {
                const tagged wanted = {read_size(reader), 0};
                if (dimension != 3 || reader->failed) continue;
                const tagged *found = bsearch(&wanted, tags, (size_t)out->num_nodes, sizeof *tags, by_tag);
                if (!found)
                    return pliant_fail(PLIANT_ERROR_FORMAT, "%s: a tetrahedron has node %lld, which $Nodes lacks", path,
                                       (long long)wanted.tag);
                out->tets[4 * (int64_t)out->num_tets + v] = found->row;
            }
            if (dimension == 3 && !reader->failed) out->region[out->num_tets++] = region;
        }
    }
    return reader->failed ? damaged(reader, "$Elements") : PLIANT_OK;
}

pliant_status pliant_mesh_parse_msh(const file_text *text, mesh_file *out)
{
    msh_reader reader = {.text = text};
    volume_groups groups = {0};
    tagged *tags = NULL;
    pliant_status status = read_format(&reader);
    if (status == PLIANT_OK) status = read_names(&reader, out);
    if (status == PLIANT_OK) status = read_entities(&reader, &groups);
    if (status == PLIANT_OK) status = read_nodes(&reader, &tags, out);
    if (status == PLIANT_OK) status = read_elements(&reader, tags, &groups, out);
    bool any = out->num_names > 0; /* volumes without groups have no meaning for a material table */
    for (int64_t n = 0; n < groups.count; n++) any = any || groups.of[n].group != 0;
    out->regions = any ? MESH_REGIONS_NUMBERED : MESH_REGIONS_NONE;
    pliant_free(groups.of);
    pliant_free(tags);
    return status;
}
