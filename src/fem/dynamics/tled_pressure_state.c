/* State of the pressures of nearly incompressible tissue (tled_pressure.h): creation, cuts, parts of a frame. */
#include "base/buffer.h"
#include "base/fail.h"
#include "base/memory.h"
#include "fem/dynamics/tled_pressure.h"
#include "fem/system.h"

#include <math.h>
#include <string.h>

/* ---- Creation. */

/* Compute S at the present positions. index: (count) scratch. */
static void find_matrix(const pliant_tled *tled, double factor, int32_t *index, double *values)
{
    const pliant_tled_pressure *pressure = tled->pressure_of_groups;
    const pliant_tled_groups *groups = pressure->groups;
    for (int32_t g = 0; g < groups->count; g++) {
        for (int i = groups->column_start[g]; i < groups->column_start[g + 1]; i++) index[groups->row[i]] = i;
        values[index[g]] = groups->compliance[g];
        for (int32_t c = groups->corner_start[g]; c < groups->corner_start[g + 1]; c++) {
            const int32_t n = groups->node[c];
            const float *own = pressure->rows + PLIANT_ROW * (size_t)c;
            const double answer = factor * tled->inverse_mass[n];
            for (int32_t i = groups->node_start[n]; answer > 0 && i < groups->node_start[n + 1]; i++) {
                const int32_t corner = groups->node_corner[i], other = groups->group[corner];
                const float *row = pressure->rows + PLIANT_ROW * (size_t)corner;
                for (int d = 0; d < 3 && other >= g; d++)
                    values[index[other]] += answer * (double)own[d] * (double)row[d];
            }
        }
    }
}

/* Factor S at the present positions. Errors: MEMORY, NUMERIC, SCENE. */
static pliant_status make_factor(pliant_tled *tled)
{
    pliant_tled_pressure *pressure = tled->pressure_of_groups;
    const pliant_tled_groups *groups = pressure->groups;
    int32_t *index = pliant_malloc((size_t)groups->count, sizeof *index);
    double *values = pliant_calloc((size_t)groups->column_start[groups->count], sizeof *values);
    pliant_status status = index && values ? PLIANT_OK : pliant_fail_memory("the pressures");
    if (status == PLIANT_OK)
        status = pliant_factor_analyze_scalar(groups->count, groups->column_start, groups->row, &pressure->factor);
    if (status == PLIANT_OK) {
        pliant_tled_pressure_find(tled);
        find_matrix(tled, pliant_tled_scheme_of(tled->time_step, tled->system->damping).factor, index, values);
        status = pliant_factor_numeric(pressure->factor, values);
    }
    PLIANT_FREE(index, values);
    return status;
}

pliant_status pliant_tled_pressure_create(pliant_tled *tled)
{
    const pliant_tled_groups *groups = tled->system->groups;
    if (!groups || groups->count == 0) return PLIANT_OK;
    const size_t count = (size_t)groups->count;
    pliant_tled_pressure *pressure = tled->pressure_of_groups = pliant_calloc(1, sizeof *pressure);
    if (!pressure) return pliant_fail_memory("the pressures");
    pressure->groups = groups;
    pressure->state = pliant_calloc(2 * count, sizeof *pressure->state);
    pressure->start_state = pliant_calloc(2 * count, sizeof *pressure->start_state);
    pressure->change = pliant_calloc(count, sizeof *pressure->change);
    pressure->rows = pliant_calloc((size_t)groups->num_corners, PLIANT_ROW * sizeof *pressure->rows);
    pressure->residual = pliant_calloc(count, sizeof *pressure->residual);
    pressure->solution = pliant_calloc(count, sizeof *pressure->solution);
    pressure->direction = pliant_calloc(count, sizeof *pressure->direction);
    pressure->product = pliant_calloc(count, sizeof *pressure->product);
    pressure->motion = pliant_calloc((size_t)tled->system->mesh->num_nodes, PLIANT_ROW * sizeof *pressure->motion);
    if (!pressure->state || !pressure->start_state || !pressure->change || !pressure->rows || !pressure->residual ||
        !pressure->solution || !pressure->direction || !pressure->product || !pressure->motion)
        return pliant_fail_memory("the pressures");
    return make_factor(tled);
}

void pliant_tled_pressure_free(pliant_tled_pressure *pressure)
{
    if (!pressure) return;
    if (pressure->factor) pliant_factor_free(pressure->factor);
    PLIANT_FREE(pressure->state, pressure->start_state, pressure->change, pressure->rows, pressure->residual,
                pressure->solution, pressure->direction, pressure->product, pressure->motion, pressure);
}

/* ---- State. */

static size_t state_bytes(const pliant_tled_pressure *pressure)
{
    return 2 * (size_t)pressure->groups->count * sizeof *pressure->state;
}

void pliant_tled_pressure_reset(pliant_tled *tled)
{
    if (tled->pressure_of_groups) memset(tled->pressure_of_groups->state, 0, state_bytes(tled->pressure_of_groups));
}

void pliant_tled_pressure_save_or_restore(pliant_tled *tled, bool back)
{
    pliant_tled_pressure *pressure = tled->pressure_of_groups;
    if (!pressure) return;
    memcpy(back ? pressure->state : pressure->start_state, back ? pressure->start_state : pressure->state,
           state_bytes(pressure));
    if (!back) pressure->status = PLIANT_OK;
}

void pliant_tled_pressure_mix(pliant_tled *tled, const double *fraction)
{
    pliant_tled_pressure *pressure = tled->pressure_of_groups;
    for (int32_t g = 0; pressure && g < pressure->groups->count; g++) {
        double minimum = 1;
        for (int32_t c = pressure->groups->corner_start[g]; c < pressure->groups->corner_start[g + 1]; c++)
            minimum = fmin(minimum, fraction[pressure->groups->node[c]]);
        if (minimum < 1)
            pressure->state[g] = pressure->start_state[g] + minimum * (pressure->state[g] - pressure->start_state[g]);
    }
}

double pliant_tled_pressure_energy(const pliant_tled *tled)
{
    const pliant_tled_pressure *pressure = tled->pressure_of_groups;
    double sum = 0;
    for (int32_t g = 0; pressure && g < pressure->groups->count; g++)
        sum += 0.5 * pressure->groups->compliance[g] * pressure->state[g] * pressure->state[g];
    return sum;
}

/* ---- Cuts. */

/* The groups of a cell: their number, their volume, and the sum of volume times pressure; `only`: the last of them. */
typedef struct cell_sum {
    int32_t groups, only;
    double volume, pressure;
} cell_sum;

static int32_t count_cells(const pliant_tled_groups *groups)
{
    int32_t cells = 0;
    for (int32_t g = 0; g < groups->count; g++) cells = groups->cell[g] >= cells ? groups->cell[g] + 1 : cells;
    return cells;
}

static void sum_cells(const pliant_tled_groups *groups, const double *p, cell_sum *out)
{
    for (int32_t g = 0; g < groups->count; g++) {
        if (groups->cell[g] < 0) continue;
        cell_sum *cell = out + groups->cell[g];
        cell->groups++;
        cell->only = g;
        cell->volume += groups->volume[g];
        cell->pressure += p ? groups->volume[g] * p[g] : 0;
    }
}

pliant_status pliant_tled_pressure_carry(pliant_tled *tled, const pliant_tled *from)
{
    pliant_tled_pressure *pressure = tled->pressure_of_groups;
    const pliant_tled_pressure *before = from->pressure_of_groups;
    if (!pressure || !before) return PLIANT_OK;
    const pliant_tled_groups *now = pressure->groups, *was = before->groups;
    const int32_t most = count_cells(now) > count_cells(was) ? count_cells(now) : count_cells(was);
    cell_sum *cells = pliant_calloc((size_t)most + 1, sizeof *cells),
             *cells_now = pliant_calloc((size_t)most + 1, sizeof *cells_now);
    if (!cells || !cells_now) {
        PLIANT_FREE(cells, cells_now);
        return pliant_fail_memory("the pressures");
    }
    sum_cells(was, before->state, cells);
    sum_cells(now, NULL, cells_now);
    pliant_tled_pressure_find(tled);
    for (int32_t g = 0; g < now->count; g++) {
        if (now->cell[g] < 0) continue;
        const cell_sum *cell = cells + now->cell[g];
        const int32_t old = cell->only;
        if (cell->groups == 1 && cells_now[now->cell[g]].groups == 1 && was->volume[old] == now->volume[g] &&
            was->compliance[old] == now->compliance[g]) {
            pressure->state[g] = before->state[old];
            pressure->state[now->count + g] = before->state[was->count + old];
            continue;
        }
        pressure->state[g] = cell->volume > 0 ? cell->pressure / cell->volume : 0;
        pressure->state[now->count + g] = pressure->change[g] - now->compliance[g] * pressure->state[g];
    }
    PLIANT_FREE(cells, cells_now);
    return PLIANT_OK;
}
