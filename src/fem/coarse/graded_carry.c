/* Mapping of solved nodes across a cut that has replaced coarse elements by fine elements (graded.c). */
#include "base/fail.h"
#include "fem/system.h"
#include "base/memory.h"

#include <string.h>

static pliant_status no_memory(void) { return pliant_fail_memory("the solved nodes"); }

pliant_status pliant_solved_sources(const pliant_system *system, const pliant_system *before,
                                    const pliant_body_map *map, int32_t **own, const int32_t **out)
{
    *own = NULL;
    if (system->mesh == system->fine) {
        *out = map->node;
        return PLIANT_OK;
    }
    const int32_t nodes = system->mesh->num_nodes, coarse = system->graded ? system->graded->coarse_nodes : nodes;
    int32_t *list = *own = pliant_calloc((size_t)nodes, sizeof *list);
    if (!list) return no_memory();
    for (int32_t n = 0; n < nodes; n++) list[n] = n < coarse ? n : before->graded ? coarse + map->node[n - coarse] : -1;
    *out = list;
    return PLIANT_OK;
}

/* Find the fine node that follows each coarse node with the largest weight, in a body at load time; -1: none. nearest:
 * (coarse nodes); best: zeroed. */
static void find_nearest(const pliant_system *system, int32_t *nearest, double *best)
{
    const pliant_upsample *upsample = system->upsample;
    const int32_t coarse = system->graded ? system->graded->coarse_nodes : system->mesh->num_nodes;
    memset(nearest, 0xff, (size_t)coarse * sizeof *nearest);
    for (int32_t i = 0; upsample && upsample->node && i < upsample->corners * system->fine->num_nodes; i++) {
        const int32_t node = upsample->node[i];
        if (node >= coarse || upsample->weights[i] <= best[node]) continue;
        best[node] = upsample->weights[i];
        nearest[node] = i / upsample->corners;
    }
}

/* Move each coarse node without elements by the displacement of the fine node that follows it with the largest weight.
 * fine: present positions of the fine nodes. */
static pliant_status place_unused(const pliant_system *system, const pliant_system *before, const double *fine,
                                  double *out)
{
    const int32_t coarse = before->graded->coarse_nodes;
    int32_t *nearest = pliant_calloc((size_t)coarse, sizeof *nearest);
    double *best = pliant_calloc((size_t)coarse, sizeof *best);
    if (nearest && best) find_nearest(system, nearest, best);
    for (int32_t n = 0; nearest && best && n < coarse; n++)
        for (int d = 0; !before->graded->used[n] && nearest[n] >= 0 && d < 3; d++) {
            const size_t at = 3 * (size_t)nearest[n] + (size_t)d;
            out[3 * n + d] = system->mesh->rest[3 * n + d] + fine[at] - system->fine->rest[at];
        }
    const bool good = nearest && best;
    pliant_free(nearest);
    pliant_free(best);
    return good ? PLIANT_OK : no_memory();
}

pliant_status pliant_solved_positions(const pliant_system *system, const pliant_system *before,
                                      const pliant_body_map *map, const double *x, double *out)
{
    const bool fine = system->mesh == system->fine;
    if (!before->upsample || (!fine && !system->graded && !before->graded)) {
        if (fine) pliant_body_map_vectors(map, x, out);
        else memcpy(out, x, 3 * (size_t)system->mesh->num_nodes * sizeof *out);
        return PLIANT_OK;
    }
    double *was = pliant_calloc(3 * (size_t)before->fine->num_nodes, sizeof *was),
           *now = pliant_calloc(3 * (size_t)system->fine->num_nodes, sizeof *now);
    pliant_status status = was && now ? PLIANT_OK : no_memory();
    if (status == PLIANT_OK) {
        pliant_upsample_positions(before, x, was); /* includes followers, which may be free after the cut */
        pliant_body_map_vectors(map, was, fine ? out : now);
    }
    if (status == PLIANT_OK && !fine) {
        const size_t coarse = (size_t)(system->graded ? system->graded->coarse_nodes : system->mesh->num_nodes);
        memcpy(out, x, 3 * coarse * sizeof *out);
        if (system->graded) memcpy(out + 3 * coarse, now, 3 * (size_t)system->fine->num_nodes * sizeof *out);
        if (before->graded) status = place_unused(system, before, now, out);
    }
    pliant_free(was);
    pliant_free(now);
    return status;
}

int32_t pliant_fine_of_solved(const pliant_system *system, const pliant_body *body, int32_t node)
{
    if (system->mesh == system->fine) return node;
    if (!system->graded || node < system->graded->coarse_nodes) return body->fine_of_coarse[node];
    return node - system->graded->coarse_nodes;
}
