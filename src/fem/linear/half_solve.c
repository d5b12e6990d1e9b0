#include "fem/linear/half_solve.h"

#include "base/fail.h"
#include "base/lanes.h"
#include "base/memory.h"

#include <string.h>

void pliant_half_solve_free(pliant_half_solve *half)
{
    pliant_free(half->value);
    memset(half, 0, sizeof *half);
}

static pliant_status reserve_capacity(pliant_half_solve *half, int32_t length)
{
    if (length > half->capacity) {
        double *value = pliant_resize(half->value, (size_t)length, 3 * sizeof *value);
        if (!value) return pliant_fail_memory("contact compliance");
        half->value = value;
        half->capacity = length;
    }
    half->length = length;
    return PLIANT_OK;
}

pliant_status pliant_half_solve_compute(pliant_panels *panels, const pliant_supernodes *of, pliant_reach *reach,
                                        int32_t node, pliant_half_solve *out)
{
    int32_t first = reach->of[3 * node];
    /* The first unknown is eliminated into the supernodes of the others. */
    for (int d = 1; d < 3; d++) first = reach->of[3 * node + d] < first ? reach->of[3 * node + d] : first;
    pliant_status status = reserve_capacity(out, reach->length[first]);
    if (status != PLIANT_OK) return status;
    out->supernode = first;
    for (int d = 0; d < 3; d++) {
        double *next = out->value + (size_t)d * (size_t)out->length;
        for (int32_t s = first; s >= 0; s = reach->above[s])
            memset(reach->x + of->first[s], 0, (size_t)(of->first[s + 1] - of->first[s]) * sizeof *reach->x);
        reach->x[reach->place[3 * node + d]] = 1;
        for (int32_t s = first; s >= 0; s = reach->above[s]) {
            const int columns = of->first[s + 1] - of->first[s];
            pliant_panels_forward(panels, of, s, reach->x);
            memcpy(next, reach->x + of->first[s], (size_t)columns * sizeof *next);
            next += columns;
        }
    }
    return PLIANT_OK;
}

/* Compute a' b of three vectors each. */
PLIANT_VECTORIZED static void products(size_t count, const double *const a[3], const double *const b[3], double out[9])
{
    double sum[9][LANES] = {{0}};
    size_t i = 0;
    for (; i + LANES <= count; i += LANES)
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                for (int k = 0; k < LANES; k++) sum[3 * r + c][k] += a[r][i + (size_t)k] * b[c][i + (size_t)k];
    for (int m = 0; m < 9; m++) {
        out[m] = 0;
        for (size_t j = i; j < count; j++) out[m] += a[m / 3][j] * b[m % 3][j];
        for (int k = 0; k < LANES; k++) out[m] += sum[m][k];
    }
}

void pliant_half_solve_product(const pliant_reach *reach, const pliant_half_solve *a, const pliant_half_solve *b,
                               double out[9])
{
    int32_t s = a->supernode, t = b->supernode;
    while (s != t && s >= 0 && t >= 0) { /* up to the first common supernode: later ones have higher numbers */
        if (s < t) s = reach->above[s];
        else t = reach->above[t];
    }
    memset(out, 0, 9 * sizeof *out);
    if (s != t || s < 0) return;
    const int32_t common = reach->length[s];
    const double *of_a[3], *of_b[3];
    for (int d = 0; d < 3; d++) {
        of_a[d] = a->value + (size_t)(d + 1) * (size_t)a->length - (size_t)common;
        of_b[d] = b->value + (size_t)(d + 1) * (size_t)b->length - (size_t)common;
    }
    products((size_t)common, of_a, of_b, out);
}

PLIANT_VECTORIZED static void answer(size_t count, const double *const z[3], const double *x, double out[3])
{
    double sum[3][LANES] = {{0}};
    size_t i = 0;
    for (; i + LANES <= count; i += LANES)
        for (int d = 0; d < 3; d++)
            for (int k = 0; k < LANES; k++) sum[d][k] += z[d][i + (size_t)k] * x[i + (size_t)k];
    for (int d = 0; d < 3; d++) {
        for (size_t j = i; j < count; j++) out[d] += z[d][j] * x[j];
        for (int k = 0; k < LANES; k++) out[d] += sum[d][k];
    }
}

PLIANT_VECTORIZED static void add(size_t count, const double *const z[3], const double force[3], double *x)
{
    for (size_t i = 0; i < count; i++) x[i] += z[0][i] * force[0] + z[1][i] * force[1] + z[2][i] * force[2];
}

void pliant_half_solve_displacement(const pliant_supernodes *of, const pliant_reach *reach,
                                    const pliant_half_solve *half, const double *x, double out[3])
{
    const size_t length = (size_t)half->length;
    const double *z[3] = {half->value, half->value + length, half->value + 2 * length};
    memset(out, 0, 3 * sizeof *out);
    for (int32_t s = half->supernode; s >= 0; s = reach->above[s]) {
        const size_t columns = (size_t)(of->first[s + 1] - of->first[s]);
        answer(columns, z, x + of->first[s], out);
        for (int d = 0; d < 3; d++) z[d] += columns;
    }
}

void pliant_half_solve_add_force(const pliant_supernodes *of, const pliant_reach *reach, const pliant_half_solve *half,
                                 const double force[3], double *x)
{
    const size_t length = (size_t)half->length;
    const double *z[3] = {half->value, half->value + length, half->value + 2 * length};
    for (int32_t s = half->supernode; s >= 0; s = reach->above[s]) {
        const size_t columns = (size_t)(of->first[s + 1] - of->first[s]);
        add(columns, z, force, x + of->first[s]);
        for (int d = 0; d < 3; d++) z[d] += columns;
    }
}
