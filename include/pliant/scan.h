/** @file scan.h
 *  Volumes and label maps: geometry, storage, reading, writing, and the built-in phantom.
 *
 *  A volume is flat, i fastest: voxel (i, j, k) is voxels[i + size[0] * (j + size[1] * k)]. Its centre is at
 *  origin + direction * diag(spacing) * (i, j, k) in patient LPS axes [m]. The direction is a row-major 3 x 3 matrix.
 *  Its columns are the unit vectors of the i, j and k axes. It is orthonormal and may be left-handed (flipped axes).
 */
#ifndef PLIANT_SCAN_H
#define PLIANT_SCAN_H

#include "pliant/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- TYPES */

/** Type of a stored voxel. */
typedef enum pliant_encoding { PLIANT_UINT8 = 1, PLIANT_INT16 = 2, PLIANT_FLOAT32 = 3 } pliant_encoding;

/** Grid of a volume. */
typedef struct pliant_geometry {
    int32_t size[3];     /**< number of voxels along i, j, k */
    double origin[3];    /**< centre of voxel (0, 0, 0), LPS [m] */
    double spacing[3];   /**< distance of voxel centres along i, j, k [m] */
    double direction[9]; /**< row-major; columns are the i, j and k axes */
} pliant_geometry;

/** Kind of a scan, as the header of its file says. */
typedef enum pliant_modality {
    PLIANT_MODALITY_UNKNOWN, /**< the header names none */
    PLIANT_MODALITY_CT,      /**< values are Hounsfield units */
    PLIANT_MODALITY_MR,      /**< magnetic resonance */
    PLIANT_MODALITY_OTHER    /**< another kind, such as PET or ultrasound */
} pliant_modality;

/** A scan, or the deformed volume. */
typedef struct pliant_volume {
    pliant_geometry geometry;
    pliant_encoding encoding;
    float slope, intercept; /**< value = slope * stored + intercept; CT: Hounsfield units */
    float background;       /**< stored value outside of the scan (CT: air) */
    pliant_modality modality; /**< from DICOM Modality, fields of this name in NRRD and MetaImage, or an echo time
                               *   in NIfTI's descrip */
    void *voxels;           /**< owned; pliant_volume_free */
    char id[128];           /**< name for people and messages: file name or "phantom" */
} pliant_volume;

/** A segment of a segmentation file (.seg.nrrd, DICOM SEG), or a label with a name in NIfTI (as TotalSegmentator writes
 *  it). Texts are UTF-8 of at most 63 bytes, "" if the file has none. */
typedef struct pliant_label_segment {
    uint16_t label;       /**< value in the label map */
    uint16_t value;       /**< value in the file: SegmentN_LabelValue, SegmentNumber. It differs from label if layers
                           *   repeat values */
    char name[64];        /**< SegmentN_Name, SegmentLabel */
    char identifier[64];  /**< SegmentN_ID */
    char terminology[64]; /**< type and modifier of the terminology entry; meaning of the property type in DICOM SEG */
    float color[3];       /**< red, green, blue in 0 .. 1; negative if the file has none */
    uint32_t is_class;    /**< 1: the value is the id of a class (NIfTI), and its material has this label; 0: its
                           *   material has its name */
} pliant_label_segment;

/** Label map on the grid of its scan. 0 is no label. */
typedef struct pliant_labels {
    pliant_geometry geometry;
    uint16_t *voxels; /**< owned; pliant_labels_free */
    pliant_label_segment *segments; /**< (num_segments) owned; NULL for a label map without names */
    uint32_t num_segments;
} pliant_labels;

/* ---- GRIDS */

/** Count the voxels of a grid.
 *  @param geometry The grid.
 *  @return The number; 0 if a size is below 1 or the number overflows. */
PLIANT_API size_t pliant_geometry_voxels(const pliant_geometry *geometry);

/** Transform a continuous voxel index to a point.
 *  @param geometry The grid.
 *  @param index    (3) Continuous index; whole numbers are centres of voxels.
 *  @param world    (3) Out: LPS [m]. */
PLIANT_API void pliant_geometry_to_world(const pliant_geometry *geometry, const double index[3], double world[3]);

/** Transform a point to a continuous voxel index.
 *  @param geometry The grid.
 *  @param world    (3) LPS [m].
 *  @param index    (3) Out: continuous index, which may lie outside of the grid. */
PLIANT_API void pliant_geometry_to_index(const pliant_geometry *geometry, const double world[3], double index[3]);

/* ---- MEMORY */

/** Allocate a volume with zero voxels, slope 1 and intercept 0.
 *  @param geometry Copied.
 *  @param encoding Type of the voxels.
 *  @param out      Out: free with pliant_volume_free.
 *  @return Errors: ARGUMENT (sizes, spacing, direction), MEMORY. */
PLIANT_API pliant_status pliant_volume_create(const pliant_geometry *geometry, pliant_encoding encoding,
                                              pliant_volume *out);

/** Free the voxels of a volume and zero the struct.
 *  @param volume Nullable. */
PLIANT_API void pliant_volume_free(pliant_volume *volume);

/** Allocate a label map without labels.
 *  @param geometry Copied.
 *  @param out      Out: free with pliant_labels_free.
 *  @return Errors: ARGUMENT (sizes, spacing, direction), MEMORY. */
PLIANT_API pliant_status pliant_labels_create(const pliant_geometry *geometry, pliant_labels *out);

/** Free the voxels and segments of a label map and zero the struct.
 *  @param labels Nullable. */
PLIANT_API void pliant_labels_free(pliant_labels *labels);

/** Return the value of a voxel, with slope and intercept applied.
 *  @param volume The volume.
 *  @param index  Flat index, below the number of voxels.
 *  @return The value; CT: Hounsfield units. */
PLIANT_API float pliant_volume_value(const pliant_volume *volume, size_t index);

/* ---- FILES */

/** Read a scan from a folder with a DICOM series, or from a file.
 *
 *  A series has one image per file, or is an enhanced or legacy converted CT or MR with several frames. Files are DICOM
 *  with several frames, NIfTI-1 or 2 (.nii, .nii.gz, .hdr with its .img), NRRD (.nrrd, .nhdr; raw or gzip), or
 *  MetaImage (.mha, .mhd).
 *  - Voxels are UINT8 or INT16 with slope 1 if rescaled values are integers of this range. Otherwise they are FLOAT32.
 *  - Slice spacing follows from slice positions. Rounded positions are accepted with a warning: at most 0.1 mm or 5 %
 *    of the spacing.
 *  - Scouts, colour pictures and empty files of a series are ignored with a warning.
 *  - PixelPaddingValue becomes air, or the darkest value.
 *  - MONOCHROME1 inverts intensities without a unit (smallest + largest - value). Hounsfield units, activities and
 *    counts stay.
 *  - The image must be complete: a regular 3-D grid with right angles and one finite value per voxel.
 *  - A child process decompresses JPEG, JPEG-LS and JPEG 2000 with GDCM, so that a damaged image cannot end this
 *    process.
 *  @param path         Folder or file.
 *  @param series       Nullable: DICOM SeriesInstanceUID, or its unique ending, if the folder contains several series.
 *  @param memory_limit Maximum size of the voxels [bytes], checked from the header before any allocation; 0: the free
 *                      memory.
 *  @param out          Out: free with pliant_volume_free. Unchanged after an error.
 *  @return Errors: FILE, FORMAT (with the file and the reason), MEMORY, ARGUMENT (path is NULL). */
PLIANT_API pliant_status pliant_volume_read(const char *path, const char *series, size_t memory_limit,
                                            pliant_volume *out);

/** Read a label map with whole numbers in 0 .. 65535, to within 1e-3; scaled values are rounded.
 *
 *  The file has a format of scans, or it is a segmentation: a .seg.nrrd of 3D Slicer with one or several layers, a
 *  DICOM SEG (a file, or a folder with one file), or a folder with one mask per segment (liver.nii.gz, as
 *  TotalSegmentator writes it). Segmentations name their labels in out->segments. Where segments overlap, the later
 *  segment wins, with a warning. A label is the value of the segment in the file if no two segments share a value.
 *  Otherwise it is the segment's position in the file, counted from 1. A map without a label is read with a warning.
 *  @param path         Folder or file.
 *  @param memory_limit See pliant_volume_read [bytes].
 *  @param out          Out: free with pliant_labels_free. Unchanged after an error.
 *  @return Errors: FILE, FORMAT (with the file and the reason), MEMORY, ARGUMENT (path is NULL). */
PLIANT_API pliant_status pliant_labels_read(const char *path, size_t memory_limit, pliant_labels *out);

/** Write a volume in millimetres. UINT8 and INT16 keep their stored type; otherwise slope and intercept are applied.
 *  @param path   Its ending selects the format: .nii, .nii.gz, .nrrd, .mha. An existing file is replaced after the new
 *                file is complete.
 *  @param volume The volume.
 *  @return Errors: ARGUMENT (ending), FILE, FORMAT (too long for NIfTI), MEMORY. */
PLIANT_API pliant_status pliant_volume_write(const char *path, const pliant_volume *volume);

/** Write a label map as pliant_volume_write writes a volume. Names of segments are not written.
 *  @param path   See pliant_volume_write.
 *  @param labels The label map.
 *  @return Errors: as of pliant_volume_write. */
PLIANT_API pliant_status pliant_labels_write(const char *path, const pliant_labels *labels);

/* ---- PHANTOM */

/** X(label, name) of the phantom's label map. */
#define PLIANT_PHANTOM_LIST(X)                                                                              \
    X(1, skin) X(2, fat) X(3, muscle) X(4, liver) X(5, tumour) X(6, kidney_left) X(7, kidney_right)          \
    X(8, spleen) X(9, aorta) X(10, vessel) X(11, spine) X(12, rib) X(13, hip) X(14, bowel) X(15, bowel_gas)

/** Generate the built-in scan: an abdomen in Hounsfield units with noise, and its label map. The box is 0.40 x 0.29 x
 *  0.30 m around the origin. Voxels are INT16 with slope 1; air is -1000, with label 0. The same size and seed give the
 *  same bits on every machine.
 *  @param size   (3) Number of voxels, each at least 16. The spacing follows from it.
 *  @param seed   Seed of the noise; the label map does not depend on it.
 *  @param scan   Out: free with pliant_volume_free.
 *  @param labels Nullable, out: free with pliant_labels_free.
 *  @return Errors: ARGUMENT, MEMORY. */
PLIANT_API pliant_status pliant_phantom(const int32_t size[3], uint32_t seed, pliant_volume *scan,
                                        pliant_labels *labels);

#ifdef __cplusplus
}
#endif
#endif
