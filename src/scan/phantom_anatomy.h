/* Positions of the phantom's organs, and painting of one row of voxels. */
#ifndef PLIANT_SCAN_PHANTOM_ANATOMY_H
#define PLIANT_SCAN_PHANTOM_ANATOMY_H

#include "pliant/scan.h"
#include "scan/phantom_shapes.h"

enum {
    PHANTOM_AIR = 0,
#define PHANTOM_ENUM(id, name) PHANTOM_##name = id,
    PLIANT_PHANTOM_LIST(PHANTOM_ENUM)
#undef PHANTOM_ENUM
    PHANTOM_ORGAN_CAPACITY = 200, /* abdominal fat where organs can be painted; becomes fat at the end */
    PHANTOM_KEPT_FREE              /* fat around a kidney, without organs */
};

enum { PHANTOM_AIR_VALUE = -1000 /* [HU] */ };

/* The scanned box [mm] */
#define PHANTOM_BOX_X 400.0
#define PHANTOM_BOX_Y 290.0
#define PHANTOM_BOX_Z 300.0

typedef struct phantom_anatomy {
    phantom_tubes muscles, ribs, colon, small_bowel, stomach, liver_vessels, vessels, aorta;
    phantom_ellipsoid liver[3], spleen, spleen_hollow, kidney[2], sinus[2], tumour; /* kidneys: left, right */
    phantom_tube store[2048];
} phantom_anatomy;

static inline void phantom_put(phantom_row *row, int n, int tissue, float value)
{
    row->tissue[n] = (uint8_t)tissue;
    row->value[n] = (int16_t)value;
}

/* Create the anatomy. Return false if a list is too short for its tubes (never, tested). */
bool phantom_anatomy_make(phantom_anatomy *anatomy);

/* Return the depth of a point below the skin [mm]; negative outside of the body. */
float phantom_depth(float x, float y, float z);
/* Return the depths at which the subcutaneous fat and the muscle wall end [mm]. */
void phantom_wall(float x, float y, float z, float *fat, float *muscle);
/* Return y of the middle of the spine at height z; x is 0. */
float phantom_spine_y(float z);

/* Set tissue and value of one row; its position arrays are set. */
void phantom_paint(const phantom_anatomy *anatomy, phantom_row *row);
/* Paint the bones of a row. */
void phantom_paint_spine(phantom_row *row);
void phantom_paint_hips(phantom_row *row);

#endif
