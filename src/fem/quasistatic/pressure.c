/* Pressures of nearly incompressible tissue in a step (element/pressures.h, NUMERICS.md). The force of a pressure acts
 * like the force of a spring. Its change dp follows the displacement step dx:
 *     dp = gain (t(x) + t'(x) dx - compliance p)
 * Anderson's method mixes both, so both converge together. */
#include "fem/quasistatic/pressure.h"

#include "base/fail.h"
#include "base/memory.h"
#include "fem/element/pressure_rules.h"

#include <string.h>

static size_t count_of(const pliant_solver *solver)
{
    return solver->pressures ? (size_t)solver->pressures->count : 0;
}

pliant_status pliant_pressure_allocate(const pliant_pressures *pressures, double **first, double **second)
{
    if (!pressures) return PLIANT_OK;
    const size_t count = (size_t)pressures->count;
    if (!*first) *first = pliant_calloc(count, sizeof **first);
    if (second && !*second) *second = pliant_calloc(count, sizeof **second);
    return *first && (!second || *second) ? PLIANT_OK : pliant_fail_memory("the pressures");
}

pliant_status pliant_pressure_wake(pliant_solver *solver)
{
    const pliant_system *system = solver->system;
    if (!solver->pressures) return PLIANT_OK;
    const int32_t elements = pliant_element_count(system);
    solver->volume_change = pliant_calloc((size_t)elements, sizeof *solver->volume_change);
    solver->volume_rows = pliant_calloc((size_t)pliant_element_begin(system, elements), 3 * sizeof(double));
    return solver->volume_change && solver->volume_rows ? PLIANT_OK : pliant_fail_memory("the pressures");
}

void pliant_pressure_copy(const pliant_solver *solver, const double *from, double *to)
{
    if (solver->pressures) memcpy(to, from, count_of(solver) * sizeof *to);
}

void pliant_pressure_forces(pliant_solver *solver, const pliant_iterate *at, double *elastic)
{
    if (!solver->pressures) return;
    pliant_pressure_find(solver, at);
    pliant_pressures_add(solver->pressures, solver->system, solver->volume_rows, at->pressure, elastic);
}

void pliant_pressure_find(pliant_solver *solver, const pliant_iterate *at)
{
    if (solver->pressures)
        pliant_pressures_find(solver->pressures, solver->system, at->x, solver->volume_change, solver->volume_rows);
}

void pliant_pressure_step(pliant_solver *solver, pliant_iterate *at)
{
    const pliant_system *system = solver->system;
    const pliant_pressures *pressures = solver->pressures;
    if (!pressures) return;
    const int32_t *node = pliant_element_nodes(system);
    memset(at->pressure_step, 0, count_of(solver) * sizeof *at->pressure_step);
    for (int32_t e = 0; e < pliant_element_count(system); e++) {
        const int32_t p = pressures->of_element[e];
        double change = pressures->element_volume[e] * solver->volume_change[e];
        for (int32_t c = pliant_element_begin(system, e); p >= 0 && c < pliant_element_begin(system, e + 1); c++) {
            const int32_t f = system->free_of_node[node[c]];
            if (f < 0) continue;
            double step[3] = {at->step[3 * f], at->step[3 * f + 1], at->step[3 * f + 2]};
            pliant_from_node_axes(solver->rotations, f, step);
            for (int d = 0; d < 3; d++) change += solver->volume_rows[3 * (size_t)c + (size_t)d] * step[d];
        }
        if (p >= 0) at->pressure_step[p] += change / pressures->volume[p];
    }
    for (int32_t p = 0; p < pressures->count; p++)
        at->pressure_step[p] = pliant_pressure_increment(pressures->gain[p], at->pressure_step[p],
                                                         pressures->compliance[p], at->pressure[p]);
}

void pliant_pressure_times_volume(const pliant_solver *solver, double *out)
{
    const pliant_pressures *pressures = solver->pressures;
    for (int32_t e = 0; pressures && e < pliant_element_count(solver->system); e++) {
        const int32_t p = pressures->of_element[e];
        out[e] = p >= 0 ? pressures->element_volume[e] * solver->now.pressure[p] : 0;
    }
}

double pliant_pressure_energy(const pliant_solver *solver, const double *a, const double *b)
{
    const pliant_pressures *pressures = solver->pressures;
    double sum = 0;
    for (int32_t p = 0; pressures && p < pressures->count; p++)
        sum += pliant_pressure_weight(pressures->volume[p], pressures->gain[p]) * a[p] * b[p];
    return sum;
}

void pliant_pressure_remember(const pliant_solver *solver, const pliant_iterate *from, const pliant_iterate *to,
                              pliant_secant *secant)
{
    for (size_t p = 0; p < count_of(solver); p++) {
        secant->pressure[p] = to->pressure[p] - from->pressure[p];
        secant->pressure_step[p] = to->pressure_step[p] - from->pressure_step[p];
    }
}

void pliant_pressure_propose(pliant_solver *solver, const double weights[PLIANT_MAX_HISTORY])
{
    const size_t count = count_of(solver);
    double *out = solver->trial.pressure;
    for (size_t p = 0; p < count; p++) out[p] = solver->now.pressure_step[p];
    for (int32_t h = 0; h < PLIANT_MAX_HISTORY; h++)
        for (size_t p = 0; p < count && weights[h] != 0; p++)
            out[p] -= weights[h] * (solver->history[h].pressure[p] + solver->history[h].pressure_step[p]);
    for (size_t p = 0; p < count; p++) out[p] = solver->now.pressure[p] + solver->rules.damping * out[p];
}

pliant_status pliant_pressure_carry(pliant_solver *solver, const pliant_solver *from)
{
    const pliant_pressures *now = solver->pressures, *was = from->pressures;
    if (!now || !was) return PLIANT_OK;
    int32_t cells = 0;
    for (int32_t p = 0; p < was->count; p++) cells = was->cell[p] >= cells ? was->cell[p] + 1 : cells;
    double *sum = pliant_calloc((size_t)cells + 1, sizeof *sum),
           *volume = pliant_calloc((size_t)cells + 1, sizeof *volume);
    pliant_status status = sum && volume ? PLIANT_OK : pliant_fail_memory("the pressures");
    for (int32_t p = 0; status == PLIANT_OK && p < was->count; p++) {
        if (was->cell[p] < 0) continue;
        sum[was->cell[p]] += was->volume[p] * from->now.pressure[p];
        volume[was->cell[p]] += was->volume[p];
    }
    for (int32_t p = 0; status == PLIANT_OK && p < now->count; p++) {
        const int32_t cell = now->cell[p];
        if (cell >= 0 && cell < cells && volume[cell] > 0) solver->now.pressure[p] = sum[cell] / volume[cell];
    }
    pliant_free(sum);
    pliant_free(volume);
    return status;
}
