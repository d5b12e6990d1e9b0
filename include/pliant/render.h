/** @file render.h
 *  Pictures of the deformed scan: views of its surface, and radiographs.
 *
 *  Rays pass through the volume, which is interpolated trilinearly. The surface is where the value reaches a threshold,
 *  or where shown tissues begin. The scan's value a
 *  little below it gives its colour. Skin looks like skin, and the face of a cut shows the scan. Rays advance by half a
 *  voxel, then a bisection finds the surface to 2e-4 voxels. Thinner features may be missed. Images are flat, with the
 *  top row first. The CPU and the GPU give the same bits for any number of threads.
 */
#ifndef PLIANT_RENDER_H
#define PLIANT_RENDER_H

#include "pliant/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- CAMERAS */

/** A pinhole camera in the optical convention: x right, y down, z forward. Pixel centres have whole coordinates. Pixel
 *  (column, row) sees along ((column - cx) / fx, (row - cy) / fy, 1), as K of sensor_msgs/CameraInfo defines it. */
typedef struct pliant_camera {
    int32_t width, height; /**< [pixels] */
    double fx, fy, cx, cy; /**< [pixels]; a negative fx or fy mirrors the image */
    double pose[12];       /**< row-major 3 x 4, rotation and translation from the camera's axes to LPS [m] */
    double near, far;      /**< visible range along z [m]. Tissue at near is cut there and shows the scan. far <= 0: no
                            *   limit */
} pliant_camera;

/** Compute a camera with square pixels and a centred axis from its field of view. The pose is the identity, and the
 *  range has no limit.
 *  @param width         [pixels].
 *  @param height        [pixels].
 *  @param field_of_view Along the width [rad].
 *  @param out           Out: the camera. */
PLIANT_API void pliant_camera_of_view(int32_t width, int32_t height, double field_of_view, pliant_camera *out);

/** Set the pose of a camera at a point that looks at another point.
 *  @param camera In/out: only the pose changes.
 *  @param from   (3) Position of the camera, LPS [m].
 *  @param at     (3) Point on the optical axis, LPS [m].
 *  @param up     (3) Direction that is up in the image; not parallel to the optical axis.
 *  @return Errors: ARGUMENT. */
PLIANT_API pliant_status pliant_camera_look_at(pliant_camera *camera, const double from[3], const double at[3],
                                               const double up[3]);

/** An X-ray C-arm in DICOM's terms (PS3.3 C.8.7.5). At angles 0, the detector is in front of the patient and the source
 *  is behind. */
typedef struct pliant_c_arm {
    double isocentre[3];        /**< LPS [m] */
    double source_to_isocentre; /**< DistanceSourceToPatient [m] */
    double source_to_detector;  /**< DistanceSourceToDetector [m] */
    double primary_angle;       /**< PositionerPrimaryAngle: the detector moves to the patient's left (LAO) [rad] */
    double secondary_angle;     /**< PositionerSecondaryAngle: the detector moves to the patient's head (cranial)
                                 *   [rad] */
    int32_t width, height;      /**< size of the detector [pixels] */
    double pixel;               /**< edge length of a detector pixel [m] */
} pliant_c_arm;

/** Compute the camera at the source of a C-arm. As on a viewing box, the patient's left is at the right of the image,
 *  and the head is up.
 *  @param arm The C-arm.
 *  @param out Out: the camera.
 *  @return Errors: ARGUMENT. */
PLIANT_API pliant_status pliant_c_arm_camera(const pliant_c_arm *arm, pliant_camera *out);

/* ---- STYLE */

enum {
    PLIANT_MAX_COLOURS = 16, /**< maximum number of colours of a style */
    PLIANT_NUM_LABELS = 256   /**< number of labels of a style */
};

/** A point of the transfer function. */
typedef struct pliant_colour {
    float value;  /**< value of the scan, with slope and intercept */
    float rgb[3]; /**< 0 .. 1 */
} pliant_colour;

/** Appearance of surfaces. */
typedef struct pliant_style {
    bool by_label;                     /**< the surface is the surface of shown tissues; otherwise it is where the value
                                        *   reaches the threshold */
    float threshold;                   /**< value of the surface, with slope and intercept */
    uint8_t shown[PLIANT_NUM_LABELS];  /**< 1: the label is shown. Labels of a view are numbers of materials, plus 1 */
    int32_t num_colours;               /**< of colours */
    pliant_colour colours[PLIANT_MAX_COLOURS]; /**< transfer function by ascending value, with linear interpolation and
                                                 *   constant ends */
    float beneath;                     /**< largest depth below the surface of the values that colour it [m] */
    float ambient, diffuse, specular;  /**< weights of a light at the camera */
    float background[3];               /**< colour of pixels without a surface, 0 .. 1 */
} pliant_style;

/** Choose a style for a scan. For CT, the threshold is -300 HU and the colours imitate an endoscope. Otherwise,
 *  threshold and greys follow the scan's percentiles. All labels but 0 are shown.
 *  @param scan The scan.
 *  @param out  Out: the style.
 *  @return Errors: MEMORY. */
PLIANT_API pliant_status pliant_style_defaults(const pliant_volume *scan, pliant_style *out);

/** Arrays of the caller for the results of a picture, each Nullable. */
typedef struct pliant_image {
    uint8_t *rgb;   /**< (height x width x 3) */
    float *depth;   /**< (height x width) along z [m]; NaN without a surface */
    uint8_t *label; /**< (height x width) label of the tissue at the surface; 0 without one */
} pliant_image;

/** Linear attenuation of water at 60 keV, about the mean energy of a radiograph's spectrum [1/m]: 0.2059 cm^2/g
 *  (J. H. Hubbell, S. M. Seltzer, NISTIR 5632, table 4). */
#define PLIANT_WATER_ATTENUATION 20.59

/* ---- VIEWS of a model's deformed tissue */

/** opaque: a view has its own volumes, which it updates incrementally when it draws. It uses a GPU if solver/backend
 *  allows it. It is independent of the simulation's thread. */
typedef struct pliant_view pliant_view;

/** Create a view of the tissue at rest.
 *  @param model  Borrowed; must outlive the view.
 *  @param target Nullable: the scan's grid with warp/margin around the tissue at rest. Grid of the deformed volume,
 *                copied.
 *  @param out    Out: free with pliant_view_free.
 *  @return Errors: ARGUMENT, MEMORY. */
PLIANT_API pliant_status pliant_view_create(const pliant_model *model, const pliant_geometry *target,
                                            pliant_view **out);

/** Free a view.
 *  @param view Nullable. */
PLIANT_API void pliant_view_free(pliant_view *view);

/** Set the tissue that a view shows.
 *  @param view      Unchanged after an error.
 *  @param body      A body of the model; retained.
 *  @param positions (body->fine.num_nodes x 3) LPS [m], copied.
 *  @param drawn     Nullable: the view draws its own volume. A warp with these positions, borrowed until the next call:
 *                   the view shows its volume, also on a GPU.
 *  @return Errors: ARGUMENT (not finite, another load), MEMORY. */
PLIANT_API pliant_status pliant_view_set(pliant_view *view, const pliant_body *body, const double *positions,
                                         const pliant_warp *drawn);

/** Render a picture. Labels are numbers of materials, plus 1; empty materials have no label.
 *  @param view   The view.
 *  @param camera The camera.
 *  @param style  Nullable: pliant_style_defaults of the scan.
 *  @param out    Arrays to fill.
 *  @return Errors: ARGUMENT (camera, style), MEMORY. */
PLIANT_API pliant_status pliant_view_render(pliant_view *view, const pliant_camera *camera, const pliant_style *style,
                                            const pliant_image *out);

/** Compute a radiograph of a CT: line integrals of attenuation along the camera's rays. A detector measures exp(-out).
 *  Attenuation is water x (1 + HU / 1000); it is 0 below -1000 HU and outside of the volume.
 *  @param view   The view.
 *  @param camera The camera (pliant_c_arm_camera).
 *  @param water  Attenuation of water [1/m], such as PLIANT_WATER_ATTENUATION.
 *  @param out    (height x width) Out: line integrals.
 *  @return Errors: ARGUMENT (camera, water), MEMORY. */
PLIANT_API pliant_status pliant_view_radiograph(pliant_view *view, const pliant_camera *camera, double water,
                                                float *out);

#ifdef __cplusplus
}
#endif
#endif
