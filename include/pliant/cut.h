/** @file cut.h
 *  The result of a cut. data.h declares the cutting functions.
 */
#ifndef PLIANT_CUT_H
#define PLIANT_CUT_H

#include "pliant/body.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Links and tetrahedra that a cut has severed. */
typedef struct pliant_cut_report {
    int32_t num_links;    /**< links between adjacent voxels */
    int32_t num_bridges;  /**< connections between voxels that are not adjacent */
    int32_t touched;      /**< number of changed tetrahedra */
    double area;          /**< severed area at rest, between tissue on both sides [m^2] */
    double area_of[256];  /**< severed area by material, as an index into the material table [m^2] */
    int32_t pieces;       /**< number of connected pieces of tissue after the cut */
} pliant_cut_report;

#ifdef __cplusplus
}
#endif
#endif
