/* Writing a field of vectors. */
#ifndef PLIANT_SCAN_WRITE_H
#define PLIANT_SCAN_WRITE_H

#include "pliant/scan.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Write a vector per voxel as ITK writes a displacement field, by the ending of path as pliant_volume_write does.
 * vectors: (voxels x 3) LPS; each is multiplied by factor. Errors: ARGUMENT (ending), FILE, FORMAT, MEMORY. */
pliant_status pliant_vectors_write(const char *path, const pliant_geometry *geometry, double factor, const float *vectors);

#ifdef __cplusplus
}
#endif
#endif
