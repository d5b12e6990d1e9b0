#include "fem/linear/compliance.h"

#include "base/fail.h"
#include "base/memory.h"

#include <string.h>

void pliant_compliance_free(pliant_compliance_blocks *blocks)
{
    for (int32_t s = 0; s < blocks->capacity; s++) pliant_half_solve_free(blocks->half + s);
    pliant_free(blocks->half);
    pliant_free(blocks->slot);
    pliant_free(blocks->unknown);
    pliant_free(blocks->block);
    pliant_free(blocks->column);
    memset(blocks, 0, sizeof *blocks);
}

pliant_status pliant_compliance_create(int32_t num_free, pliant_compliance_blocks *out)
{
    pliant_compliance_blocks blocks = {.num_free = num_free};
    blocks.slot = pliant_calloc((size_t)num_free, sizeof *blocks.slot);
    blocks.column = pliant_calloc((size_t)num_free, 9 * sizeof *blocks.column);
    if (!blocks.slot || !blocks.column) {
        pliant_compliance_free(&blocks);
        return pliant_fail_memory("contact compliance");
    }
    for (int32_t f = 0; f < num_free; f++) blocks.slot[f] = -1;
    *out = blocks;
    return PLIANT_OK;
}

/* Allocate a larger buffer, and keep only the known blocks that are needed again. */
static pliant_status reserve_capacity(pliant_compliance_blocks *blocks, int32_t count, const int32_t *unknown)
{
    const int32_t minimum = 32, capacity = 2 * count > minimum ? 2 * count : minimum;
    int32_t *kept = pliant_calloc((size_t)capacity, sizeof *kept), num_kept = 0;
    double *block = pliant_calloc((size_t)capacity * (size_t)capacity, 9 * sizeof *block);
    pliant_half_solve *half = pliant_calloc((size_t)capacity, sizeof *half);
    if (!kept || !block || !half) {
        pliant_free(kept);
        pliant_free(half);
        pliant_free(block);
        return pliant_fail_memory("contact compliance");
    }
    for (int32_t i = 0; i < count; i++)
        if (blocks->slot[unknown[i]] >= 0) kept[num_kept++] = unknown[i];
    for (int32_t a = 0; a < num_kept; a++) {
        for (int32_t b = 0; b < num_kept; b++)
            memcpy(block + 9 * ((size_t)a * (size_t)capacity + (size_t)b),
                   pliant_compliance_block(blocks, kept[a], kept[b]), 9 * sizeof *block);
    }
    for (int32_t a = 0; a < num_kept; a++) {
        half[a] = blocks->half[blocks->slot[kept[a]]];
        blocks->half[blocks->slot[kept[a]]] = (pliant_half_solve){0};
    }
    for (int32_t s = 0; s < blocks->capacity; s++) pliant_half_solve_free(blocks->half + s);
    pliant_free(blocks->half);
    blocks->half = half;
    for (int32_t s = 0; s < blocks->count; s++) blocks->slot[blocks->unknown[s]] = -1;
    for (int32_t a = 0; a < num_kept; a++) blocks->slot[kept[a]] = a;
    pliant_free(blocks->unknown);
    pliant_free(blocks->block);
    blocks->unknown = kept;
    blocks->block = block;
    blocks->count = num_kept;
    blocks->capacity = capacity;
    return PLIANT_OK;
}

static void set_block(pliant_compliance_blocks *blocks, int32_t a, int32_t b, const double block[9])
{
    const size_t capacity = (size_t)blocks->capacity, here = 9 * ((size_t)a * capacity + (size_t)b),
                 there = 9 * ((size_t)b * capacity + (size_t)a);
    for (size_t r = 0; r < 3; r++)
        for (size_t c = 0; c < 3; c++)
            blocks->block[here + 3 * r + c] = blocks->block[there + 3 * c + r] = block[3 * r + c];
}

static pliant_status find_by_half(pliant_compliance_blocks *blocks, pliant_factor *factor, int32_t slot)
{
    pliant_half_solve *half = blocks->half + slot;
    pliant_status status = pliant_factor_half(factor, blocks->unknown[slot], half);
    for (int32_t b = 0; b < blocks->count && status == PLIANT_OK; b++) {
        double block[9];
        pliant_factor_half_product(factor, blocks->half + b, half, block);
        set_block(blocks, b, slot, block);
    }
    return status;
}

static pliant_status find_column(pliant_compliance_blocks *blocks, pliant_preconditioner *preconditioner, int32_t slot)
{
    const size_t n = 3 * (size_t)blocks->num_free;
    memset(blocks->column, 0, 3 * n * sizeof *blocks->column);
    for (size_t d = 0; d < 3; d++) blocks->column[n * d + 3 * (size_t)blocks->unknown[slot] + d] = 1;
    pliant_status status = pliant_preconditioner_solve(preconditioner, 3, blocks->column, blocks->column);
    for (int32_t b = 0; b < blocks->count && status == PLIANT_OK; b++) {
        double block[9];
        for (size_t m = 0; m < 9; m++)
            block[m] = blocks->column[n * (m % 3) + 3 * (size_t)blocks->unknown[b] + m / 3];
        set_block(blocks, b, slot, block);
    }
    return status;
}

void pliant_compliance_discard(pliant_compliance_blocks *blocks)
{
    for (int32_t s = 0; s < blocks->count; s++) blocks->slot[blocks->unknown[s]] = -1;
    blocks->count = 0;
}

pliant_status pliant_compliance_compute(pliant_compliance_blocks *blocks, pliant_preconditioner *preconditioner,
                                        pliant_factor *factor, int32_t count, const int32_t *unknown)
{
    int32_t missing = 0;
    for (int32_t i = 0; i < count; i++) missing += blocks->slot[unknown[i]] < 0;
    pliant_status status =
        blocks->count + missing > blocks->capacity ? reserve_capacity(blocks, count, unknown) : PLIANT_OK;
    for (int32_t i = 0; i < count && status == PLIANT_OK; i++) {
        if (blocks->slot[unknown[i]] >= 0) continue;
        const int32_t slot = blocks->count++;
        blocks->unknown[slot] = unknown[i];
        blocks->slot[unknown[i]] = slot;
        status = factor ? find_by_half(blocks, factor, slot) : find_column(blocks, preconditioner, slot);
        if (status == PLIANT_OK) continue;
        blocks->slot[unknown[i]] = -1;
        blocks->count--;
    }
    return status;
}
