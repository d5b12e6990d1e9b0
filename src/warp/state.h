/* A warp, for the files of this folder that work on it. */
#ifndef PLIANT_WARP_STATE_H
#define PLIANT_WARP_STATE_H

#include "warp/device.h"
#include "warp/fit.h"
#include "warp/parts.h"
#include "warp/raster.h"

struct pliant_warp {
    const pliant_mesh *mesh;
    const pliant_body *body; /* whose mesh that is; NULL: of a mesh alone, of which nothing is cut */
    pliant_geometry scan;
    raster_grid grid;
    raster_source source;
    raster_kernels kernels;
    pliant_volume volume;
    int num_threads;
    bool drawn;              /* there was an update */
    bool adapted;            /* the body is another one since */
    bool told;               /* that tissue leaves the target */
    double *rest;            /* (num_nodes x 3) continuous index in the scan */
    int32_t *fixed, *next;   /* (num_nodes x 3) nodes of the last and of the coming update */
    uint8_t *moved;          /* (num_nodes) */
    pliant_parts *parts;     /* NULL: nothing is cut */
    part_hosts *hosts;       /* Nullable: for parts to come */
    int32_t *guest_fixed;    /* (guests x 12) corners of guests, as of the last update */
    int32_t num_elements;    /* tetrahedra, and after them guests */
    raster_tet *tets;        /* (num_elements), of the last update */
    uint8_t *anew;           /* (num_elements) drawn anew in the coming update, though it did not move */
    size_t node_room, element_room;
    int32_t num_bricks;
    uint8_t *changed, *dirty; /* (num_bricks) of the last and of the coming update */
    uint8_t *left;           /* (num_bricks) of elements that are gone since the last update */
    int32_t *dirty_bricks;   /* (num_bricks) those of the coming one */
    size_t *end; /* (num_threads x num_bricks) where a thread's part of a brick's candidates ends; it begins where
                  * that of the thread before ends, or of the last thread in the brick before */
    int32_t listed[2];       /* bricks whose candidates are listed, from the first to before the second: all, but where memory is short */
    int32_t *candidates;     /* tetrahedra by brick, ascending */
    size_t capacity;         /* no less than there are tetrahedra: an update needs no more memory */
    raster_brick *scratch;   /* (num_threads) */
    double seconds[2];       /* cull, rasterize */
    pliant_fit *fit;         /* NULL: rasterize */
    const pliant_warp_device *device; /* of the object */
    void *accelerated;       /* its object; NULL: the CPU draws */
};

/* warp.c: a scan as what voxels are sampled from */
raster_source pliant_warp_source(const pliant_volume *scan);

/* warp.c: what an element touched in the last update is drawn anew in the coming one */
void pliant_warp_leave_bricks(pliant_warp *warp, int32_t element);

pliant_warp_parts pliant_warp_device_parts(pliant_warp *warp);

#endif
