/* Functions on the faces of a mesh whose neighbours are known (pliant_mesh_neighbours). */
#ifndef PLIANT_MESH_FACES_H
#define PLIANT_MESH_FACES_H

#include "pliant/mesh.h"

/* Corners of the face opposite each corner, counter-clockwise from outside for a positive tetrahedron. */
static const int pliant_face_corners[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};

/* Return the nodes of a face's triangle. */
static inline void pliant_face_triangle(const pliant_mesh *mesh, int32_t face, int32_t out[3])
{
    for (int v = 0; v < 3; v++) out[v] = mesh->tets[4 * (size_t)(face / 4) + (size_t)pliant_face_corners[face % 4][v]];
}

#endif
