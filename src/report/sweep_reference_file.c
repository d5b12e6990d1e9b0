/* Store reference solutions on disk, so that a continued sweep does not compute them again. An incomplete or different
 * file is ignored. */
#include "base/fail.h"
#include "base/memory.h"
#include "report/sweep.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

typedef struct kept_header {
    char magic[8], key[256];
    int64_t positions, last; /* number of following values */
    double force[3];
    uint64_t hash; /* hash of the values */
} kept_header;
static const char magic[8] = "PLREF01";
static const int64_t max_bytes = 64 << 20; /* larger references are recomputed */

static uint64_t hash_of(uint64_t hash, const void *bytes, size_t size)
{
    for (const unsigned char *at = bytes; size-- > 0; at++) hash = (hash ^ *at) * 1099511628211u; /* FNV-1a */
    return hash;
}

static const uint64_t hash_start = 14695981039346656037u;

static void begin_header(const sweep_state *state, const sweep_reference_key *kept, kept_header *out)
{
    const sweep_ground *ground = &state->ground;
    memset(out, 0, sizeof *out);
    memcpy(out->magic, magic, sizeof magic);
    snprintf(out->key, sizeof out->key, "%s|%d|%s|%s|%s|%d nodes|%g", state->setup, (int)ground->scene.mesh.ratio,
             state->variant, report_case_name(ground->cases[kept->index].kind), ground->point_names[kept->index],
             (int)kept->nodes, kept->tolerance);
    out->positions = 3 * (int64_t)ground->cases[kept->index].frames * kept->points;
    out->last = kept->has_last_state ? 3 * (int64_t)kept->nodes : 0;
}

static bool name_file(const sweep_state *state, const kept_header *header, char out[4096])
{
    uint64_t hash = hash_of(hash_start, header->key, sizeof header->key);
    const char *folder = state->ground.folder;
    return folder && snprintf(out, 4096, "%s/reference_%08x.bin", folder, (unsigned)(hash ^ hash >> 32)) < 4096;
}

static uint64_t hash_of_numbers(const kept_header *header, const double *positions, const double *last)
{
    uint64_t hash = hash_of(hash_start, header->force, sizeof header->force);
    hash = hash_of(hash, positions, (size_t)header->positions * sizeof *positions);
    return last ? hash_of(hash, last, (size_t)header->last * sizeof *last) : hash;
}

pliant_status sweep_reference_read(const sweep_state *state, const sweep_reference_key *kept, sweep_reference *out)
{
    kept_header wanted, header;
    char path[4096];
    double *positions = NULL, *last = NULL;
    pliant_status status = PLIANT_OK;
    begin_header(state, kept, &wanted);
    FILE *file = name_file(state, &wanted, path) ? fopen(path, "rb") : NULL;
    if (!file) return PLIANT_OK;
    bool same = fread(&header, sizeof header, 1, file) == 1 && memcmp(header.magic, wanted.magic, sizeof magic) == 0 &&
                memcmp(header.key, wanted.key, sizeof wanted.key) == 0 && header.positions == wanted.positions &&
                header.last == wanted.last;
    if (same) {
        positions = pliant_calloc((size_t)header.positions, sizeof *positions);
        if (header.last > 0) last = pliant_calloc((size_t)header.last, sizeof *last);
        if (!positions || (header.last > 0 && !last)) status = pliant_fail_memory("a reference solution");
    }
    same = same && status >= 0 &&
           fread(positions, sizeof *positions, (size_t)header.positions, file) == (size_t)header.positions &&
           (!last || fread(last, sizeof *last, (size_t)header.last, file) == (size_t)header.last) &&
           header.hash == hash_of_numbers(&header, positions, last);
    fclose(file);
    if (!same) {
        pliant_free(positions);
        pliant_free(last);
        return status;
    }
    out->run =
        (report_run){.frames = state->ground.cases[kept->index].frames, .points = kept->points, .positions = positions};
    memcpy(out->run.force, header.force, sizeof header.force);
    out->last = last;
    out->there = true;
    return PLIANT_OK;
}

pliant_status sweep_reference_write(const sweep_state *state, const sweep_reference_key *kept,
                                    const sweep_reference *reference)
{
    kept_header header;
    char path[4096], part[4096 + 8];
    begin_header(state, kept, &header);
    if (!state->ground.folder || (int64_t)sizeof(double) * (header.positions + header.last) > max_bytes)
        return PLIANT_OK;
    if (!name_file(state, &header, path))
        return pliant_fail(PLIANT_ERROR_FILE, "%s: the name is too long", state->ground.folder);
    memcpy(header.force, reference->run.force, sizeof header.force);
    header.hash = hash_of_numbers(&header, reference->run.positions, reference->last);
    snprintf(part, sizeof part, "%s.part", path);
    FILE *file = fopen(part, "wb");
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", part, strerror(errno));
    bool good =
        fwrite(&header, sizeof header, 1, file) == 1 &&
        fwrite(reference->run.positions, sizeof(double), (size_t)header.positions, file) == (size_t)header.positions &&
        (!reference->last || fwrite(reference->last, sizeof(double), (size_t)header.last, file) == (size_t)header.last);
    good = (fclose(file) == 0) && good;
    if (good && rename(part, path) == 0) return PLIANT_OK;
    pliant_status status =
        pliant_fail(PLIANT_ERROR_FILE, "%s could not be written completely: %s", path, strerror(errno));
    remove(part);
    return status;
}
