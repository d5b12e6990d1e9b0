/* Broad phase on another device: list the triangles of the surface that may be near a rigid part in a leg. The device
 * has the positions already. The host then tests the listed triangles as it would test all of them. The list contains
 * all triangles that pass those tests, so it changes no result.
 *
 * With a list, the host computes only the corners of listed triangles. It computes all corners with self-contact, and
 * while no tool moves farther than settings.hysteresis. A fast tool that presses on nothing needs the bounding box
 * of all corners. There is no list after the host has moved detached pieces or patches, and in explicit dynamics. */
#ifndef PLIANT_CONTACT_ADVANCE_NEAR_TRIANGLES_H
#define PLIANT_CONTACT_ADVANCE_NEAR_TRIANGLES_H

#include "base/inline.h"
#include "pliant/contact.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Where a part can touch triangles: the points of the box with normal . x <= offset. A normal of 0 has no effect if the
 * offset is not negative. */
typedef struct pliant_near_region {
    double low[3], high[3];   /* [m] */
    double normal[3], offset; /* [m] */
} pliant_near_region;

typedef struct pliant_triangle_list {
    int32_t count;
    const int32_t *triangle; /* (count) ascending; NULL: the triangles from 0 to count - 1 */
} pliant_triangle_list;

/* Function that lists the triangles that may be near one of the regions. Return false if it cannot. The list is valid
 * until the next call. */
typedef struct pliant_near_finder {
    bool (*find)(void *context, int32_t count, const pliant_near_region *regions, pliant_triangle_list *out);
    void *context;
} pliant_near_finder;

/* Return the triangles near the regions, or all triangles. finder: Nullable */
static inline pliant_triangle_list pliant_near_find(const pliant_near_finder *finder, int32_t num_triangles,
                                                    int32_t count, const pliant_near_region *regions)
{
    pliant_triangle_list out;
    if (finder && finder->find(finder->context, count, regions, &out)) return out;
    out.count = num_triangles;
    out.triangle = NULL;
    return out;
}

/* Limit a region to the distance `margin` from a half-space. */
void pliant_near_limit_to_half_space(const pliant_part *half_space, double margin, pliant_near_region *region);

static inline int32_t pliant_triangle_at(const pliant_triangle_list *list, int32_t n)
{
    return list->triangle ? list->triangle[n] : n;
}

/* Return whether a triangle is certainly not near a region. The box around the triangle is enlarged by its diagonal, so
 * that it contains the triangle's bounding sphere. It is also enlarged by much more than the rounding errors of
 * positions. */
PLIANT_INLINE bool pliant_near_is_apart(const pliant_near_region *region, const double low[3], const double high[3])
{
    double square = 0.0, height = 0.0;
    bool apart = false;
    for (int d = 0; d < 3; d++) square += (high[d] - low[d]) * (high[d] - low[d]);
    const double more = sqrt(square) + 1e-9; /* [m] */
    for (int d = 0; d < 3; d++) {
        apart = apart | (low[d] - more > region->high[d]) | (high[d] + more < region->low[d]);
        height += region->normal[d] * (region->normal[d] > 0.0 ? low[d] - more : high[d] + more);
    }
    return apart | (height > region->offset);
}

#ifdef __cplusplus
}
#endif

#endif
