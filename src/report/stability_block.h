/* Bodies for stability trials: a block of voxels whose first face along x is fixed. */
#ifndef PLIANT_REPORT_STABILITY_BLOCK_H
#define PLIANT_REPORT_STABILITY_BLOCK_H

#include "pliant/report.h"

enum { BLOCK_SOFT, BLOCK_HARD, BLOCK_AIR, BLOCK_BONE, BLOCK_MATERIALS };

typedef struct block_body {
    pliant_scene scene;
    pliant_volume scan;
    pliant_material materials[BLOCK_MATERIALS]; /* the stored value of a voxel is its material */
    pliant_material_table table;
    pliant_report_input input;    /* points to the members above, so the struct must not be copied */
} block_body;

typedef int (*block_paint)(const int32_t voxel[3], const int32_t size[3]);

/* Create a block. The scene's mesh has 3 x 3 x 3 coarse cells with ratio 2.
 * @param paint Nullable: default: soft tissue with a hard core */
pliant_status block_create(const int32_t size[3], const double box[3], block_paint paint, block_body *out);
/* Create a block of 12^3 voxels with an edge of 10 cm. */
pliant_status block_create_default(block_body *out);
void block_free(block_body *body);

#endif
