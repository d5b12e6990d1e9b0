/** @file segment.h
 *  Tissues by intensity alone ([C] 4.1, V-GMM): a Gaussian mixture fitted to the whole volume, neighbours that agree, connected pieces.
 *
 *  What comes out is a label map whose labels are pieces: connected voxels of one class, numbered from the largest. A user picks targets
 *  among them by number; a material table names them as any labels.
 */
#ifndef PLIANT_SEGMENT_H
#define PLIANT_SEGMENT_H

#include "pliant/scan.h"
#include "pliant/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_MAX_CLASSES = 16 };

typedef struct pliant_segment_options {
    int32_t classes;      /**< of the mixture, 1 to PLIANT_MAX_CLASSES; 0: the number with the best BIC */
    int32_t most_classes; /**< that BIC may choose */
    double coherence;     /**< what one of six neighbours in the same class weighs [log probability]; 0: voxels stand alone */
    double smallest;      /**< pieces below this volume join their neighbours [m^3] */
    int num_threads;      /**< 0: as many as the machine has cores */
    pliant_backend_choice backend; /**< auto: a GPU if one can be used; it gives the CPU's labels */
} pliant_segment_options;

/** Take the options from a scene. segment/smallest: auto becomes 1e-6 m^3, or 0.0005 of the scan's volume where that is less. */
PLIANT_API void pliant_segment_options_from(const pliant_scene *scene, const pliant_geometry *scan, pliant_segment_options *out);

/** Class of the mixture, by ascending mean. */
typedef struct pliant_segment_class {
    double weight, mean, deviation; /**< values with slope and intercept */
} pliant_segment_class;

typedef struct pliant_segment_piece {
    int32_t class_index;
    double mean;           /**< intensity */
    double volume;         /**< [m^3] */
    double centre[3];      /**< mean of the voxels' centres, LPS [m] */
} pliant_segment_piece;

typedef struct pliant_segmentation {
    pliant_segment_class classes[PLIANT_MAX_CLASSES];
    int32_t num_classes;
    double criterion;      /**< BIC of the mixture; lower is better */
    pliant_labels labels;  /**< piece + 1 for every voxel */
    pliant_segment_piece *pieces; /**< (num_pieces) largest first; those of one volume in the order of their first voxels */
    int32_t num_pieces;
} pliant_segmentation;

/** Free with pliant_segmentation_free. The same volume and options give the same result whatever the number of threads.
 *  Errors: ARGUMENT (options, a value that is not finite), UNAVAILABLE (a GPU that was asked for), MEMORY, FORMAT (more than 65535 pieces: take a larger smallest piece). */
PLIANT_API pliant_status pliant_segment(const pliant_volume *scan, const pliant_segment_options *options, pliant_segmentation *out);
PLIANT_API void pliant_segmentation_free(pliant_segmentation *segmentation); /**< Nullable; leaves the struct zeroed */

#ifdef __cplusplus
}
#endif
#endif
