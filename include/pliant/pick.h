/** @file pick.h
 *  A point of the visible isosurface of the deformed volume, found along a ray ([H] 3.2).
 */
#ifndef PLIANT_PICK_H
#define PLIANT_PICK_H

#include "pliant/model.h"
#include "pliant/warp.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_ray {
    double origin[3];    /**< LPS [m] */
    double direction[3]; /**< any length but 0 */
    double near, far;    /**< part that counts, from the origin [m]; far <= 0: without end */
} pliant_ray;

typedef struct pliant_picked {
    bool hit;              /**< false: the ray meets no tissue; only reason is set */
    double point[3];       /**< on the isosurface, LPS [m] */
    double distance;       /**< from the origin [m] */
    float intensity;       /**< value of the deformed volume there; CT: Hounsfield units */
    int32_t tetrahedron;   /**< of the fine mesh; of what is cut, the fragment whose tissue that is (pliant_pick_warped) */
    double barycentric[4]; /**< of the point in it */
    double rest[3];        /**< the same piece of tissue at rest, LPS [m] */
    const char *reason;    /**< why nothing is hit, a static text; "" where something is */
} pliant_picked;

/** Pick as pliant_pick_warped does, but do not count voxels of empty materials (air inside elements) as tissue where the ray crosses no isosurface.
 *  With a threshold below all values the result is on the skin, not on the border of the first element.
 *  @param warp draws the model's scan. Errors: as pliant_pick. */
PLIANT_API pliant_status pliant_pick_tissue(const pliant_model *model, const pliant_warp *warp, const double *positions, const pliant_ray *ray,
                                            double threshold, pliant_picked *out);

#ifdef __cplusplus
}
#endif
#endif
