/* Who runs the stages of a step: one table of functions a backend. The CPU is always there, and what the others are compared
 * with. State stays where the backend keeps it; what the host needs comes back in every step: fine positions, the tools'
 * forces, statistics. */
#ifndef PLIANT_BACKEND_BACKEND_H
#define PLIANT_BACKEND_BACKEND_H

#include "pliant/data.h"
#include "pliant/segment.h"
#include "warp/fit.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What another backend needs to know of a warp. All is borrowed and outlives its object. */
typedef struct pliant_warp_parts {
    const pliant_mesh *mesh;
    const raster_grid *grid;
    const raster_source *source;
    const double *rest;          /* (num_nodes x 3) continuous index in the scan */
    pliant_volume *volume;       /* of the host; what the warp's owner sees */
    uint8_t *changed;            /* (bricks) of the last update */
    double *seconds;             /* cull, rasterize */
    const fit_view *fit;         /* NULL: rasterize */
} pliant_warp_parts;

/* What a kind of solver (solver/kind) does on the host, whoever runs its steps. */
typedef struct pliant_host_solver {
    pliant_status (*create)(const pliant_model *model, pliant_data *data); /* its state in data, at rest. Errors: MEMORY, SCENE */
    pliant_status (*reset)(pliant_data *data);                             /* to rest. Errors: MEMORY (nothing changed) */
    pliant_status (*interact)(const pliant_model *model, pliant_data *data); /* the first stage of a step: what the tools pull at */
    void (*set_positions)(const pliant_model *model, pliant_data *data, const double *positions); /* data's own positions too */
    void (*limits)(pliant_data *data, int iterations, double tolerance);
    void (*left)(pliant_data *data); /* another backend failed: what it made is not to be used. Nullable */
    const pliant_backend *cpu, *cuda; /* who can run its steps; cuda is NULL in a build without */
} pliant_host_solver;
extern const pliant_host_solver pliant_corotational, pliant_explicit;

struct pliant_backend {
    const char *name;
    const pliant_host_solver *kind;
    bool on_host; /* keeps no state of its own: nothing to bring or to free, and none to fall back on when it fails */
    bool solves_on_host; /* what a solve leads to is the host's as soon as it ends: when a later stage fails, it is not done again */
    /* Whether it can be used here. text: the device's name, or the reason why not. Says nothing itself. */
    bool (*probe)(char *text, size_t size);

    /* STATE of a data, from its host state. Errors: MEMORY, NUMERIC, UNAVAILABLE. */
    pliant_status (*create)(const pliant_model *model, pliant_data *data);
    void (*free)(pliant_data *data); /* NULL on the host */
    pliant_status (*restart)(const pliant_model *model, pliant_data *data); /* the host's state was changed: take it */
    void (*bring)(const pliant_model *model, pliant_data *data); /* the state of the last step to the host's solver; NULL: it is there */

    /* STAGES, each from the state that the one before left */
    pliant_status (*solve)(const pliant_model *model, pliant_data *data);
    pliant_status (*upsample)(const pliant_model *model, pliant_data *data);
    pliant_status (*warp)(const pliant_model *model, pliant_data *data);

    /* WARP on its own; NULL: the CPU's */
    pliant_status (*warp_create)(const pliant_warp_parts *parts, void **out);
    void (*warp_free)(void *warp);
    pliant_status (*warp_update)(void *warp, const double *positions);
    pliant_status (*warp_fetch)(void *warp); /* the volume to the host, where it changed since the last time */
    /* pliant_warp_cross in the volume of the last update; NULL: the volume is fetched, and the CPU's */
    pliant_status (*warp_cross)(void *warp, const march_ray *ray, int64_t first, march_crossing *out);

    /* pliant_segment, of checked arguments, out zeroed; NULL: the CPU's. What it leaves in out on an error is freed by the caller. */
    pliant_status (*segment)(const pliant_volume *scan, const pliant_segment_options *options, pliant_segmentation *out);
};

extern const pliant_backend pliant_cpu_backend;
extern const pliant_backend pliant_tled_backend; /* explicit dynamics on the CPU */
/* what the two share */
bool pliant_cpu_probe(char *text, size_t size);
pliant_status pliant_cpu_nothing(const pliant_model *model, pliant_data *data);
pliant_status pliant_cpu_warp(const pliant_model *model, pliant_data *data);
/* explicit dynamics: positions from the displacements, what is told of the tools */
pliant_status pliant_tled_upsample(const pliant_model *model, pliant_data *data);

#ifdef PLIANT_WITH_CUDA
extern const pliant_backend pliant_cuda_backend, pliant_cuda_tled_backend;
#define PLIANT_ON_GPU(backend) &(backend)
#else
#define PLIANT_ON_GPU(backend) NULL
#endif

const pliant_host_solver *pliant_host_solver_of(const pliant_model *model);

/* text: what the GPU is called, or why there is none. Errors: UNAVAILABLE, with the reason, when the one asked for cannot be
 * used. */
enum { PLIANT_BACKEND_TEXT = 256 };
pliant_status pliant_backend_choose(pliant_backend_choice choice, char text[PLIANT_BACKEND_TEXT], const pliant_backend **out);
/* For a data that was just made. A line in the log says which it is; with auto also why not a GPU. */
pliant_status pliant_backend_create(const pliant_model *model, pliant_data *data);
/* The host's state was changed: the backend takes it, or the CPU goes on. Errors: none but those of neither. */
pliant_status pliant_backend_restart(const pliant_model *model, pliant_data *data);
/* After a failure of the backend: the CPU goes on from the last good state. false: it was the CPU's own failure. */
bool pliant_backend_leave(const pliant_model *model, pliant_data *data, pliant_status status);

#ifdef __cplusplus
}
#endif
#endif
