/* Make cuts before the first real one, and discard them. Memory is then allocated and cleared, threads are started,
 * and kernels are loaded, so the first stroke is not delayed. */
#include "backend/backend.h"
#include "base/buffer.h"
#include "fem/quasistatic/solver.h"
#include "sim/step/cut.h"
#include "sim/build/discretization.h"
#include "warp/device.h"

#include <math.h>

/* Topologies that exist at once: the current one, the next one, and the previous one, which a solver may still use. */
enum { BODIES = 3, POINTS = 17 };
static const double strip_width = 0.02; /* fraction of the mesh */

/* Compute a strip across the middle of the mesh at rest, a third of its width, next to the previous strips. */
static void find_strip(const pliant_mesh *mesh, int number, double from[3 * POINTS], double to[3 * POINTS])
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (int32_t n = 0; n < mesh->num_nodes; n++)
        for (int d = 0; d < 3; d++) {
            low[d] = fmin(low[d], mesh->rest[3 * (size_t)n + d]);
            high[d] = fmax(high[d], mesh->rest[3 * (size_t)n + d]);
        }
    for (int p = 0; p < POINTS; p++) {
        const double along[3] = {1.0 / 3 + p / (3.0 * (POINTS - 1)), 0.5 + strip_width * number, 0.5};
        for (int d = 0; d < 3; d++) {
            from[3 * p + d] = low[d] + along[d] * (high[d] - low[d]);
            to[3 * p + d] = from[3 * p + d] + (d == 1 ? strip_width * (high[d] - low[d]) : 0);
        }
    }
}

/* Make one cut. *next stays NULL if the strip cuts nothing.
 * @param solver NULL, or out: the solver of the next topology */
static pliant_status make_next_cut(const pliant_model *model, const pliant_data *data,
                                   const pliant_discretization *before, int number, const pliant_discretization **next,
                                   pliant_solver **solver)
{
    double from[3 * POINTS], to[3 * POINTS];
    pliant_body *body = NULL;
    find_strip(&before->body->fine, number, from, to);
    const pliant_cut_sweep sweep = {.count = POINTS, .from = from, .to = to};
    pliant_status status = pliant_body_cut(before->body, data->last_revision + 1 + (uint64_t)number,
                                           before->body->fine.rest, &sweep, &body, NULL);
    if (status != PLIANT_OK || !body) return status;
    pliant_body_map map = {0};
    status = pliant_body_map_create(before->body, body, &map);
    if (status == PLIANT_OK) status = pliant_discretization_next(&model->scene, before, body, &map, next);
    if (status == PLIANT_OK && solver)
        status = pliant_solver_carry_over_cut(&model->scene, (*next)->system, data->solver, &map,
                                              !data->backend->state_is_on_host, NULL, solver);
    pliant_body_map_free(&map);
    pliant_body_release(body);
    return status;
}

static void reserve_memory(pliant_data *data, int64_t taken)
{
    if (taken <= (int64_t)data->reserved_bytes) return;
    pliant_memory_change_reserve(taken - (int64_t)data->reserved_bytes);
    data->reserved_bytes = (size_t)taken;
}

void pliant_warm_up_cut(const pliant_model *model, pliant_data *data)
{
    const pliant_discretization *made[1 + BODIES] = {data->discretization};
    const pliant_body *body = data->discretization->body;
    if (!body->voxels || body->cuts || body->subdivision || data->tled || model->scene.model.method != PLIANT_FINE)
        return;
    const int64_t before = pliant_memory_thread_bytes();
    pliant_warp_next *warp = NULL;
    pliant_solver *solver = NULL;
    pliant_status status = PLIANT_OK;
    for (int n = 0; n < BODIES && made[n] && status == PLIANT_OK; n++)
        status = make_next_cut(model, data, made[n], n, made + n + 1, n == 0 ? &solver : NULL);
    if (status == PLIANT_OK && made[1] && data->warp) status = pliant_warp_prepare(data->warp, made[1]->body, &warp);
    reserve_memory(data, pliant_memory_thread_bytes() - before);
    pliant_warp_next_free(warp);
    pliant_solver_free(solver);
    for (int n = 1; n <= BODIES; n++) pliant_discretization_release(made[n]);
}
