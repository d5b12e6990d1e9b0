/* Total Lagrangian explicit dynamics on the fine mesh ([C] 4.3 and 5.1; Miller et al. 2007).
 *
 * Central differences with lumped mass M and damping D = alpha M:
 *     M (u+ - 2 u + u-) / dt^2 + D (u+ - u-) / (2 dt) = R - F(u)
 *     u+ = A (R - F) + B u + C u-,   A = 1 / (D / (2 dt) + M / dt^2),   B = 2 M A / dt^2,   C = D A / (2 dt) - B / 2
 * ([C] 8 and 9; the last form of C is printed there with D / dt, which does not follow from the form before it.) Since B + C = 1, the
 * same is written by increments, which round less:  d+ = A (R - F) - C d,  u+ = u + d+,  d = u - u-.
 *
 * Shape functions are those of a tetrahedron with constant strain: the gradients are g_v, F = I + sum u_v g_v'. ([C] 4 prints the
 * shape functions of a brick that was collapsed to four corners; their gradients vary inside the element.)
 *
 * Elements are taken LANES at a time in single precision; each writes the forces on its corners to its own place, and every node
 * then sums its corners in ascending order. No atomics: the same bits whatever the number of threads. Single precision leaves 1e-7 of
 * the volume modulus in the pressures. */
#ifndef PLIANT_FEM_DYNAMICS_TLED_H
#define PLIANT_FEM_DYNAMICS_TLED_H

#include "fem/element/law.h"
#include "base/lanes.h"
#include "contact/detect/tissue.h"
#include "fem/dynamics/touch.h"
#include "state/data.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_PRONY_TERMS = 3, PLIANT_CHUNK = 256 /* nodes whose sums are formed together */ };

/* Sums over the nodes of a chunk after a step, products weighted by mass: squares of residual and load; of dynamic relaxation the last
 * increment's product with itself and with the change of force that it made; and the largest increment, squared, over what is sound. Largest errors
 * of time integration after a frame's last sub-step but one, and after its last [m]. */
typedef enum pliant_tled_sum {
    PLIANT_SUM_RESIDUAL, PLIANT_SUM_LOAD, PLIANT_SUM_INERTIA, PLIANT_SUM_STIFFNESS, PLIANT_SUM_LARGEST,
    PLIANT_SUM_ERROR_BEFORE, PLIANT_SUM_ERROR, PLIANT_NUM_SUMS
} pliant_tled_sum;

/* What sub-steps take with one thread and with all: on a machine that does other work too, a barrier waits for a thread that has no core. Results
 * are the same with any number. */
typedef struct pliant_pace {
    double seconds[2];                      /* of a sub-step, in the last burst by one thread [0] and by all [1] */
    int quicker;
    bool trying;                            /* the slower way, in the last burst */
    int32_t wait, left;                     /* bursts until that is tried again */
} pliant_pace;

typedef struct pliant_tled_cubes pliant_tled_cubes;

/* What stays constant while stepping. */
struct pliant_tled_system {
    const pliant_mesh *mesh;
    pliant_law law;
    int num_threads;
    bool nodal_pressure, quasi_static;
    double damping, safety;                 /* [1/s], - */
    double stiffness_damping;               /* [s]; not in dynamic relaxation */
    double prony_share[PLIANT_PRONY_TERMS], prony_time[PLIANT_PRONY_TERMS]; /* shares > 0 first */
    int num_prony;
    pliant_wall walls[PLIANT_MAX_WALLS];
    int num_walls;
    double friction, restitution;

    /* ELEMENTS, in blocks of LANES, lane innermost; the last block is padded with elements that carry nothing */
    int32_t num_blocks;
    float (*gradients)[9][LANES];           /* of corners 1 to 3 [1/m]; that of corner 0 is minus their sum */
    float (*moduli)[3][LANES];              /* rest volume times mu, times the volume modulus [N m]; rest volume [m^3] */
    int32_t (*nodes)[4][LANES];

    /* HEXAHEDRA (element/kind), after the tetrahedra, which are then those of cubes that are not whole: tled_cubes.h */
    pliant_tled_cubes *cubes;               /* NULL: all are tetrahedra */

    /* NODES */
    int32_t *corner_start;                  /* (num_nodes + 1) */
    int32_t *corner;                        /* where a corner's force lies in the element forces, ascending; its y and z LANES and
                                             * 2 LANES further */
    double *inverse_mass;                   /* (num_nodes) [1/kg]; 0: fixed. quasi_static: of the mass that gives every element the
                                             * same critical step, for steps of 1 */
    double *node_mass;                      /* (num_nodes) [kg], borrowed: weight */
    float *node_modulus;                    /* (num_nodes) volume modulus for nodal pressure [Pa]; NULL: off */
    float *node_volume;                     /* (num_nodes) reciprocal of a fourth of the volume around the node [1/m^3] */

    /* BOUNDS of the time step at rest [s] */
    double edge_bound;                      /* [C] 1: shortest edge over the speed of sound, smallest over elements, and over the
                                             * fragments that cuts can make of them */
    double eigenvalue_bound;                /* that of the element of the largest frequency, with what damps it */
};

/* contact/response paper without contact/delay: what overlaps is looked for in every sub-step. */
typedef struct pliant_tled_slowing {
    pliant_tissue *tissue;                  /* Nullable: not asked for */
    uint8_t *overlaps;                      /* (num_nodes) */
    double *place;                          /* (num_nodes x 3) room [m] */
    pliant_status status;                   /* of the search */
} pliant_tled_slowing;

struct pliant_tled {
    const pliant_tled_system *system;
    double frame;                           /* time of a step of the scene [s] */
    int32_t relaxation_steps;
    double tolerance;
    int32_t substeps;                       /* per frame */
    int32_t made, part;                     /* of a frame that is taken in parts: sub-steps that are done, and those of the next part; 0: all that are left */
    int32_t later[PLIANT_MAX_TOOLS];        /* sub-steps after this part in which a tool that holds, and has jumped, still gets where it is set to */
    bool firm;                              /* sub-steps that are too long are not halved: it fails */
    int32_t halvings;                       /* of the sub-step that the bounds at rest allow, since nodes moved too fast for that */
    double time_step;                       /* [s] */
    double gravity[3];

    const double *inverse_mass;             /* (num_nodes) the system's, or its own, where pieces were stopped */
    double *own_inverse_mass;               /* Nullable: room for that */

    /* STATE */
    double *u, *d;                          /* (num_nodes x 3) displacement and its last increment [m] */
    float (*memory)[6 * PLIANT_PRONY_TERMS][LANES]; /* Prony: overstress that has relaxed, rest volume times second
                                                     * Piola-Kirchhoff [N m]; NULL: elastic */
    double *kept_u, *kept_d;                /* as the frame, or the part of it that is run, began; a backend's arrivals */
    float (*kept_memory)[6 * PLIANT_PRONY_TERMS][LANES];
    double target[PLIANT_MAX_TOOLS][3];     /* where held points are pulled to now [m] */
    double kept_target[PLIANT_MAX_TOOLS][3];
    double passed[PLIANT_MAX_TOOLS][3];     /* where held points were one sub-step before the last [m] */
    double passed_target[PLIANT_MAX_TOOLS][3]; /* their targets then */
    double passed_step, kept_passed[PLIANT_MAX_TOOLS][3], kept_passed_target[PLIANT_MAX_TOOLS][3]; /* time between that and the last sub-step [s] */
    double quotient[4];                     /* dynamic relaxation: pliant_substep_frequency */
    pliant_pace pace;                       /* of its threads */
    double smallest_load;                   /* dynamic relaxation: what the residual is taken of where there is no load; as PLIANT_SUM_LOAD */
    pliant_contacts *contacts;              /* Nullable: borrowed, for a frame */
    pliant_tled_touch *touch;               /* (room_touch) of these */
    int32_t room_touch;
    uint8_t *touched;                       /* Nullable: (num_nodes) by some of them */
    pliant_tled_slowing slowing;            /* borrowed, for a frame */
    double reach;                           /* longest way of a held point in a sub-step [m] */

    /* WORK */
    double *acceleration;                   /* (num_nodes x 3) by all forces of this step [m/s^2] */
    double *own;                            /* (num_nodes x 3) by R - F alone, of this and the last step; dynamic relaxation only */
    float *forces;                          /* (num_blocks x 12 x LANES) of elements on their corners */
    float (*change)[LANES];                 /* (num_blocks) J - 1, nodal pressure only */
    float *pressure;                        /* (num_nodes) */
    double (*sums)[PLIANT_NUM_SUMS];        /* (chunks) by pliant_tled_sum */
    double *limit;                          /* (num_nodes) largest sound increment of a step [m], squared */
};

/* ---- tled_bound.c */
double pliant_tled_shortest_edge(const pliant_mesh *mesh, const int32_t *nodes); /* of a tetrahedron [m] */
/* the system's bounds, for its elements and for all that cuts can make of them. Errors: MEMORY. */
pliant_status pliant_tled_find_bounds(const pliant_body *body, pliant_tled_system *system);

/* ---- tled_create.c */
/* before: Nullable: of the body before, whose bounds hold for all that cuts make. Errors: MEMORY, SCENE. */
pliant_status pliant_tled_system_create(const pliant_scene *scene, const pliant_body *body, const pliant_tled_system *before, pliant_tled_system **out);
void pliant_tled_system_free(pliant_tled_system *system); /* Nullable */
pliant_status pliant_tled_create(const pliant_scene *scene, const pliant_tled_system *system, pliant_tled **out);
void pliant_tled_free(pliant_tled *tled); /* Nullable */
void pliant_tled_reset(pliant_tled *tled);
/* At rest where it is: dynamic relaxation begins anew. */
void pliant_tled_stop_motion(pliant_tled *tled);
/* Largest eigenvalue of B'DB of an isotropic tetrahedron, over its volume [N/m^4], from its gradients (4 x 3). */
double pliant_element_largest_eigenvalue(const double gradients[12], double lambda, double mu);
/* the same of any element with one strain: gram = sum of g_v g_v' over its corners, xx yy zz xy xz yz */
double pliant_gram_largest_eigenvalue(const double gram[6], double lambda, double mu);

/* Plane and box of the scene's ground. Returns how many. */
int pliant_tled_walls(const pliant_scene *scene, pliant_wall walls[PLIANT_MAX_WALLS]);
void pliant_tled_limits(pliant_tled *tled, int32_t steps, double tolerance);
/* A node is there, and does not move. */
void pliant_tled_place(pliant_tled *tled, int32_t node, const double position[3]);
/* Room for nodes that stop; those: they stay where they are, for ever. Errors: MEMORY. */
pliant_status pliant_tled_may_stop(pliant_tled *tled);
void pliant_tled_stop(pliant_tled *tled, int32_t count, const int32_t *nodes);

/* ---- tled_carry.c */
/* The state of one for the body before: displacements, velocities, what has relaxed, limits. Tools are not. */
void pliant_tled_carry(pliant_tled *tled, const pliant_tled *from, const pliant_body_map *map);

/* ---- tled_conserve.c */
/* Correct the carried state after a cut. Each component keeps its momentum and angular momentum. Strain and kinetic energy together do not rise.
 * Components that the cut does not touch keep every bit. Errors: MEMORY. */
pliant_status pliant_tled_conserve(pliant_tled *tled, const pliant_tled *from, const pliant_body *before, const pliant_body *body);

/* ---- tled_cubes.c */
/* Blocks of all elements: of tetrahedra, then of hexahedra; numbers of forces in them. */
int32_t pliant_tled_blocks(const pliant_tled_system *system);
size_t pliant_tled_force_count(const pliant_tled_system *system);

/* ---- tled_elements.c: to be called by all threads of a parallel region, or by one outside of any */
void pliant_tled_element_forces(pliant_tled *tled, double time_step);
void pliant_tled_pressures(pliant_tled *tled);

/* ---- tled_step.c */
/* Sub-steps of this part of the frame. */
static inline int32_t pliant_tled_part_steps(const pliant_tled *tled)
{
    const int32_t left = tled->substeps - tled->made;
    return tled->part > 0 && tled->part < left ? tled->part : left;
}
static inline bool pliant_tled_in_parts(const pliant_tled *tled) { return pliant_tled_part_steps(tled) < tled->substeps; }
/* Displacements, increments and what has relaxed are those that the frame or the part of it that was run last began with; that has ended well. */
void pliant_tled_back(pliant_tled *tled);
/* One frame, or a part of it: sub-steps, or dynamic relaxation. NUMERIC keeps the state before it. What is told of tools and contacts: of tools the mean since
 * the frame began, of contacts that of the part. */
void pliant_tled_set_positions(pliant_tled *tled, const double *positions); /* at rest there; fixed nodes stay */
pliant_status pliant_tled_step(pliant_tled *tled, pliant_tool *tools, int num_tools, pliant_statistics *statistics);

/* d+ = A (R - F) + kept d. A = factor / M. */
typedef struct pliant_tled_scheme { double factor, kept; } pliant_tled_scheme;
pliant_tled_scheme pliant_tled_scheme_of(double dt, double alpha);
/* The residual that is told, from PLIANT_SUM_RESIDUAL and PLIANT_SUM_LOAD with that of the tools. */
double pliant_tled_relative(const pliant_tled *tled, double residual, double load);
/* The error that is told, from PLIANT_SUM_ERROR_BEFORE and PLIANT_SUM_ERROR: their mean, as one alone may fall on where all turn; of two sub-steps the last,
 * of one it is not known (0). */
double pliant_tled_frame_error(const pliant_tled *tled, double before, double last);

/* What came of a frame's sub-steps. sound: no node moved faster than sound; otherwise the state is the one before. */
typedef struct pliant_tled_frame { int32_t steps; double residual, error; bool sound, settled; } pliant_tled_frame;
/* Runs a frame: u, d, memory, target and quotient go from one frame to the next; forces of sub-steps are added to the tools'. On an error
 * the state is the one before. */
typedef pliant_status (*pliant_tled_runner)(void *with, pliant_tled *tled, pliant_tool *tools, int num_tools, pliant_tled_frame *out);
/* pliant_tled_step with another runner than the CPU's; its errors are handed on. */
pliant_status pliant_tled_step_by(pliant_tled_runner runner, void *with, pliant_tled *tled, pliant_tool *tools, int num_tools,
                                  pliant_statistics *statistics);

/* ---- tled_tools.c */
/* The tools' forces on the nodes that they hold, after a step that knew nothing of them: u, d and acceleration are put right; forces are
 * added to those of the tools. Returns their load, as PLIANT_SUM_LOAD.
 *  @param factor A over the inverse mass [s^2]
 *  @param parts  sub-steps that are left to bring the held points to the tips, this one too */
double pliant_tled_pull(pliant_tled *tled, pliant_tool *tools, int num_tools, double factor, int32_t parts);
/* How far a unit force at what b holds takes the point that a holds, over the factor of pliant_tled_pull [1/kg]. */
double pliant_tled_answer(const pliant_tled *tled, const pliant_tool *a, const pliant_tool *b);
/* Nodes behind walls are put back on them. */
void pliant_tled_collide(pliant_tled *tled, double factor, int32_t first, int32_t end);

/* ---- tled_contact.c */
static inline bool pliant_tled_touches(const pliant_tled *tled) { return tled->contacts && tled->contacts->count > 0; }
pliant_status pliant_tled_touch_begin(pliant_tled *tled); /* of a frame. Errors: MEMORY */
/* Contact of all points, after a sub-step and what tools pull; made: sub-steps of this part of the frame before it. Returns their load, as pliant_tled_pull. */
double pliant_tled_touch_all(pliant_tled *tled, double factor, int32_t made);
void pliant_tled_touch_end(pliant_tled *tled, int32_t steps, pliant_statistics *statistics); /* to the points */
void pliant_tled_touch_free(pliant_tled *tled);

/* Before a frame: a tool that took hold pulls from where the tissue is. */
void pliant_tled_interact(pliant_tled *tled, const double gravity[3], pliant_tool *tools, int num_tools);

/* ---- tled_energy.c */
/* Kinetic energy, of half a step ago, strain energy, and what central differences keep of both [J], in double; of elastic tissue without
 * nodal pressure. */
void pliant_tled_energies(const pliant_tled *tled, const pliant_tet_material *material, double *kinetic, double *strain, double *kept);
/* The element of an index below the count: the number t of a tetrahedron, or ~c of the hexahedron c. */
int32_t pliant_tled_element_count(const pliant_tled_system *system);
int32_t pliant_tled_element(const pliant_tled_system *system, int32_t index);
const int32_t *pliant_tled_element_nodes(const pliant_tled_system *system, int32_t element, int *corners);
/* Strain energy of an element [J], and, Nullable, its elastic force on each of its corners [N]. */
double pliant_tled_element_energy(const pliant_tled *tled, const pliant_tet_material *material, int32_t element, double force[8][3]);

#ifdef __cplusplus
}
#endif

#endif
