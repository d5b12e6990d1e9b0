/* Hexahedra of explicit dynamics: one point for the stress (Flanagan and Belytschko, Int. J. Numer. Meth. Engng 17:679, 1981), of the mean
 * deformation gradient, and a stiffness against what it does not see, the hourglass modes. For a box the trilinear displacement falls into
 *     u = sum over m of w_m / 8 * product of +-1 over the axes in m,   w_m = sum over corners of +-1 u_a,
 * with m the bits of x, y, z: the three single ones are the mean gradient, xy, yz, xz bend and twist a bar, xyz twists its sides. As total Lagrangian
 * modes leave out every linear displacement, |w_m| and F'w_m do not feel a rotation (Joldes, Wittek, Miller, Commun. Numer. Meth. Engng 24:1315, 2008),
 * and W = V psi(F) + their own (cube_bending.h) is an energy. None of it is a free parameter: xy, yz, xz have what bending and torsion cost, xyz what
 * the deviatoric stress of the trilinear displacement does, V mu 40/81 (1/h_x^2 + 1/h_y^2 + 1/h_z^2) |w / 8|^2 / 2.
 *
 * Of an octree, leaves without smaller ones beside them are hexahedra; the others, whose nodes in the middle of edges and faces move by themselves, are
 * tetrahedra. */
#ifndef PLIANT_FEM_DYNAMICS_TLED_CUBES_H
#define PLIANT_FEM_DYNAMICS_TLED_CUBES_H

#include "fem/dynamics/cube_bending.h"
#include "fem/dynamics/tled.h"
#include "fem/element/hexahedra.h"

#ifdef __cplusplus
extern "C" {
#endif

struct pliant_tled_cubes {
    int32_t count, num_blocks;
    pliant_cube *cube;          /* (count) */
    int32_t (*nodes)[8][LANES]; /* (num_blocks) */
    float (*moduli)[3][LANES];  /* two as of tetrahedra, and c of cube_bending.h; padding carries nothing */
    float (*finer)[LANES];      /* (num_blocks) 1 over the edge in smallest cells, of an octree's leaves */
    float gradient[9];          /* of a smallest cell: H = finer sum over axes a of w_a gradient_a' */
    pliant_cube_bending bending; /* likewise */
    int32_t *size;              /* (count) edge in smallest cells */
    int32_t num_tets;           /* that are in no cube */
    int32_t *tet;               /* (num_tets) */
    int32_t *element_of_tet;    /* (num_tets of the mesh) lane by lane: of the tetrahedra's blocks, then of the hexahedra's */
    double *node_mass;          /* (num_nodes) an eighth of a cube's [kg] */
};

/* all of it but forces; prony: sum of the shares */
pliant_status pliant_tled_cubes_create(const pliant_mesh *mesh, const pliant_tet_material *material, pliant_law law, double prony,
                                       pliant_tled_cubes **out);
void pliant_tled_cubes_free(pliant_tled_cubes *cubes); /* Nullable */
/* edges of one [m] */
void pliant_tled_cube_size(const pliant_mesh *mesh, const pliant_tled_cubes *cubes, int32_t cube, double size[3]);
/* means over a cube; its volume [m^3] */
double pliant_tled_cube_mean(const pliant_mesh *mesh, const pliant_cube *cube, const pliant_tet_material *material, double *lambda, double *mu,
                             double *density);
/* largest eigenvalue of a cube's stiffness over its volume [N/m^4] */
double pliant_cube_largest_eigenvalue(const double size[3], double lambda, double mu);

#ifdef __cplusplus
}
#endif

#endif
