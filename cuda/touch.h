/* Contact in the quasi-static solve on the GPU, by the rules of src/fem/quasistatic/contact.h. The host says where points are, and finds their forces
 * from few numbers (cones.h): how free steps move them, and A. The GPU has all that is as long as the body: loads, columns of the inverse, the step. */
#ifndef PLIANT_CUDA_TOUCH_H
#define PLIANT_CUDA_TOUCH_H

#include "answers.h"
#include "fem/quasistatic/contact.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Points of a step, as kernels see them. */
typedef struct gpu_touch_view {
    int32_t count, num_weights, num_slots, num_springs; /* slots: unknowns that points move */
    int32_t spring[PLIANT_MAX_TOOLS]; /* tools that pull by springs, in A after the points */
    const double *d_frame, *d_goal, *d_block; /* struct pliant_touches */
    double *d_force;           /* (3 count) of the state of the step */
    const int32_t *d_start, *d_unknown;
    const int32_t *d_place, *d_point; /* (num_weights) slot; point */
    const int32_t *d_touched, *d_first; /* (num_slots) unknown; the first of its columns */
    const int32_t *d_weight_start, *d_weight; /* (num_slots + 1): the weights of each */
    double *d_turned;          /* (9 num_weights) */
    double *d_pull;            /* (3 num_slots) W' dl, in the nodes' axes */
    double *d_change, *d_found; /* (3 count) dl; l + dl */
    double *d_motion, *d_matrix; /* rows: 3 (count + num_springs); A */
    const float *d_column;
    size_t stride;
} gpu_touch_view;

enum { TOUCH_BLOCKS = 3 /* what goes up, what stays, what goes up at every evaluation */ };

typedef struct gpu_touches {
    gpu_answers answers;
    gpu_touch_view view;
    void *d_block[TOUCH_BLOCKS], *h_block[TOUCH_BLOCKS]; /* page-locked; of what stays, what comes back */
    size_t d_room[TOUCH_BLOCKS], h_room[TOUCH_BLOCKS];   /* bytes */
    int32_t num_free, *place;  /* (num_free) slot, or -1 */
    int32_t *touched;          /* (num_free) */
} gpu_touches;

struct pliant_cuda_solver;

void pliant_cuda_touches_free(gpu_touches *touches);
/* A step's evaluations with the points of solver->touches, one of which there is at least: as those without (solve.cu). */
pliant_status pliant_cuda_touches_run(struct pliant_cuda_solver *gpu, pliant_solver *solver, const gpu_step *step);
/* Where it has led the points (pliant_touches_tell). */
const double *pliant_cuda_touches_moved(const gpu_touches *touches);

#ifdef __cplusplus
}
#endif
#endif
