/* Interface of a device that draws the deformed volume instead of the CPU. */
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

/* Host data of a warp that a device needs. All pointers are borrowed and outlive the device object. */
typedef struct pliant_warp_parts {
    const pliant_mesh *mesh;
    const raster_grid *grid;
    const raster_source *source;
    const double *rest;          /* (num_nodes x 3) continuous index in the scan */
    pliant_volume *volume;       /* host volume that the user of the warp reads */
    uint8_t *changed;            /* (bricks) changed in the last update */
    double *seconds;             /* times of the stages cull and rasterize */
    const fit_view *fit;         /* NULL: rasterize */
    const pliant_parts *parts;   /* NULL: no cuts */
    /* for a next body: number of nodes with the same rest position as in the previous body */
    int32_t num_same_rest;
} pliant_warp_parts;

/* Correspondence of elements (parts.h) between two bodies. */
typedef struct pliant_warp_changes {
    int32_t before, now;           /* number of elements */
    int32_t common;                /* number of tetrahedra in both bodies; only those in `rebuilt` have changed */
    int32_t num_rebuilt, *rebuilt; /* tetrahedra to redraw, ascending */
    int32_t *from;                 /* (now - common) previous element of each other element; -1: redraw */
    /* previous elements, ascending, that the new body does not have; their region is redrawn */
    int32_t num_removed, *removed;
} pliant_warp_changes;

/* Functions of a device.
 * object: created by `create`
 * Errors: MEMORY, UNAVAILABLE. */
typedef struct pliant_warp_device {
    pliant_probe probe;
    pliant_status (*create)(const pliant_warp_parts *parts, void **object);
    void (*free)(void *object);
    pliant_status (*update)(void *object, const double *positions);
    pliant_status (*fetch)(void *object); /* copy the changed parts of the volume to the host */
    /* pliant_warp_cross in the volume of the last update; NULL: the volume is fetched and the CPU computes it */
    pliant_status (*cross)(void *object, const march_ray *ray, int64_t first, march_crossing *out);
    /* Image of the volume of the last update (warp/ray.h). NULL: the volume is fetched and the CPU draws it.
     * labels: Nullable; object of a warp of labels */
    pliant_status (*draw_image)(void *object, void *labels, const struct render_scene *scene,
                                const struct render_output *out);
    /* Change to the next body, as pliant_warp_prepare and pliant_warp_take. drop: free the prepared data, whether taken
     * or not. */
    pliant_status (*prepare)(void *object, const pliant_warp_parts *parts, const pliant_warp_changes *changes,
                             void **next);
    void (*take)(void *object, void *next);
    void (*drop)(void *next);
} pliant_warp_device;

#ifdef PLIANT_WITH_CUDA
extern const pliant_warp_device pliant_cuda_warp_device;
#endif

/* Prepare data that cuts of this body will need, so that no cut waits for it. Errors: MEMORY. */
pliant_status pliant_warp_expect_cuts(pliant_warp *warp, const pliant_body *body);

/* pliant_warp_set_body in two stages: prepare can fail but changes nothing visible; take cannot fail. */
typedef struct pliant_warp_next pliant_warp_next;
pliant_status pliant_warp_prepare(pliant_warp *warp, const pliant_body *body, pliant_warp_next **out);
/* next must still be freed by pliant_warp_next_free */
void pliant_warp_take(pliant_warp *warp, pliant_warp_next *next);
void pliant_warp_next_free(pliant_warp_next *next); /* Nullable */
/* Return the device's object, NULL if the CPU does the updates. pliant_warp_fall_back ends its use after a failure. */
void *pliant_warp_accelerated(const pliant_warp *warp);
void pliant_warp_fall_back(pliant_warp *warp);

#ifdef __cplusplus
}
#endif
#endif
