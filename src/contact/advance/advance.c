#include "contact/advance/advance.h"

#include "base/fail.h"
#include "base/threads.h"
#include "contact/advance/advance_workspace.h"
#include "base/memory.h"

#include <math.h>

pliant_status pliant_advance_create(const pliant_contact_settings *settings, pliant_advance **out)
{
    pliant_advance *advance = pliant_calloc(1, sizeof *advance);
    if (!advance) return pliant_fail_memory("contact advance");
    advance->settings = settings ? *settings : pliant_contact_settings_default();
    *out = advance;
    return PLIANT_OK;
}

void pliant_advance_set_finder(pliant_advance *advance, const pliant_near_finder *finder) { advance->finder = finder; }

void pliant_advance_free(pliant_advance *advance)
{
    if (!advance) return;
    PLIANT_FREE(advance->pair, advance->pair_time, advance->motion, advance->region, advance->box, advance->near,
                advance->group, advance->self);
    pliant_advance_tree_free(&advance->tree);
    pliant_free(advance);
}

typedef struct surface {
    const int32_t *triangles;
    const double *from, *to;
} surface;

static pliant_advance_triangle triangle_of(const surface *of, const pliant_advance_pair *pair)
{
    pliant_advance_triangle out;
    pliant_advance_triangle_init(of->triangles + 3 * (size_t)pair->triangle, of->from, of->to, &out);
    return out;
}

/* Make one iteration for every pair. Most pairs need no other. */
static void step_all(pliant_advance *advance, const surface *of, int num_threads)
{
    const int32_t several = 256; /* fewer are faster on one thread */
#pragma omp parallel for schedule(dynamic, 16) num_threads(num_threads) if (advance->num_pairs > several)
    for (int32_t n = 0; n < advance->num_pairs; n++) {
        pliant_advance_pair *pair = advance->pair + n;
        const pliant_advance_triangle triangle = triangle_of(of, pair);
        pair->ends = pliant_advance_pair_step(&advance->settings, advance->motion + pair->part, &triangle, pair);
    }
}

static int32_t sort_pairs(pliant_advance *advance)
{
    int32_t count = 0;
    for (int32_t n = 0; n < advance->num_pairs; n++)
        if (advance->pair[n].t < 1) advance->pair_time[count++] = (pliant_advance_pair_time){advance->pair[n].t, n};
    pliant_advance_sort(count, advance->pair_time);
    return count;
}

int32_t pliant_advance_get_pairs(const pliant_advance *advance, const pliant_advance_pair **pairs)
{
    *pairs = advance->pair;
    return advance->num_pairs;
}

pliant_status pliant_advance_find(pliant_advance *advance, int32_t num_triangles, const int32_t *triangles,
                                  const double *from, const double *to, int32_t count, const pliant_advance_part *parts,
                                  int num_threads, bool every_pair, double *fraction)
{
    const surface of = {triangles, from, to};
    const int threads = pliant_threads_or_cores(num_threads);
    double margin = 0, smallest = 1;
    for (int32_t p = 0; p < count; p++) margin = fmax(margin, advance->settings.advance_stop * parts[p].guard);
    pliant_status status = pliant_advance_broad_phase(advance, num_triangles, triangles, from, to, count, parts, margin,
                                                      false, threads, advance->finder);
    if (status == PLIANT_OK) status = pliant_advance_reserve_times(advance, advance->num_pairs);
    if (status != PLIANT_OK) return status;
    step_all(advance, &of, threads);
    const int32_t left = sort_pairs(advance);
    for (int32_t n = 0; n < left; n++) {
        pliant_advance_pair *pair = advance->pair + advance->pair_time[n].pair;
        const pliant_advance_triangle triangle = triangle_of(&of, pair);
        if (pair->t >= smallest && !every_pair) break; /* the other pairs have larger fractions */
        while (!pair->ends && (pair->t < smallest || every_pair))
            pair->ends = pliant_advance_pair_step(&advance->settings, advance->motion + pair->part, &triangle, pair);
        if (!(pair->t >= smallest)) smallest = pair->t;
    }
    *fraction = smallest;
    return PLIANT_OK;
}
