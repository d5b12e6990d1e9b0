/* Total Lagrangian explicit dynamics on the fine mesh ([C] 4.3 and 5.1; Miller et al. 2007).
 *
 * Central differences with lumped mass M and damping D = alpha M:
 *     M (u+ - 2 u + u-) / dt^2 + D (u+ - u-) / (2 dt) = R - F(u)
 *     u+ = A (R - F) + B u + C u-
 *     A = 1 / (D / (2 dt) + M / dt^2),   B = 2 M A / dt^2,   C = D A / (2 dt) - B / 2
 * These are [C] 8 and 9. The last form of C is printed there with D / dt, which does not follow from the form before
 * it. Since B + C = 1, the same scheme in increments has smaller rounding errors:
 *     d+ = A (R - F) - C d,   u+ = u + d+,   d = u - u-
 *
 * A tetrahedron has constant strain, with gradients g_v and F = I + sum u_v g_v'. [C] 4 prints the shape functions
 * of a brick collapsed to four corners, whose gradients vary inside the element.
 *
 * LANES elements are processed at a time, in single precision. Each element writes its corner forces to separate
 * memory, and every node then sums its corner forces in ascending order. Without atomics, the result is bitwise
 * identical for any number of threads. Single precision limits the accuracy of pressures to 1e-7 of the volume
 * modulus. */
#ifndef PLIANT_FEM_DYNAMICS_TLED_H
#define PLIANT_FEM_DYNAMICS_TLED_H

#include "fem/element/law.h"
#include "base/lanes.h"
#include "contact/detect/impact_zones.h"
#include "contact/detect/tissue.h"
#include "fem/dynamics/substep_contact.h"
#include "model_data/data.h"
#include "topology/body.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_PRONY_TERMS = 3, PLIANT_CHUNK = 256 /* nodes whose sums are computed together */ };

/* Coefficients of d+ = A (R - F) + kept d, with A = factor / M. */
typedef struct pliant_tled_scheme { double factor, kept; } pliant_tled_scheme;
static inline pliant_tled_scheme pliant_tled_scheme_of(double dt, double alpha)
{
    const double inertia = 1 / (dt * dt), drag = alpha / (2 * dt);
    pliant_tled_scheme out;
    out.factor = 1 / (inertia + drag);
    out.kept = (inertia - drag) / (inertia + drag);
    return out;
}

/* Results of a step over the nodes of a chunk. Products are weighted by mass.
 * - RESIDUAL, LOAD: sums of squares.
 * - INERTIA, STIFFNESS: in dynamic relaxation, products of the last increment with itself and with its change of force.
 * - LARGEST: squared largest increment divided by the stable limit.
 * - ERROR_BEFORE, ERROR: largest errors of time integration, after a frame's second-last and last sub-step [m]. */
typedef enum pliant_tled_sum {
    PLIANT_SUM_RESIDUAL, PLIANT_SUM_LOAD, PLIANT_SUM_INERTIA, PLIANT_SUM_STIFFNESS, PLIANT_SUM_LARGEST,
    PLIANT_SUM_ERROR_BEFORE, PLIANT_SUM_ERROR, PLIANT_NUM_SUMS
} pliant_tled_sum;

/* Duration of sub-steps with one thread and with all threads. On a machine with other load, a barrier waits for threads
 * without a core. Results are the same with both. */
typedef struct pliant_thread_choice {
    double seconds[2];                      /* of a sub-step, in the last burst with one thread [0] and with all [1] */
    int faster_choice;
    bool is_trial;      /* the last burst used the slower alternative */
    int32_t wait, left; /* bursts until the next trial of the slower alternative */
} pliant_thread_choice;

typedef struct pliant_tled_cubes pliant_tled_cubes;
typedef struct pliant_tled_groups pliant_tled_groups;
typedef struct pliant_tled_pressure pliant_tled_pressure;

/* Constant data of the time integration. */
struct pliant_tled_system {
    const pliant_mesh *mesh;
    pliant_law law;
    int num_threads;
    bool nodal_pressure, quasi_static;
    double damping, safety;                 /* [1/s], - */
    double stiffness_damping;               /* [s]; not in dynamic relaxation */
    double prony_share[PLIANT_PRONY_TERMS], prony_time[PLIANT_PRONY_TERMS]; /* shares > 0 come first */
    int num_prony;
    double stiffening; /* instantaneous shear modulus divided by the material's: 1 without tled/loss_factor */
    pliant_wall walls[PLIANT_MAX_WALLS];
    int num_walls;
    double friction, restitution;

    /* ELEMENTS, in blocks of LANES, lane innermost. The last block is padded with elements without stiffness. */
    int32_t num_blocks;
    float (*gradients)[9][LANES];           /* of corners 1 to 3 [1/m]; corner 0 has minus their sum */
    float (*moduli)[3][LANES]; /* rest volume times mu, rest volume times the volume modulus [N m]; rest volume [m^3] */
    int32_t (*nodes)[4][LANES];

    /* HEXAHEDRA (element/kind), after the tetrahedra, which then fill only incomplete cubes: tled_cubes.h. */
    pliant_tled_cubes *cubes;               /* NULL: all elements are tetrahedra */
    pliant_tled_groups *groups; /* NULL: no nearly incompressible tissue has pressures (tled_pressure.h) */

    /* NODES */
    int32_t *corner_start;                  /* (num_nodes + 1) */
    /* Index of a corner's x force in the element forces, ascending. The y and z forces are LANES and 2 LANES
     * further. */
    int32_t *corner;
    /* (num_nodes) [1/kg]; 0: fixed. quasi_static: inverse of pseudo-masses that give every element the critical step
     * 1. */
    double *inverse_mass;
    double *node_mass;                      /* (num_nodes) [kg], borrowed: for weight */
    float *node_modulus;                    /* (num_nodes) volume modulus for nodal pressure [Pa]; NULL: off */
    float *node_volume;                     /* (num_nodes) 4 divided by the volume around the node [1/m^3] */

    /* BOUNDS of the time step at rest [s] */
    /* [C] 1: shortest edge divided by the speed of sound. Minimum over the elements and over all fragments that cuts
     * can make. */
    double edge_bound;
    double eigenvalue_bound;                /* of the element with the highest frequency, with its damping */
};

/* Data of contact/response paper without contact/delay: every sub-step detects overlaps. */
typedef struct pliant_tled_overlap_damping {
    pliant_tissue *tissue;                  /* Nullable: not used */
    uint8_t *overlaps;                      /* (num_nodes) */
    double *place;                          /* (num_nodes x 3) work array [m] */
    pliant_status status;                   /* status of the detection */
} pliant_tled_overlap_damping;

struct pliant_tled {
    const pliant_tled_system *system;
    double frame;                           /* duration of a scene step [s] */
    int32_t relaxation_steps;
    double tolerance;
    int32_t substeps;                       /* per frame */
    /* For a frame in several parts: sub-steps done so far, and sub-steps of the next part; 0: all remaining
     * sub-steps. */
    int32_t substeps_done, part;
    /* Sub-steps after this part in which a tool that holds, and has jumped, still reaches its target. */
    int32_t substeps_after_part[PLIANT_MAX_TOOLS];
    /* Number of halvings of the initial sub-step, for fast tools, and after elements strained too fast for it. */
    int32_t halvings;
    double time_step;                       /* [s] */
    double gravity[3];

    const double *inverse_mass; /* (num_nodes) the system's array, or own_inverse_mass after pieces were stopped */
    double *own_inverse_mass;               /* Nullable: array for stopped pieces */

    /* STATE */
    double *u, *d;                          /* (num_nodes x 3) displacement and last increment [m] */
    /* Prony series: relaxed overstress, as rest volume times second Piola-Kirchhoff stress [N m]; NULL: elastic. */
    float (*memory)[6 * PLIANT_PRONY_TERMS][LANES];
    /* State at the start of the frame or of the current part. A backend stores its results here as well. */
    double *start_u, *start_d;
    float (*start_memory)[6 * PLIANT_PRONY_TERMS][LANES];
    pliant_tled_pressure *pressure_of_groups; /* NULL: as the system's groups */
    double target[PLIANT_MAX_TOOLS][3];     /* present targets of the held points [m] */
    double start_target[PLIANT_MAX_TOOLS][3];
    double previous_point[PLIANT_MAX_TOOLS][3];  /* positions of held points before the last sub-step [m] */
    double previous_target[PLIANT_MAX_TOOLS][3]; /* targets before the last sub-step */
    /* Duration of the last sub-step [s]. */
    double previous_time_step, start_previous_point[PLIANT_MAX_TOOLS][3], start_previous_target[PLIANT_MAX_TOOLS][3];
    double quotient[4];                 /* dynamic relaxation: state of pliant_substep_frequency */
    pliant_thread_choice thread_choice; /* thread count of the bursts */
    /* Dynamic relaxation: reference load for the residual where there is no load; as PLIANT_SUM_LOAD. */
    double smallest_load;
    pliant_contacts *contacts;    /* Nullable: borrowed, for a frame */
    pliant_tled_contact *contact; /* (contact_capacity) state of these contacts */
    int32_t contact_capacity;
    double contact_energy;        /* that contacts have dissipated and may use to remove penetrations [J] */
    double tool_work;             /* of the tools' contact forces on the tissue, in the last frame [J] */
    uint8_t *in_contact;                         /* Nullable: (num_nodes) nonzero: node of a contact */
    pliant_tled_overlap_damping overlap_damping; /* borrowed, for a frame */
    pliant_impact_zones *zones;                  /* Nullable: borrowed, for a frame */
    double reach;                                /* maximum motion of a held point per sub-step [m] */
    double shortest_edge;                        /* at rest [m] */

    /* WORK ARRAYS */
    double *acceleration;                   /* (num_nodes x 3) by all forces of this step [m/s^2] */
    double *own; /* (num_nodes x 3) by R - F alone, of this and the last step; dynamic relaxation only */
    float *forces;                          /* (num_blocks x 12 x LANES) element forces on corners */
    float (*change)[LANES];                 /* (num_blocks) J - 1, nodal pressure only */
    float *pressure;                        /* (num_nodes) */
    double (*sums)[PLIANT_NUM_SUMS];        /* (chunks) by pliant_tled_sum */
    double *limit;                          /* (num_nodes) square of the largest stable increment per step [m^2] */
};

/* ---- Implemented in tled_bound.c. */
double pliant_tled_shortest_edge(const pliant_mesh *mesh, const int32_t *nodes); /* of a tetrahedron [m] */
/* Compute the system's bounds, for its elements and for all fragments that cuts can make. Errors: MEMORY. */
pliant_status pliant_tled_find_bounds(const pliant_body *body, pliant_tled_system *system);

/* ---- Implemented in tled_create.c. */
/* Create the constant data of a body. before: Nullable: data before a cut, whose bounds hold for all fragments. Errors:
 * MEMORY, SCENE. */
pliant_status pliant_tled_system_create(const pliant_scene *scene, const pliant_body *body,
                                        const pliant_tled_system *before, pliant_tled_system **out);
void pliant_tled_system_free(pliant_tled_system *system); /* Nullable */
pliant_status pliant_tled_create(const pliant_scene *scene, const pliant_tled_system *system, pliant_tled **out);
void pliant_tled_free(pliant_tled *tled); /* Nullable */
void pliant_tled_reset(pliant_tled *tled);
/* Set all velocities to zero and restart dynamic relaxation. */
void pliant_tled_stop_motion(pliant_tled *tled);
/* Return the largest eigenvalue of B'DB of an isotropic tetrahedron divided by its volume [N/m^4]. gradients: (4 x
 * 3). */
double pliant_element_largest_eigenvalue(const double gradients[12], double lambda, double mu);
/* Return the same value for any element with constant strain. gram: sum of g_v g_v' over its corners; xx yy zz xy xz
 * yz. */
double pliant_gram_largest_eigenvalue(const double gram[6], double lambda, double mu);

/* List the walls of the scene's ground, plane and box, and return their number. */
int pliant_tled_walls(const pliant_scene *scene, pliant_wall walls[PLIANT_MAX_WALLS]);
void pliant_tled_set_limits(pliant_tled *tled, int32_t steps, double tolerance);
/* Set the position of a node, at zero velocity. */
void pliant_tled_set_node_position(pliant_tled *tled, int32_t node, const double position[3]);
/* Allocate own_inverse_mass (allow_stop), and fix nodes permanently (fix_nodes). Errors: MEMORY. */
pliant_status pliant_tled_allow_stop(pliant_tled *tled);
void pliant_tled_fix_nodes(pliant_tled *tled, int32_t count, const int32_t *nodes);

/* ---- Implemented in tled_carry.c. */
/* Copy the state from before a cut: displacements, velocities, relaxed stress, limits. Tools are not copied. */
void pliant_tled_carry(pliant_tled *tled, const pliant_tled *from, const pliant_body_map *map);

/* ---- Implemented in tled_conserve.c. */
/* Correct the carried state after a cut. Each component keeps its momentum and angular momentum. Strain and kinetic
 * energy together do not rise. Components that the cut does not touch stay bitwise unchanged. Errors: MEMORY. */
pliant_status pliant_tled_conserve(pliant_tled *tled, const pliant_tled *from, const pliant_body *before,
                                   const pliant_body *body);

/* ---- Implemented in tled_cubes.c. */
/* Return the number of blocks, tetrahedra first and hexahedra next, or the number of floats in their forces. */
int32_t pliant_tled_blocks(const pliant_tled_system *system);
size_t pliant_tled_force_count(const pliant_tled_system *system);

/* ---- Implemented in tled_elements.c. Call from all threads of a parallel region, or from one thread outside of
 * any. */
void pliant_tled_element_forces(pliant_tled *tled, double time_step);
void pliant_tled_pressures(pliant_tled *tled);

/* ---- Implemented in tled_step.c. */
/* Return the number of sub-steps in this part of the frame. */
static inline int32_t pliant_tled_part_substeps(const pliant_tled *tled)
{
    const int32_t left = tled->substeps - tled->substeps_done;
    return tled->part > 0 && tled->part < left ? tled->part : left;
}
/* Set the positions at zero velocity. Fixed nodes do not move. */
void pliant_tled_set_positions(pliant_tled *tled, const double *positions);
/* Run one frame or a part of it: sub-steps, or dynamic relaxation. NUMERIC keeps the state before it. Tool forces are
 * means since the start of the frame, contact forces are means of the part. */
pliant_status pliant_tled_step(pliant_tled *tled, pliant_tool *tools, int num_tools, pliant_statistics *statistics);

/* Return the reported residual. residual: PLIANT_SUM_RESIDUAL; load: PLIANT_SUM_LOAD including the tools' load. */
double pliant_tled_relative(const pliant_tled *tled, double residual, double load);
/* Return the reported error: the mean of PLIANT_SUM_ERROR_BEFORE and PLIANT_SUM_ERROR. One of them alone can be small
 * when all nodes reverse direction. With two sub-steps it is the last value, with one sub-step it is unknown (0). */
double pliant_tled_frame_error(const pliant_tled *tled, double before, double last);

/* Result of a frame's sub-steps. is_stable: no element strained faster than sound; otherwise the state is unchanged. */
typedef struct pliant_tled_frame { int32_t steps; double residual, error; bool is_stable, settled; } pliant_tled_frame;
/* Runs a frame. Displacements, increments, memory, targets and quotient continue from frame to frame. The tools sum the
 * forces. After an error the state is unchanged. `is_stable` may be false where nodes only moved faster than sound. */
typedef pliant_status (*pliant_tled_runner)(void *with, pliant_tled *tled, pliant_tool *tools, int num_tools,
                                            pliant_tled_frame *out);
/* Do the same as pliant_tled_step with another runner than the CPU's. Its errors are returned. */
pliant_status pliant_tled_step_by(pliant_tled_runner runner, void *with, pliant_tled *tled, pliant_tool *tools,
                                  int num_tools, pliant_statistics *statistics);

/* ---- Implemented in tled_substep.c. */
/* Choose the duration of the next sub-steps. Halve it if tools and tissue move too far in a sub-step. At the start of a
 * frame, double it again if nothing moves fast and no element is crushed. The sub-steps done and the sub-steps of the
 * part keep their total durations. Return whether the duration and the increments have changed.
 * @param motion  Sum of the motions of a tool and of the tissue near it in one sub-step [m]. */
bool pliant_tled_choose_substep(pliant_tled *tled, double motion);
void pliant_tled_halve(pliant_tled *tled);

/* ---- Implemented in tled_tools.c. */
/* Add the tools' forces after a sub-step without tools: correct u, d and acceleration, and accumulate the forces in the
 * tools. Return their load, as PLIANT_SUM_LOAD.
 * @param factor  A divided by the inverse mass [s^2].
 * @param parts   Sub-steps left to move the held points to the tips, including this one. */
double pliant_tled_pull(pliant_tled *tled, pliant_tool *tools, int num_tools, double factor, int32_t parts);
/* Return the displacement of the point that a holds per unit force at b's nodes, divided by the factor of
 * pliant_tled_pull [1/kg]. */
double pliant_tled_tool_compliance(const pliant_tled *tled, const pliant_tool *a, const pliant_tool *b);
/* Move nodes behind walls back to the walls. */
void pliant_tled_collide(pliant_tled *tled, double factor, int32_t first, int32_t end);

/* ---- Implemented in tled_contact.c. */
static inline bool pliant_tled_touches(const pliant_tled *tled) { return tled->contacts && tled->contacts->count > 0; }
pliant_status pliant_tled_contacts_begin(pliant_tled *tled); /* for a frame. Errors: MEMORY */
/* Apply all contacts after a sub-step and the tools' forces. made: sub-steps of this part of the frame before this one.
 * Return their load, as pliant_tled_pull. */
double pliant_tled_contacts_correct(pliant_tled *tled, double factor, int32_t made);
/* Write the mean forces to the contact points. */
void pliant_tled_contacts_end(pliant_tled *tled, int32_t steps, pliant_statistics *statistics);
void pliant_tled_contacts_free(pliant_tled *tled);

/* Prepare the tools for a frame. A tool that has just grasped starts from the tissue's position. */
void pliant_tled_interact(pliant_tled *tled, const double gravity[3], pliant_tool *tools, int num_tools);
/* Move the targets of held points by the distances that the points lose if each node makes its own fraction of its
 * motion in this part. Otherwise the next sub-step would pull a point back by the whole distance. */
void pliant_tled_shift_targets(pliant_tled *tled, const pliant_tool *tools, int num_tools, const double *fraction);

/* ---- Implemented in tled_energy.c. */
/* Compute the kinetic energy, half a step ago, the strain energy, and the conserved energy of central differences [J].
 * The computation uses double precision. It applies to elastic tissue without nodal pressure. */
void pliant_tled_energies(const pliant_tled *tled, const pliant_tet_material *material, double *kinetic, double *strain,
                          double *kept);
/* Return the element at an index below the count: t for tetrahedron t, or ~c for hexahedron c. */
int32_t pliant_tled_element_count(const pliant_tled_system *system);
int32_t pliant_tled_element(const pliant_tled_system *system, int32_t index);
const int32_t *pliant_tled_element_nodes(const pliant_tled_system *system, int32_t element, int *corners);
/* Return the strain energy of an element [J]. force: Nullable: out: elastic force on each corner [N]. */
double pliant_tled_element_energy(const pliant_tled *tled, const pliant_tet_material *material, int32_t element,
                                  double force[8][3]);

#ifdef __cplusplus
}
#endif

#endif
