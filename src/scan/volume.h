/* Volumes and label maps: what the library needs beyond pliant/scan.h. */
#ifndef PLIANT_SCAN_VOLUME_H
#define PLIANT_SCAN_VOLUME_H

#include "base/export.h"
#include "pliant/scan.h"

#ifdef __cplusplus
extern "C" {
#endif

/* True when size, origin, spacing and direction agree (to 1e-4 of a voxel, and the rounding of an origin kept in
 *  single precision). */
bool pliant_geometry_equal(const pliant_geometry *a, const pliant_geometry *b);

/* Bytes of one voxel. */
PLIANT_INTERNAL size_t pliant_encoding_size(pliant_encoding encoding);

/* Values of which so many per cent are smaller; of a large volume from a million voxels. Errors: MEMORY.
 *  @param percent (count) 0 .. 100
 *  @param value   (count) out */
PLIANT_INTERNAL pliant_status pliant_volume_percentiles(const pliant_volume *volume, int count, const double *percent, double *value);

/* Put labels on the grid of a scan: every voxel of the scan takes the nearest label, or none outside of the label map. Turned axes and
 *  cropped maps change no label. If a corner lies more than 0.05 voxel from a voxel of the scan, a warning names the differences of the grids.
 *  Errors (labels untouched): ARGUMENT (the label map misses the scan), MEMORY. */
pliant_status pliant_labels_to_grid(pliant_labels *labels, const pliant_geometry *grid);

/* Same box, other voxel counts: trilinear in the scan's own type; nearest for labels.
 *  The new voxels cover the same box edge to edge, so spacing[d] = old size[d] * old spacing[d] / size[d]. */
pliant_status pliant_volume_resample(const pliant_volume *volume, const int32_t size[3], pliant_volume *out);

pliant_status pliant_labels_resample(const pliant_labels *labels, const int32_t size[3], pliant_labels *out);

/* Name of a phantom label ("" when there is none). */
PLIANT_INTERNAL const char *pliant_phantom_label_name(int label);

#ifdef __cplusplus
}
#endif
#endif
