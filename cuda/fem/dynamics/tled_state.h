/* Explicit dynamics on the GPU: what src/fem/dynamics/tled.h keeps, laid out for one kernel a sub-step.
 *
 * A block has a group of nodes that lie together, and a thread for every element that touches one of them. It keeps the
 * forces in shared memory, sums those on its nodes in the CPU's order, and moves them. Elements between groups are
 * worked out by each: twice the arithmetic in all, for half of the launches, and no forces that go through memory.
 * Neighbours read displacements while others are moved, so there are two of them, which change places in every
 * sub-step.
 *
 * Elements are in single precision as on the CPU; displacements, sums over a node's corners and everything of tools and
 * walls are in double. A bar that swings undamped for 10,000 sub-steps is then 8e-7 of its motion away from one that is
 * in double throughout; with displacements in single precision too it is 5e-6, and pressures of nearly incompressible
 * tissue lose a digit more. */
#ifndef PLIANT_CUDA_TLED_STATE_H
#define PLIANT_CUDA_TLED_STATE_H

#include "fem/dynamics/cube_bending.h"
#include "fem/dynamics/tled.h"

#include <cuda_runtime_api.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { GPU_THREADS = 256 /* of a block: most elements of a group */, GPU_GROUP_NODES = 10 * (GPU_THREADS / 32) };
enum { NEAR_NUMBERS = 13 /* of a node that contacts have: rest, displacement, increment, acceleration, inverse mass */ };

/* An element as one thread reads it; the moduli come times the rest volume. */
typedef struct gpu_tet {
    int32_t node[4];
    float gradient[9];         /* of corners 1 to 3 [1/m] */
    float shear, bulk;         /* [N m] */
    float volume;              /* [m^3] */
} gpu_tet;

/* A hexahedron likewise (src/fem/dynamics/tled_cubes.h). */
typedef struct gpu_cube {
    int32_t node[8];
    float shear, bulk, contraction, finer; /* contraction: c of cube_bending.h; finer: 1 over the edge in smallest cells */
} gpu_cube;

/* A node as one thread reads it. */
typedef struct gpu_node { double inverse_mass, mass, limit, held; /* held: 1 by a tool or a contact, else 0 */ } gpu_node;

/* What a tool does in a frame: struct pliant_tool. */
typedef struct gpu_hold {
    int32_t active, drive, first, count; /* of d_tool_node, d_tool_weight */
    double goal[3], driving_force[3], stiffness, damping;
    int32_t later;             /* struct pliant_tled */
    double load_share;         /* sum of squared weights over masses */
} gpu_hold;

/* What the host says at the beginning of a frame. */
typedef struct gpu_frame {
    double gravity[3], time_step, reach;
    double factor, kept;       /* d+ = factor / M (R - F) + kept d; of dynamic relaxation worked out in every sub-step */
    float prony_part[PLIANT_PRONY_TERMS], prony_share[PLIANT_PRONY_TERMS];
    float damping;             /* in proportion to stiffness, over the sub-step; 0: none */
    float gap;
    double tolerance, smallest_load; /* of dynamic relaxation */
    int32_t substeps, num_tools, num_held; /* of this part of the frame (struct pliant_tled); num_held: of d_held_node */
    int32_t made, whole;       /* sub-steps of the frame before them; of all of it */
    int32_t num_points, num_levels, num_near; /* of contacts */
    gpu_hold tools[PLIANT_MAX_TOOLS];
    double answer[PLIANT_MAX_TOOLS][PLIANT_MAX_TOOLS]; /* sums of weight times weight over mass of nodes that two tools share */
} gpu_frame;

/* What a frame makes of it, and what goes from frame to frame. */
typedef struct gpu_outcome {
    double passed[PLIANT_MAX_TOOLS][3], passed_target[PLIANT_MAX_TOOLS][3], passed_step; /* struct pliant_tled */
    double target[PLIANT_MAX_TOOLS][3], force[PLIANT_MAX_TOOLS][3], quotient[4];
    double factor, kept;       /* dynamic relaxation: of this sub-step */
    double tool_load, sums[PLIANT_NUM_SUMS], residual;
    int32_t base;              /* sub-steps before the present graph */
    int32_t steps;
    int32_t unsound;           /* first sub-step in which a node moved faster than sound; INT32_MAX: none */
    int32_t settled;
    uint32_t arrived;          /* blocks of a kernel that are done */
} gpu_outcome;

/* Arrays. Pointers are of the device. */
typedef struct gpu_tled {
    pliant_law law;
    bool viscous, nodal, still;
    bool damped;               /* in proportion to stiffness */
    int32_t num_nodes, num_groups, num_prony;
    int32_t num_tets, num_elements; /* as lanes of the host's blocks: tetrahedra, and with hexahedra after them */
    const int32_t *d_group;    /* (num_groups + 1) first of a group's nodes in d_order */
    const int32_t *d_order;    /* (num_nodes) nodes by groups */
    const int32_t *d_element;  /* (num_groups x GPU_THREADS) 2 element + whether this group keeps its memory; -1: none */
    const int32_t *d_corner_start; /* (num_nodes + 1) of nodes by groups */
    const uint16_t *d_corner;  /* (corners) GPU_THREADS times corner + place in d_element of the group, elements ascending */
    const gpu_tet *d_tets;
    const gpu_cube *d_cubes;   /* (num_elements - num_tets); NULL: all are tetrahedra */
    float cube_gradient[9];    /* struct pliant_tled_cubes, as the next */
    pliant_cube_bending cube_bending;
    gpu_node *d_nodes;
    const double *d_rest;      /* (num_nodes x 3) */
    const float *d_node_modulus, *d_node_volume; /* nodal pressure, as is d_pressure */
    float *d_pressure;
    double *d_u[2];            /* (num_nodes x 4), three numbers and a gap */
    double *d_d[2];            /* (num_nodes x 3) last increments; one array, unless damped: then neighbours read them */
    double *d_older;           /* (num_nodes x 3) increments before the last ones, at the end of a frame; NULL: still */
    double *d_acceleration, *d_own; /* (num_nodes x 3); acceleration of held nodes only, but for dynamic relaxation */
    float *d_memory[2];        /* (num_prony x num_elements x 8), six numbers and a gap */
    double *d_sums;            /* (blocks x PLIANT_NUM_SUMS) */
    gpu_frame *d_frame;
    gpu_outcome *d_outcome;
    int32_t *d_held_node, *d_tool_node; /* nodes that any tool holds or a contact has, ascending; each tool's */
    double *d_tool_weight;
    int32_t *d_near;           /* nodes that contacts have */
    int32_t room_points, room_near; /* of contacts; of these nodes */
    size_t shared_bytes;       /* in which contacts are put right; 0: in d_near_room */
    pliant_contact_point *d_point; /* by levels; tled_touch.h */
    pliant_tled_touch *d_touch;
    int32_t *d_level;
    double *d_near_room;       /* (room_near x NEAR_NUMBERS) */
    double *d_positions, *d_packed_u; /* (num_nodes x 3) what others are given */
    float *d_packed_memory;    /* as the host's */
    int32_t num_walls;
    pliant_wall walls[PLIANT_MAX_WALLS];
    double friction, restitution;
} gpu_tled;

/* ---- tled_groups.cu: sets what is said of groups. Errors: MEMORY, UNAVAILABLE (a node of too many tetrahedra). */
pliant_status pliant_cuda_tled_groups(const pliant_tled_system *system, gpu_tled *tled, cudaStream_t stream);

/* ---- tled_step.cu */
static inline size_t pliant_cuda_touch_bytes(int32_t points, int32_t near)
{
    return (size_t)points * (sizeof(pliant_contact_point) + sizeof(pliant_tled_touch)) + (size_t)near * NEAR_NUMBERS * sizeof(double);
}
/* Contacts in so many bytes of shared memory, if the kernel has as many left of those. */
pliant_status pliant_cuda_tled_share(gpu_tled *tled, size_t bytes, size_t most);
/* enqueue */
/* The sub-step with this number in its graph; whether it is one of the frame is seen there. pulled: tools hold nodes,
 * or contacts have some. */
pliant_status pliant_cuda_tled_substep(const gpu_tled *tled, int32_t number, bool pulled, cudaStream_t stream);
/* Later graphs of this frame have done so many sub-steps before. */
pliant_status pliant_cuda_tled_bump(const gpu_tled *tled, int32_t steps, cudaStream_t stream);
/* Sums of the last sub-step; state to where a frame begins, and as the host has it. */
pliant_status pliant_cuda_tled_finish(const gpu_tled *tled, cudaStream_t stream);
/* The host's state (d_packed_u, d_packed_memory) to where a frame begins. */
pliant_status pliant_cuda_tled_unpack(const gpu_tled *tled, cudaStream_t stream);
/* Nodes of d_held_node and no others are held. */
pliant_status pliant_cuda_tled_hold(const gpu_tled *tled, int32_t num_held, cudaStream_t stream);

#ifdef __cplusplus
}
#endif
#endif
