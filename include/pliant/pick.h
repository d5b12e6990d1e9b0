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

/** Find the first point along the ray where the volume, interpolated trilinearly, is not below the threshold and where there
 *  is tissue. A ray that starts in tissue above the threshold hits right there, as it is drawn. With a threshold below all values
 *  that is the first tissue.
 *  Steps of half a voxel, then bisection to 1e-4 voxels; features thinner than a step may be missed.
 *  @param volume    the deformed volume (pliant_warp_volume), or the scan for a mesh at rest
 *  @param positions (mesh->num_nodes x 3) LPS [m]
 *  @param threshold value, slope and intercept applied
 *  Errors: ARGUMENT (a number of the ray or the threshold that is not finite, no direction). */
PLIANT_API pliant_status pliant_pick(const pliant_volume *volume, const pliant_mesh *mesh, const double *positions, const pliant_ray *ray,
                                     double threshold, pliant_picked *out);

/** The same in what a warp has drawn last. Where a GPU has drawn it the ray is followed there, and no volume comes to the host:
 *  the result is the same, bit for bit. Should the GPU fail, the volume is fetched and the CPU picks, with a line in the log.
 *  @param positions (num_nodes x 3) LPS [m], those of the warp's last update
 *  Errors: as pliant_pick. */
PLIANT_API pliant_status pliant_pick_warped(const pliant_warp *warp, const double *positions, const pliant_ray *ray, double threshold,
                                            pliant_picked *out);

/** Pick as pliant_pick_warped does, but do not count voxels of empty materials (air inside elements) as tissue where the ray crosses no isosurface.
 *  With a threshold below all values the result is on the skin, not on the border of the first element.
 *  @param warp draws the model's scan. Errors: as pliant_pick. */
PLIANT_API pliant_status pliant_pick_tissue(const pliant_model *model, const pliant_warp *warp, const double *positions, const pliant_ray *ray,
                                            double threshold, pliant_picked *out);

#ifdef __cplusplus
}
#endif
#endif
