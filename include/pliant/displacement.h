/** @file displacement.h
 *  The displacement of every voxel, for programs that resample or register volumes.
 *
 *  Two senses, which differ by which grid the vectors belong to:
 *  - PLIANT_DISPLACEMENT_RESAMPLE: from a voxel of the deformed volume to where its tissue was at rest. ITK's displacement field transform
 *    with these vectors resamples the undeformed scan into the deformed volume.
 *  - PLIANT_DISPLACEMENT_TISSUE: from a voxel of the undeformed scan to where its tissue is.
 *
 *  Vectors have patient LPS axes, in memory in metres, in files in millimetres.
 */
#ifndef PLIANT_DISPLACEMENT_H
#define PLIANT_DISPLACEMENT_H

#include "pliant/model.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum pliant_displacement_sense { PLIANT_DISPLACEMENT_RESAMPLE, PLIANT_DISPLACEMENT_TISSUE } pliant_displacement_sense;

/** What a voxel of the mask says. */
typedef enum pliant_displacement_mask {
    PLIANT_MASK_NO_TISSUE, /**< no tissue: the vector is that of the nearest tissue */
    PLIANT_MASK_TISSUE,
    PLIANT_MASK_CUT        /**< a cut lies so near that an interpolated vector mixes the cut's two sides */
} pliant_displacement_mask;

typedef struct pliant_displacement {
    pliant_geometry geometry;
    float *vectors; /**< (voxels x 3) LPS [m]; owned; pliant_displacement_free */
    uint8_t *mask;  /**< (voxels) pliant_displacement_mask; owned */
} pliant_displacement;

/** The displacement field of a body at these positions. In the sense RESAMPLE it is computed as the deformed volume is (warp.h). So the scan,
 *  interpolated trilinearly there, equals the deformed volume wherever the mask is PLIANT_MASK_TISSUE.
 *  With warp/hide_empty this holds for the volume that is drawn (pliant_model_get_drawn) instead of the scan.
 *  @param body      of the model, or of a simulation of it (pliant_data_get_body)
 *  @param positions (body's fine.num_nodes x 3) LPS [m]
 *  @param target    any grid; NULL: with sense RESAMPLE that of the deformed volume (pliant_warp_target, warp/margin), with sense TISSUE the scan's
 *  Errors: ARGUMENT (a position is not finite), MEMORY. */
PLIANT_API pliant_status pliant_displacement_create(const pliant_model *model, const pliant_body *body, const double *positions,
                                                    pliant_displacement_sense sense, const pliant_geometry *target, pliant_displacement *out);
PLIANT_API void pliant_displacement_free(pliant_displacement *displacement); /**< Nullable; leaves the struct zeroed */

/** Write the vectors [mm] by the ending of path (.nii, .nii.gz, .nrrd, .mha) as ITK writes a displacement field. Write the mask as a
 *  label map to the same name with _mask before its ending. ITK and 3D Slicer read the field as a grid transform. Errors: as of pliant_volume_write. */
PLIANT_API pliant_status pliant_displacement_write(const char *path, const pliant_displacement *displacement);

#ifdef __cplusplus
}
#endif
#endif
