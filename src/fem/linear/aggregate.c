#include "fem/linear/aggregate.h"

#include "base/fail.h"
#include "pliant/memory.h"

#include <math.h>
#include <string.h>

static double size_of(const double block[9])
{
    double sum = 0;
    for (int m = 0; m < 9; m++) sum += block[m] * block[m];
    return sqrt(sum);
}

pliant_status pliant_ties_create(const pliant_pattern *pattern, const double *blocks, int32_t stride, pliant_ties *out)
{
    pliant_ties ties = {.count = pattern->num_columns / stride};
    const size_t most = 2 * (size_t)pattern->num_blocks;
    ties.start = pliant_calloc((size_t)ties.count + 2, sizeof *ties.start);
    ties.neighbour = pliant_calloc(most, sizeof *ties.neighbour);
    ties.strength = pliant_calloc(most, sizeof *ties.strength);
    if (!ties.start || !ties.neighbour || !ties.strength) {
        pliant_ties_free(&ties);
        return pliant_fail_memory("the aggregates");
    }
    for (int pass = 0; pass < 2; pass++) { /* count, then fill */
        for (int32_t column = 0; column < pattern->num_columns; column += stride)
            for (int32_t b = pattern->start[column]; b < pattern->start[column + 1]; b++) {
                const int32_t row = pattern->row[b];
                if (row == column || row % stride != 0) continue;
                const int32_t ends[2] = {row / stride, column / stride};
                if (pass == 0) {
                    ties.start[ends[0] + 2]++;
                    ties.start[ends[1] + 2]++;
                    continue;
                }
                const double own = size_of(blocks + 9 * (size_t)pattern->start[row]) * size_of(blocks + 9 * (size_t)pattern->start[column]);
                const float strength = own > 0 ? (float)(size_of(blocks + 9 * (size_t)b) / sqrt(own)) : 0;
                for (int e = 0; e < 2; e++) {
                    const int32_t at = ties.start[ends[e] + 1]++;
                    ties.neighbour[at] = ends[1 - e];
                    ties.strength[at] = strength;
                }
            }
        for (int32_t n = 0; pass == 0 && n < ties.count; n++) ties.start[n + 2] += ties.start[n + 1];
    }
    *out = ties;
    return PLIANT_OK;
}

void pliant_ties_free(pliant_ties *ties)
{
    pliant_free(ties->start);
    pliant_free(ties->neighbour);
    pliant_free(ties->strength);
    memset(ties, 0, sizeof *ties);
}

/* the aggregate, not newer than `before`, that a vertex is tied to most strongly; -1: none */
static int32_t strongest(const pliant_ties *ties, int32_t vertex, float least, int32_t before, const int32_t *of)
{
    int32_t best = -1;
    float most = least;
    for (int32_t e = ties->start[vertex]; e < ties->start[vertex + 1]; e++) {
        const int32_t other = of[ties->neighbour[e]];
        if (other < 0 || other >= before || !(ties->strength[e] > 0) || ties->strength[e] < most || (best >= 0 && ties->strength[e] == most)) continue;
        most = ties->strength[e];
        best = other;
    }
    return best;
}

/* a vertex and what is bound to it and free becomes one */
static void gather(const pliant_ties *ties, int32_t vertex, float least, int32_t name, int32_t *of)
{
    of[vertex] = name;
    for (int32_t e = ties->start[vertex]; e < ties->start[vertex + 1]; e++)
        if (ties->strength[e] >= least && of[ties->neighbour[e]] < 0) of[ties->neighbour[e]] = name;
}

static bool stands_alone(const pliant_ties *ties, int32_t vertex, float least, const int32_t *of)
{
    bool bound = false;
    for (int32_t e = ties->start[vertex]; e < ties->start[vertex + 1]; e++) {
        if (ties->strength[e] < least) continue;
        if (of[ties->neighbour[e]] >= 0) return false;
        bound = true;
    }
    return bound;
}

int32_t pliant_aggregate(const pliant_ties *ties, float least, int32_t *of)
{
    int32_t count = 0;
    for (int32_t v = 0; v < ties->count; v++) of[v] = -1;
    /* whole neighbourhoods; then what lies between joins them; then neighbourhoods of what is left */
    for (int32_t v = 0; v < ties->count; v++)
        if (of[v] < 0 && stands_alone(ties, v, least, of)) gather(ties, v, least, count++, of);
    const int32_t whole = count;
    for (int32_t v = 0; v < ties->count; v++) /* those that joined in this pass are not joined: they would make chains */
        if (of[v] < 0) {
            const int32_t best = strongest(ties, v, least, whole, of);
            if (best >= 0) of[v] = -2 - best;
        }
    for (int32_t v = 0; v < ties->count; v++)
        if (of[v] < -1) of[v] = -2 - of[v];
    for (int32_t v = 0; v < ties->count; v++) {
        if (of[v] >= 0) continue;
        bool alone = true;
        for (int32_t e = ties->start[v]; e < ties->start[v + 1]; e++) alone = alone && !(ties->strength[e] >= least && of[ties->neighbour[e]] < 0);
        /* nothing free is bound to it: it goes where it is tied to at all */
        const int32_t best = alone ? strongest(ties, v, 0, count, of) : -1;
        if (best >= 0) of[v] = best;
        else gather(ties, v, least, count++, of);
    }
    return count;
}
