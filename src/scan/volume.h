/* Volumes and label maps: functions for the library, nodes and programs. */
#ifndef PLIANT_SCAN_VOLUME_H
#define PLIANT_SCAN_VOLUME_H

#include "base/export.h"
#include "pliant/scan.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Return whether size, origin, spacing and direction agree to 1e-4 of a voxel, and to the rounding of an origin in
 * single precision. */
bool pliant_geometry_equal(const pliant_geometry *a, const pliant_geometry *b);

/* Return the size of a voxel [bytes]. */
PLIANT_INTERNAL size_t pliant_encoding_size(pliant_encoding encoding);

/* Compute percentiles of a volume's values; for a large volume from a million voxels. Errors: MEMORY.
 * @param percent (count) 0 .. 100
 * @param value (count) out */
PLIANT_INTERNAL pliant_status pliant_volume_percentiles(const pliant_volume *volume, int count, const double *percent,
                                                        double *value);

/* Resample labels to the grid of a scan: every voxel of the scan gets the nearest label, or none outside of the label
 * map. Rotated axes and cropped maps change no label. If a corner lies more than 0.05 voxel from a voxel of the scan, a
 * warning names the differences of the grids. Errors (labels unchanged): ARGUMENT (the label map misses the scan),
 * MEMORY. */
pliant_status pliant_labels_to_grid(pliant_labels *labels, const pliant_geometry *grid);

/* Resample a volume to another number of voxels in the same box, trilinearly in the scan's own type. The new spacing is
 * old size * old spacing / size. Errors: ARGUMENT, MEMORY. */
pliant_status pliant_volume_resample(const pliant_volume *volume, const int32_t size[3], pliant_volume *out);

/* Resample labels as pliant_volume_resample does, with the nearest label. */
pliant_status pliant_labels_resample(const pliant_labels *labels, const int32_t size[3], pliant_labels *out);

/* Return the name of a phantom label, static; "" for other numbers. */
PLIANT_INTERNAL const char *pliant_phantom_label_name(int label);

#ifdef __cplusplus
}
#endif
#endif
