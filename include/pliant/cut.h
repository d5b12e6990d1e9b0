/** @file cut.h
 *  What a blade severs: links between voxels, and the next body that follows from it.
 */
#ifndef PLIANT_CUT_H
#define PLIANT_CUT_H

#include "pliant/body.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Of a blade's edge: a strip of triangles between where the edge was and where it is. Deformed space, LPS [m]. */
typedef struct pliant_cut_sweep {
    int32_t count;
    const double *from, *to;          /**< (count x 3) the same points along the edge, before and now; `from` has moved with the tissue */
    const uint8_t *material_of_voxel; /**< Nullable; (voxels) for the report */
} pliant_cut_sweep;

/** What was newly severed. */
typedef struct pliant_cut_report {
    int32_t num_links, num_bridges;
    int32_t touched;      /**< tetrahedra */
    double area;          /**< at rest, of links with tissue on both ends [m^2] */
    double area_of[256];  /**< the same by material of material_of_voxel [m^2] */
    int32_t pieces;       /**< of the next body */
} pliant_cut_report;

/* Still to come, as blades need it in every step: pliant_body_cut with out NULL tells the report alone and makes nothing;
 * pliant_body_locate is asked for every half voxel of an edge, near where it was asked before. */

#ifdef __cplusplus
}
#endif
#endif
