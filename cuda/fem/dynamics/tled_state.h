/* State of explicit dynamics on the GPU. It corresponds to src/fem/dynamics/tled.h, laid out for one kernel per
 * sub-step.
 *
 * A block has a group of adjacent nodes, and one thread for every element with a node in the group. It keeps the
 * element forces in shared memory, sums them per node in the CPU's order, and moves the nodes. Each group computes the
 * elements at its boundary. This doubles the arithmetic, but halves the launches and keeps forces out of global memory.
 * Neighbours read displacements while others are moved. Therefore there are two displacement arrays, which are
 * exchanged in every sub-step.
 *
 * Elements are in single precision as on the CPU. Displacements, nodal sums, tools and walls are in double precision.
 * Deviation of an undamped bar from a computation in double precision, after 10,000 sub-steps, relative to its motion:
 *   displacements in double precision  8e-7
 *   displacements in single precision  5e-6, and pressures of nearly incompressible tissue lose one more digit */
#ifndef PLIANT_CUDA_TLED_STATE_H
#define PLIANT_CUDA_TLED_STATE_H

#include "fem/dynamics/cube_bending.h"
#include "fem/dynamics/tled.h"

#include <cuda_runtime_api.h>

enum {
    GPU_THREADS = 256 /* threads per block: maximum elements of a group */,
    GPU_GROUP_NODES = 10 * (GPU_THREADS / 32)
};
enum {
    NEAR_NUMBERS = 13 /* numbers of a node with contact: rest, displacement, increment, acceleration, inverse mass */
};

/* An element as one thread reads it. The moduli are multiplied by the rest volume. */
typedef struct gpu_tet {
    int32_t node[4];
    float gradient[9];         /* of corners 1 to 3 [1/m] */
    float shear, bulk;         /* [N m] */
    float volume;              /* [m^3] */
} gpu_tet;

/* A hexahedron as one thread reads it (src/fem/dynamics/tled_cubes.h). */
typedef struct gpu_cube {
    int32_t node[8];
    /* Contraction: c of cube_bending.h; finer: 1 divided by the edge in smallest cells. */
    float shear, bulk, contraction, finer;
} gpu_cube;

/* A node as one thread reads it. */
typedef struct gpu_node {
    double inverse_mass, mass, limit, held; /* held: 1 for nodes of a tool or a contact, else 0 */
} gpu_node;

/* Input of a tool in a frame: struct pliant_tool. */
typedef struct gpu_hold {
    int32_t active, drive, first, count; /* of d_tool_node, d_tool_weight */
    double goal[3], driving_force[3], stiffness, damping;
    int32_t substeps_after_part; /* struct pliant_tled */
    double load_share;           /* sum of squared weights divided by masses */
} gpu_hold;

/* Inputs of a frame, written by the host. */
typedef struct gpu_frame {
    double gravity[3], time_step, reach;
    double factor, kept; /* d+ = factor / M (R - F) + kept d; dynamic relaxation computes them in every sub-step */
    float prony_relaxed_fraction[PLIANT_PRONY_TERMS], prony_share[PLIANT_PRONY_TERMS];
    float damping;             /* proportional to stiffness, divided by the sub-step; 0: none */
    float gap;
    double tolerance, smallest_load; /* of dynamic relaxation */
    int32_t substeps, num_tools, num_held; /* of this part of the frame (struct pliant_tled); num_held: entries of
                                            * d_held_node */
    int32_t substeps_done, whole;             /* sub-steps of the frame before this part, and in total */
    int32_t num_points, num_levels, num_near; /* of contacts */
    gpu_hold tools[PLIANT_MAX_TOOLS];
    /* Sums of products of two tools' weights divided by mass, over common nodes. */
    double answer[PLIANT_MAX_TOOLS][PLIANT_MAX_TOOLS];
} gpu_frame;

/* Results of a frame, and state between frames. */
typedef struct gpu_outcome {
    double previous_point[PLIANT_MAX_TOOLS][3], previous_target[PLIANT_MAX_TOOLS][3],
        previous_time_step; /* struct pliant_tled */
    double target[PLIANT_MAX_TOOLS][3], force[PLIANT_MAX_TOOLS][3], quotient[4];
    double factor, kept;       /* dynamic relaxation: of this sub-step */
    double tool_load, sums[PLIANT_NUM_SUMS], residual;
    int32_t base;              /* sub-steps before the present graph */
    int32_t steps;
    int32_t first_unstable_step;           /* first sub-step in which a node moved faster than sound; INT32_MAX: none */
    int32_t settled;
    uint32_t arrived;          /* number of finished blocks of a kernel */
} gpu_outcome;

/* The arrays. Pointers are device pointers. */
typedef struct gpu_tled {
    pliant_law law;
    bool viscous, nodal, still;
    bool damped;               /* damping proportional to stiffness */
    int32_t num_nodes, num_groups, num_prony;
    /* Counted as lanes of the host's blocks: tetrahedra, and all elements including the hexahedra after them. */
    int32_t num_tets, num_elements;
    const int32_t *d_group;    /* (num_groups + 1) first node of each group in d_order */
    const int32_t *d_order;    /* (num_nodes) nodes sorted by groups */
    const int32_t *d_element;  /* (num_groups x GPU_THREADS) 2 element + whether this group stores its memory; -1:
                                * none */
    const int32_t *d_corner_start; /* (num_nodes + 1) in group order */
    const uint16_t *d_corner;  /* (corners) GPU_THREADS times corner + index in d_element of the group, elements
                                * ascending */
    const gpu_tet *d_tets;
    const gpu_cube *d_cubes;   /* (num_elements - num_tets); NULL: all elements are tetrahedra */
    float cube_gradient[9];    /* of struct pliant_tled_cubes, as is the next */
    pliant_cube_bending cube_bending;
    gpu_node *d_nodes;
    const double *d_rest;      /* (num_nodes x 3) */
    const float *d_node_modulus, *d_node_volume; /* nodal pressure only, as is d_pressure */
    float *d_pressure;
    double *d_u[2];            /* (num_nodes x 4), three numbers and padding */
    double *d_d[2];            /* (num_nodes x 3) last increments; two different arrays only with damping, since
                                * neighbours then read them */
    /* (num_nodes x 3) increments before the last ones, at the end of a frame; NULL in dynamic relaxation. */
    double *d_older;
    double *d_acceleration, *d_own; /* (num_nodes x 3); without dynamic relaxation, acceleration of held nodes only */
    float *d_memory[2];        /* (num_prony x num_elements x 8), six numbers and padding */
    double *d_sums;            /* (blocks x PLIANT_NUM_SUMS) */
    gpu_frame *d_frame;
    gpu_outcome *d_outcome;
    int32_t *d_held_node, *d_tool_node; /* nodes of any tool or contact, ascending; nodes of each tool */
    double *d_tool_weight;
    int32_t *d_near;                       /* nodes of contacts */
    int32_t point_capacity, near_capacity; /* capacity for contacts, and for their nodes */
    size_t shared_bytes;                   /* shared memory for contacts; 0: they are in d_near_buffer */
    pliant_contact_point *d_point;         /* sorted by levels; tled_contact.h */
    pliant_tled_contact *d_contact;
    int32_t *d_level;
    double *d_near_buffer;       /* (`near_capacity` x NEAR_NUMBERS) */
    double *d_positions, *d_packed_u; /* (num_nodes x 3) for other stages */
    float *d_packed_memory;    /* in the host's layout */
    int32_t num_walls;
    pliant_wall walls[PLIANT_MAX_WALLS];
    double friction, restitution;
} gpu_tled;

/* ---- Implemented in tled_groups.cu: build the groups. Errors: MEMORY, UNAVAILABLE (a node has too many
 * tetrahedra). */
pliant_status pliant_cuda_tled_groups(const pliant_tled_system *system, gpu_tled *tled, cudaStream_t stream);

/* ---- Implemented in tled_step.cu. */
static inline size_t pliant_cuda_tled_contact_bytes(int32_t points, int32_t near)
{
    return (size_t)points * (sizeof(pliant_contact_point) + sizeof(pliant_tled_contact)) +
           (size_t)near * NEAR_NUMBERS * sizeof(double);
}
/* Keep the contacts in `bytes` of shared memory, if the kernel has that much available. */
pliant_status pliant_cuda_tled_use_shared_memory(gpu_tled *tled, size_t bytes, size_t maximum);
/* The following functions enqueue work. */
/* Enqueue the sub-step with this number in its graph. The kernel checks whether it belongs to the frame. pulled: there
 * are held nodes or contacts. */
pliant_status pliant_cuda_tled_substep(const gpu_tled *tled, int32_t number, bool pulled, cudaStream_t stream);
/* Add the completed sub-steps to the base of the frame's later graphs. */
pliant_status pliant_cuda_tled_advance_base(const gpu_tled *tled, int32_t steps, cudaStream_t stream);
/* Enqueue the sums of the last sub-step, and store the state for the next frame, also in the host's layout. */
pliant_status pliant_cuda_tled_finish(const gpu_tled *tled, cudaStream_t stream);
/* Unpack the host's state (d_packed_u, d_packed_memory) for the start of a frame. */
pliant_status pliant_cuda_tled_unpack(const gpu_tled *tled, cudaStream_t stream);
/* Mark exactly the nodes of d_held_node as held. */
pliant_status pliant_cuda_tled_hold(const gpu_tled *tled, int32_t num_held, cudaStream_t stream);

#endif
