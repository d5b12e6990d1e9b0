/* The corrector of a cube (lod.h). */
#ifndef PLIANT_FEM_COARSE_LOD_CORRECTOR_H
#define PLIANT_FEM_COARSE_LOD_CORRECTOR_H

#include "fem/coarse/lod_cubes.h"

/* Compute patch_nodes and patch_means of a cube. Errors: MEMORY. */
pliant_status lod_size(lod_builder *lod, lod_buffers *buffers, int32_t cube);
/* Compute the corrector of a cube. Errors: MEMORY, NUMERIC. */
pliant_status lod_correct(lod_builder *lod, lod_buffers *buffers, int32_t cube);

#endif
