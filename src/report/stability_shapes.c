/* Stability cases that start from an impossible shape, and a long run. */
#include "base/fail.h"
#include "fem/element/scalar.h"
#include "model_data/data.h"
#include "base/memory.h"
#include "report/stability_cases.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Function that computes positions from the rest positions. */
typedef struct shape { void (*make)(const pliant_model *model, double part, double *positions); double part; } shape;

static pliant_status start_from_shape(stability_trial *trial, const void *argument)
{
    const shape *from = argument;
    const pliant_mesh *fine = &trial->model->body->fine;
    double *positions = pliant_calloc((size_t)fine->num_nodes, 3 * sizeof *positions);
    if (!positions) return trial_check_status(trial, pliant_fail_memory("a shape"));
    memcpy(positions, fine->rest, 3 * (size_t)fine->num_nodes * sizeof *positions);
    from->make(trial->model, from->part, positions);
    pliant_status status = trial_check_status(trial, pliant_data_set_positions(trial->model, trial->data, positions));
    pliant_free(positions);
    if (status < 0) return status;
    trial->max_inverted_elements = pliant_mesh_inverted(fine, trial->data->positions);
    snprintf(trial->figure, sizeof trial->figure, "%d of %d inverted at first", trial->max_inverted_elements,
             fine->num_tets);
    return trial_release_tools(trial);
}

/* Find a free node of a tetrahedron in the middle of the mesh. */
static void find_middle(const pliant_model *model, int32_t *tet, int *corner)
{
    const pliant_mesh *fine = &model->body->fine;
    for (int32_t n = 0; n < 4 * fine->num_tets; n++) {
        int32_t at = (n + 2 * fine->num_tets) % (4 * fine->num_tets);
        if (model->body->fine_fixed[fine->tets[at]]) continue;
        *tet = at / 4;
        *corner = at % 4;
        return;
    }
}

/* Move a free node to the opposite face of a tetrahedron, and beyond it by (part - 1) times the distance. */
static void squash(const pliant_model *model, double part, double *positions)
{
    int32_t tet = 0;
    int corner = 0;
    find_middle(model, &tet, &corner);
    const int32_t *nodes = model->body->fine.tets + 4 * tet;
    double opposite[3] = {0, 0, 0};
    for (int v = 0; v < 4; v++)
        for (int d = 0; v != corner && d < 3; d++) opposite[d] += model->body->fine.rest[3 * nodes[v] + d] / 3;
    for (int d = 0; d < 3; d++) {
        double *x = positions + 3 * nodes[corner] + d;
        *x += part * (opposite[d] - *x);
    }
}

static void scramble(const pliant_model *model, double part, double *positions)
{
    const pliant_mesh *fine = &model->body->fine;
    uint64_t state = 11;
    double low[3], high[3];
    for (int d = 0; d < 3; d++) {
        low[d] = INFINITY, high[d] = -INFINITY;
        for (int32_t n = 0; n < fine->num_nodes; n++) {
            low[d] = fmin(low[d], fine->rest[3 * n + d]);
            high[d] = fmax(high[d], fine->rest[3 * n + d]);
        }
    }
    for (int32_t i = 0; i < 3 * fine->num_nodes; i++) {
        state = state * 6364136223846793005u + 1442695040888963407u;
        double random = (double)(state >> 11) / 9007199254740992.0;
        positions[i] += part * (low[i % 3] + random * (high[i % 3] - low[i % 3]) - positions[i]);
    }
}

/* Move every node to the centre along the first `part` axes, starting with z: 1 gives a plane, 3 a point. */
static void collapse(const pliant_model *model, double part, double *positions)
{
    const pliant_mesh *fine = &model->body->fine;
    double middle[3] = {0, 0, 0};
    for (int32_t i = 0; i < 3 * fine->num_nodes; i++) middle[i % 3] += fine->rest[i] / fine->num_nodes;
    for (int32_t i = 0; i < 3 * fine->num_nodes; i++)
        if (3 - i % 3 <= (int)part) positions[i] = middle[i % 3];
}

/* Mirror at the central plane across x, and shift by `part` times the size. */
static void mirror(const pliant_model *model, double part, double *positions)
{
    const pliant_mesh *fine = &model->body->fine;
    double middle = 0;
    for (int32_t n = 0; n < fine->num_nodes; n++) middle += fine->rest[3 * n] / fine->num_nodes;
    for (int32_t n = 0; n < fine->num_nodes; n++) positions[3 * n] = middle - part * (fine->rest[3 * n] - middle);
}

static pliant_status run_on_block(stability_context *context, const char *parameter, const shape *from)
{
    block_body body;
    pliant_status status = block_create_default(&body);
    if (status >= 0) status = stability_try(context, parameter, &body.input, start_from_shape, from);
    block_free(&body);
    return status;
}

pliant_status stability_flat(stability_context *context)
{
    const shape flat = {squash, 1};
    return run_on_block(context, "one element", &flat);
}

pliant_status stability_inverted(stability_context *context)
{
    const shape one = {squash, 2}, far = {squash, 20}, all = {mirror, 1};
    pliant_status status = run_on_block(context, "one element, by its height", &one);
    if (status >= 0) status = run_on_block(context, "one element, by 19 heights", &far);
    return status < 0 ? status : run_on_block(context, "the whole body, mirrored", &all);
}

pliant_status stability_scrambled(stability_context *context)
{
    const shape slightly = {scramble, 0.2}, wholly = {scramble, 1};
    pliant_status status = run_on_block(context, "by a fifth", &slightly);
    return status < 0 ? status : run_on_block(context, "wholly", &wholly);
}

pliant_status stability_plane(stability_context *context)
{
    const shape plane = {collapse, 1}, line = {collapse, 2};
    pliant_status status = run_on_block(context, "onto a plane", &plane);
    return status < 0 ? status : run_on_block(context, "onto a line", &line);
}

pliant_status stability_point(stability_context *context)
{
    const shape point = {collapse, 3};
    return run_on_block(context, "onto a point", &point);
}

/* ---- long run: a circular pull; the same phase of every round must give the same result */

enum { ROUND = 100, SKIPPED = 3 }; /* steps per round; rounds to skip before measuring */

static double farthest(const double *a, const double *b, int32_t count)
{
    double maximum = 0;
    for (int32_t i = 0; i < count; i++) maximum = fmax(maximum, fabs(a[i] - b[i]));
    return maximum;
}

static pliant_status run_circular_path(stability_trial *trial, const void *argument)
{
    int64_t steps = *(const int64_t *)argument;
    int32_t count = 3 * trial->model->body->fine.num_nodes;
    double from[3], *first = pliant_calloc((size_t)count, sizeof *first), drift = 0;
    size_t bytes = 0;
    /* minimum over the rounds, because data allocated once, such as a background factorization, are no leak */
    int64_t growth = INT64_MAX;
    if (!first) return trial_check_status(trial, pliant_fail_memory("the first round"));
    pliant_status status = trial_grasp(trial, PLIANT_DRIVE_SPRING, from);
    for (int64_t step = 0; status >= 0 && step < steps; step++) {
        double angle = 6.28318530717958647693 * (double)(step % ROUND) / ROUND, r = 0.05 * trial->size;
        double tip[3] = {from[0] + r * sin(angle), from[1] + r * (1 - cos(angle)), from[2] + 0.5 * r * sin(2 * angle)};
        status = trial_check_status(trial, pliant_tool_set_pose(trial->data, 0, tip, NULL));
        if (status >= 0) status = trial_step(trial);
        if (step % ROUND != 0 || step / ROUND < SKIPPED) continue;
        const size_t now = pliant_memory_in_use();
        if (step / ROUND == SKIPPED) memcpy(first, trial->data->positions, (size_t)count * sizeof *first);
        else if ((int64_t)now - (int64_t)bytes < growth) growth = (int64_t)now - (int64_t)bytes;
        bytes = now;
        drift = fmax(drift, farthest(first, trial->data->positions, count));
    }
    if (growth == INT64_MAX) growth = 0; /* too few rounds */
    pliant_free(first);
    snprintf(trial->figure, sizeof trial->figure, "drift %.3g mm, growth %lld bytes a round", 1e3 * drift,
             (long long)growth);
    if (status >= 0 && (growth > 0 || drift > 1e-3 * trial->size)) {
        trial->broken = true;
        snprintf(trial->message, sizeof trial->message, "the body drifts or memory grows: %s", trial->figure);
    }
    return status < 0 ? status : trial_release_tools(trial);
}

pliant_status stability_long_run(stability_context *context)
{
    static const int32_t size[3] = {4, 4, 4};
    static const double box[3] = {0.04, 0.04, 0.04};
    block_body body;
    char text[48];
    pliant_status status = block_create(size, box, NULL, &body);
    for (int d = 0; d < 3; d++) body.scene.mesh.coarse_cells[d] = 1;
    body.scene.mesh.ratio = 2;
    snprintf(text, sizeof text, "%lld steps", (long long)context->options->long_steps);
    if (status >= 0)
        status = stability_try(context, text, &body.input, run_circular_path, &context->options->long_steps);
    block_free(&body);
    return status;
}
