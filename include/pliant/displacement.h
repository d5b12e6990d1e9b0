/** @file displacement.h
 *  Displacement fields, for programs that resample or register volumes. Vectors have patient LPS axes, in metres in
 *  memory and in millimetres in files.
 */
#ifndef PLIANT_DISPLACEMENT_H
#define PLIANT_DISPLACEMENT_H

#include "pliant/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Direction of the vectors. */
typedef enum pliant_displacement_sense {
    PLIANT_DISPLACEMENT_RESAMPLE, /**< from a voxel of the deformed volume to the rest position of its tissue. ITK's
                                   *   displacement field transform resamples the undeformed scan into the deformed
                                   *   volume with these vectors */
    PLIANT_DISPLACEMENT_TISSUE    /**< from a voxel of the undeformed scan to the deformed position of its tissue */
} pliant_displacement_sense;

/** Validity of the vector of a voxel. */
typedef enum pliant_displacement_mask {
    PLIANT_MASK_NO_TISSUE, /**< no tissue: the voxel has the vector of the nearest tissue */
    PLIANT_MASK_TISSUE,    /**< tissue */
    PLIANT_MASK_CUT        /**< near a cut: an interpolated vector mixes the cut's two sides */
} pliant_displacement_mask;

/** A displacement field. */
typedef struct pliant_displacement {
    pliant_geometry geometry; /**< grid of the vectors */
    float *vectors; /**< (voxels x 3) LPS [m]; owned; pliant_displacement_free */
    uint8_t *mask;  /**< (voxels) pliant_displacement_mask; owned */
} pliant_displacement;

/** Compute the displacement field of a body at given positions. With sense RESAMPLE
 *  it uses the map of the deformed volume (warp.h). The scan, interpolated trilinearly, then equals the deformed
 *  volume wherever the mask is PLIANT_MASK_TISSUE. With warp/hide_empty this holds for the drawn volume instead of the
 *  scan.
 *  @param model     The model.
 *  @param body      Body of the model, or of its simulation (pliant_data_get_body).
 *  @param positions (body->fine.num_nodes x 3) LPS [m].
 *  @param sense     Direction of the vectors.
 *  @param target    Any grid. NULL: with RESAMPLE the grid of the deformed volume (pliant_warp_target, warp/margin),
 *                   with TISSUE the scan's.
 *  @param out       Out: free with pliant_displacement_free.
 *  @return Errors: ARGUMENT (a position is not finite), MEMORY. */
PLIANT_API pliant_status pliant_displacement_create(const pliant_model *model, const pliant_body *body,
                                                    const double *positions, pliant_displacement_sense sense,
                                                    const pliant_geometry *target, pliant_displacement *out);

/** Free a displacement field and zero the struct.
 *  @param displacement Nullable. */
PLIANT_API void pliant_displacement_free(pliant_displacement *displacement);

/** Write the vectors [mm] as ITK writes a displacement field. The mask becomes a label map with the same name and _mask
 *  before its ending. ITK and 3D Slicer read the field as a grid transform.
 *  @param path         Its ending selects the format: .nii, .nii.gz, .nrrd, .mha.
 *  @param displacement The field.
 *  @return Errors: as of pliant_volume_write. */
PLIANT_API pliant_status pliant_displacement_write(const char *path, const pliant_displacement *displacement);

#ifdef __cplusplus
}
#endif
#endif
