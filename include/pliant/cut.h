/** @file cut.h
 *  What a blade severs: links between voxels, and the next body that follows from it.
 */
#ifndef PLIANT_CUT_H
#define PLIANT_CUT_H

#include "pliant/body.h"

#ifdef __cplusplus
extern "C" {
#endif

/** What was newly severed. */
typedef struct pliant_cut_report {
    int32_t num_links, num_bridges;
    int32_t touched;      /**< tetrahedra */
    double area;          /**< at rest, of links with tissue on both ends, or of triangles at which tetrahedra with tissue part [m^2] */
    double area_of[256];  /**< the same by material of material_of_voxel [m^2] */
    int32_t pieces;       /**< of the next body */
} pliant_cut_report;

#ifdef __cplusplus
}
#endif
#endif
