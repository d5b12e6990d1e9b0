/** @file save.h
 *  Meshes for other programs: ParaView, VTK, meshio, Blender.
 */
#ifndef PLIANT_SAVE_H
#define PLIANT_SAVE_H

#include "pliant/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Write a mesh by the ending of path. Axes are LPS, points are the deformed positions.
 *
 *  - .vtu (VTK XML, binary appended): the fine mesh. Cells are tetrahedra, or hexahedra with element/kind hexahedra.
 *  - .vtp (VTK XML, binary appended): the surface with its cut faces.
 *  - .ply (text): the same surface, as pliant_surface_write writes it.
 *
 *  Arrays of a .vtu file. A .vtp file has those marked p at its points, and `cut` in its triangles: 1 if a cut made it.
 *
 *  | array | of | meaning |
 *  |---|---|---|
 *  | rest_position | point, p | undeformed position [unit] |
 *  | displacement | point, p | deformed minus undeformed position [unit] |
 *  | contact_force | point, p | force of contact on the tissue [N] |
 *  | fixed | point | pliant_fixing |
 *  | material | cell, p at points | number in the material table; a comment at the top of the file lists the names |
 *  | material_fraction | cell | tissue's fraction of the cell's volume |
 *  | fragment | cell | 0; 1 and above for further fragments of a cut tetrahedron, which overlap |
 *  | piece | cell | 0 for tissue that is held; 1 and above for detached pieces |
 *  | stress | cell | Cauchy stress, 3 x 3, world axes [Pa] |
 *  | von_mises | cell | von Mises stress [Pa] |
 *  | strain | cell | Green-Lagrange strain, 3 x 3, axes at rest |
 *
 *  @param body           of the model, or of a simulation of it (pliant_data_get_body)
 *  @param positions      (body's fine.num_nodes x 3) LPS [m]
 *  @param contact_forces Nullable, and then there is no such array: (fine.num_nodes x 3) [N] (pliant_data_get_contact_forces)
 *  @param unit           of lengths in the file [m]: 1, or 1e-3 for millimetres. Forces and stresses keep N and Pa.
 *  Errors: ARGUMENT (ending, unit), FILE, MEMORY. A file that was there before is replaced at the end. */
PLIANT_API pliant_status pliant_mesh_save(const char *path, const pliant_model *model, const pliant_body *body, const double *positions,
                                          const double *contact_forces, double unit);

#ifdef __cplusplus
}
#endif
#endif
