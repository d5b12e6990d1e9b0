/** @file pick.h
 *  A point of the visible isosurface of the deformed volume, along a ray ([H] 3.2).
 */
#ifndef PLIANT_PICK_H
#define PLIANT_PICK_H

#include "pliant/model.h"
#include "pliant/warp.h"

#ifdef __cplusplus
extern "C" {
#endif

/** A ray. */
typedef struct pliant_ray {
    double origin[3];    /**< LPS [m] */
    double direction[3]; /**< any length but 0 */
    double near, far;    /**< searched range, from the origin [m]; far <= 0: no limit */
} pliant_ray;

/** Result of picking. */
typedef struct pliant_picked {
    bool hit;              /**< false: the ray meets no tissue, and only reason is set */
    double point[3];       /**< on the isosurface, LPS [m] */
    double distance;       /**< from the origin [m] */
    float intensity;       /**< value of the deformed volume at the point; CT: Hounsfield units */
    int32_t tetrahedron;   /**< of the fine mesh; in cut tissue, the fragment that has this tissue */
    double barycentric[4]; /**< coordinates of the point in the tetrahedron */
    double rest[3];        /**< rest position of the same tissue, LPS [m] */
    const char *reason;    /**< why the ray hits nothing, static text; "" for a hit */
} pliant_picked;

/** Find the first tissue along a ray whose value is not below a threshold. The volume is interpolated trilinearly. A
 *  ray that starts in such tissue hits at its start. With a threshold below all values, the result is on the skin:
 *  empty materials (air inside elements) do not count as tissue. Rays advance by half a voxel, then a bisection finds
 *  the surface to 1e-4 voxels. Thinner features may be missed. A GPU that draws the volume also picks, with the same
 *  bits. If it fails, the CPU picks and the log says so.
 *  @param model     The model.
 *  @param warp      Draws the model's scan (pliant_data_get_warp).
 *  @param positions (fine.num_nodes x 3) LPS [m], of the warp's last update.
 *  @param ray       The ray.
 *  @param threshold Value, with slope and intercept.
 *  @param out       Out: the result.
 *  @return Errors: ARGUMENT (a number is not finite, or the direction is 0), MEMORY. */
PLIANT_API pliant_status pliant_pick_tissue(const pliant_model *model, const pliant_warp *warp, const double *positions,
                                            const pliant_ray *ray, double threshold, pliant_picked *out);

#ifdef __cplusplus
}
#endif
#endif
