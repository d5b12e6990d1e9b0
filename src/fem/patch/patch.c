#include "base/fail.h"
#include "fem/patch/patch_job.h"
#include "base/memory.h"
#include "model_data/discretization.h"

#include <math.h>
#include <string.h>

enum { LARGEST_DIRECT = 40000 }; /* free nodes; a factor of about 300 MB */

/* Build the elements. before, kept: Nullable: unchanged elements from before a cut */
static pliant_status make_elements(const pliant_scene *scene, const pliant_body *body, const pliant_system *before,
                                   const uint8_t *kept, pliant_system *system)
{
    return scene->element.kind == PLIANT_HEXAHEDRA
               ? pliant_system_build_hexahedra(system, body->fine_material, NULL, before, kept)
               : pliant_system_build_tetrahedra(system, body->fine_material, before, kept);
}

pliant_status pliant_patch_system(const pliant_scene *scene, const pliant_body *body, int num_threads,
                                  pliant_system **out)
{
    pliant_system *system = pliant_calloc(1, sizeof *system);
    pliant_tangent *tangents = NULL;
    if (!system) return pliant_fail_memory("the fine mesh of patches");
    system->mesh = system->fine = &body->fine;
    system->num_threads = num_threads;
    pliant_status status = make_elements(scene, body, NULL, NULL, system);
    if (status == PLIANT_OK) status = pliant_system_unknowns(system, body->fine_fixed);
    /* The matrix is used for nine solves, so a factor is worthwhile for larger meshes than in a solver. */
    pliant_preconditioner_choice choice = scene->solver.preconditioner;
    if (choice == PLIANT_PRECONDITIONER_AUTO && system->num_free <= LARGEST_DIRECT) choice = PLIANT_DIRECT;
    if (status == PLIANT_OK) status = pliant_preconditioner_create(system, choice, NULL, &system->preconditioner);
    if (status == PLIANT_OK && !(tangents = pliant_calloc((size_t)system->num_blocks, sizeof *tangents)))
        status = pliant_fail_memory("the fine mesh of patches");
    if (status == PLIANT_OK) {
        pliant_system_tangents(system, body->fine.rest, PLIANT_TWIST_EXACT, tangents);
        status = pliant_preconditioner_numeric(system->preconditioner, tangents);
    }
    pliant_free(tangents);
    if (status != PLIANT_OK) {
        pliant_system_free(system);
        return status;
    }
    *out = system;
    return PLIANT_OK;
}

pliant_status pliant_patch_next_system(const pliant_scene *scene, const pliant_body *body, int num_threads,
                                       const pliant_unchanged_elements *kept, pliant_system **out)
{
    pliant_system *system = pliant_calloc(1, sizeof *system);
    if (!system) return pliant_fail_memory("the fine mesh of patches");
    system->mesh = system->fine = &body->fine;
    system->num_threads = num_threads;
    pliant_status status = make_elements(scene, body, kept->before->fine_system, kept->fine, system);
    if (status == PLIANT_OK) status = pliant_system_number_unknowns(system, body->fine_fixed);
    if (status != PLIANT_OK) {
        pliant_system_free(system);
        return status;
    }
    *out = system;
    return PLIANT_OK;
}

pliant_status pliant_patch_create(const pliant_scene *scene, const pliant_discretization *discretization,
                                  pliant_patch **out)
{
    pliant_patch *patch = pliant_calloc(1, sizeof *patch);
    if (!patch) return pliant_fail_memory("the patches");
    patch->scene = scene;
    patch->discretization = pliant_discretization_retain(discretization);
    atomic_init(&patch->stop, false);
    *out = patch;
    return PLIANT_OK;
}

/* ---- Holds. */

/* Forget a hold and all responses that include it. */
static void forget_hold(pliant_patch *patch, int tool)
{
    patch_hold_free(patch->holds + tool);
    for (int u = 0; u < PLIANT_MAX_TOOLS; u++) {
        double **block = tool < u ? &patch->blocks[tool][u] : &patch->blocks[u][tool];
        pliant_free(*block);
        *block = NULL;
    }
}

static bool is_in_basis(const pliant_data *data, int tool)
{
    const pliant_patch *patch = data->patch;
    return patch && patch->basis && patch->is_in_basis[tool] && patch_still_held(data, tool, patch->holds[tool].hold);
}

int pliant_patch_count_tools(const pliant_data *data)
{
    int count = 0;
    for (int t = 0; t < data->num_tools; t++) count += is_in_basis(data, t);
    return count;
}

static pliant_status buffers_create(const pliant_discretization *discretization, const pliant_basis *basis,
                                    patch_buffers *out)
{
    out->element_forces = pliant_calloc((size_t)basis->system.num_blocks, sizeof *out->element_forces);
    out->positions = pliant_calloc((size_t)discretization->body->fine.num_nodes, 3 * sizeof *out->positions);
    out->coarse = pliant_calloc((size_t)discretization->system->mesh->num_nodes, 3 * sizeof *out->coarse);
    return out->element_forces && out->positions && out->coarse ? PLIANT_OK : pliant_fail_memory("a patch");
}

static void buffers_free(patch_buffers *buffers)
{
    PLIANT_FREE(buffers->element_forces, buffers->positions, buffers->coarse);
    memset(buffers, 0, sizeof *buffers);
}

/* Drop the basis. Tools that pulled at it have no hold until they are attached again. */
static void basis_drop(pliant_patch *patch, pliant_data *data)
{
    for (int t = 0; data && t < data->num_tools; t++)
        if (patch->is_in_basis[t]) data->tools[t].attached = false;
    pliant_solver_free(patch->solver);
    pliant_basis_free(patch->basis);
    buffers_free(&patch->buffers);
    patch->solver = NULL;
    patch->basis = NULL;
    memset(patch->is_in_basis, 0, sizeof patch->is_in_basis);
}

void pliant_patch_reset(pliant_patch *patch)
{
    patch_job_clear(patch);
    basis_drop(patch, NULL);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) forget_hold(patch, t);
    memset(patch->refused, 0, sizeof patch->refused);
    memset(patch->press, 0, sizeof patch->press);
}

void pliant_patch_free(pliant_patch *patch)
{
    if (!patch) return;
    pliant_patch_reset(patch);
    pliant_preconditioner_free(patch->preconditioner);
    pliant_patch_free(patch->before);
    pliant_discretization_release(patch->discretization);
    patch_contact_free(patch);
    pliant_free(patch);
}

static bool is_busy(const pliant_patch *patch)
{
    return (patch->job.running && !pliant_worker_has_finished(&patch->job.worker)) ||
           (patch->solver && pliant_refresh_is_busy(patch->solver));
}

void pliant_patch_replace(pliant_patch *patch, pliant_patch *before)
{
    atomic_store(&before->stop, true);
    patch->before = before;
}

/* Free the patches of earlier bodies whose threads have finished. */
static void free_before(pliant_patch *patch)
{
    for (pliant_patch **at = &patch->before; *at;) {
        pliant_patch *before = *at;
        if (is_busy(before)) {
            at = &before->before;
            continue;
        }
        *at = before->before;
        before->before = NULL;
        pliant_patch_free(before);
    }
}

/* ---- Delivery of results. */

static void near_positions(const pliant_basis *basis, const double *fine, double *out)
{
    for (int32_t v = 0; v < basis->mesh.num_nodes; v++)
        memcpy(out + 3 * v, fine + 3 * basis->fine_node[v], 3 * sizeof *out);
}

/* Start the patch at these positions: project their displacement from the coarse model's base onto the basis.
 * `buffers`:
 * (3 fine nodes). */
static void start_at(const pliant_data *data, pliant_basis *basis, double *buffers, double *x)
{
    pliant_upsample_positions(data->solver->system, data->solver->now.x, buffers);
    near_positions(basis, buffers, basis->mesh.rest);
    near_positions(basis, data->positions, x);
    pliant_basis_project(basis, x);
}

/* Start the new basis at the old one's state if it includes all remaining holds of the old one. Otherwise start at the
 * base. */
static void take_over(pliant_patch *patch, pliant_data *data)
{
    patch_job *job = &patch->job;
    bool goes_on = patch->basis != NULL;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        goes_on = goes_on && (!is_in_basis(data, t) || job->holds[t].hold == patch->holds[t].hold);
    if (goes_on) start_at(data, job->basis, job->x, job->solver->now.x); /* the job does not need its x any more */
    basis_drop(patch, data);
    patch->basis = job->basis;
    patch->solver = job->solver;
    job->basis = NULL;
    job->solver = NULL;
}

/* Continue the hold at the coarse model. After a memory error, try again 1000 steps later. */
static void refuse(pliant_patch *patch, const pliant_data *data, int tool)
{
    const uint64_t later = 1000;
    patch->refused[tool] = patch->job.holds[tool].hold;
    patch->refused_until[tool] = patch->job.status == PLIANT_ERROR_MEMORY ? data->statistics.step + later : UINT64_MAX;
}

/* Return whether the job has no remaining hold. */
static bool is_abandoned(const pliant_patch *patch, const pliant_data *data)
{
    bool held = false;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) held = held || patch_still_held(data, t, patch->job.holds[t].hold);
    return patch->job.running && !held;
}

static pliant_status deliver(pliant_patch *patch, pliant_data *data)
{
    patch_job *job = &patch->job;
    pliant_worker_join(&job->worker);
    if (job->status == PLIANT_OK) {
        patch_buffers buffers = {0};
        pliant_status status = buffers_create(patch->discretization, job->basis, &buffers);
        if (status != PLIANT_OK) {
            buffers_free(&buffers);
            return status; /* delivered in the next step */
        }
        take_over(patch, data);
        patch->buffers = buffers;
    } else {
        pliant_log(PLIANT_LOG_WARNING, "no patch could be made; the tools pull at the coarse model: %s", job->message);
    }
    for (int t = 0; t < data->num_tools; t++) {
        if (!job->holds[t].hold) continue;
        if (job->status != PLIANT_OK) {
            if (!patch->is_in_basis[t]) refuse(patch, data, t); /* the others keep their present patch */
            continue;
        }
        if (job->copied[t]) {
            forget_hold(patch, t);
            patch->holds[t] = job->holds[t];
            job->copied[t] = false;
            patch->press[t].before = 0;
        }
        patch->is_in_basis[t] = patch->basis && patch_still_held(data, t, patch->holds[t].hold);
        if (!patch->is_in_basis[t]) continue;
        pliant_solver_remove_grasp(data->solver, t); /* released from the coarse model */
        data->tools[t].attached = false;
    }
    for (int t = 0; job->status == PLIANT_OK && t < PLIANT_MAX_TOOLS; t++)
        for (int u = t; u < PLIANT_MAX_TOOLS; u++) {
            if (!job->wanted[t][u]) continue;
            patch->blocks[t][u] = job->blocks[t][u];
            job->wanted[t][u] = false;
        }
    job->running = false;
    patch_job_clear(patch);
    return PLIANT_OK;
}

static bool waits(const pliant_data *data, int tool)
{
    const pliant_patch *patch = data->patch;
    const uint64_t hold = patch_hold_of(data, tool);
    return hold && !(patch->is_in_basis[tool] && patch->holds[tool].hold == hold) &&
           !patch_is_refused(patch, data, tool);
}

/* Store the state for a rollback of pliant_patch_step. */
static void keep(pliant_patch *patch, const pliant_data *data)
{
    const pliant_discretization *discretization = patch->discretization;
    memcpy(patch->buffers.positions, data->positions,
           3 * (size_t)discretization->body->fine.num_nodes * sizeof *data->positions);
    memcpy(patch->buffers.coarse, data->solver->now.x,
           3 * (size_t)discretization->system->mesh->num_nodes * sizeof *data->solver->now.x);
    for (int t = 0; t < data->num_tools; t++)
        memcpy(patch->buffers.force + 3 * t, data->tools[t].force, sizeof data->tools[t].force);
}

static bool arrives(pliant_patch *patch, pliant_data *data, uint32_t result, bool due)
{
    return pliant_background_installs(&data->background, result, pliant_worker_has_finished(&patch->job.worker), due);
}

pliant_status pliant_patch_begin(pliant_data *data)
{
    pliant_patch *patch = data->patch;
    free_before(patch);
    patch_find_presses(data);
    bool abandoned = is_abandoned(patch, data);
    if (abandoned) atomic_store(&patch->stop, true); /* the thread ends later; no step waits for it */
    else if (patch->job.running && arrives(patch, data, PLIANT_RESULT_PATCH, data->statistics.step >= patch->job.due)) {
        pliant_status status = deliver(patch, data);
        if (status != PLIANT_OK) return status;
    }
    bool used = false, wanted = false;
    for (int t = 0; t < data->num_tools; t++) {
        bool held = patch_still_held(data, t, patch->holds[t].hold);
        if (patch->is_in_basis[t] && !held) { /* the others continue in the same basis */
            pliant_solver_remove_grasp(patch->solver, t);
            patch->is_in_basis[t] = false;
        }
        if (!held && !patch->job.running) forget_hold(patch, t);
        used = used || patch->is_in_basis[t];
        wanted = wanted || waits(data, t);
    }
    if (patch->basis && !used) basis_drop(patch, data);
    if (patch->basis) keep(patch, data);
    if (abandoned && arrives(patch, data, PLIANT_RESULT_PATCH_END, wanted || data->statistics.step >= patch->job.due))
        patch_job_clear(patch);
    return wanted && !patch->job.running ? patch_job_start(patch, data) : PLIANT_OK;
}

/* ---- Tools. */

pliant_solver *pliant_patch_solver(const pliant_data *data, int tool)
{
    return is_in_basis(data, tool) ? data->patch->solver : data->solver;
}

pliant_status pliant_patch_hold(pliant_data *data, int index)
{
    const pliant_tool *tool = data->tools + index;
    if (!is_in_basis(data, index))
        return pliant_solver_add_grasp(data->solver, index, tool->num_held, tool->held, tool->weight, data->positions);
    pliant_patch *patch = data->patch;
    int32_t *nodes = pliant_calloc((size_t)tool->num_held, sizeof *nodes);
    if (!nodes) return pliant_fail_memory("a tool's hold");
    for (int32_t h = 0; h < tool->num_held; h++) nodes[h] = patch->basis->near_node[tool->held[h]];
    pliant_status status =
        pliant_solver_add_grasp(patch->solver, index, tool->num_held, nodes, tool->weight, patch->solver->now.x);
    pliant_free(nodes);
    if (status == PLIANT_OK) memcpy(patch->solver->grasps[index].force, tool->force, sizeof tool->force);
    return status;
}

/* ---- The stage. */

static void move(const pliant_basis *basis, const double *by, double *x)
{
    for (int32_t i = 0; i < 3 * basis->mesh.num_nodes; i++) x[i] += by[i] - basis->mesh.rest[i];
}

/* Move the patch with the coarse model. Its load is the force that holds the fine elements at the base. */
static void move_with_coarse_model(pliant_patch *patch, const double *base)
{
    pliant_basis *basis = patch->basis;
    pliant_solver *solver = patch->solver;
    size_t bytes = 3 * (size_t)basis->mesh.num_nodes * sizeof *base;
    near_positions(basis, base, solver->trial.x); /* overwritten by the next trial */
    if (solver->loaded && memcmp(solver->trial.x, basis->mesh.rest, bytes) == 0) return;
    move(basis, solver->trial.x, solver->now.x);
    if (solver->rules.follows_blind_step) move(basis, solver->trial.x, solver->previous_x);
    memcpy(basis->mesh.rest, solver->trial.x, bytes);
    pliant_system_element_forces(&basis->system, basis->mesh.rest, patch->buffers.element_forces);
    pliant_system_gather(&basis->system, patch->buffers.element_forces, solver->load);
    solver->loaded = true;
}

/* Return the largest distance of a node between two states. */
static double largest_distance(int32_t nodes, const double *a, const double *b)
{
    double maximum = 0;
    for (int32_t n = 0; n < nodes; n++) {
        double squares = 0;
        for (int d = 0; d < 3; d++) squares += (a[3 * n + d] - b[3 * n + d]) * (a[3 * n + d] - b[3 * n + d]);
        maximum = fmax(maximum, squares);
    }
    return sqrt(maximum);
}

static void restart(pliant_solver *solver)
{
    pliant_solver_reset_after_move(solver);
}

/* Restore the coarse model and the patch from before this step. */
static void undo(pliant_patch *patch, pliant_data *data)
{
    const pliant_discretization *discretization = patch->discretization;
    patch_buffers *buffers = &patch->buffers;
    memcpy(data->positions, buffers->positions,
           3 * (size_t)discretization->body->fine.num_nodes * sizeof *data->positions);
    memcpy(data->solver->now.x, buffers->coarse,
           3 * (size_t)discretization->system->mesh->num_nodes * sizeof *buffers->coarse);
    start_at(data, patch->basis, buffers->positions, patch->solver->now.x);
    patch->solver->loaded = false; /* the load belongs to the base */
    restart(data->solver);
    restart(patch->solver);
    for (int t = 0; t < data->num_tools; t++)
        memcpy(pliant_patch_solver(data, t)->grasps[t].force, buffers->force + 3 * t, sizeof data->tools[t].force);
}

void pliant_patch_follow_move(pliant_data *data, const double *start_positions)
{
    pliant_patch *patch = data->patch;
    double *buffers = patch->buffers.positions;
    start_at(data, patch->basis, buffers, patch->solver->now.x);
    const pliant_evaluation_history evaluation_history = patch->solver->evaluation_history;
    patch->solver->loaded = false;
    restart(patch->solver);
    patch->solver->evaluation_history = evaluation_history;
    memcpy(buffers, start_positions, 3 * (size_t)data->body->fine.num_nodes * sizeof *buffers);
}

void pliant_patch_suspend(pliant_data *data, bool is_suspended)
{
    if (data->patch) data->patch->is_suspended = is_suspended;
}

pliant_status pliant_patch_step(pliant_data *data)
{
    pliant_patch *patch = data->patch;
    pliant_statistics *statistics = &data->statistics, own = {.step = data->statistics.step};
    statistics->patched = statistics->patch_waiting = statistics->patch_iterations = 0;
    statistics->patch_residual = statistics->patch_moved = 0;
    for (int t = 0; t < data->num_tools; t++) statistics->patch_waiting += waits(data, t);
    if (!patch->basis) return PLIANT_OK;
    pliant_basis *basis = patch->basis;
    pliant_solver *solver = patch->solver;
    solver->rules.max_evaluations = data->solver->rules.max_evaluations;
    solver->rules.tolerance = data->solver->rules.tolerance;
    solver->background = &data->background;
    solver->takes_factor = PLIANT_RESULT_PATCH_FACTOR;
    solver->takes_history = PLIANT_RESULT_PATCH_HISTORY;
    solver->clock = data->solver->clock;
    move_with_coarse_model(patch, data->positions);
    if (patch->is_suspended) {
        pliant_basis_positions(basis, patch->discretization->fine_system, data->positions, solver->now.x,
                               data->positions);
        statistics->patched = pliant_patch_count_tools(data);
        return PLIANT_OK;
    }
    patch->proxies = (pliant_contact_bodies){0};
    if (data->bodies) {
        patch->proxies.proxy = data->bodies->proxy;
        patch->proxies.limit = data->bodies->limit;
    }
    pliant_status status = pliant_solver_set_contacts(solver, &patch->inside, &patch->proxies, solver->now.x);
    if (status == PLIANT_OK) status = pliant_solver_step(solver, &own);
    if (status < 0) {
        undo(patch, data);
        return status;
    }
    patch_merge(data);
    statistics->contacts = 0;
    for (int32_t p = 0; p < data->contacts.count; p++)
        statistics->contacts +=
            data->contacts.point[p].was_pressed && data->contacts.point[p].kind != PLIANT_OBSTACLE_ELEMENT;
    statistics->penetration = fmax(patch->outside.count > 0 ? statistics->penetration : 0, own.penetration);
    pliant_basis_positions(basis, patch->discretization->fine_system, data->positions, solver->now.x, data->positions);
    statistics->patched = pliant_patch_count_tools(data);
    statistics->patch_iterations = own.iterations;
    statistics->patch_residual = own.residual;
    statistics->patch_moved = largest_distance(basis->mesh.num_nodes, solver->now.x, basis->mesh.rest);
    statistics->iterations += own.iterations;
    statistics->residual = fmax(statistics->residual, own.residual);
    statistics->residual_force = fmax(statistics->residual_force, own.residual_force);
    statistics->error = fmax(statistics->error, own.error);
    statistics->error_before = fmax(statistics->error_before, own.error_before);
    statistics->rejected += own.rejected;
    statistics->factors += own.factors;
    return status;
}

void pliant_patch_clear_displacement(pliant_patch *patch)
{
    if (!patch->basis) return;
    memcpy(patch->solver->now.x, patch->basis->mesh.rest,
           3 * (size_t)patch->basis->mesh.num_nodes * sizeof *patch->basis->mesh.rest);
    restart(patch->solver);
}
