#include "fem/linear/panels.h"

#include "base/fail.h"
#include "base/lanes.h"
#include "base/memory.h"

#include <string.h>

pliant_status pliant_panels_create(size_t num_values, int32_t size, pliant_panels *out)
{
    pliant_panels panels = {.num_values = num_values};
    panels.value = pliant_calloc(num_values, sizeof *panels.value);
    panels.x = pliant_calloc((size_t)size, sizeof *panels.x);
    panels.column = pliant_calloc((size_t)size, sizeof *panels.column);
    if (!panels.value || !panels.x || !panels.column) {
        pliant_panels_free(&panels);
        return pliant_fail_memory("the factor in single precision");
    }
    *out = panels;
    return PLIANT_OK;
}

void pliant_panels_free(pliant_panels *panels)
{
    pliant_free(panels->value);
    pliant_free(panels->x);
    pliant_free(panels->column);
    memset(panels, 0, sizeof *panels);
}

void pliant_panels_fill(pliant_panels *panels, const pliant_supernodes *from)
{
    for (size_t i = 0; i < panels->num_values; i++) panels->value[i] = (float)from->value[i];
    for (int32_t s = 0; s < from->count; s++) {
        int columns = from->first[s + 1] - from->first[s], rows = from->row_start[s + 1] - from->row_start[s];
        for (int c = 0; c < columns; c++) {
            size_t at = (size_t)from->value_start[s] + (size_t)c * (size_t)(rows + 1);
            panels->value[at] = (float)(1 / from->value[at]);
        }
    }
}

/* Compute y -= a l. */
static inline __attribute__((always_inline)) void subtract(int count, double a, const float *l, double *y)
{
    for (int i = 0; i < count; i++) y[i] -= a * (double)l[i];
}

static inline __attribute__((always_inline)) double product(int count, const float *l, const double *y)
{
    double sum[LANES] = {0}, rest = 0;
    int i = 0;
    for (; i + LANES <= count; i += LANES)
        for (int k = 0; k < LANES; k++) sum[k] += (double)l[i + k] * y[i + k];
    for (; i < count; i++) rest += (double)l[i] * y[i];
    for (int k = 0; k < LANES; k++) rest += sum[k];
    return rest;
}

/* Apply L^-1 of one supernode. y: its own unknowns, then the rows below: L y_own = y_own, y_below -= L_below y_own.
 * Four columns are processed at a time below. */
PLIANT_VECTORIZED static void forward(int columns, int rows, const float *panel, double *y)
{
    for (int c = 0; c < columns; c++) {
        const float *l = panel + (size_t)c * (size_t)rows;
        y[c] *= (double)l[c];
        subtract(columns - c - 1, y[c], l + c + 1, y + c + 1);
    }
    int c = 0;
    for (; c + 4 <= columns; c += 4) {
        const float *l0 = panel + (size_t)c * (size_t)rows, *l1 = l0 + rows, *l2 = l1 + rows, *l3 = l2 + rows;
        double a0 = y[c], a1 = y[c + 1], a2 = y[c + 2], a3 = y[c + 3];
        for (int i = columns; i < rows; i++)
            y[i] -= a0 * (double)l0[i] + a1 * (double)l1[i] + a2 * (double)l2[i] + a3 * (double)l3[i];
    }
    for (; c < columns; c++) subtract(rows - columns, y[c], panel + (size_t)c * (size_t)rows + columns, y + columns);
}

/* Solve L' y_own = y_own - L_below' y_below. */
PLIANT_VECTORIZED static void backward(int columns, int rows, const float *panel, double *y)
{
    for (int c = columns - 1; c >= 0; c--) {
        const float *l = panel + (size_t)c * (size_t)rows;
        y[c] = (y[c] - product(rows - c - 1, l + c + 1, y + c + 1)) * (double)l[c];
    }
}

void pliant_panels_forward(pliant_panels *panels, const pliant_supernodes *of, int32_t s, double *x)
{
    double *y = panels->column;
    const int columns = of->first[s + 1] - of->first[s], rows = of->row_start[s + 1] - of->row_start[s],
              *row = of->row + of->row_start[s];
    for (int i = 0; i < rows; i++) y[i] = x[row[i]];
    forward(columns, rows, panels->value + of->value_start[s], y);
    for (int i = 0; i < rows; i++) x[row[i]] = y[i];
}

static void backward_through(pliant_panels *panels, const pliant_supernodes *of, int32_t s, double *x)
{
    double *y = panels->column;
    const int columns = of->first[s + 1] - of->first[s], rows = of->row_start[s + 1] - of->row_start[s],
              *row = of->row + of->row_start[s];
    for (int i = 0; i < rows; i++) y[i] = x[row[i]];
    backward(columns, rows, panels->value + of->value_start[s], y);
    for (int i = 0; i < columns; i++) x[row[i]] = y[i];
}

void pliant_panels_begin_half(pliant_panels *panels, const pliant_supernodes *of, int32_t size, const double *right)
{
    for (int32_t i = 0; i < size; i++) panels->x[i] = right[of->permutation[i]];
    for (int32_t s = 0; s < of->count; s++) pliant_panels_forward(panels, of, s, panels->x);
}

void pliant_panels_end_half(pliant_panels *panels, const pliant_supernodes *of, int32_t size, double *out)
{
    for (int32_t s = of->count - 1; s >= 0; s--) backward_through(panels, of, s, panels->x);
    for (int32_t i = 0; i < size; i++) out[of->permutation[i]] = panels->x[i];
}

void pliant_panels_solve(pliant_panels *panels, const pliant_supernodes *of, int32_t size, const double *right,
                         double *out)
{
    pliant_panels_begin_half(panels, of, size, right);
    pliant_panels_end_half(panels, of, size, out);
}

/* ---- Solves at some unknowns. */

void pliant_reach_free(pliant_reach *reach)
{
    pliant_free(reach->above);
    pliant_free(reach->length);
    pliant_free(reach->of);
    pliant_free(reach->place);
    pliant_free(reach->marked);
    pliant_free(reach->supernode);
    pliant_free(reach->node);
    pliant_free(reach->x);
    memset(reach, 0, sizeof *reach);
}

pliant_status pliant_reach_create(const pliant_supernodes *of, int32_t size, pliant_reach *out)
{
    const size_t count = (size_t)of->count, unknowns = (size_t)size;
    pliant_reach reach = {0};
    reach.above = pliant_calloc(count, sizeof *reach.above);
    reach.length = pliant_calloc(count, sizeof *reach.length);
    reach.of = pliant_calloc(unknowns, sizeof *reach.of);
    reach.place = pliant_calloc(unknowns, sizeof *reach.place);
    reach.marked = pliant_calloc(count, 1);
    reach.supernode = pliant_calloc(count, sizeof *reach.supernode);
    reach.node = pliant_calloc(unknowns, sizeof *reach.node);
    reach.x = pliant_calloc(unknowns, sizeof *reach.x);
    if (!reach.above || !reach.length || !reach.of || !reach.place || !reach.marked || !reach.supernode ||
        !reach.node || !reach.x) {
        pliant_reach_free(&reach);
        return pliant_fail_memory("solves at a few unknowns");
    }
    for (int32_t s = 0; s < of->count; s++)
        for (int c = of->first[s]; c < of->first[s + 1]; c++) {
            reach.of[of->permutation[c]] = s;
            reach.place[of->permutation[c]] = c;
        }
    for (int32_t s = of->count - 1; s >= 0; s--) {
        const int columns = of->first[s + 1] - of->first[s], rows = of->row_start[s + 1] - of->row_start[s];
        reach.above[s] = rows > columns ? reach.of[of->permutation[of->row[of->row_start[s] + columns]]] : -1;
        reach.length[s] = columns + (reach.above[s] >= 0 ? reach.length[reach.above[s]] : 0);
    }
    *out = reach;
    return PLIANT_OK;
}

void pliant_reach_mark(pliant_reach *reach, const pliant_supernodes *of, int32_t count, const int32_t *nodes)
{
    memset(reach->marked, 0, (size_t)of->count);
    memcpy(reach->node, nodes, (size_t)count * sizeof *nodes);
    reach->num_nodes = count;
    for (int32_t n = 0; n < 3 * count; n++)
        for (int32_t s = reach->of[3 * nodes[n / 3] + n % 3]; s >= 0 && !reach->marked[s]; s = reach->above[s])
            reach->marked[s] = 1;
    reach->count = 0;
    for (int32_t s = 0; s < of->count; s++)
        if (reach->marked[s]) reach->supernode[reach->count++] = s;
}

/* Set x of the reach's columns to zero, or copy it. */
static void set_reach(const pliant_reach *reach, const pliant_supernodes *of, const double *from)
{
    for (int32_t i = 0; i < reach->count; i++) {
        const int first = of->first[reach->supernode[i]];
        const size_t bytes = (size_t)(of->first[reach->supernode[i] + 1] - first) * sizeof *from;
        if (from) memcpy(reach->x + first, from + first, bytes);
        else memset(reach->x + first, 0, bytes);
    }
}

static void finish_at_nodes(pliant_panels *panels, const pliant_supernodes *of, pliant_reach *reach, double *out)
{
    for (int32_t i = reach->count - 1; i >= 0; i--) backward_through(panels, of, reach->supernode[i], reach->x);
    for (int32_t n = 0; n < 3 * reach->num_nodes; n++) {
        const int32_t unknown = 3 * reach->node[n / 3] + n % 3;
        out[unknown] = reach->x[reach->place[unknown]];
    }
}

void pliant_panels_begin(pliant_panels *panels, const pliant_supernodes *of, pliant_reach *reach, int32_t size,
                         const double *right, double *out)
{
    pliant_panels_begin_half(panels, of, size, right);
    set_reach(reach, of, panels->x);
    finish_at_nodes(panels, of, reach, out);
}

void pliant_panels_end(pliant_panels *panels, const pliant_supernodes *of, pliant_reach *reach, int32_t size,
                       const double *more, double *out)
{
    double *x = panels->x;
    if (more) {
        set_reach(reach, of, NULL);
        for (int32_t n = 0; n < 3 * reach->num_nodes; n++) {
            const int32_t unknown = 3 * reach->node[n / 3] + n % 3;
            reach->x[reach->place[unknown]] = more[unknown];
        }
        for (int32_t i = 0; i < reach->count; i++) {
            const int32_t s = reach->supernode[i];
            pliant_panels_forward(panels, of, s, reach->x);
            for (int c = of->first[s]; c < of->first[s + 1]; c++) x[c] += reach->x[c];
        }
    }
    pliant_panels_end_half(panels, of, size, out);
}
