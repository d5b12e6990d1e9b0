/* Hexahedra of explicit dynamics. The stress is evaluated at one point (Flanagan and Belytschko, Int. J. Numer. Meth.
 * Engng 17:679, 1981), from the mean deformation gradient. A separate stiffness resists the hourglass modes, which the
 * mean gradient does not contain. In a box the trilinear displacement is
 *     u = sum over m of w_m / 8 * product of +-1 over the axes in m,   w_m = sum over corners of +-1 u_a.
 *
 * The bits of m are x, y, z. The three single modes form the mean gradient; xy, yz, xz bend and twist a bar; xyz warps
 * its sides. Total Lagrangian modes contain no linear displacement, so |w_m| and F'w_m are independent of rotations
 * (Joldes, Wittek, Miller, Commun. Numer. Meth. Engng 24:1315, 2008). Therefore W = V psi(F) plus the mode energies
 * (cube_bending.h) is an energy. No parameter is free. The modes xy, yz, xz have the energy of bending and torsion. The
 * mode xyz has the deviatoric energy of the trilinear displacement, V mu 40/81 (1/h_x^2 + 1/h_y^2 + 1/h_z^2) |w / 8|^2
 * / 2.
 *
 * In an octree, leaves without adjacent smaller leaves are hexahedra. The others have nodes in the middle of edges and
 * faces that move freely, so they are tetrahedra. */
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
    float (*moduli)[3][LANES];  /* two moduli as for tetrahedra, and c of cube_bending.h; padding has zeros */
    float (*finer)[LANES];      /* (num_blocks) 1 divided by the edge in smallest cells, for an octree's leaves */
    float gradient[9];          /* of a smallest cell: H = finer sum over axes a of w_a gradient_a' */
    pliant_cube_bending bending; /* of a smallest cell */
    int32_t *size;              /* (count) edge in smallest cells */
    int32_t num_tets;           /* number of tetrahedra that are in no cube */
    int32_t *tet;               /* (num_tets) */
    int32_t *element_of_tet;    /* (num_tets of the mesh) lane by lane: in the tetrahedra's blocks, then in the
                                 * hexahedra's */
    double *node_mass;          /* (num_nodes) from an eighth of each cube's mass [kg] */
};

/* Create the hexahedra of a mesh, without forces.
 * @param material  (num_tets) of the elements; @param complete  with the part of lambda that acts as pressures, too
 * @param prony sum of the shares; @param stiffening as in struct pliant_tled_system */
pliant_status pliant_tled_cubes_create(const pliant_mesh *mesh, const pliant_tet_material *material,
                                       const pliant_tet_material *complete, pliant_law law, double prony,
                                       double stiffening, pliant_tled_cubes **out);
void pliant_tled_cubes_free(pliant_tled_cubes *cubes); /* Nullable */
/* Return the edge lengths of a cube [m]. */
void pliant_tled_cube_size(const pliant_mesh *mesh, const pliant_tled_cubes *cubes, int32_t cube, double size[3]);
/* Compute material means over a cube, and return its volume [m^3]. */
double pliant_tled_cube_mean(const pliant_mesh *mesh, const pliant_cube *cube, const pliant_tet_material *material,
                             double *lambda, double *mu, double *density);
/* Return the largest eigenvalue of a cube's stiffness divided by its volume [N/m^4]. */
double pliant_cube_largest_eigenvalue(const double size[3], double lambda, double mu);

#ifdef __cplusplus
}
#endif

#endif
