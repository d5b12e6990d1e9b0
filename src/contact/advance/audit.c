/* Check whether the surface and the cores overlap. The algorithms are independent of the advancement: ternary
 * search of a convex function on a segment, and signed volumes for segments that pass through triangles. */
#include "contact/advance/self_rules.h"

#include "base/threads.h"
#include "contact/advance/advance_rules.h"

#include <math.h>
#include <string.h>

static double distance_on(const pliant_part *core, const double end[2][3], double fraction)
{
    double point[3], normal[3];
    for (int d = 0; d < 3; d++) point[d] = end[0][d] + fraction * (end[1][d] - end[0][d]);
    return pliant_part_distance(core, point, normal);
}

/* Return whether a segment enters the core. For a part that is not convex, test samples at a quarter of its field's
 * cell size. */
static bool enters(const pliant_part *core, const double end[2][3])
{
    enum { ROUNDS = 60, MAX_SAMPLES = 1000 };
    const double grain = pliant_part_cell_size(core);
    double low = 0, high = 1, length = 0, minimum = INFINITY;
    for (int d = 0; d < 3; d++) length += pow(end[1][d] - end[0][d], 2);
    const int samples = grain > 0 ? 1 + (int)fmin(4 * sqrt(length) / grain, MAX_SAMPLES) : 0;
    for (int n = 0; n <= samples && grain > 0; n++)
        minimum = fmin(minimum, distance_on(core, end, (double)n / samples));
    for (int round = 0; round < ROUNDS && grain == 0; round++) {
        const double a = low + (high - low) / 3, b = high - (high - low) / 3, at_a = distance_on(core, end, a),
                     at_b = distance_on(core, end, b);
        minimum = fmin(minimum, fmin(at_a, at_b));
        if (at_a < at_b)
            high = b;
        else
            low = a;
    }
    return minimum < 0;
}

/* Return whether the axis of a capsule, or an edge of a box, passes through a triangle. */
static bool passes_through(const pliant_part *core, const double corner[3][3])
{
    const double *const corners[3] = {corner[0], corner[1], corner[2]};
    double end[2][3];
    const double *const ends[2] = {end[0], end[1]};
    bool crosses = false;
    if (core->kind == PLIANT_PART_CAPSULE) {
        memcpy(end[0], core->from, sizeof end[0]);
        memcpy(end[1], core->to, sizeof end[1]);
        return pliant_segment_crosses_triangle(corners, ends);
    }
    for (int edge = 0; edge < 12 && core->kind == PLIANT_PART_BOX && !crosses; edge++) {
        const int along = edge / 4;
        for (int n = 0; n < 2; n++)
            for (int d = 0; d < 3; d++) {
                const int upper = d == along ? n : edge >> (d == (along + 1) % 3) & 1;
                end[n][d] = upper ? core->to[d] : core->from[d];
            }
        crosses = pliant_segment_crosses_triangle(corners, ends);
    }
    return crosses;
}

static bool is_crossed(const pliant_advance_motion *motion, const int32_t node[3], const double *positions)
{
    pliant_advance_state state;
    double corner[3][3];
    bool crossed = false;
    pliant_advance_motion_at(motion, 0, &state);
    for (int c = 0; c < 3; c++) pliant_pose_from(&state.pose, positions + 3 * (size_t)node[c], corner[c]);
    for (int c = 0; c < 3 && !crossed; c++) {
        const double end[2][3] = {{corner[c][0], corner[c][1], corner[c][2]},
                                  {corner[(c + 1) % 3][0], corner[(c + 1) % 3][1], corner[(c + 1) % 3][2]}};
        crossed = enters(&motion->core, end);
    }
    return crossed || passes_through(&motion->core, (const double(*)[3])corner);
}

pliant_status pliant_advance_audit(pliant_advance *advance, int32_t num_triangles, const int32_t *triangles,
                                   const double *positions, int32_t count, const pliant_advance_part *parts,
                                   int num_threads, pliant_advance_audit_result *out)
{
    const int threads = pliant_threads_or_cores(num_threads);
    double margin = 0;
    for (int32_t p = 0; p < count; p++) margin = fmax(margin, parts[p].guard);
    const pliant_status status = pliant_advance_broad_phase(advance, num_triangles, triangles, positions, positions,
                                                            count, parts, margin, true, threads, NULL);
    if (status != PLIANT_OK) return status;
    *out = (pliant_advance_audit_result){.minimum = INFINITY};
#pragma omp parallel for schedule(dynamic, 16) num_threads(threads)
    for (int32_t n = 0; n < advance->num_pairs; n++) {
        pliant_advance_pair *pair = advance->pair + n;
        const int32_t *node = triangles + 3 * (size_t)pair->triangle;
        const pliant_advance_motion *motion = advance->motion + pair->part;
        pliant_advance_triangle triangle;
        if (motion->leg->released) continue;
        pliant_advance_triangle_init(node, positions, positions, &triangle);
        pair->limit = pliant_advance_pair_distance(motion, &triangle, 0, pair->weight);
        pair->exempt = is_crossed(motion, node, positions);
    }
    for (int32_t n = 0; n < advance->num_pairs; n++) {
        const pliant_advance_pair *pair = advance->pair + n;
        if (advance->motion[pair->part].leg->released) continue;
        out->minimum = fmin(out->minimum, pair->limit);
        out->crossings += pair->exempt;
    }
    return PLIANT_OK;
}
