/** @file save.h
 *  Meshes for other programs: ParaView, VTK, meshio, Blender.
 */
#ifndef PLIANT_SAVE_H
#define PLIANT_SAVE_H

#include "pliant/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Write a mesh. Axes are LPS, points are the deformed positions. An existing file is replaced after the new file is
 *  complete.
 *
 *  - .vtu (VTK XML, binary appended): the fine mesh. Cells are tetrahedra, or hexahedra with element/kind hexahedra.
 *  - .vtp (VTK XML, binary appended): the surface with its cut faces.
 *  - .ply (text): the same surface with rest_position, material and cut.
 *
 *  Arrays of a .vtu file. A .vtp file has the arrays marked p at its points, and `cut` at its triangles: 1 for a face
 *  of a cut.
 *
 *  | array | at | meaning |
 *  |---|---|---|
 *  | rest_position | point, p | undeformed position [unit] |
 *  | displacement | point, p | deformed minus undeformed position [unit] |
 *  | contact_force | point, p | contact force on the tissue [N] |
 *  | fixed | point | pliant_fixing |
 *  | material | cell, p at points | index into the material table; a comment at the top of the file lists the names |
 *  | material_fraction | cell | tissue's fraction of the cell's volume |
 *  | fragment | cell | 0; 1 and above for further fragments of a cut tetrahedron, which overlap |
 *  | piece | cell | 0 for attached tissue; 1 and above for detached pieces |
 *  | stress | cell | Cauchy stress, 3 x 3, world axes [Pa] |
 *  | von_mises | cell | von Mises stress [Pa] |
 *  | strain | cell | Green-Lagrange strain, 3 x 3, axes at rest |
 *
 *  @param path           Its ending selects the format.
 *  @param model          The model.
 *  @param body           Body of the model, or of its simulation (pliant_data_get_body).
 *  @param positions      (body->fine.num_nodes x 3) LPS [m].
 *  @param contact_forces Nullable: no such array. (body->fine.num_nodes x 3) [N], from pliant_data_get_contact_forces.
 *  @param unit           Unit of lengths in the file [m]: 1, or 1e-3 for millimetres. Forces and stresses are in N and
 *                        Pa.
 *  @return Errors: ARGUMENT (ending, unit), FILE, MEMORY. */
PLIANT_API pliant_status pliant_mesh_save(const char *path, const pliant_model *model, const pliant_body *body,
                                          const double *positions, const double *contact_forces, double unit);

#ifdef __cplusplus
}
#endif
#endif
