/* Creation and destruction of a solver, and its load. */
#include "base/fail.h"
#include "base/buffer.h"
#include "fem/quasistatic/pressure.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

static pliant_status iterate_create(const pliant_solver *solver, pliant_iterate *iterate)
{
    const pliant_system *system = solver->system;
    size_t n = 3 * (size_t)system->num_free;
    if (!iterate->x) iterate->x = pliant_calloc((size_t)system->mesh->num_nodes, 3 * sizeof *iterate->x);
    iterate->step = pliant_calloc(n, sizeof *iterate->step);
    iterate->residual = pliant_calloc(n, sizeof *iterate->residual);
    iterate->elastic = pliant_calloc(n, sizeof *iterate->elastic);
    iterate->free_step = pliant_calloc(n, sizeof *iterate->free_step);
    if (!iterate->x || !iterate->step || !iterate->residual || !iterate->elastic || !iterate->free_step)
        return pliant_fail_memory("the solver");
    return pliant_pressure_allocate(solver->pressures, &iterate->pressure, &iterate->pressure_step);
}

static pliant_status final_state_create(pliant_solver *solver)
{
    const size_t n = pliant_solver_unknowns(solver);
    pliant_iterate *at = &solver->final_state.at;
    at->step = pliant_calloc(n, sizeof *at->step);
    at->residual = pliant_calloc(n, sizeof *at->residual);
    if (!at->step || !at->residual) return pliant_fail_memory("the solver");
    return pliant_pressure_allocate(solver->pressures, &at->pressure_step, NULL);
}

/* Free all arrays of an iterate except x and its pressures. */
static void iterate_free(pliant_iterate *iterate)
{
    PLIANT_FREE(iterate->step, iterate->residual, iterate->elastic, iterate->free_step, iterate->pressure_step);
    iterate->step = iterate->residual = iterate->elastic = iterate->free_step = iterate->pressure_step = NULL;
}

/* Free the arrays that pliant_solver_allocate_step allocates. */
static void free_buffers(pliant_solver *solver)
{
    iterate_free(&solver->now);
    iterate_free(&solver->trial);
    PLIANT_FREE(solver->trial.x, solver->trial.pressure, solver->previous_pressure, solver->volume_change,
                solver->volume_rows, solver->final_state.at.step, solver->final_state.at.residual,
                solver->final_state.at.pressure_step);
    pliant_nodal_rotations_free(solver->rotations);
    pliant_secants_free(solver->history);
    pliant_free(solver->previous_x);
    pliant_free(solver->element_forces);
    solver->trial.x = solver->previous_x = NULL;
    solver->trial.pressure = solver->previous_pressure = solver->volume_change = solver->volume_rows = NULL;
    solver->rotations = NULL;
    solver->element_forces = NULL;
    memset(&solver->final_state, 0, sizeof solver->final_state);
    solver->previous.is_comparable = false;
    memset(solver->history, 0, sizeof solver->history);
    solver->has_step_arrays = false;
}

pliant_status pliant_solver_allocate_step(pliant_solver *solver)
{
    const pliant_system *system = solver->system;
    if (solver->has_step_arrays) return PLIANT_OK;
    solver->previous_x = pliant_calloc((size_t)system->mesh->num_nodes, 3 * sizeof *solver->previous_x);
    solver->element_forces = pliant_malloc((size_t)system->num_blocks, sizeof *solver->element_forces);
    pliant_status status = solver->previous_x && solver->element_forces ? PLIANT_OK : pliant_fail_memory("the solver");
    if (status == PLIANT_OK) status = iterate_create(solver, &solver->now);
    if (status == PLIANT_OK) status = iterate_create(solver, &solver->trial);
    if (status == PLIANT_OK) status = pliant_pressure_allocate(solver->pressures, &solver->previous_pressure, NULL);
    if (status == PLIANT_OK) status = pliant_pressure_wake(solver);
    if (status == PLIANT_OK) status = pliant_secants_create(system, solver->rules.capacity, solver->history);
    for (int32_t h = 0; status == PLIANT_OK && h < solver->rules.capacity; h++)
        status = pliant_pressure_allocate(solver->pressures, &solver->history[h].pressure,
                                          &solver->history[h].pressure_step);
    if (status == PLIANT_OK) status = final_state_create(solver);
    if (status == PLIANT_OK) status = pliant_nodal_rotations_create(system, &solver->rotations);
    if (status != PLIANT_OK) {
        free_buffers(solver);
        return status;
    }
    solver->has_step_arrays = true;
    return PLIANT_OK;
}

/* Return the number of steps for background work, from its operations at a fixed rate. The result is the same on every
 * machine, and steps seldom wait. A late factor is less accurate (test/bench/bench_budget). */
static int32_t steps_for(double operations, double step)
{
    return (int32_t)fmin(ceil(operations / pliant_get_quasistatic_settings().background_rate / step), 99998);
}

static void set_delays(const pliant_scene *scene, pliant_solver *solver)
{
    const pliant_preconditioner *preconditioner = solver->system->preconditioner;
    solver->refresh_delay = scene->solver.refresh_delay;
    solver->convert_delay = 1;
    if (solver->refresh_delay > 0 || !preconditioner) return; /* after a cut: as before it */
    solver->refresh_delay = 1 + steps_for(pliant_preconditioner_operations(preconditioner), scene->solver.step);
    solver->convert_delay +=
        steps_for(solver->rules.capacity * pliant_preconditioner_apply_operations(preconditioner), scene->solver.step) -
        1;
}

static bool allocate_weights(size_t unknowns, pliant_weight_blocks *out)
{
    out->block = pliant_calloc(unknowns, 9 * sizeof *out->block);
    out->is_listed = pliant_calloc(unknowns, sizeof *out->is_listed);
    out->unknown = pliant_malloc(unknowns, sizeof *out->unknown);
    return out->block && out->is_listed && out->unknown;
}

pliant_status pliant_solver_create_empty(const pliant_scene *scene, const pliant_system *system,
                                         bool without_step_arrays, pliant_solver **out)
{
    pliant_solver *solver = pliant_calloc(1, sizeof *solver);
    if (!solver) return pliant_fail_memory("the solver");
    solver->system = system;
    pliant_anderson *rules = &solver->rules;
    rules->max_evaluations = scene->solver.iterations;
    rules->depth = scene->solver.history;
    rules->capacity = pliant_anderson_depth(rules->depth, rules->max_evaluations);
    /* Around a patch the merit can become meaningless; the plain step follows directly there. */
    rules->limits_secants = !system->basis;
    rules->tolerance = scene->solver.tolerance;
    solver->takes_factor = PLIANT_RESULT_FACTOR;
    solver->takes_history = PLIANT_RESULT_HISTORY;
    solver->refresh_interval = scene->solver.refresh_interval;
    set_delays(scene, solver);
    double length = 0;
    for (int d = 0; d < 3; d++) length = fmax(length, system->mesh->cells[d] * system->mesh->cell_size[d]);
    /* Lower bound of the displacement for the tolerance: a thousandth of the body's length. */
    rules->smallest_displacement = pliant_get_quasistatic_settings().smallest_displacement * length;
    solver->smallest_scale = rules->smallest_displacement * sqrt(system->mean_diagonal);
    bool good = pliant_solves_fine(system) || allocate_weights((size_t)system->num_free, &solver->weights);
    solver->now.x = pliant_malloc((size_t)system->mesh->num_nodes, 3 * sizeof *solver->now.x);
    pliant_status status = good && solver->now.x ? PLIANT_OK : pliant_fail_memory("the solver");
    /* Coarse elements contain their complete stiffness. */
    if (status == PLIANT_OK && system->of && system->of->system == system && system->mesh == system->fine)
        status = pliant_pressures_create(system, system->of->body->fine_material, &solver->pressures);
    if (status == PLIANT_OK) status = pliant_pressure_allocate(solver->pressures, &solver->now.pressure, NULL);
    if (status == PLIANT_OK && !without_step_arrays) status = pliant_solver_allocate_step(solver);
    if (status != PLIANT_OK) {
        pliant_solver_free(solver);
        return status;
    }
    solver->factors = solver->in_use.number = 1;
    pliant_anderson_reset(rules);
    *out = solver;
    return PLIANT_OK;
}

pliant_status pliant_solver_create(const pliant_scene *scene, const pliant_system *system, pliant_solver **out)
{
    pliant_solver *solver = NULL;
    pliant_status status = pliant_solver_create_empty(scene, system, false, &solver);
    if (status != PLIANT_OK) return status;
    solver->load = pliant_calloc((size_t)system->num_free, 3 * sizeof *solver->load);
    status = solver->load ? pliant_solver_reset(solver) : pliant_fail_memory("the solver");
    if (status != PLIANT_OK) {
        pliant_solver_free(solver);
        return status;
    }
    *out = solver;
    return PLIANT_OK;
}

pliant_status pliant_solver_reset(pliant_solver *solver)
{
    if (!solver->preconditioner || solver->factors > 1 || pliant_preconditioner_base(solver->preconditioner)) {
        pliant_preconditioner *preconditioner;
        pliant_status status =
            pliant_preconditioner_clone(solver->system->preconditioner, solver->system->num_threads, &preconditioner);
        if (status != PLIANT_OK) return status;
        pliant_preconditioner_free(solver->preconditioner);
        solver->preconditioner = preconditioner;
    }
    pliant_refresh_free(solver);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) pliant_solver_remove_grasp(solver, t);
    pliant_contact_problem_free(solver->contacts);
    solver->contacts = NULL;
    solver->factors = 1;
    solver->in_use.number++;
    pliant_nodal_rotations_refer(solver->system, solver->system->mesh->rest, solver->rotations);
    solver->in_use.evaluations = 0;
    solver->is_after_cut = false;
    pliant_anderson_reset(&solver->rules);
    pliant_evaluations_clear(&solver->evaluation_history);
    pliant_solver_drop_history(solver);
    memcpy(solver->now.x, solver->system->mesh->rest,
           3 * (size_t)solver->system->mesh->num_nodes * sizeof *solver->now.x);
    memset(solver->now.force, 0, sizeof solver->now.force);
    const pliant_pressures *pressures = solver->pressures;
    if (pressures) memset(solver->now.pressure, 0, (size_t)pressures->count * sizeof *solver->now.pressure);
    return PLIANT_OK;
}

/* Compute F_j = M_j' g ([H] 9 and 10) of unknowns [from, to). */
static void find_load(pliant_solver *solver, int32_t from, int32_t to)
{
    const double *gravity = solver->gravity;
    for (int32_t f = from; f < to; f++)
        for (int d = 0; d < 3; d++) {
            const double *mass = solver->system->gravity_mass + 9 * (size_t)f;
            solver->load[3 * f + d] = mass[d] * gravity[0] + mass[3 + d] * gravity[1] + mass[6 + d] * gravity[2];
        }
    pliant_mark_written(solver->load, 3 * (size_t)from, 3 * (size_t)(to - from), sizeof *solver->load);
}

void pliant_solver_set_gravity(pliant_solver *solver, const double gravity[3])
{
    if (solver->loaded && memcmp(solver->gravity, gravity, sizeof solver->gravity) == 0) return;
    memcpy(solver->gravity, gravity, sizeof solver->gravity);
    solver->loaded = true;
    find_load(solver, 0, solver->system->num_free);
}

pliant_status pliant_solver_carry_load(pliant_solver *solver, const pliant_solver *from)
{
    const pliant_system *system = solver->system, *before = from->system;
    const int32_t both = system->num_free < before->num_free ? system->num_free : before->num_free;
    const size_t row = 9 * sizeof *system->gravity_mass;
    solver->load = from->loaded ? pliant_next_version(from->load, 3 * (size_t)both, 3 * (size_t)system->num_free,
                                                      sizeof *solver->load)
                                : pliant_calloc((size_t)system->num_free, 3 * sizeof *solver->load);
    if (!solver->load) return pliant_fail_memory("the solver");
    solver->loaded = from->loaded;
    memcpy(solver->gravity, from->gravity, sizeof solver->gravity);
    if (!from->loaded) return PLIANT_OK;
    for (size_t first = 0, end = 0;
         pliant_next_difference(system->gravity_mass, before->gravity_mass, row * (size_t)both, &first, &end);)
        find_load(solver, (int32_t)(first / row), (int32_t)((end + row - 1) / row));
    find_load(solver, both, system->num_free);
    return PLIANT_OK;
}

void pliant_solver_free(pliant_solver *solver)
{
    if (!solver) return;
    pliant_refresh_free(solver);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) pliant_solver_remove_grasp(solver, t);
    free_buffers(solver);
    pliant_contact_problem_free(solver->contacts);
    pliant_free(solver->now.x);
    pliant_free(solver->now.pressure);
    pliant_pressures_free(solver->pressures);
    PLIANT_FREE(solver->load, solver->weights.block, solver->weights.is_listed, solver->weights.unknown);
    pliant_preconditioner_free(solver->preconditioner);
    pliant_free(solver);
}
