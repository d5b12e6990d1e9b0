/** @file segment.h
 *  Segmentation by intensity ([C] 4.1, V-GMM): a Gaussian mixture of the values of the whole volume, a Markov random
 *  field over neighbours, and connected pieces.
 *
 *  The result is a label map. Each label is a piece: connected voxels of one class, numbered from the largest piece. A
 *  material table assigns materials to these labels as to any others.
 */
#ifndef PLIANT_SEGMENT_H
#define PLIANT_SEGMENT_H

#include "pliant/scan.h"
#include "pliant/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_MAX_CLASSES = 16 /**< maximum number of classes of the mixture */ };

/** Options of a segmentation; pliant_segment_options_from fills them from a scene. */
typedef struct pliant_segment_options {
    int32_t classes;      /**< number of classes, 1 to PLIANT_MAX_CLASSES; 0: the number with the lowest BIC */
    int32_t max_classes; /**< largest number of classes that BIC may select */
    double coherence;     /**< Markov random field weight per neighbour of the same class [log probability]; 0: voxels
                           *   are independent */
    double min_volume;      /**< pieces below this volume are merged into their neighbours [m^3] */
    int num_threads;      /**< 0: the number of cores */
    pliant_backend_choice backend; /**< auto: a GPU if there is one; it gives the same labels as the CPU */
} pliant_segment_options;

/** Class of the mixture. Values include slope and intercept. */
typedef struct pliant_segment_class {
    double weight;    /**< fraction of the voxels */
    double mean;      /**< mean value */
    double deviation; /**< standard deviation of the values */
} pliant_segment_class;

/** Connected voxels of one class. */
typedef struct pliant_segment_piece {
    int32_t class_index;   /**< into pliant_segmentation.classes */
    double mean;           /**< mean value */
    double volume;         /**< [m^3] */
    double centre[3];      /**< mean of the centres of its voxels, LPS [m] */
} pliant_segment_piece;

/** Result of a segmentation. */
typedef struct pliant_segmentation {
    pliant_segment_class classes[PLIANT_MAX_CLASSES]; /**< (num_classes) by ascending mean */
    int32_t num_classes;
    double criterion;      /**< BIC of the mixture; lower is better */
    pliant_labels labels;  /**< number of the piece + 1 for every voxel */
    pliant_segment_piece *pieces; /**< (num_pieces) the largest first; equal volumes in the order of their first
                                   *   voxels */
    int32_t num_pieces;
} pliant_segmentation;

/** Fill the options of a segmentation from a scene (group `segment`).
 *  @param scene The scene. segment/min_volume: auto becomes 1e-6 m^3, or 0.0005 of the scan's volume if that is less.
 *  @param scan  Grid of the scan.
 *  @param out   Out: the options. */
PLIANT_API void pliant_segment_options_from(const pliant_scene *scene, const pliant_geometry *scan,
                                            pliant_segment_options *out);

/** Segment a scan. The result does not depend on the number of threads.
 *  @param scan    The scan.
 *  @param options The options.
 *  @param out     Out: free with pliant_segmentation_free. Unchanged after an error.
 *  @return Errors: ARGUMENT (options, or a value that is not finite), UNAVAILABLE (no GPU for backend cuda), MEMORY,
 *          FORMAT (more than 65535 pieces: use a larger smallest volume). */
PLIANT_API pliant_status pliant_segment(const pliant_volume *scan, const pliant_segment_options *options,
                                        pliant_segmentation *out);

/** Free a segmentation and zero the struct.
 *  @param segmentation Nullable. */
PLIANT_API void pliant_segmentation_free(pliant_segmentation *segmentation);

#ifdef __cplusplus
}
#endif
#endif
