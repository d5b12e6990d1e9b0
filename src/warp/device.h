/* Who draws a deformed volume in place of the CPU, and what a step on that device needs of a warp. */
#ifndef PLIANT_WARP_DEVICE_H
#define PLIANT_WARP_DEVICE_H

#include "scan/march.h"
#include "scene/gpu_choice.h"
#include "warp/fit.h"
#include "warp/parts.h"

#ifdef __cplusplus
extern "C" {
#endif

struct render_scene;
struct render_output;

/* What a device needs to know of a warp. All is borrowed and outlives its object. */
typedef struct pliant_warp_parts {
    const pliant_mesh *mesh;
    const raster_grid *grid;
    const raster_source *source;
    const double *rest;          /* (num_nodes x 3) continuous index in the scan */
    pliant_volume *volume;       /* of the host; what the warp's owner sees */
    uint8_t *changed;            /* (bricks) of the last update */
    double *seconds;             /* cull, rasterize */
    const fit_view *fit;         /* NULL: rasterize */
    const pliant_parts *parts;   /* NULL: nothing is cut */
    int32_t rest_known;          /* of a next body: so many nodes are where those of the body before are */
} pliant_warp_parts;

/* What becomes of elements (parts.h) from one body to the next. */
typedef struct pliant_warp_changes {
    int32_t before, now;         /* elements */
    int32_t common;              /* tetrahedra of both: each is what it was, but for those that are drawn anew */
    int32_t num_anew, *anew;     /* those, ascending */
    int32_t *from;               /* (now - common) what each of the others was before; -1: it is drawn anew */
    int32_t num_gone, *gone;     /* those of before, ascending, that are none of now: where they were is drawn anew */
} pliant_warp_changes;

/* Its functions; object: what create made. Errors: MEMORY, UNAVAILABLE. */
typedef struct pliant_warp_device {
    pliant_probe probe;
    pliant_status (*create)(const pliant_warp_parts *parts, void **object);
    void (*free)(void *object);
    pliant_status (*update)(void *object, const double *positions);
    pliant_status (*fetch)(void *object); /* the volume to the host, where it changed since the last time */
    /* pliant_warp_cross in the volume of the last update; NULL: the volume is fetched, and the CPU's */
    pliant_status (*cross)(void *object, const march_ray *ray, int64_t first, march_crossing *out);
    /* A picture of the volume of the last update (render/ray.h). labels: Nullable, object of a warp of labels. NULL: the volume is fetched,
     * and the CPU draws it */
    pliant_status (*see)(void *object, void *labels, const struct render_scene *scene, const struct render_output *out);
    /* For the next body, as pliant_warp_prepare and pliant_warp_take; drop: what was prepared, taken or not */
    pliant_status (*prepare)(void *object, const pliant_warp_parts *parts, const pliant_warp_changes *changes, void **next);
    void (*take)(void *object, void *next);
    void (*drop)(void *next);
} pliant_warp_device;

#ifdef PLIANT_WITH_CUDA
extern const pliant_warp_device pliant_cuda_warp_device;
#endif

/* What bodies that are cut from this one on will ask for is made, so that no stroke waits for it. Errors: MEMORY. */
pliant_status pliant_warp_expect_cuts(pliant_warp *warp, const pliant_body *body);

/* pliant_warp_set_body in two parts: all that can fail, which changes nothing that is seen; and what cannot. */
typedef struct pliant_warp_next pliant_warp_next;
pliant_status pliant_warp_prepare(pliant_warp *warp, const pliant_body *body, pliant_warp_next **out);
void pliant_warp_take(pliant_warp *warp, pliant_warp_next *next); /* next goes to pliant_warp_next_free all the same */
void pliant_warp_next_free(pliant_warp_next *next); /* Nullable */
/* The device's object, NULL when the CPU does the updates; and the end of that, when it failed. */
void *pliant_warp_accelerated(const pliant_warp *warp);
void pliant_warp_fall_back(pliant_warp *warp);

#ifdef __cplusplus
}
#endif
#endif
