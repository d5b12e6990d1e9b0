/* Writing of vector fields. */
#ifndef PLIANT_SCAN_WRITE_H
#define PLIANT_SCAN_WRITE_H

#include "pliant/scan.h"

/* Write a vector field as ITK writes a displacement field. The extension of path selects the format, as in
 * pliant_volume_write.
 * @param vectors  (voxels x 3) LPS; each is multiplied by factor.
 * Errors: ARGUMENT (extension), FILE, FORMAT, MEMORY. */
pliant_status pliant_vectors_write(const char *path, const pliant_geometry *geometry, double factor,
                                   const float *vectors);

#endif
