/* Internal state of a warp. */
#ifndef PLIANT_WARP_WARP_STATE_H
#define PLIANT_WARP_WARP_STATE_H

#include "warp/device.h"
#include "warp/fit.h"
#include "warp/parts.h"
#include "warp/raster.h"

struct pliant_warp {
    const pliant_mesh *mesh;
    const pliant_body *body; /* body of the mesh; NULL: a mesh without a body, which cannot be cut */
    pliant_geometry scan;
    raster_grid grid;
    raster_source source;
    raster_kernels kernels;
    pliant_volume volume;
    int num_threads;
    bool drawn;                 /* whether there was an update */
    bool has_new_body;          /* whether the body has changed since the last update */
    bool has_logged_clipping;   /* whether the message about clipped tissue was logged */
    double *rest;               /* (num_nodes x 3) continuous index in the scan */
    int32_t *fixed, *next;      /* (num_nodes x 3) fixed-point nodes of the last and of the next update */
    uint8_t *moved;             /* (num_nodes) */
    pliant_parts *parts;        /* NULL: no cuts */
    part_hosts *hosts;          /* Nullable: for later parts */
    int32_t *carried_tet_fixed; /* (num_carried_tets x 12) their corners in the last update */
    int32_t num_elements;       /* tetrahedra followed by carried tetrahedra */
    raster_tet *tets;           /* (num_elements) setup of the last update */
    uint8_t *rebuilt;           /* (num_elements) redraw in the next update although it did not move */
    size_t node_capacity, element_capacity;
    int32_t num_bricks;
    uint8_t *changed, *dirty; /* (num_bricks) of the last and of the next update */
    uint8_t *vacated;        /* (num_bricks) contained an element that was removed since the last update */
    int32_t *dirty_bricks;   /* (num_bricks) dirty bricks of the next update */
    /* (num_threads x num_bricks) end of each thread's range of a brick's candidates. A range begins where the previous
     * thread's range ends, or the last thread's range of the previous brick. */
    size_t *end;
    int32_t listed[2];       /* range of bricks whose candidates are listed; all bricks unless memory is short */
    int32_t *candidates;     /* elements by brick, ascending */
    size_t capacity;         /* at least the number of elements, so an update needs no more memory */
    raster_brick *scratch;   /* (num_threads) */
    double seconds[2];       /* times of the stages cull and rasterize */
    pliant_fit *fit;         /* NULL: rasterize */
    const pliant_warp_device *device; /* device of the object */
    void *accelerated;       /* device object; NULL: the CPU draws */
};

/* warp.c: describe a scan for sampling */
raster_source pliant_warp_source(const pliant_volume *scan);

/* warp.c: redraw the bricks that an element touched in the last update */
void pliant_warp_remove_from_bricks(pliant_warp *warp, int32_t element);

pliant_warp_parts pliant_warp_device_parts(pliant_warp *warp);

#endif
