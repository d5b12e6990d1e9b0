/* Background computation of a patch: the missing responses, and the basis. */
#include "base/fail.h"
#include "base/free_memory.h"
#include "fem/patch/patch_job.h"
#include "base/memory.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static int32_t list_footprints(const patch_job *job, pliant_footprint out[PLIANT_MAX_TOOLS])
{
    int32_t count = 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        if (job->holds[t].hold) out[count++] = job->holds[t].footprint;
    return count;
}

static pliant_basis_size size_of(const pliant_patch *patch, int32_t blocks)
{
    pliant_footprint footprints[PLIANT_MAX_TOOLS];
    int32_t count = list_footprints(&patch->job, footprints);
    return pliant_basis_measure(patch->discretization->fine_system, patch->scene->model.patch, count, footprints,
                                blocks);
}

/* Return the discretization whose fine system has a factor. */
static const pliant_discretization *at_rest_of(const pliant_discretization *discretization)
{
    return discretization->fine_system->preconditioner ? discretization : discretization->first;
}

/* Return the number of steps until a patch is installed, from its operations at a fixed rate of a typical core. The
 * result is the same on every machine, and steps seldom wait. missing: responses to compute; all: responses in the
 * basis. */
static int32_t delay_of(const pliant_patch *patch, int missing, int all)
{
    const double rate = 2e9;
    const pliant_scene *scene = patch->scene;
    const pliant_system *fine = patch->discretization->fine_system;
    const pliant_preconditioner *at_rest = at_rest_of(patch->discretization)->fine_system->preconditioner;
    if (scene->model.patch_delay > 0) return scene->model.patch_delay;
    double operations = pliant_basis_operations(fine, size_of(patch, all));
    if (missing > 0) operations += missing * pliant_response_operations(fine, at_rest, patch->job.x);
    return 1 + (int32_t)fmin(ceil(operations / rate / scene->solver.step), 99998);
}

void patch_hold_free(patch_hold *hold)
{
    pliant_free(hold->footprint.nodes);
    pliant_free(hold->footprint.weights);
    memset(hold, 0, sizeof *hold);
}

static pliant_status hold_copy(const pliant_mesh *fine, const pliant_tool *tool, patch_hold *out)
{
    pliant_footprint footprint = {.count = tool->num_held};
    footprint.nodes = pliant_calloc((size_t)tool->num_held, sizeof *footprint.nodes);
    footprint.weights = pliant_calloc((size_t)tool->num_held, sizeof *footprint.weights);
    if (!footprint.nodes || !footprint.weights) {
        pliant_free(footprint.nodes);
        pliant_free(footprint.weights);
        return pliant_fail_memory("a patch");
    }
    memcpy(footprint.nodes, tool->held, (size_t)tool->num_held * sizeof *footprint.nodes);
    memcpy(footprint.weights, tool->weight, (size_t)tool->num_held * sizeof *footprint.weights);
    for (int32_t h = 0; h < tool->num_held; h++)
        for (int d = 0; d < 3; d++) footprint.centre[d] += tool->weight[h] * fine->rest[3 * tool->held[h] + d];
    *out = (patch_hold){.hold = tool->hold, .footprint = footprint};
    return PLIANT_OK;
}

/* ---- In the background. */

static pliant_status make_block(pliant_patch *patch, pliant_linearized *linearized, int t, int u)
{
    patch_job *job = &patch->job;
    const pliant_footprint *footprint = &job->holds[t].footprint;
    double *block = pliant_calloc((size_t)linearized->system.num_free, 3 * PLIANT_RESPONSE_MODES * sizeof *block);
    if (!block) return pliant_fail_memory("a patch");
    job->blocks[t][u] = block;
    if (t != u)
        return pliant_response_pair_modes(linearized, patch->preconditioner, job->blocks[t][t], job->blocks[u][u],
                                          block);
    return pliant_response_modes(linearized, patch->preconditioner, footprint->count, footprint->nodes,
                                 footprint->weights, block);
}

/* Compute the blocks of single holds first, since the pairs depend on them. */
static pliant_status make_blocks(pliant_patch *patch, pliant_linearized *linearized)
{
    pliant_status status = PLIANT_OK;
    for (int offset = 0; offset < PLIANT_MAX_TOOLS; offset++)
        for (int t = 0; t + offset < PLIANT_MAX_TOOLS && status == PLIANT_OK; t++)
            if (patch->job.wanted[t][t + offset]) status = make_block(patch, linearized, t, t + offset);
    return status;
}

static bool still_wanted(double fraction, const char *stage, void *user)
{
    const pliant_patch *patch = user;
    (void)fraction, (void)stage;
    return !atomic_load(&patch->stop);
}

/* Check that the missing responses, a copy of all responses in the basis, and the factors fit in half of the free
 * memory. */
static pliant_status check_memory(const pliant_patch *patch)
{
    const double fraction = 0.5;
    const patch_job *job = &patch->job;
    int32_t blocks = 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        for (int u = t; u < PLIANT_MAX_TOOLS; u++) blocks += 2 * job->wanted[t][u] + (job->blocks[t][u] != NULL);
    double bytes = pliant_basis_bytes(patch->discretization->fine_system, size_of(patch, blocks)),
           available = pliant_free_memory();
    if (bytes <= fraction * available) return PLIANT_OK;
    return pliant_fail(
        PLIANT_ERROR_MEMORY,
        "a patch around the grasps needs %.0f MB, more than half of the %.0f MB that the machine has free", bytes / 1e6,
        available / 1e6);
}

/* Create the patch's preconditioner. After a cut, carry over the preconditioner from load time. */
static pliant_status make_preconditioner(pliant_patch *patch)
{
    const pliant_discretization *first = at_rest_of(patch->discretization);
    const pliant_system *fine = patch->discretization->fine_system;
    const int32_t *parent = patch->discretization->body->node_parent;
    pliant_preconditioner *base = NULL, *made = NULL;
    pliant_status status = pliant_preconditioner_clone(first->fine_system->preconditioner, 1, &base);
    if (status != PLIANT_OK || first == patch->discretization) {
        patch->preconditioner = base;
        return status;
    }
    int32_t *source = pliant_calloc((size_t)fine->num_free, sizeof *source);
    for (int32_t f = 0; source && f < fine->num_free; f++) {
        const int32_t node = fine->node_of_free[f];
        source[f] = first->fine_system->free_of_node[parent ? parent[node] : node];
    }
    status = source
                 ? pliant_preconditioner_carry(fine, first, first->fine_system, source, fine->mesh->rest, NULL, &made)
                 : pliant_fail_memory("a patch");
    if (status == PLIANT_OK) pliant_preconditioner_take_base(made, &base);
    pliant_preconditioner_free(base);
    patch->preconditioner = made;
    return status;
}

static pliant_status make_basis(pliant_patch *patch)
{
    enum { MAX_BLOCKS = PLIANT_MAX_TOOLS * (PLIANT_MAX_TOOLS + 1) / 2 };
    patch_job *job = &patch->job;
    const pliant_system *fine = patch->discretization->fine_system;
    const pliant_body *body = patch->discretization->body;
    pliant_linearized linearized = {0};
    pliant_footprint footprints[PLIANT_MAX_TOOLS];
    const double *blocks[MAX_BLOCKS];
    int32_t count = list_footprints(job, footprints), num_blocks = 0;
    pliant_status status = check_memory(patch);
    if (status == PLIANT_OK && !patch->preconditioner) status = make_preconditioner(patch);
    if (status == PLIANT_OK) status = pliant_linearized_create(fine, job->x, &linearized);
    linearized.progress = (pliant_progress){still_wanted, patch};
    if (status == PLIANT_OK) status = make_blocks(patch, &linearized);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        for (int u = t; u < PLIANT_MAX_TOOLS; u++)
            if (job->blocks[t][u]) blocks[num_blocks++] = job->blocks[t][u];
    if (status == PLIANT_OK)
        status = pliant_basis_create(fine, &linearized, body->fine_fixed, patch->scene->model.patch, count, footprints,
                                     num_blocks, blocks, patch->discretization->system->num_threads, &job->basis);
    if (status == PLIANT_OK) status = pliant_solver_create(patch->scene, &job->basis->system, &job->solver);
    pliant_linearized_free(&linearized);
    return status;
}

static void run_job(void *argument)
{
    pliant_patch *patch = argument;
    patch->job.status = make_basis(patch);
    if (patch->job.status != PLIANT_OK)
        snprintf(patch->job.message, sizeof patch->job.message, "%s", pliant_last_error());
}

void patch_job_clear(pliant_patch *patch)
{
    patch_job *job = &patch->job;
    atomic_store(&patch->stop, true);
    pliant_worker_join(&job->worker);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        if (job->copied[t]) patch_hold_free(job->holds + t);
        for (int u = t; u < PLIANT_MAX_TOOLS; u++)
            if (job->wanted[t][u]) pliant_free(job->blocks[t][u]);
    }
    pliant_solver_free(job->solver);
    pliant_basis_free(job->basis);
    pliant_free(job->x);
    memset(job, 0, sizeof *job);
}

/* ---- Start. */

bool patch_is_refused(const pliant_patch *patch, const pliant_data *data, int tool)
{
    return patch->refused[tool] == patch_hold_of(data, tool) && data->statistics.step < patch->refused_until[tool];
}

/* Return whether the near parts of two tools touch, so that their interaction matters. */
static bool touch(const patch_hold *a, const patch_hold *b, double radius)
{
    double squares = 0;
    for (int d = 0; d < 3; d++) squares += pow(a->footprint.centre[d] - b->footprint.centre[d], 2);
    return squares <= 16 * radius * radius;
}

/* List the missing responses. Return the number of steps until the patch is due. */
static int32_t list_wanted(pliant_patch *patch)
{
    patch_job *job = &patch->job;
    int missing = 0, all = 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        for (int u = t; u < PLIANT_MAX_TOOLS; u++) {
            if (!job->holds[t].hold || !job->holds[u].hold) continue;
            if (!touch(job->holds + t, job->holds + u, patch->scene->model.patch)) continue;
            if (!job->copied[t] && !job->copied[u]) job->blocks[t][u] = patch->blocks[t][u];
            job->wanted[t][u] = !job->blocks[t][u];
            missing += job->wanted[t][u];
            all++;
        }
    return delay_of(patch, missing, all);
}

pliant_status patch_job_start(pliant_patch *patch, pliant_data *data)
{
    patch_job *job = &patch->job;
    size_t bytes = 3 * (size_t)patch->discretization->body->fine.num_nodes * sizeof *job->x;
    pliant_status status = PLIANT_OK;
    for (int t = 0; t < data->num_tools && status == PLIANT_OK; t++) {
        const pliant_tool *tool = data->tools + t;
        const uint64_t hold = patch_hold_of(data, t);
        if (!hold || patch_is_refused(patch, data, t)) continue;
        job->copied[t] = patch->holds[t].hold != hold;
        if (job->copied[t])
            status = pliant_tool_grips(tool) ? hold_copy(&patch->discretization->body->fine, tool, job->holds + t)
                                             : patch_press_copy(data, t, job->holds + t);
        else job->holds[t] = patch->holds[t];
    }
    if (status == PLIANT_OK && !(job->x = pliant_calloc(bytes, 1))) status = pliant_fail_memory("a patch");
    if (status != PLIANT_OK) {
        patch_job_clear(patch);
        return status;
    }
    memcpy(job->x, data->positions, bytes);
    job->due = data->statistics.step + (uint64_t)list_wanted(patch);
    job->running = true;
    atomic_store(&patch->stop, false);
    pliant_worker_start(&job->worker, run_job, patch);
    return PLIANT_OK;
}
