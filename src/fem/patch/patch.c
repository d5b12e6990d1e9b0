#include "fem/patch/patch.h"

#include "base/fail.h"
#include "base/threads.h"
#include "base/free_memory.h"
#include "fem/patch/space.h"
#include "fem/quasistatic/background.h"
#include "interact/tool.h"
#include "pliant/memory.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>

enum { LARGEST_DIRECT = 40000 }; /* free nodes; a factor of some 300 MB */

/* A hold: whose, and where. */
typedef struct patch_hold {
    uint64_t hold;            /* pliant_tool.hold; 0: none */
    pliant_foothold foothold;
} patch_hold;

/* The responses to them: of a hold alone at [t][t], of two together at [t][u], t < u (response.h). NULL: not known, or too far
 * from each other to matter. */
typedef double *patch_blocks[PLIANT_MAX_TOOLS][PLIANT_MAX_TOOLS];

/* What is being made in the background. */
typedef struct patch_job {
    pthread_t thread;
    bool running, in_thread;
    uint64_t due;             /* step */
    double *x;                /* (3 fine nodes) the state */
    patch_hold holds[PLIANT_MAX_TOOLS]; /* known ones borrowed from the patch, others copied here */
    bool copied[PLIANT_MAX_TOOLS];
    patch_blocks blocks;      /* likewise */
    bool wanted[PLIANT_MAX_TOOLS][PLIANT_MAX_TOOLS]; /* made here */
    pliant_space *space;
    pliant_solver *solver;
    pliant_status status;
    char message[256];
} patch_job;

/* What a step with a space needs besides. */
typedef struct patch_room {
    double (*element_forces)[12][LANES]; /* of the near elements at the base */
    double *positions, *coarse;          /* (3 fine nodes), (3 coarse nodes) before the step, to undo it */
    double force[PLIANT_MAX_ROWS];       /* of the tools, likewise */
} patch_room;

struct pliant_patch {
    const pliant_scene *scene;
    const pliant_discretization *discretization;
    pliant_preconditioner *preconditioner; /* of the fine system, this one's own; made with the first patch */
    patch_job job;
    atomic_bool stop;         /* the job is no longer wanted */
    atomic_bool finished;     /* it has ended */
    patch_hold holds[PLIANT_MAX_TOOLS]; /* whose responses are known */
    patch_blocks blocks;
    bool serves[PLIANT_MAX_TOOLS];      /* the space in use is for this hold, too */
    uint64_t refused[PLIANT_MAX_TOOLS]; /* holds that no patch could be made for */
    uint64_t refused_until[PLIANT_MAX_TOOLS]; /* step */
    pliant_space *space;      /* Nullable */
    uint64_t made_for[PLIANT_MAX_TOOLS]; /* holds that it was made for */
    pliant_solver *solver;    /* of it */
    patch_room room;
};

pliant_status pliant_patch_system(const pliant_scene *scene, const pliant_body *body, int num_threads, pliant_system **out)
{
    pliant_system *system = pliant_calloc(1, sizeof *system);
    pliant_tangent *tangents = NULL;
    if (!system) return pliant_fail_memory("the fine mesh of patches");
    system->mesh = system->fine = &body->fine;
    system->num_threads = num_threads;
    pliant_status status = pliant_system_elements(system, body->fine_material);
    if (status == PLIANT_OK) status = pliant_system_unknowns(system, body->fine_fixed);
    /* nine solves with one matrix: a factor pays for longer than in a solver, which makes it anew */
    pliant_preconditioner_choice choice = scene->solver.preconditioner;
    if (choice == PLIANT_PRECONDITIONER_AUTO && system->num_free <= LARGEST_DIRECT) choice = PLIANT_DIRECT;
    if (status == PLIANT_OK) status = pliant_preconditioner_create(system, choice, &system->preconditioner);
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

static int32_t list_footholds(const patch_job *job, pliant_foothold out[PLIANT_MAX_TOOLS])
{
    int32_t count = 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        if (job->holds[t].hold) out[count++] = job->holds[t].foothold;
    return count;
}

static pliant_space_size size_of(const pliant_patch *patch, int32_t blocks)
{
    pliant_foothold footholds[PLIANT_MAX_TOOLS];
    int32_t count = list_footholds(&patch->job, footholds);
    return pliant_space_measure(patch->discretization->fine_system, patch->scene->model.patch, count, footholds, blocks);
}

/* Steps that a patch may take, of so many blocks of responses, some of which are still to be made: its operations at a rate that a
 * core of today has, so that the answer is the same everywhere and the step seldom waits. */
static int32_t delay_of(const pliant_patch *patch, int missing, int all)
{
    const double rate = 2e9;
    const pliant_scene *scene = patch->scene;
    const pliant_system *fine = patch->discretization->fine_system;
    if (scene->model.patch_delay > 0) return scene->model.patch_delay;
    double operations = pliant_space_operations(fine, size_of(patch, all));
    if (missing > 0) operations += missing * pliant_response_operations(fine, fine->preconditioner, patch->job.x);
    return 1 + (int32_t)fmin(ceil(operations / rate / scene->solver.step), 99998);
}

pliant_status pliant_patch_create(const pliant_scene *scene, const pliant_discretization *discretization, pliant_patch **out)
{
    pliant_patch *patch = pliant_calloc(1, sizeof *patch);
    if (!patch) return pliant_fail_memory("the patches");
    patch->scene = scene;
    patch->discretization = discretization;
    atomic_init(&patch->stop, false);
    *out = patch;
    return PLIANT_OK;
}

/* ---- holds */

static void hold_free(patch_hold *hold)
{
    pliant_free(hold->foothold.nodes);
    pliant_free(hold->foothold.weights);
    memset(hold, 0, sizeof *hold);
}

/* a hold and all responses that it is part of */
static void forget_hold(pliant_patch *patch, int tool)
{
    hold_free(patch->holds + tool);
    for (int u = 0; u < PLIANT_MAX_TOOLS; u++) {
        double **block = tool < u ? &patch->blocks[tool][u] : &patch->blocks[u][tool];
        pliant_free(*block);
        *block = NULL;
    }
}

static pliant_status hold_copy(const pliant_mesh *fine, const pliant_tool *tool, patch_hold *out)
{
    pliant_foothold foothold = {.count = tool->num_held};
    foothold.nodes = pliant_calloc((size_t)tool->num_held, sizeof *foothold.nodes);
    foothold.weights = pliant_calloc((size_t)tool->num_held, sizeof *foothold.weights);
    if (!foothold.nodes || !foothold.weights) {
        pliant_free(foothold.nodes);
        pliant_free(foothold.weights);
        return pliant_fail_memory("a patch");
    }
    memcpy(foothold.nodes, tool->held, (size_t)tool->num_held * sizeof *foothold.nodes);
    memcpy(foothold.weights, tool->weight, (size_t)tool->num_held * sizeof *foothold.weights);
    for (int32_t h = 0; h < tool->num_held; h++)
        for (int d = 0; d < 3; d++) foothold.centre[d] += tool->weight[h] * fine->rest[3 * tool->held[h] + d];
    *out = (patch_hold){.hold = tool->hold, .foothold = foothold};
    return PLIANT_OK;
}

static bool still_held(const pliant_data *data, int tool, uint64_t hold)
{
    return hold != 0 && tool < data->num_tools && data->tools[tool].holding && data->tools[tool].hold == hold;
}

static bool is_refused(const pliant_patch *patch, const pliant_data *data, int tool)
{
    return patch->refused[tool] == data->tools[tool].hold && data->statistics.step < patch->refused_until[tool];
}

static pliant_status room_create(const pliant_discretization *discretization, const pliant_space *space, patch_room *out)
{
    out->element_forces = pliant_calloc((size_t)space->system.num_blocks, sizeof *out->element_forces);
    out->positions = pliant_calloc((size_t)discretization->body->fine.num_nodes, 3 * sizeof *out->positions);
    out->coarse = pliant_calloc((size_t)discretization->system->mesh->num_nodes, 3 * sizeof *out->coarse);
    return out->element_forces && out->positions && out->coarse ? PLIANT_OK : pliant_fail_memory("a patch");
}

static void room_free(patch_room *room)
{
    pliant_free(room->element_forces);
    pliant_free(room->positions);
    pliant_free(room->coarse);
    memset(room, 0, sizeof *room);
}

/* Tools that pulled at it have no hold until they are attached anew, to whatever is there then. */
static void space_drop(pliant_patch *patch, pliant_data *data)
{
    for (int t = 0; data && t < data->num_tools; t++)
        if (patch->serves[t]) data->tools[t].attached = false;
    pliant_solver_free(patch->solver);
    pliant_space_free(patch->space);
    room_free(&patch->room);
    patch->solver = NULL;
    patch->space = NULL;
    memset(patch->serves, 0, sizeof patch->serves);
    memset(patch->made_for, 0, sizeof patch->made_for);
}

/* ---- in the background */

static pliant_status make_block(pliant_patch *patch, pliant_linearized *linearized, int t, int u)
{
    patch_job *job = &patch->job;
    const pliant_foothold *foothold = &job->holds[t].foothold;
    double *block = pliant_calloc((size_t)linearized->system.num_free, 3 * PLIANT_RESPONSE_MODES * sizeof *block);
    if (!block) return pliant_fail_memory("a patch");
    job->blocks[t][u] = block;
    if (t != u) return pliant_response_crossed(linearized, patch->preconditioner, job->blocks[t][t], job->blocks[u][u], block);
    return pliant_response_modes(linearized, patch->preconditioner, foothold->count, foothold->nodes, foothold->weights, block);
}

/* of single holds first: those of two are made of them */
static pliant_status make_blocks(pliant_patch *patch, pliant_linearized *linearized)
{
    pliant_status status = PLIANT_OK;
    for (int apart = 0; apart < PLIANT_MAX_TOOLS; apart++)
        for (int t = 0; t + apart < PLIANT_MAX_TOOLS && status == PLIANT_OK; t++)
            if (patch->job.wanted[t][t + apart]) status = make_block(patch, linearized, t, t + apart);
    return status;
}

static bool still_wanted(double fraction, const char *stage, void *user)
{
    const pliant_patch *patch = user;
    (void)fraction, (void)stage;
    return !atomic_load(&patch->stop);
}

/* The responses that are missing, all of them once more in the space, and its factors. */
static pliant_status check_memory(const pliant_patch *patch)
{
    const double share = 0.5;
    const patch_job *job = &patch->job;
    int32_t blocks = 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        for (int u = t; u < PLIANT_MAX_TOOLS; u++) blocks += 2 * job->wanted[t][u] + (job->blocks[t][u] != NULL);
    double bytes = pliant_space_bytes(patch->discretization->fine_system, size_of(patch, blocks)), available = pliant_free_memory();
    if (bytes <= share * available) return PLIANT_OK;
    return pliant_fail(PLIANT_ERROR_MEMORY, "a patch around these holds needs %.0f MB, more than half of the %.0f MB that the machine has free",
                       bytes / 1e6, available / 1e6);
}

static pliant_status make_space(pliant_patch *patch)
{
    enum { MOST_BLOCKS = PLIANT_MAX_TOOLS * (PLIANT_MAX_TOOLS + 1) / 2 };
    patch_job *job = &patch->job;
    const pliant_system *fine = patch->discretization->fine_system;
    const pliant_body *body = patch->discretization->body;
    pliant_linearized linearized = {0};
    pliant_foothold footholds[PLIANT_MAX_TOOLS];
    const double *blocks[MOST_BLOCKS];
    int32_t count = list_footholds(job, footholds), num_blocks = 0;
    pliant_status status = check_memory(patch);
    if (status == PLIANT_OK && !patch->preconditioner) status = pliant_preconditioner_clone(fine->preconditioner, 1, &patch->preconditioner);
    if (status == PLIANT_OK) status = pliant_linearized_create(fine, job->x, &linearized);
    linearized.progress = (pliant_progress){still_wanted, patch};
    if (status == PLIANT_OK) status = make_blocks(patch, &linearized);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        for (int u = t; u < PLIANT_MAX_TOOLS; u++)
            if (job->blocks[t][u]) blocks[num_blocks++] = job->blocks[t][u];
    if (status == PLIANT_OK)
        status = pliant_space_create(fine, &linearized, body->fine_material, body->fine_fixed, patch->scene->model.patch, count, footholds, num_blocks,
                                     blocks, patch->discretization->system->num_threads, &job->space);
    if (status == PLIANT_OK) status = pliant_solver_create(patch->scene, &job->space->system, &job->solver);
    pliant_linearized_free(&linearized);
    return status;
}

static void run_job(pliant_patch *patch)
{
    patch->job.status = make_space(patch);
    if (patch->job.status != PLIANT_OK) snprintf(patch->job.message, sizeof patch->job.message, "%s", pliant_last_error());
}

static void *in_background(void *argument)
{
    pliant_threads_step_back();
    pliant_patch *patch = argument;
    run_job(patch);
    atomic_store(&patch->finished, true);
    return NULL;
}

static void job_clear(pliant_patch *patch)
{
    patch_job *job = &patch->job;
    atomic_store(&patch->stop, true);
    if (job->running && job->in_thread) pthread_join(job->thread, NULL);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
        if (job->copied[t]) hold_free(job->holds + t);
        for (int u = t; u < PLIANT_MAX_TOOLS; u++)
            if (job->wanted[t][u]) pliant_free(job->blocks[t][u]);
    }
    pliant_solver_free(job->solver);
    pliant_space_free(job->space);
    pliant_free(job->x);
    memset(job, 0, sizeof *job);
}

void pliant_patch_reset(pliant_patch *patch)
{
    job_clear(patch);
    space_drop(patch, NULL);
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) forget_hold(patch, t);
    memset(patch->refused, 0, sizeof patch->refused);
}

void pliant_patch_free(pliant_patch *patch)
{
    if (!patch) return;
    pliant_patch_reset(patch);
    pliant_preconditioner_free(patch->preconditioner);
    pliant_free(patch);
}

/* ---- starting and delivering */

/* what two tools do together matters where their near parts touch */
static bool touch(const patch_hold *a, const patch_hold *b, double radius)
{
    double squares = 0;
    for (int d = 0; d < 3; d++) squares += pow(a->foothold.centre[d] - b->foothold.centre[d], 2);
    return squares <= 16 * radius * radius;
}

/* Which responses are missing. Returns the steps that the patch is due in. */
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

static pliant_status start(pliant_patch *patch, pliant_data *data)
{
    patch_job *job = &patch->job;
    size_t bytes = 3 * (size_t)patch->discretization->body->fine.num_nodes * sizeof *job->x;
    pliant_status status = PLIANT_OK;
    for (int t = 0; t < data->num_tools && status == PLIANT_OK; t++) {
        const pliant_tool *tool = data->tools + t;
        if (!tool->holding || is_refused(patch, data, t)) continue;
        job->copied[t] = patch->holds[t].hold != tool->hold;
        if (job->copied[t]) status = hold_copy(&patch->discretization->body->fine, tool, job->holds + t);
        else job->holds[t] = patch->holds[t];
    }
    if (status == PLIANT_OK && !(job->x = pliant_calloc(bytes, 1))) status = pliant_fail_memory("a patch");
    if (status != PLIANT_OK) {
        job_clear(patch);
        return status;
    }
    memcpy(job->x, data->positions, bytes);
    job->due = data->statistics.step + (uint64_t)list_wanted(patch);
    job->running = true;
    atomic_store(&patch->stop, false);
    atomic_store(&patch->finished, false);
    job->in_thread = pthread_create(&job->thread, NULL, in_background, patch) == 0;
    if (job->in_thread) return PLIANT_OK;
    run_job(patch);
    atomic_store(&patch->finished, true);
    return PLIANT_OK;
}

static void near_positions(const pliant_space *space, const double *fine, double *out)
{
    for (int32_t v = 0; v < space->mesh.num_nodes; v++) memcpy(out + 3 * v, fine + 3 * space->fine_node[v], 3 * sizeof *out);
}

/* The displacement from the coarse model's base to these positions, as far as the space has it. room: (3 fine nodes) */
static void start_at(const pliant_data *data, pliant_space *space, double *room, double *x)
{
    pliant_upsample_positions(data->solver->system, data->solver->now.x, room);
    near_positions(space, room, space->mesh.rest);
    near_positions(space, data->positions, x);
    pliant_space_project(space, x);
}

/* The new space takes over where the old one was, if it holds all that the old one still does; else it begins at the base. */
static void take_over(pliant_patch *patch, pliant_data *data)
{
    patch_job *job = &patch->job;
    bool goes_on = patch->space != NULL;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        goes_on = goes_on && (!still_held(data, t, patch->made_for[t]) || job->holds[t].hold == patch->made_for[t]);
    if (goes_on) start_at(data, job->space, job->x, job->solver->now.x); /* the job is done with its x */
    space_drop(patch, data);
    patch->space = job->space;
    patch->solver = job->solver;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) patch->made_for[t] = job->holds[t].hold;
    job->space = NULL;
    job->solver = NULL;
}

/* The hold goes on at the coarse model. For want of memory it is tried again, much later. */
static void refuse(pliant_patch *patch, const pliant_data *data, int tool)
{
    const uint64_t later = 1000;
    patch->refused[tool] = patch->job.holds[tool].hold;
    patch->refused_until[tool] = patch->job.status == PLIANT_ERROR_MEMORY ? data->statistics.step + later : UINT64_MAX;
}

/* one that no hold is left of */
static bool is_abandoned(const pliant_patch *patch, const pliant_data *data)
{
    bool held = false;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++) held = held || still_held(data, t, patch->job.holds[t].hold);
    return patch->job.running && !held;
}

static pliant_status deliver(pliant_patch *patch, pliant_data *data)
{
    patch_job *job = &patch->job;
    if (job->in_thread) pthread_join(job->thread, NULL);
    job->in_thread = false;
    if (job->status == PLIANT_OK) {
        patch_room room = {0};
        pliant_status status = room_create(patch->discretization, job->space, &room);
        if (status != PLIANT_OK) {
            room_free(&room);
            return status; /* delivered in the next step */
        }
        take_over(patch, data);
        patch->room = room;
    } else {
        pliant_log(PLIANT_LOG_WARNING, "no patch could be made; the tools pull at the coarse model: %s", job->message);
    }
    for (int t = 0; t < data->num_tools; t++) {
        if (!job->holds[t].hold) continue;
        if (job->status != PLIANT_OK) {
            if (!patch->serves[t]) refuse(patch, data, t); /* others keep what they have */
            continue;
        }
        if (job->copied[t]) {
            forget_hold(patch, t);
            patch->holds[t] = job->holds[t];
            job->copied[t] = false;
        }
        patch->serves[t] = patch->space && still_held(data, t, patch->holds[t].hold);
        if (!patch->serves[t]) continue;
        pliant_solver_release(data->solver, t); /* the coarse model is rid of it */
        data->tools[t].attached = false;
    }
    for (int t = 0; job->status == PLIANT_OK && t < PLIANT_MAX_TOOLS; t++)
        for (int u = t; u < PLIANT_MAX_TOOLS; u++) {
            if (!job->wanted[t][u]) continue;
            patch->blocks[t][u] = job->blocks[t][u];
            job->wanted[t][u] = false;
        }
    job->running = false;
    job_clear(patch);
    return PLIANT_OK;
}

static bool waits(const pliant_data *data, int tool)
{
    const pliant_patch *patch = data->patch;
    return data->tools[tool].holding && !patch->serves[tool] && !is_refused(patch, data, tool);
}

/* what pliant_patch_step goes back to when it fails */
static void keep(pliant_patch *patch, const pliant_data *data)
{
    const pliant_discretization *discretization = patch->discretization;
    memcpy(patch->room.positions, data->positions, 3 * (size_t)discretization->body->fine.num_nodes * sizeof *data->positions);
    memcpy(patch->room.coarse, data->solver->now.x, 3 * (size_t)discretization->system->mesh->num_nodes * sizeof *data->solver->now.x);
    for (int t = 0; t < data->num_tools; t++) memcpy(patch->room.force + 3 * t, data->tools[t].force, sizeof data->tools[t].force);
}

static bool arrives(pliant_patch *patch, pliant_data *data, uint32_t result, bool due)
{
    return pliant_background_arrives(&data->background, result, atomic_load(&patch->finished), due);
}

pliant_status pliant_patch_begin(pliant_data *data)
{
    pliant_patch *patch = data->patch;
    bool abandoned = is_abandoned(patch, data);
    if (abandoned) atomic_store(&patch->stop, true); /* it ends by itself; nobody waits for that */
    else if (patch->job.running && arrives(patch, data, PLIANT_TAKES_PATCH, data->statistics.step >= patch->job.due)) {
        pliant_status status = deliver(patch, data);
        if (status != PLIANT_OK) return status;
    }
    bool used = false, wanted = false;
    for (int t = 0; t < data->num_tools; t++) {
        bool held = still_held(data, t, patch->holds[t].hold);
        if (patch->serves[t] && !held) { /* the others go on in the same space */
            pliant_solver_release(patch->solver, t);
            patch->serves[t] = false;
        }
        if (!held && !patch->job.running) forget_hold(patch, t);
        used = used || patch->serves[t];
        wanted = wanted || waits(data, t);
    }
    if (patch->space && !used) space_drop(patch, data);
    if (patch->space) keep(patch, data);
    if (abandoned && arrives(patch, data, PLIANT_TAKES_PATCH_END, wanted || data->statistics.step >= patch->job.due)) job_clear(patch);
    return wanted && !patch->job.running ? start(patch, data) : PLIANT_OK;
}

/* ---- tools */

static bool serves(const pliant_data *data, int tool)
{
    const pliant_patch *patch = data->patch;
    return patch && patch->space && patch->serves[tool] && still_held(data, tool, patch->holds[tool].hold);
}

pliant_solver *pliant_patch_solver(const pliant_data *data, int tool) { return serves(data, tool) ? data->patch->solver : data->solver; }

pliant_status pliant_patch_hold(pliant_data *data, int index)
{
    const pliant_tool *tool = data->tools + index;
    if (!serves(data, index)) return pliant_solver_hold(data->solver, index, tool->num_held, tool->held, tool->weight, data->positions);
    pliant_patch *patch = data->patch;
    int32_t *nodes = pliant_calloc((size_t)tool->num_held, sizeof *nodes);
    if (!nodes) return pliant_fail_memory("a tool's hold");
    for (int32_t h = 0; h < tool->num_held; h++) nodes[h] = patch->space->near_node[tool->held[h]];
    pliant_status status = pliant_solver_hold(patch->solver, index, tool->num_held, nodes, tool->weight, patch->solver->now.x);
    pliant_free(nodes);
    if (status == PLIANT_OK) memcpy(patch->solver->handles[index].force, tool->force, sizeof tool->force);
    return status;
}

/* ---- the stage */

static void move(const pliant_space *space, const double *by, double *x)
{
    for (int32_t i = 0; i < 3 * space->mesh.num_nodes; i++) x[i] += by[i] - space->mesh.rest[i];
}

/* The coarse model moved: the patch moves with it, and its load is what holds the fine elements there. */
static void follow(pliant_patch *patch, const double *base)
{
    pliant_space *space = patch->space;
    pliant_solver *solver = patch->solver;
    size_t bytes = 3 * (size_t)space->mesh.num_nodes * sizeof *base;
    near_positions(space, base, solver->trial.x); /* overwritten by the next trial */
    if (solver->loaded && memcmp(solver->trial.x, space->mesh.rest, bytes) == 0) return;
    move(space, solver->trial.x, solver->now.x);
    if (solver->rules.blind) move(space, solver->trial.x, solver->left_x);
    memcpy(space->mesh.rest, solver->trial.x, bytes);
    pliant_system_element_forces(&space->system, space->mesh.rest, patch->room.element_forces);
    pliant_system_gather(&space->system, patch->room.element_forces, solver->load);
    solver->loaded = true;
}

/* largest distance between two states */
static double largest_apart(int32_t nodes, const double *a, const double *b)
{
    double most = 0;
    for (int32_t n = 0; n < nodes; n++) {
        double squares = 0;
        for (int d = 0; d < 3; d++) squares += (a[3 * n + d] - b[3 * n + d]) * (a[3 * n + d] - b[3 * n + d]);
        most = fmax(most, squares);
    }
    return sqrt(most);
}

static void restart(pliant_solver *solver)
{
    pliant_solver_moved(solver);
}

/* The coarse model and the patch are where they were before this step. */
static void undo(pliant_patch *patch, pliant_data *data)
{
    const pliant_discretization *discretization = patch->discretization;
    patch_room *room = &patch->room;
    memcpy(data->positions, room->positions, 3 * (size_t)discretization->body->fine.num_nodes * sizeof *data->positions);
    memcpy(data->solver->now.x, room->coarse, 3 * (size_t)discretization->system->mesh->num_nodes * sizeof *room->coarse);
    start_at(data, patch->space, room->positions, patch->solver->now.x);
    patch->solver->loaded = false; /* the load is of the base */
    restart(data->solver);
    restart(patch->solver);
    for (int t = 0; t < data->num_tools; t++) {
        double *force = pliant_patch_solver(data, t)->handles[t].force;
        memcpy(force, room->force + 3 * t, sizeof data->tools[t].force);
        pliant_tool_report(data, t, force);
    }
}

pliant_status pliant_patch_step(pliant_data *data)
{
    pliant_patch *patch = data->patch;
    pliant_statistics *statistics = &data->statistics, own = {.step = data->statistics.step};
    statistics->patched = statistics->patch_waiting = statistics->patch_iterations = 0;
    statistics->patch_residual = statistics->patch_moved = 0;
    for (int t = 0; t < data->num_tools; t++) statistics->patch_waiting += waits(data, t);
    if (!patch->space) return PLIANT_OK;
    pliant_space *space = patch->space;
    pliant_solver *solver = patch->solver;
    solver->rules.most_evaluations = data->solver->rules.most_evaluations;
    solver->rules.tolerance = data->solver->rules.tolerance;
    solver->background = &data->background;
    solver->takes_factor = PLIANT_TAKES_PATCH_FACTOR;
    solver->takes_history = PLIANT_TAKES_PATCH_HISTORY;
    if (data->solver->budget > 0) solver->budget = fmax(data->solver->budget - statistics->seconds[PLIANT_STEP_solve], 1e-9);
    follow(patch, data->positions);
    pliant_status status = pliant_solver_step(solver, &own);
    if (status < 0) {
        undo(patch, data);
        return status;
    }
    pliant_space_positions(space, patch->discretization->fine_system, data->positions, solver->now.x, data->positions);
    for (int t = 0; t < data->num_tools; t++) pliant_tool_report(data, t, pliant_patch_solver(data, t)->handles[t].force);
    for (int t = 0; t < data->num_tools; t++) statistics->patched += serves(data, t);
    statistics->patch_iterations = own.iterations;
    statistics->patch_residual = own.residual;
    statistics->patch_moved = largest_apart(space->mesh.num_nodes, solver->now.x, space->mesh.rest);
    statistics->iterations += own.iterations;
    statistics->residual = fmax(statistics->residual, own.residual);
    statistics->residual_force = fmax(statistics->residual_force, own.residual_force);
    statistics->error = fmax(statistics->error, own.error);
    statistics->error_before = fmax(statistics->error_before, own.error_before);
    statistics->rejected += own.rejected;
    statistics->factors += own.factors;
    return status;
}

void pliant_patch_flatten(pliant_patch *patch)
{
    if (!patch->space) return;
    memcpy(patch->solver->now.x, patch->space->mesh.rest, 3 * (size_t)patch->space->mesh.num_nodes * sizeof *patch->space->mesh.rest);
    restart(patch->solver);
}
