/* Triangles of the surface that a blade sweeps. */
#include "cut/cut_stages.h"

#include "base/fail.h"
#include "base/memory.h"

#include <math.h>

static inline double lesser(double a, double b) { return a < b ? a : b; }
static inline double greater(double a, double b) { return a > b ? a : b; }

static void add_triangle(cut_strip *strip, const double aside[3], const double *p, const double *q, const double *r)
{
    cut_triangle *made = strip->triangles + strip->count;
    double u[3], v[3], squares = 0;
    for (int d = 0; d < 3; d++) {
        made->corner[d] = p[d] + aside[d];
        made->corner[3 + d] = q[d] + aside[d];
        made->corner[6 + d] = r[d] + aside[d];
        u[d] = q[d] - p[d];
        v[d] = r[d] - p[d];
        made->low[d] = lesser(made->corner[d], lesser(made->corner[3 + d], made->corner[6 + d]));
        made->high[d] = greater(made->corner[d], greater(made->corner[3 + d], made->corner[6 + d]));
    }
    for (int d = 0; d < 3; d++) {
        made->normal[d] = u[(d + 1) % 3] * v[(d + 2) % 3] - u[(d + 2) % 3] * v[(d + 1) % 3];
        squares += made->normal[d] * made->normal[d];
    }
    if (!(squares > 0) || !isfinite(squares)) return; /* degenerate triangle or invalid number */
    for (int d = 0; d < 3; d++) {
        if (strip->count == 0 || made->low[d] < strip->low[d]) strip->low[d] = made->low[d];
        if (strip->count == 0 || made->high[d] > strip->high[d]) strip->high[d] = made->high[d];
    }
    strip->count++;
}

pliant_status pliant_cut_strip(const pliant_cut_sweep *sweep, const double aside[3], cut_strip *out)
{
    *out = (cut_strip){0};
    if (sweep->count < 2) return PLIANT_OK;
    if (!(out->triangles = pliant_calloc(2 * ((size_t)sweep->count - 1), sizeof *out->triangles)))
        return pliant_fail_memory("the swept surface of the blade");
    for (int32_t i = 0; i + 1 < sweep->count; i++) {
        add_triangle(out, aside, sweep->from + 3 * i, sweep->from + 3 * (i + 1), sweep->to + 3 * i);
        add_triangle(out, aside, sweep->from + 3 * (i + 1), sweep->to + 3 * (i + 1), sweep->to + 3 * i);
    }
    return PLIANT_OK;
}
