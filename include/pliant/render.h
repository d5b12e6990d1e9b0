/** @file render.h
 *  Pictures of the deformed scan: what a camera sees of its surface, and radiographs.
 *
 *  Rays are cast through the volume itself, interpolated trilinearly: the surface is where its value reaches a threshold, or where tissues
 *  that are to be seen begin; it is coloured by the scan's value a little beneath it, so that skin looks like skin and the face of a cut
 *  shows the scan. Steps of half a voxel, then bisection to 2e-4 voxels; features thinner than a step may be missed.
 *  Images are flat, top row first; the CPU, whatever its threads, and the GPU draw the same bits.
 */
#ifndef PLIANT_RENDER_H
#define PLIANT_RENDER_H

#include "pliant/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/** A pinhole camera in the optical convention: x right, y down, z forward. Pixel (column, row) has its centre at those numbers and sees
 *  along ((column - cx) / fx, (row - cy) / fy, 1), as K of a sensor_msgs/CameraInfo says it. */
typedef struct pliant_camera {
    int32_t width, height; /**< [pixels] */
    double fx, fy, cx, cy; /**< [pixels]; a negative fx or fy mirrors the image */
    double pose[12];       /**< row-major 3 x 4, rotation and translation: from the camera's axes to LPS [m] */
    double near, far;      /**< part that is seen, along z [m]; tissue that lies at near is cut there and shows the scan. far <= 0: without end */
} pliant_camera;

/** Intrinsics from the field of view along the width [rad]: square pixels, the axis through the middle. The pose is the identity. */
PLIANT_API void pliant_camera_of_view(int32_t width, int32_t height, double field_of_view, pliant_camera *out);
/** At a place, looking at a point. @param up direction that is up in the image, not along the view. Errors: ARGUMENT. */
PLIANT_API pliant_status pliant_camera_look_at(pliant_camera *camera, const double from[3], const double at[3], const double up[3]);

/** An X-ray C-arm in DICOM's terms (PS3.3 C.8.7.5): angles 0 have the detector in front of a patient, the source behind. */
typedef struct pliant_c_arm {
    double isocentre[3];        /**< LPS [m] */
    double source_to_isocentre; /**< DistanceSourceToPatient [m] */
    double source_to_detector;  /**< DistanceSourceToDetector [m] */
    double primary_angle;       /**< PositionerPrimaryAngle: the detector moves to the patient's left (LAO) [rad] */
    double secondary_angle;     /**< PositionerSecondaryAngle: to the patient's head (cranial) [rad] */
    int32_t width, height;      /**< of the detector [pixels] */
    double pixel;               /**< edge of a detector's pixel [m] */
} pliant_c_arm;
/** The camera that stands for it, at its source: the patient's left is on the right of the image, as on a viewing box, the head up.
 *  Errors: ARGUMENT. */
PLIANT_API pliant_status pliant_c_arm_camera(const pliant_c_arm *arm, pliant_camera *out);

enum { PLIANT_MOST_COLOURS = 16, PLIANT_NUM_LABELS = 256 };

typedef struct pliant_colour {
    float value;  /**< of the scan, slope and intercept applied */
    float rgb[3]; /**< 0 .. 1 */
} pliant_colour;

/** How surfaces look. */
typedef struct pliant_style {
    bool by_label;                     /**< the surface is that of the tissues in shown, not where the value reaches the threshold */
    float threshold;                   /**< value, slope and intercept applied */
    uint8_t shown[PLIANT_NUM_LABELS];  /**< 1: the label is seen; of a view labels are numbers of materials, plus 1 */
    int32_t num_colours;               /**< transfer function: by ascending value, interpolated between, the outermost go on */
    pliant_colour colours[PLIANT_MOST_COLOURS];
    float beneath;                     /**< down to where below the surface values are taken for its colour [m] */
    float ambient, diffuse, specular;  /**< of a light at the camera */
    float background[3];               /**< where no surface is, 0 .. 1 */
} pliant_style;

/** For a scan: of a CT the threshold is -300 HU, and colours are those that tissues have in an endoscope; otherwise threshold and greys follow
 *  its percentiles. All labels but 0 are shown. Errors: MEMORY. */
PLIANT_API pliant_status pliant_style_defaults(const pliant_volume *scan, pliant_style *out);

/** What is asked for: arrays of the caller's, each Nullable. */
typedef struct pliant_image {
    uint8_t *rgb;   /**< (height x width x 3) */
    float *depth;   /**< (height x width) along z [m]; NaN where no surface is */
    uint8_t *label; /**< (height x width) of the tissue at the surface; 0: none, or not known */
} pliant_image;

/** Linear attenuation of water at 60 keV, about the mean energy of a radiograph's spectrum [1/m]: 0.2059 cm^2/g
 *  (J. H. Hubbell, S. M. Seltzer, NISTIR 5632, table 4). */
#define PLIANT_WATER_ATTENUATION 20.59

/** Sees the tissue of a model as it is deformed. It keeps volumes of its own, redone only as far as tissue has moved when a picture asks for
 *  them, and runs on a GPU where solver/backend says so: an object of its own, to be used beside the simulation's thread. */
typedef struct pliant_view pliant_view;

/** @param target Nullable: grid of the deformed volume; the scan's with warp/margin around the tissue at rest. Tissue is at rest at first.
 *  Errors: ARGUMENT, MEMORY. */
PLIANT_API pliant_status pliant_view_create(const pliant_model *model, const pliant_geometry *target, pliant_view **out);
PLIANT_API void pliant_view_free(pliant_view *view); /**< Nullable */

/** Where the tissue is from now on.
 *  @param body      of the model's load; retained
 *  @param positions (body->fine.num_nodes x 3) LPS [m], copied
 *  @param drawn     Nullable: a warp that has drawn these positions, borrowed until the next call: its volume is seen, on the GPU where it lies there.
 *                   NULL: the view draws its own
 *  Errors (as it was before): MEMORY, ARGUMENT (not finite; another load). */
PLIANT_API pliant_status pliant_view_set(pliant_view *view, const pliant_body *body, const double *positions, const pliant_warp *drawn);

/** The tissue as it was set last. Labels are numbers of materials, plus 1; empty materials are none.
 *  @param style Nullable: pliant_style_defaults of the scan. Errors: as pliant_render. */
PLIANT_API pliant_status pliant_view_render(pliant_view *view, const pliant_camera *camera, const pliant_style *style, const pliant_image *out);
/** Errors: as pliant_radiograph. */
PLIANT_API pliant_status pliant_view_radiograph(pliant_view *view, const pliant_camera *camera, double water, float *out);

#ifdef __cplusplus
}
#endif
#endif
