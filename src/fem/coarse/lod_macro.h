/* Macro-elements from the correctors (lod.h). */
#ifndef PLIANT_FEM_COARSE_LOD_MACRO_H
#define PLIANT_FEM_COARSE_LOD_MACRO_H

#include "fem/coarse/lod_cubes.h"

#ifdef __cplusplus
extern "C" {
#endif

/* system->macros with corners, frames and the fine nodes that follow each. Errors: MEMORY. */
pliant_status lod_macros_create(lod_builder *lod);
/* The matrix of a cube, and how its fine nodes follow. Errors: MEMORY. */
pliant_status lod_macro(lod_builder *lod, lod_room *room, int32_t cube);

#ifdef __cplusplus
}
#endif

#endif
