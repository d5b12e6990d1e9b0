#include "fem/linear/answers.h"

#include "base/fail.h"
#include "base/memory.h"

#include <string.h>

void pliant_answers_free(pliant_answers *answers)
{
    for (int32_t s = 0; s < answers->room; s++) pliant_half_free(answers->half + s);
    pliant_free(answers->half);
    pliant_free(answers->slot);
    pliant_free(answers->unknown);
    pliant_free(answers->block);
    pliant_free(answers->column);
    memset(answers, 0, sizeof *answers);
}

pliant_status pliant_answers_create(int32_t num_free, pliant_answers *out)
{
    pliant_answers answers = {.num_free = num_free};
    answers.slot = pliant_calloc((size_t)num_free, sizeof *answers.slot);
    answers.column = pliant_calloc((size_t)num_free, 9 * sizeof *answers.column);
    if (!answers.slot || !answers.column) {
        pliant_answers_free(&answers);
        return pliant_fail_memory("answers to contact");
    }
    for (int32_t f = 0; f < num_free; f++) answers.slot[f] = -1;
    *out = answers;
    return PLIANT_OK;
}

/* Allocate a larger buffer, and keep only the known blocks that are needed again. */
static pliant_status make_room(pliant_answers *answers, int32_t count, const int32_t *unknown)
{
    const int32_t least = 32, room = 2 * count > least ? 2 * count : least;
    int32_t *kept = pliant_calloc((size_t)room, sizeof *kept), num_kept = 0;
    double *block = pliant_calloc((size_t)room * (size_t)room, 9 * sizeof *block);
    pliant_half *half = pliant_calloc((size_t)room, sizeof *half);
    if (!kept || !block || !half) {
        pliant_free(kept);
        pliant_free(half);
        pliant_free(block);
        return pliant_fail_memory("answers to contact");
    }
    for (int32_t i = 0; i < count; i++)
        if (answers->slot[unknown[i]] >= 0) kept[num_kept++] = unknown[i];
    for (int32_t a = 0; a < num_kept; a++) {
        for (int32_t b = 0; b < num_kept; b++)
            memcpy(block + 9 * ((size_t)a * (size_t)room + (size_t)b), pliant_answer(answers, kept[a], kept[b]),
                   9 * sizeof *block);
    }
    for (int32_t a = 0; a < num_kept; a++) {
        half[a] = answers->half[answers->slot[kept[a]]];
        answers->half[answers->slot[kept[a]]] = (pliant_half){0};
    }
    for (int32_t s = 0; s < answers->room; s++) pliant_half_free(answers->half + s);
    pliant_free(answers->half);
    answers->half = half;
    for (int32_t s = 0; s < answers->count; s++) answers->slot[answers->unknown[s]] = -1;
    for (int32_t a = 0; a < num_kept; a++) answers->slot[kept[a]] = a;
    pliant_free(answers->unknown);
    pliant_free(answers->block);
    answers->unknown = kept;
    answers->block = block;
    answers->count = num_kept;
    answers->room = room;
    return PLIANT_OK;
}

static void set_block(pliant_answers *answers, int32_t a, int32_t b, const double block[9])
{
    const size_t room = (size_t)answers->room, here = 9 * ((size_t)a * room + (size_t)b),
                 there = 9 * ((size_t)b * room + (size_t)a);
    for (size_t r = 0; r < 3; r++)
        for (size_t c = 0; c < 3; c++)
            answers->block[here + 3 * r + c] = answers->block[there + 3 * c + r] = block[3 * r + c];
}

static pliant_status find_by_half(pliant_answers *answers, pliant_factor *factor, int32_t slot)
{
    pliant_half *half = answers->half + slot;
    pliant_status status = pliant_factor_half(factor, answers->unknown[slot], half);
    for (int32_t b = 0; b < answers->count && status == PLIANT_OK; b++) {
        double block[9];
        pliant_factor_half_product(factor, answers->half + b, half, block);
        set_block(answers, b, slot, block);
    }
    return status;
}

static pliant_status find_column(pliant_answers *answers, pliant_preconditioner *preconditioner, int32_t slot)
{
    const size_t n = 3 * (size_t)answers->num_free;
    memset(answers->column, 0, 3 * n * sizeof *answers->column);
    for (size_t d = 0; d < 3; d++) answers->column[n * d + 3 * (size_t)answers->unknown[slot] + d] = 1;
    pliant_status status = pliant_preconditioner_solve(preconditioner, 3, answers->column, answers->column);
    for (int32_t b = 0; b < answers->count && status == PLIANT_OK; b++) {
        double block[9];
        for (size_t m = 0; m < 9; m++)
            block[m] = answers->column[n * (m % 3) + 3 * (size_t)answers->unknown[b] + m / 3];
        set_block(answers, b, slot, block);
    }
    return status;
}

void pliant_answers_forget(pliant_answers *answers)
{
    for (int32_t s = 0; s < answers->count; s++) answers->slot[answers->unknown[s]] = -1;
    answers->count = 0;
}

pliant_status pliant_answers_find(pliant_answers *answers, pliant_preconditioner *preconditioner, pliant_factor *factor,
                                  int32_t count, const int32_t *unknown)
{
    int32_t missing = 0;
    for (int32_t i = 0; i < count; i++) missing += answers->slot[unknown[i]] < 0;
    pliant_status status = answers->count + missing > answers->room ? make_room(answers, count, unknown) : PLIANT_OK;
    for (int32_t i = 0; i < count && status == PLIANT_OK; i++) {
        if (answers->slot[unknown[i]] >= 0) continue;
        const int32_t slot = answers->count++;
        answers->unknown[slot] = unknown[i];
        answers->slot[unknown[i]] = slot;
        status = factor ? find_by_half(answers, factor, slot) : find_column(answers, preconditioner, slot);
        if (status == PLIANT_OK) continue;
        answers->slot[unknown[i]] = -1;
        answers->count--;
    }
    return status;
}
