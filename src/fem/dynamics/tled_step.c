/* A frame of TLED: sub-steps of central differences, or dynamic relaxation. */
#include "base/fail.h"
#include "base/clock.h"
#include "fem/dynamics/tled_cubes.h"
#include "fem/dynamics/tled_pressure.h"

#include <math.h>
#include <string.h>

enum {
    MAX_HALVINGS = 3 /* in a frame */,
    ALL_HALVINGS = 10,
    BURST = 64,
    TRIAL = 8 /* sub-steps by the same number of threads */
};

static int32_t end_of(const pliant_tled *tled, int32_t chunk)
{
    int32_t nodes = tled->system->mesh->num_nodes;
    return (chunk + 1) * PLIANT_CHUNK < nodes ? (chunk + 1) * PLIANT_CHUNK : nodes;
}

static bool is_held(const pliant_tool *tools, int num_tools, int32_t node)
{
    for (int t = 0; t < num_tools; t++)
        for (int32_t h = 0; tools[t].holding && h < tools[t].num_held; h++)
            if (tools[t].held[h] == node) return true;
    return false;
}

/* Return the error of time integration at a node, or `minimum` if that is larger or the error is unknown. The
 * acceleration of the sub-step before must still be stored. */
static double error_at(const pliant_tled *tled, const pliant_tool *tools, int num_tools, int32_t node,
                       const double acceleration[3], double minimum)
{
    const pliant_tled_system *system = tled->system;
    const size_t at = 3 * (size_t)node;
    const double *d = tled->d + at, *before = tled->acceleration + at;
    double change = 0, increment = 0;
    for (int k = 0; k < 3; k++) {
        change += (acceleration[k] - before[k]) * (acceleration[k] - before[k]);
        increment += d[k] * d[k];
    }
    const double error =
        pliant_substep_error(tled->substeps * tled->time_step, tled->time_step, sqrt(change), sqrt(increment));
    if (!(error > minimum) || is_held(tools, num_tools, node) || (pliant_tled_touches(tled) && tled->in_contact[node]))
        return minimum;
    return pliant_substep_touches(system->walls, system->num_walls, system->mesh->rest + at, tled->u + at) ? minimum
                                                                                                           : error;
}

/* Compute accelerations of a chunk's nodes from element forces and gravity. left: remaining sub-steps of the frame,
 * including this one. */
static void accelerate(pliant_tled *tled, const pliant_tool *tools, int num_tools, int32_t left, int32_t chunk)
{
    const pliant_tled_system *system = tled->system;
    const bool reports_error = left <= 2 && !system->quasi_static;
    double load = 0, inertia = 0, stiffness = 0, error = 0;
    for (int32_t n = chunk * PLIANT_CHUNK; n < end_of(tled, chunk); n++) {
        double inverse = tled->inverse_mass[n], sum[3] = {0, 0, 0}, now[3];
        if (inverse == 0) continue;
        for (int32_t c = system->corner_start[n]; c < system->corner_start[n + 1]; c++) {
            const float *force = tled->forces + system->corner[c];
            sum[0] += force[0];
            sum[1] += force[LANES];
            sum[2] += force[2 * LANES];
        }
        if (tled->pressure_of_groups) pliant_tled_pressure_add(tled, n, sum);
        for (int k = 0; k < 3; k++) now[k] = inverse * (system->node_mass[n] * tled->gravity[k] - sum[k]);
        if (reports_error) error = error_at(tled, tools, num_tools, n, now, error);
        for (int k = 0; k < 3; k++) {
            size_t at = 3 * (size_t)n + (size_t)k;
            double weight = system->node_mass[n] * tled->gravity[k], acceleration = now[k];
            tled->acceleration[at] = acceleration;
            load += inverse * weight * weight;
            if (!tled->own) continue;
            stiffness += tled->d[at] * (tled->own[at] - acceleration) / inverse;
            inertia += tled->d[at] * tled->d[at] / inverse;
            tled->own[at] = acceleration;
        }
    }
    tled->sums[chunk][PLIANT_SUM_LOAD] = load;
    tled->sums[chunk][PLIANT_SUM_STIFFNESS] = stiffness;
    tled->sums[chunk][PLIANT_SUM_INERTIA] = inertia;
    if (reports_error) tled->sums[chunk][left == 1 ? PLIANT_SUM_ERROR : PLIANT_SUM_ERROR_BEFORE] = error;
}

static void advance(pliant_tled *tled, pliant_tled_scheme rule, int32_t chunk)
{
    for (int32_t n = 3 * chunk * PLIANT_CHUNK; n < 3 * end_of(tled, chunk); n++) {
        tled->d[n] = rule.factor * tled->acceleration[n] + rule.kept * tled->d[n];
        tled->u[n] += tled->d[n];
    }
}

/* Finish the sub-step after all forces: walls and sums. */
static void settle(pliant_tled *tled, pliant_tled_scheme rule, int32_t chunk)
{
    const pliant_tled_system *system = tled->system;
    int32_t first = chunk * PLIANT_CHUNK, end = end_of(tled, chunk);
    double residual = 0, largest = 0;
    if (system->num_walls > 0) pliant_tled_collide(tled, rule.factor, first, end);
    for (int32_t n = first; n < end; n++) {
        double inverse = tled->inverse_mass[n];
        if (inverse == 0) continue;
        double *d = tled->d + 3 * (size_t)n, *u = tled->u + 3 * (size_t)n;
        const double *a = tled->acceleration + 3 * (size_t)n;
        double square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        if (system->quasi_static && square > tled->limit[n]) {
            pliant_substep_shorten(tled->limit[n], square, u, d);
            square = tled->limit[n];
        }
        residual += (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]) / inverse;
        /* NaN stays the maximum. */
        double over = square / tled->limit[n];
        largest = over > largest || over != over ? over : largest;
    }
    tled->sums[chunk][PLIANT_SUM_RESIDUAL] = residual;
    tled->sums[chunk][PLIANT_SUM_LARGEST] = largest;
}

static void total_of(const pliant_tled *tled, int32_t chunks, double out[PLIANT_NUM_SUMS])
{
    memset(out, 0, PLIANT_NUM_SUMS * sizeof *out);
    for (int32_t c = 0; c < chunks; c++) {
        const double *sum = tled->sums[c];
        for (int s = 0; s < PLIANT_SUM_LARGEST; s++) out[s] += sum[s];
        for (int s = PLIANT_SUM_ERROR_BEFORE; s <= PLIANT_SUM_ERROR; s++) out[s] = fmax(out[s], sum[s]);
        double over = sum[PLIANT_SUM_LARGEST];
        out[PLIANT_SUM_LARGEST] = over > out[PLIANT_SUM_LARGEST] || over != over ? over : out[PLIANT_SUM_LARGEST];
    }
}

double pliant_tled_relative(const pliant_tled *tled, double residual, double load)
{
    return pliant_substep_relative(tled->smallest_load, residual, load);
}

double pliant_tled_frame_error(const pliant_tled *tled, double before, double last)
{
    return tled->substeps > 2 ? 0.5 * (before + last) : tled->substeps == 2 ? last : 0;
}

static double lowest_frequency(const pliant_tled *tled, int32_t chunks, double quotient[4])
{
    double total[PLIANT_NUM_SUMS];
    total_of(tled, chunks, total);
    return pliant_substep_frequency(quotient, total[PLIANT_SUM_STIFFNESS], total[PLIANT_SUM_INERTIA]);
}

/* Return whether an edge of a block's elements changes by more than the limit of its nodes in the last sub-step, or by
 * NaN. nodes: (corners x LANES). Corners of a hexahedron whose numbers differ in one bit share an edge. */
static bool strains_fast(const pliant_tled *tled, int corners, int32_t (*nodes)[LANES])
{
    for (int a = 0; a < corners; a++)
        for (int b = 0; b < a; b++) {
            if (corners == 8 && ((a ^ b) & ((a ^ b) - 1))) continue;
            for (int l = 0; l < LANES; l++) {
                const int32_t from = nodes[a][l], to = nodes[b][l];
                double square = 0;
                for (int k = 0; k < 3; k++) {
                    const double difference =
                        tled->d[3 * (size_t)to + (size_t)k] - tled->d[3 * (size_t)from + (size_t)k];
                    square += difference * difference;
                }
                if (!(square <= fmin(tled->limit[from], tled->limit[to]))) return true;
            }
        }
    return false;
}

/* Return whether any element strains faster than sound. A body that moves as a whole may be faster. All threads call
 * this function. shared: a number that all threads share. */
static bool any_strains_fast(const pliant_tled *tled, int *shared)
{
    const pliant_tled_system *system = tled->system;
    const int32_t tets = system->num_blocks, blocks = pliant_tled_blocks(system);
#pragma omp single
    *shared = 0;
#pragma omp for schedule(static)
    for (int32_t block = 0; block < blocks; block++) {
        const bool fast = block < tets ? strains_fast(tled, 4, system->nodes[block])
                                       : strains_fast(tled, 8, system->cubes->nodes[block - tets]);
        if (!fast) continue;
#pragma omp atomic write
        *shared = 1;
    }
    return *shared != 0;
}

/* Return the status of collision detection in sub-steps. */
static pliant_status status_of(const pliant_tled *tled)
{
    const pliant_tled_pressure *pressure = tled->pressure_of_groups;
    const pliant_status status = tled->overlap_damping.status;
    if (status == PLIANT_OK && pressure && pressure->status != PLIANT_OK) return pressure->status;
    return status == PLIANT_OK && tled->zones ? tled->zones->status : status;
}

/* Run sub-steps up to `end`. All threads call this function, and all threads compute the same decisions. */
static pliant_tled_frame run(pliant_tled *tled, pliant_tool *tools, int num_tools, bool held, int32_t first,
                             int32_t end, double *tool_load, int *fast)
{
    const int32_t part = pliant_tled_part_substeps(tled), frame = tled->substeps - tled->substeps_done;
    const pliant_tled_system *system = tled->system;
    const int32_t chunks = (system->mesh->num_nodes + PLIANT_CHUNK - 1) / PLIANT_CHUNK;
    const bool still = system->quasi_static, acts = held || pliant_tled_touches(tled),
               corrects = acts || tled->pressure_of_groups;
    pliant_tled_scheme rule = pliant_tled_scheme_of(tled->time_step, system->damping);
    pliant_tled_frame result = {.is_stable = true, .steps = first};
    double total[PLIANT_NUM_SUMS],
        quotient[4] = {tled->quotient[0], tled->quotient[1], tled->quotient[2], tled->quotient[3]};
    while (result.steps < end && !result.settled && status_of(tled) == PLIANT_OK) {
        if (system->nodal_pressure) pliant_tled_pressures(tled);
        pliant_tled_element_forces(tled, tled->time_step);
        if (tled->pressure_of_groups) pliant_tled_pressure_find(tled);
        if (still) {
#pragma omp for schedule(static)
            for (int32_t chunk = 0; chunk < chunks; chunk++)
                accelerate(tled, tools, num_tools, frame - result.steps, chunk);
            rule = pliant_tled_scheme_of(1, 2 * lowest_frequency(tled, chunks, quotient));
        }
#pragma omp for schedule(static)
        for (int32_t chunk = 0; chunk < chunks; chunk++) {
            if (!still) accelerate(tled, tools, num_tools, frame - result.steps, chunk);
            advance(tled, rule, chunk);
            if (!corrects) settle(tled, rule, chunk);
        }
        if (tled->zones) {
#pragma omp single
            pliant_impact_zones_accelerate(tled->zones, tled->time_step, tled->acceleration);
        }
        if (acts) {
#pragma omp single
            {
                *tool_load =
                    held ? pliant_tled_pull(tled, tools, num_tools, rule.factor, still ? 1 : part - result.steps) : 0;
                if (pliant_tled_touches(tled))
                    *tool_load += pliant_tled_contacts_correct(tled, rule.factor, result.steps);
            }
        }
        if (tled->pressure_of_groups) {
#pragma omp for schedule(static)
            for (int32_t chunk = 0; chunk < chunks; chunk++)
                pliant_tled_collide(tled, rule.factor, chunk * PLIANT_CHUNK, end_of(tled, chunk));
            pliant_tled_pressure_correct(tled, tools, num_tools, rule.factor);
        }
        if (corrects) {
#pragma omp for schedule(static)
            for (int32_t chunk = 0; chunk < chunks; chunk++) settle(tled, rule, chunk);
        }
        if (tled->zones) {
#pragma omp single
            pliant_impact_zones_limit(tled->zones, tled->inverse_mass, tled->u, tled->d);
        }
        total_of(tled, chunks, total);
        result.steps++;
        result.residual = pliant_tled_relative(tled, total[PLIANT_SUM_RESIDUAL], total[PLIANT_SUM_LOAD] + *tool_load);
        if (!still)
            result.error = pliant_tled_frame_error(tled, total[PLIANT_SUM_ERROR_BEFORE], total[PLIANT_SUM_ERROR]);
        result.is_stable =
            !(tled->zones && tled->zones->is_too_fast) &&
            (total[PLIANT_SUM_LARGEST] <= (still ? INFINITY : 1) || (!still && !any_strains_fast(tled, fast)));
        if (!result.is_stable) break;
        result.settled = still && result.residual <= tled->tolerance;
    }
#pragma omp barrier /* until all threads have read the quotient of the last frame */
#pragma omp master
    memcpy(tled->quotient, quotient, sizeof quotient);
    return result;
}

static void save_or_restore_start(pliant_tled *tled, bool back)
{
    size_t nodes = 3 * (size_t)tled->system->mesh->num_nodes, blocks = (size_t)pliant_tled_blocks(tled->system);
    memcpy(back ? tled->u : tled->start_u, back ? tled->start_u : tled->u, nodes * sizeof *tled->u);
    memcpy(back ? tled->d : tled->start_d, back ? tled->start_d : tled->d, nodes * sizeof *tled->d);
    memcpy(back ? tled->target : tled->start_target, back ? tled->start_target : tled->target, sizeof tled->target);
    memcpy(back ? tled->previous_point : tled->start_previous_point,
           back ? tled->start_previous_point : tled->previous_point, sizeof tled->previous_point);
    memcpy(back ? tled->previous_target : tled->start_previous_target,
           back ? tled->start_previous_target : tled->previous_target, sizeof tled->previous_target);
    pliant_tled_pressure_save_or_restore(tled, back);
    if (tled->memory)
        memcpy(back ? tled->memory : tled->start_memory, back ? tled->start_memory : tled->memory,
               blocks * sizeof *tled->memory);
}

void pliant_tled_set_positions(pliant_tled *tled, const double *positions)
{
    const pliant_tled_system *system = tled->system;
    for (int32_t n = 0; n < 3 * system->mesh->num_nodes; n++) {
        if (tled->inverse_mass[n / 3] == 0) continue;
        tled->u[n] = positions[n] - system->mesh->rest[n];
        tled->d[n] = 0;
    }
}

/* Choose between one thread and all threads for the next burst. Use the faster alternative, and test the other one from
 * time to time. */
static int choose_pace(pliant_tled *tled)
{
    const int32_t shortest = 32, longest = 512;
    pliant_thread_choice *thread_choice = &tled->thread_choice;
    if (tled->system->num_threads == 1) return 0;
    if (thread_choice->seconds[1] == 0) return 1;
    if (thread_choice->left > 0) {
        thread_choice->left--;
        return thread_choice->faster_choice;
    }
    if (!thread_choice->is_trial) {
        thread_choice->is_trial = true;
        return !thread_choice->faster_choice;
    }
    const int faster_choice = thread_choice->seconds[1] <= thread_choice->seconds[0];
    const bool clear = faster_choice == thread_choice->faster_choice &&
                       thread_choice->seconds[!faster_choice] > 1.5 * thread_choice->seconds[faster_choice];
    thread_choice->wait = !clear ? shortest : thread_choice->wait < longest ? 2 * thread_choice->wait : longest;
    thread_choice->is_trial = false;
    thread_choice->faster_choice = faster_choice;
    thread_choice->left = thread_choice->wait;
    return faster_choice;
}

static pliant_status run_frame(void *with, pliant_tled *tled, pliant_tool *tools, int num_tools, pliant_tled_frame *out)
{
    (void)with;
    bool held = false;
    int fast = 0;
    double tool_load = 0;
    for (int t = 0; t < num_tools; t++) held = held || tools[t].holding;
    pliant_status status = pliant_tled_contacts_begin(tled);
    if (status != PLIANT_OK) return status;
    save_or_restore_start(tled, false);
    if (tled->zones) pliant_impact_zones_begin(tled->zones, tled->u);
    const int32_t part = pliant_tled_part_substeps(tled);
    pliant_tled_frame done = {.is_stable = true};
    while (status_of(tled) == PLIANT_OK && done.is_stable && !done.settled && done.steps < part) {
        const int all = choose_pace(tled);
        const bool trial = tled->thread_choice.is_trial || tled->thread_choice.seconds[all] == 0;
        const int32_t first = done.steps, maximum = trial ? TRIAL : BURST,
                      end = part - first > maximum ? first + maximum : part;
        const double start = pliant_seconds();
#pragma omp parallel num_threads(all ? tled->system->num_threads : 1)
        {
            pliant_tled_frame mine = run(tled, tools, num_tools, held, first, end, &tool_load, &fast);
#pragma omp master
            done = mine;
        }
        tled->thread_choice.seconds[all] = (pliant_seconds() - start) / (done.steps - first);
    }
    *out = done;
    if (!out->is_stable || status_of(tled) != PLIANT_OK) save_or_restore_start(tled, true);
    return status_of(tled);
}

static pliant_status diverged(const pliant_tled *tled, int32_t steps)
{
    const pliant_tled_system *system = tled->system;
    return pliant_fail(
        PLIANT_ERROR_NUMERIC,
        "tled diverged in sub-step %d of %d: an element strained faster than sound. Time step %.3g s; at rest at most "
        "%.3g s is stable (tled/safety %g). The state before the step is kept",
        steps, tled->substeps, tled->time_step, fmin(system->edge_bound, system->eigenvalue_bound), system->safety);
}

/* End a part of the frame. kept: the tools' forces of the earlier parts. */
static void end_part(pliant_tled *tled, const pliant_tled_frame *frame, pliant_tool *tools, int num_tools,
                     double (*kept)[3], pliant_statistics *statistics)
{
    statistics->residual = frame->residual;
    if (tled->substeps_done == 0) statistics->error_before = statistics->error;
    statistics->error = frame->error;
    for (int t = 0; t < num_tools && !tled->system->quasi_static; t++)
        for (int k = 0; k < 3; k++)
            tools[t].force[k] = (tools[t].force[k] + tled->substeps_done * (tled->substeps_done > 0 ? kept[t][k] : 0)) /
                                (tled->substeps_done + frame->steps);
    pliant_tled_contacts_end(tled, frame->steps, statistics);
    tled->substeps_done = tled->substeps_done + frame->steps < tled->substeps && !tled->system->quasi_static
                              ? tled->substeps_done + frame->steps
                              : 0;
}

pliant_status pliant_tled_step_by(pliant_tled_runner runner, void *with, pliant_tled *tled, pliant_tool *tools,
                                  int num_tools, pliant_statistics *statistics)
{
    const pliant_tled_system *system = tled->system;
    double kept_forces[PLIANT_MAX_TOOLS][3];
    pliant_status status = PLIANT_OK;
    for (int t = 0; t < num_tools; t++) memcpy(kept_forces[t], tools[t].force, sizeof kept_forces[t]);
    for (int halvings = 0; status == PLIANT_OK; halvings++) {
        pliant_tled_frame frame = {0};
        for (int t = 0; t < num_tools; t++) memset(tools[t].force, 0, sizeof tools[t].force);
        status = runner(with, tled, tools, num_tools, &frame);
        if (status == PLIANT_OK && !frame.is_stable && runner != run_frame && !system->quasi_static) {
            /* Another runner reports every fast node; only the CPU tests the elements. */
            for (int t = 0; t < num_tools; t++) memset(tools[t].force, 0, sizeof tools[t].force);
            status = run_frame(NULL, tled, tools, num_tools, &frame);
        }
        if (status != PLIANT_OK) break;
        statistics->iterations = frame.steps;
        if (frame.is_stable) {
            end_part(tled, &frame, tools, num_tools, kept_forces, statistics);
            return !system->quasi_static || frame.settled ? PLIANT_OK : PLIANT_NOT_CONVERGED;
        }
        if (system->quasi_static) pliant_tled_stop_motion(tled);
        if (system->quasi_static || tled->time_step > fmin(system->edge_bound, system->eigenvalue_bound) ||
            halvings == MAX_HALVINGS || tled->halvings >= ALL_HALVINGS) {
            status = diverged(tled, frame.steps);
        } else {
            pliant_tled_halve(tled);
            pliant_log(PLIANT_LOG_WARNING, "tled: an element strained faster than sound; sub-steps of %.3g s",
                       tled->time_step);
        }
    }
    for (int t = 0; t < num_tools; t++) memcpy(tools[t].force, kept_forces[t], sizeof kept_forces[t]);
    return status;
}

pliant_status pliant_tled_step(pliant_tled *tled, pliant_tool *tools, int num_tools, pliant_statistics *statistics)
{
    return pliant_tled_step_by(run_frame, NULL, tled, tools, num_tools, statistics);
}
