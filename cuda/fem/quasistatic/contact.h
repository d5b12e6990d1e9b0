/* Contact in the quasi-static solve on the GPU, with the rules of src/fem/quasistatic/contact.h. The host detects the
 * contact points. One block computes their forces (cone_rules.h), or all blocks if there are many points. So
 * evaluations run without the host. Only if there are too many points for the GPU, the host computes the forces while
 * the GPU waits. */
#ifndef PLIANT_CUDA_CONTACT_H
#define PLIANT_CUDA_CONTACT_H

#include "cuda/fem/linear/compliance.h"
#include "fem/quasistatic/contact.h"

/* The contact points of a step, as kernels read them. */
typedef struct gpu_contact_view {
    int32_t count, num_weights, num_slots, num_springs; /* slots: unknowns moved by points */
    int32_t spring[PLIANT_MAX_TOOLS]; /* tools with springs; in A, they follow the points */
    const double *d_frame, *d_goal, *d_block; /* struct pliant_contact_problem */
    const double *d_friction;  /* (count + num_springs) */
    double *d_force, *d_taken_motion; /* (3 count) of the present state: struct pliant_contact_forces */
    const int32_t *d_start, *d_unknown;
    const int32_t *d_place, *d_point; /* (num_weights) slot, and point */
    const int32_t *d_moved_unknowns, *d_first; /* (num_slots) unknown, and the first of its columns */
    const int32_t *d_weight_start, *d_weight; /* (num_slots + 1): weights of each slot */
    int32_t num_moving;        /* number of pieces in contact; 0: no arms */
    const int32_t *d_arm_start; /* (count + 1) */
    const pliant_contact_arm *d_arm;
    pliant_contact_body *d_piece;       /* (num_moving) */
    int32_t num_couplings;     /* pliant_couplings */
    pliant_coupling *d_coupling;
    const double *d_coupling_columns;
    const double *d_own_compliance;     /* (count) compliance of the pieces at the points [m/N] */
    double *d_piece_moved;     /* (6 num_moving) motion under the forces of the present state */
    double *d_turned;          /* (9 num_weights) */
    double *d_pull;            /* (3 num_slots) W' dl, in the nodes' axes */
    double *d_change, *d_found, *d_found_motion; /* (3 count) dl; forces and motion of the last evaluated state */
    double *d_motion, *d_matrix; /* rows: 3 (count + num_springs); A */
    double *d_before;          /* (rows) of each block: pliant_cones */
    unsigned *d_arrivals;      /* pliant_team */
    double *d_equations;       /* work array for data that exceeds shared memory */
    const float *d_column;
    size_t stride;
} gpu_contact_view;

enum { CONTACT_PERSISTENT, CONTACT_RESULTS, CONTACT_EVALUATION_RESULTS, CONTACT_VIEW, CONTACT_BLOCKS };

/* Resources of this GPU for the solver of contact forces. */
typedef struct gpu_cone_limits {
    int32_t shared_bytes, /* shared memory of a block; 0: unknown yet */
        num_blocks,       /* that run at the same time */
        max_points;       /* points and springs */
} gpu_cone_limits;

typedef struct gpu_contacts {
    gpu_compliance_columns blocks;
    gpu_contact_view view;
    pliant_contact_body *h_piece;  /* (view.num_moving) page-locked copy of view.d_piece */
    pliant_coupling *h_coupling;   /* (view.num_couplings) page-locked copy of view.d_coupling */
    gpu_cone_limits limits;
    bool fits_gpu, uses_all_blocks; /* the GPU computes the forces of this leg; all of its blocks do */
    void *d_block[CONTACT_BLOCKS], *h_block[CONTACT_BLOCKS]; /* page-locked; contents: persistent data, and results */
    size_t d_capacity[CONTACT_BLOCKS], h_capacity[CONTACT_BLOCKS];   /* bytes */
    int32_t num_free, *place;  /* (num_free) slot, or -1 */
    int32_t *moved_unknowns;          /* (num_free) */
} gpu_contacts;

struct pliant_cuda_solver;

void pliant_cuda_contacts_free(gpu_contacts *contacts);
/* Run a step's evaluations with the points of solver->contacts, at least one. Otherwise like a step without contact
 * (solve.cu). */
pliant_status pliant_cuda_contacts_run(struct pliant_cuda_solver *gpu, pliant_solver *solver, const gpu_step *step);
/* Return the final motion of the points (pliant_contact_problem_report_motion). */
const double *pliant_cuda_contacts_motion(const gpu_contacts *contacts);

#endif
