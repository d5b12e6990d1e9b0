/* Bodies for trials: a block of voxels, its first face along x fixed. */
#ifndef PLIANT_REPORT_STABILITY_BLOCK_H
#define PLIANT_REPORT_STABILITY_BLOCK_H

#include "pliant/report.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { BLOCK_SOFT, BLOCK_HARD, BLOCK_AIR, BLOCK_BONE, BLOCK_MATERIALS };

typedef struct block_body {
    pliant_scene scene;
    pliant_volume scan;
    pliant_material materials[BLOCK_MATERIALS]; /* a voxel's stored value is its material */
    pliant_material_table table;
    pliant_report_input input;    /* points into the above: a body is not copied */
} block_body;

typedef int (*block_paint)(const int32_t voxel[3], const int32_t size[3]);

/* @param paint Nullable: a block of soft tissue with a hard core. The scene's mesh is 3 x 3 x 3 coarse cells of ratio 2. */
pliant_status block_create(const int32_t size[3], const double box[3], block_paint paint, block_body *out);
/* 12^3 voxels, 10 cm */
pliant_status block_create_default(block_body *out);
void block_free(block_body *body);

#ifdef __cplusplus
}
#endif
#endif
