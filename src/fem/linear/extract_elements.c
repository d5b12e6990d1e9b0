/* A subset of a system's elements as a separate system. */
#include "base/fail.h"
#include "base/buffer.h"
#include "fem/element/hexahedra.h"
#include "fem/system.h"
#include "base/memory.h"

#include <string.h>

static pliant_status no_memory(void) { return pliant_fail_memory("a part of the elements"); }

static pliant_status take_tets(const pliant_system *whole, int32_t count, const int32_t *element, const int32_t *place,
                               pliant_mesh *mesh, pliant_system *out)
{
    const size_t tets = (size_t)count, blocks = (size_t)(out->num_blocks = (count + LANES - 1) / LANES);
    mesh->tets = pliant_calloc(tets, 4 * sizeof *mesh->tets);
    out->gradients = pliant_calloc(blocks, sizeof *out->gradients);
    out->lame = pliant_calloc(blocks, sizeof *out->lame);
    if (whole->stiffness) out->stiffness = pliant_calloc(tets, 144 * sizeof *out->stiffness);
    if (whole->grounded) out->grounded = pliant_calloc(blocks, LANES * sizeof *out->grounded);
    if (!mesh->tets || !out->gradients || !out->lame || (whole->stiffness && !out->stiffness) ||
        (whole->grounded && !out->grounded))
        return no_memory();
    mesh->num_tets = count;
    for (int32_t e = 0; e < out->num_blocks * LANES; e++) { /* padding repeats the last element without stiffness, as in
                                                             * elements.c */
        const int32_t at = e < count ? e : count - 1, t = element[at];
        for (int m = 0; m < 12; m++)
            out->gradients[e / LANES][m][e % LANES] = whole->gradients[t / LANES][m][t % LANES];
        if (e != at) continue;
        for (int v = 0; v < 4; v++) mesh->tets[4 * e + v] = place[whole->mesh->tets[4 * t + v]];
        for (int m = 0; m < 2; m++) out->lame[e / LANES][m][e % LANES] = whole->lame[t / LANES][m][t % LANES];
        if (whole->stiffness)
            memcpy(out->stiffness + 144 * (size_t)e, whole->stiffness + 144 * (size_t)t, 144 * sizeof *out->stiffness);
        if (whole->grounded) out->grounded[e] = whole->grounded[t];
    }
    return PLIANT_OK;
}

static pliant_status allocate(const pliant_macros *whole, size_t count, size_t corners, pliant_macros *out)
{
    bool good = (out->start = pliant_calloc(count + 1, sizeof *out->start)) &&
                (out->node = pliant_calloc(corners, sizeof *out->node)) && (out->held = pliant_calloc(corners, 1)) &&
                (out->grounded = pliant_calloc(count, 1)) && (out->own = pliant_calloc(count, 8 * sizeof *out->own)) &&
                (out->gradient = pliant_calloc(count, 24 * sizeof *out->gradient)) &&
                (out->rank = pliant_calloc(count, sizeof *out->rank)) &&
                (out->root = pliant_calloc(count, sizeof *out->root)) &&
                (!whole->shear || (out->shear = pliant_calloc(count, sizeof *out->shear)));
    return good ? PLIANT_OK : no_memory();
}

static void take_macro(const pliant_macros *whole, int32_t from, const int32_t *place, pliant_macros *out)
{
    const int32_t e = out->count, first = whole->start[from], corners = whole->start[from + 1] - first,
                  begin = out->start[e];
    for (int32_t c = 0; c < corners; c++) out->node[begin + c] = place[whole->node[first + c]];
    memcpy(out->held + begin, whole->held + first, (size_t)corners);
    for (int v = 0; v < 8; v++)
        out->own[8 * (size_t)e + (size_t)v] =
            whole->own[8 * (size_t)from + (size_t)v] < 0 ? -1 : place[whole->own[8 * (size_t)from + (size_t)v]];
    memcpy(out->gradient + 24 * (size_t)e, whole->gradient + 24 * (size_t)from, 24 * sizeof *out->gradient);
    out->grounded[e] = whole->grounded[from];
    if (whole->shear) out->shear[e] = whole->shear[from];
    out->start[e + 1] = begin + corners;
    pliant_macros_share_root(whole, from, out, e);
    out->count++;
}

static pliant_status take_macros(const pliant_system *whole, int32_t count, const int32_t *element,
                                 const int32_t *place, pliant_mesh *mesh, pliant_system *out)
{
    const pliant_macros *from = whole->macros;
    size_t corners = 0;
    for (int32_t e = 0; e < count; e++) corners += (size_t)(from->start[element[e] + 1] - from->start[element[e]]);
    if (!(out->macros = pliant_calloc(1, sizeof *out->macros))) return no_memory();
    pliant_status status = allocate(from, (size_t)count, corners, out->macros);
    for (int32_t e = 0; status == PLIANT_OK && e < count; e++) take_macro(from, element[e], place, out->macros);
    if (status == PLIANT_OK &&
        !(out->macros->rest = pliant_copy_block(mesh->rest, (size_t)mesh->num_nodes, 3 * sizeof *mesh->rest)))
        status = no_memory();
    out->num_blocks = pliant_macros_blocks((size_t)count, corners);
    return status;
}

pliant_status pliant_system_extract(const pliant_system *whole, int32_t count, const int32_t *element,
                                    const int32_t *place, pliant_mesh *mesh, pliant_system *out)
{
    memcpy(mesh->cells, whole->mesh->cells, sizeof mesh->cells);
    memcpy(mesh->cell_size, whole->mesh->cell_size, sizeof mesh->cell_size);
    if (!(mesh->rest = pliant_calloc((size_t)mesh->num_nodes, 3 * sizeof *mesh->rest))) return no_memory();
    for (int32_t n = 0; n < whole->mesh->num_nodes; n++)
        if (place[n] >= 0) memcpy(mesh->rest + 3 * place[n], whole->mesh->rest + 3 * n, 3 * sizeof *mesh->rest);
    out->mesh = out->fine = mesh;
    out->num_threads = 1;
    return whole->macros ? take_macros(whole, count, element, place, mesh, out)
                         : take_tets(whole, count, element, place, mesh, out);
}
