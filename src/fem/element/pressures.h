/* Pressures of nearly incompressible tissue, as unknowns of the quasi-static solver (mixed method: Boffi, Brezzi,
 * Fortin, Mixed Finite Element Methods and Applications, 8.1; NUMERICS.md).
 *
 * Where lambda is above PLIANT_PRESSURE_RATIO times mu, elements have a lambda of PLIANT_SOFT_RATIO times mu. The
 * rest, lambda', acts as a pressure p on the mean change of volume t of a group of elements.
 *     p = lambda' t,     t = sum of V_e tr(e_e) / V,     force on a corner: p V_e R g_v
 * With the neo-Hookean law, J - 1 replaces tr(e), and cof F replaces R.
 * A group is a hexahedron, or all tetrahedra of a lattice cube or octree leaf. Other tetrahedra are groups alone. */
#ifndef PLIANT_FEM_ELEMENT_PRESSURES_H
#define PLIANT_FEM_ELEMENT_PRESSURES_H

#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

/* lambda / mu above which tissue has pressures: above a Poisson's ratio of 0.49, which is 49. Without pressures, steps
 * converge up to there. */
#define PLIANT_PRESSURE_RATIO 49.5
/* lambda / mu of the elements' own stiffness then: a Poisson's ratio of 0.45. From 4 to 49, steps need the same number
 * of evaluations within 10 %. */
#define PLIANT_SOFT_RATIO 9.0

typedef struct pliant_pressures {
    int32_t count;
    double *volume;           /* (count) V [m^3] */
    double *compliance;       /* (count) 1 / lambda' [1/Pa] */
    double *gain;             /* (count) change of p per missing change of volume in a step [Pa] */
    int32_t *cell;            /* (count) lattice cube or octree leaf; -1: none */
    int32_t *of_element;      /* (elements) pressure of an element, or -1 */
    double *element_volume;   /* (elements) V_e [m^3] */
} pliant_pressures;

/* Find the lattice cubes or octree leaves that no cut has divided: *whole (cells) nonzero; free with pliant_free.
 * Errors: MEMORY; the caller then frees the partial result. */
pliant_status pliant_find_whole_cells(const pliant_mesh *mesh, uint8_t **whole);
/* Copy the materials with the elements' own lambda. *out: NULL if no tissue has pressures; free with pliant_free.
 * Errors: MEMORY. */
pliant_status pliant_soft_materials(const pliant_tet_material *material, int32_t count, pliant_tet_material **out);
/* Create the pressures of a system whose elements have such materials. material: (num_tets) the complete ones.
 * *out: NULL if no tissue has pressures. Errors: MEMORY. */
pliant_status pliant_pressures_create(const pliant_system *system, const pliant_tet_material *material,
                                      pliant_pressures **out);
void pliant_pressures_free(pliant_pressures *pressures); /* Nullable */
/* Compute the change of volume and its derivative at positions.
 * @param change  (elements) tr(e) or J - 1.
 * @param rows    (corners of all elements x 3) V_e R g_v or V_e cof F g_v [m^2]. */
void pliant_pressures_find(const pliant_pressures *pressures, const pliant_system *system, const double *positions,
                           double *change, double *rows);
/* Add the forces of pressures p to the free nodes: out (num_free x 3) [N]. */
void pliant_pressures_add(const pliant_pressures *pressures, const pliant_system *system, const double *rows,
                          const double *p, double *out);

#ifdef __cplusplus
}
#endif
#endif
