/* Macro-elements from the correctors (lod.h). */
#ifndef PLIANT_FEM_COARSE_LOD_MACRO_H
#define PLIANT_FEM_COARSE_LOD_MACRO_H

#include "fem/coarse/lod_cubes.h"

/* Create system->macros with corners, frames, and the fine nodes that follow each. Errors: MEMORY. */
pliant_status lod_macros_create(lod_builder *lod);
/* Compute the matrix of a cube and the shape functions of its fine nodes. Errors: MEMORY. */
pliant_status lod_macro(lod_builder *lod, lod_buffers *buffers, int32_t cube);

#endif
