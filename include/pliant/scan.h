/** @file scan.h
 *  Volumes: geometry, storage, reading, writing, resampling, the built-in phantom.
 *
 *  A volume is flat, i fastest: voxel (i, j, k) is at voxels[i + size[0] * (j + size[1] * k)].
 *  Its centre lies at  origin + direction * diag(spacing) * (i, j, k)  in patient LPS axes [m].
 *  Direction is row-major, its columns are the unit vectors of the i, j and k axes; it is orthonormal and may
 *  be left-handed (flipped axes).
 */
#ifndef PLIANT_SCAN_H
#define PLIANT_SCAN_H

#include "pliant/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum pliant_encoding { PLIANT_UINT8 = 1, PLIANT_INT16 = 2, PLIANT_FLOAT32 = 3 } pliant_encoding;

typedef struct pliant_geometry {
    int32_t size[3];     /**< voxels along i, j, k */
    double origin[3];    /**< centre of voxel (0, 0, 0), LPS [m] */
    double spacing[3];   /**< [m] */
    double direction[9]; /**< row-major, columns are the axes */
} pliant_geometry;

/** What the header of a file says that its values are. */
typedef enum pliant_modality {
    PLIANT_MODALITY_UNKNOWN, /**< nothing */
    PLIANT_MODALITY_CT,      /**< Hounsfield units */
    PLIANT_MODALITY_MR,
    PLIANT_MODALITY_OTHER    /**< something else: PET, ultrasound */
} pliant_modality;

typedef struct pliant_volume {
    pliant_geometry geometry;
    pliant_encoding encoding;
    float slope, intercept; /**< value = slope * stored + intercept; CT: Hounsfield units */
    float background;       /**< stored value outside the scan (CT: air) */
    pliant_modality modality; /**< DICOM Modality, NRRD and MetaImage fields of that name, an echo time in NIfTI's descrip */
    void *voxels;           /**< owned; pliant_volume_free */
    char id[128];           /**< name for people and messages: file name or "phantom" */
} pliant_volume;

/** A segment of a segmentation file (.seg.nrrd, DICOM SEG), or a label that NIfTI names (as TotalSegmentator writes it). Texts are UTF-8, cut to 63 bytes, "" where the file has none. */
typedef struct pliant_label_segment {
    uint16_t label;       /**< in the label map */
    uint16_t value;       /**< in the file: SegmentN_LabelValue, SegmentNumber. It differs from label if layers repeat values */
    char name[64];        /**< SegmentN_Name, SegmentLabel */
    char identifier[64];  /**< SegmentN_ID */
    char terminology[64]; /**< type and modifier of the terminology entry; meaning of the property type in DICOM SEG */
    float color[3];       /**< red, green, blue, 0 .. 1; negative where the file has none */
    uint32_t is_class;    /**< 1: the value is the id of a class (NIfTI), and its material has this label; 0: its material has its name */
} pliant_label_segment;

/** Label map on the grid of its scan; 0 is "no label". */
typedef struct pliant_labels {
    pliant_geometry geometry;
    uint16_t *voxels; /**< owned; pliant_labels_free */
    pliant_label_segment *segments; /**< owned; NULL for a label map without names */
    uint32_t num_segments;
} pliant_labels;

/** Voxels of a grid; 0 when a size is below 1 or they are too many to be counted. */
PLIANT_API size_t pliant_geometry_voxels(const pliant_geometry *geometry);
/** Continuous index -> LPS [m], and back. */
PLIANT_API void pliant_geometry_to_world(const pliant_geometry *geometry, const double index[3], double world[3]);
PLIANT_API void pliant_geometry_to_index(const pliant_geometry *geometry, const double world[3], double index[3]);

/** Zeroed voxels for a geometry. Errors: ARGUMENT (sizes, spacing, direction), MEMORY. */
PLIANT_API pliant_status pliant_volume_create(const pliant_geometry *geometry, pliant_encoding encoding, pliant_volume *out);
PLIANT_API void pliant_volume_free(pliant_volume *volume); /**< Nullable; leaves the struct zeroed */
PLIANT_API pliant_status pliant_labels_create(const pliant_geometry *geometry, pliant_labels *out);
PLIANT_API void pliant_labels_free(pliant_labels *labels);

/** Value (slope and intercept applied) of the voxel at a flat index. */
PLIANT_API float pliant_volume_value(const pliant_volume *volume, size_t index);

/** Read a scan. It is a folder with a DICOM series (an image per file, or enhanced and legacy converted CT and MR of several frames). Or it
 *  is a file: DICOM of several frames, NIfTI-1 or 2 (.nii, .nii.gz, .hdr with its .img), NRRD (.nrrd, .nhdr; raw or gzip), MetaImage (.mha, .mhd).
 *  @param series       Nullable: DICOM SeriesInstanceUID (or its unique ending) where a folder holds several
 *  @param memory_limit maximum number of bytes for voxels, checked from the header before any is allocated; 0: the free memory
 *  Integer data whose rescaled values fit are kept as UINT8 or INT16 with slope 1, all else is FLOAT32. Slice spacing comes from positions.
 *  Scouts, colour pictures and empty files in a series are left out with a warning. PixelPaddingValue becomes air, or the darkest value.
 *  MONOCHROME1 inverts intensities without a unit (smallest + largest - value); Hounsfield units, activities and counts keep their values.
 *  The image must be one regular 3-D grid with right angles of one finite value per voxel, and complete. Otherwise it is refused with the
 *  file and the reason. A child process decompresses JPEG, JPEG-LS and JPEG 2000 with GDCM, so that a damaged image cannot end this one.
 *  Rounded slice positions, at most 0.1 mm or 5 % of the spacing from regular ones, are accepted with a warning.
 *  Errors (old *out untouched): FILE, FORMAT, MEMORY, ARGUMENT (path NULL). */
PLIANT_API pliant_status pliant_volume_read(const char *path, const char *series, size_t memory_limit, pliant_volume *out);
/** Read a label map: whole numbers in 0 .. 65535, to 1e-3 (scaled ones are rounded). A map without a label is read with a warning.
 *  It has the format of a scan, or it is a segmentation. There are three kinds of segmentations: a .seg.nrrd of 3D Slicer with one or
 *  several layers; a DICOM SEG (a file, or a folder with one); a folder with a mask per segment (liver.nii.gz, as TotalSegmentator writes).
 *  Its labels are named by labels->segments. Where segments overlap the later one wins, with a warning. A label is the
 *  value of the segment in the file if no two segments share a value, and its position in the file (from 1) otherwise. */
PLIANT_API pliant_status pliant_labels_read(const char *path, size_t memory_limit, pliant_labels *out);

/** Write by the ending of path (.nii, .nii.gz, .nrrd, .mha), millimetres and values as others expect them: UINT8
 *  and INT16 stay what they are, slope and intercept are applied otherwise. The file is complete or not there; one
 *  that was there before is replaced at the end. Errors: ARGUMENT (ending), FILE, FORMAT (too long for NIfTI), MEMORY. */
PLIANT_API pliant_status pliant_volume_write(const char *path, const pliant_volume *volume);
PLIANT_API pliant_status pliant_labels_write(const char *path, const pliant_labels *labels);

/** Label ids of the phantom. */
#define PLIANT_PHANTOM_LIST(X)                                                                              \
    X(1, skin) X(2, fat) X(3, muscle) X(4, liver) X(5, tumour) X(6, kidney_left) X(7, kidney_right)          \
    X(8, spleen) X(9, aorta) X(10, vessel) X(11, spine) X(12, rib) X(13, hip) X(14, bowel) X(15, bowel_gas)

/** The built-in scan: an abdomen in Hounsfield units with noise, and its label map (0 is air outside).
 *  Deterministic: the same size and seed give the same bits on every machine.
 *  The box is 0.40 x 0.29 x 0.30 m around zero, axes LPS; INT16, slope 1, air -1000.
 *  @param size   voxels, each at least 16; the body is the same, the spacing follows
 *  @param seed   of the noise; the label map does not depend on it
 *  @param labels Nullable. Errors: ARGUMENT, MEMORY. */
PLIANT_API pliant_status pliant_phantom(const int32_t size[3], uint32_t seed, pliant_volume *scan, pliant_labels *labels);

#ifdef __cplusplus
}
#endif
#endif
