/* Pressures of nearly incompressible tissue in explicit dynamics (NUMERICS.md). If any tissue has a Poisson's ratio
 * above 0.49 (fem/element/pressures.h), elements keep a lambda of at most PLIANT_SOFT_RATIO times mu. The rest,
 * lambda', acts as a pressure p on the change of volume T of a group of elements. A group is a hexahedron, or the
 * tetrahedra of a whole lattice cube or octree leaf. Other tetrahedra are groups alone.
 *     T = sum of V_e (J_e - 1)       force on a node: -B' p, B = dT/du       C = V / lambda'       C p = T - offset
 *
 * p is implicit: it belongs to the volumes at the end of a sub-step. First, elements, tools and contact move the nodes
 * by d, with the pressures of the sub-step before. Then a correction dp of the pressures corrects d.
 *     S dp = T + B d - offset - C p,     S = C + B W B',     d -= W B' dp
 * W is h^2 / M, without the directions in which tools, contact and walls hold nodes in this sub-step. At rest the right
 * side is zero, so p does not depend on S. Conjugate gradients solve it, with the factor of S at rest as the
 * preconditioner. Rigid rotations do not change S. */
#ifndef PLIANT_FEM_DYNAMICS_TLED_PRESSURE_H
#define PLIANT_FEM_DYNAMICS_TLED_PRESSURE_H

#include "fem/dynamics/tled.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    PLIANT_ROW = 4,           /* numbers of a row or motion, the last one zero: the compiler vectorizes its products */
    PLIANT_GROUP_CORNERS = 27 /* of a group: an octree leaf with nodes in the middle of all edges and faces */
};

/* Constant data. Corners are the nodes of groups. */
typedef struct pliant_tled_groups {
    pliant_tet_material *soft; /* (num_tets) materials of the elements */
    int32_t count, num_corners;
    double *volume;                    /* (count) V at rest [m^3] */
    double *compliance;                /* (count) C [m^3 / Pa] */
    int32_t *cell;                     /* (count) lattice cube or octree leaf; -1: none */
    int32_t *cube;                     /* (count) hexahedron, or -1: tetrahedra */
    int32_t *of_cube;                  /* (hexahedra) group, or -1 */
    int32_t *tet_start, *tet_corner;   /* (count + 1), (tetrahedra x 4) corners within their group */
    int32_t *corner_start, *node;      /* (count + 1), (num_corners) */
    int32_t *group;                    /* (num_corners) group of a corner */
    int32_t *node_start, *node_corner; /* (num_nodes + 1), (num_corners) corners of a node, ascending */
    int *column_start, *row;           /* (count + 1): lower triangle of S, compressed columns */
} pliant_tled_groups;

struct pliant_tled_pressure {
    const pliant_tled_groups *groups;
    /* STATE: (count) pressures [Pa], then (count) offsets of volumes [m^3]. A cut changes the groups; offsets keep all
     * forces, and decay. */
    double *state, *start_state;
    /* WORK ARRAYS */
    double *change;                                    /* (count) T [m^3] */
    float *rows;                                       /* (num_corners x PLIANT_ROW) B [m^2] */
    double *residual, *solution, *direction, *product; /* (count) of the conjugate gradients */
    double *motion;                                    /* (num_nodes x PLIANT_ROW) W B' direction */
    struct pliant_factor *factor;                      /* of S at rest, for sub-steps of the initial duration */
    double slope, step;                                /* scalars that all threads share */
    bool is_solved;
    pliant_status status;
};

/* ---- Implemented in tled_pressure_groups.c. */
/* Return whether explicit dynamics of this body has pressures. before: Nullable: data before a cut. */
bool pliant_tled_has_pressures(const pliant_tled_system *system, const pliant_body *body,
                               const pliant_tled_system *before);
/* Return the lambda of an element's own stiffness [Pa]. */
double pliant_tled_soft_lambda(const pliant_tet_material *material);
/* Create the soft materials (groups->soft) of a body. Errors: MEMORY. */
pliant_status pliant_tled_groups_create(const pliant_body *body, pliant_tled_groups **out);
/* Find the groups, after the system has its elements. material: (num_tets) complete. Errors: MEMORY. */
pliant_status pliant_tled_groups_find(const pliant_tled_system *system, const pliant_tet_material *material,
                                      pliant_tled_groups *groups);
void pliant_tled_groups_free(pliant_tled_groups *groups); /* Nullable */

/* ---- Implemented in tled_pressure_state.c. */
/* Create the state, at rest, and the factor. Errors: MEMORY, NUMERIC, SCENE. */
pliant_status pliant_tled_pressure_create(pliant_tled *tled);
void pliant_tled_pressure_free(pliant_tled_pressure *pressure); /* Nullable */
void pliant_tled_pressure_reset(pliant_tled *tled);
void pliant_tled_pressure_save_or_restore(pliant_tled *tled, bool back);
/* Carry the pressures over a cut, cell by cell. Offsets keep the forces of cells that have changed. Errors: MEMORY. */
pliant_status pliant_tled_pressure_carry(pliant_tled *tled, const pliant_tled *from);
/* Mix the pressures of a part of a frame with those at its start. fraction: (num_nodes) of the motion that is kept. */
void pliant_tled_pressure_mix(pliant_tled *tled, const double *fraction);
/* Return the energy of the pressures [J]. */
double pliant_tled_pressure_energy(const pliant_tled *tled);

/* ---- Implemented in tled_pressure.c. Call from all threads of a parallel region, or from one thread outside. */
/* Compute T and B at the start of a sub-step. */
void pliant_tled_pressure_find(pliant_tled *tled);
/* Add the force B' p to the elastic forces at a node [N]. */
void pliant_tled_pressure_add(const pliant_tled *tled, int32_t node, double force[3]);
/* Correct the pressures, positions and increments at the end of a sub-step. factor: as in pliant_tled_pull. */
void pliant_tled_pressure_correct(pliant_tled *tled, const pliant_tool *tools, int num_tools, double factor);

#ifdef __cplusplus
}
#endif

#endif
