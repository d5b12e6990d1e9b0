/* Sections of a tetrahedral mesh with the plane of a picture. */
#ifndef PLIANT_TOOLS_PICTURE_SECTION_H
#define PLIANT_TOOLS_PICTURE_SECTION_H

#include "picture.h"
#include "pliant/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Find the tetrahedron at every pixel, row by row; -1: none. Where tetrahedra overlap, the last one counts. Free
 * *tet_of_pixel with pliant_free. Errors: MEMORY.
 * @param point on the plane, LPS [m]
 * @param positions (mesh->num_nodes x 3) LPS [m] */
pliant_status picture_section(const picture_frame *frame, const double point[3], const pliant_mesh *mesh,
                              const double *positions, int32_t **tet_of_pixel);

typedef struct picture_mesh {
    const pliant_mesh *mesh;
    const double *positions;     /* (mesh->num_nodes x 3) LPS [m] */
    const uint8_t *material;     /* (mesh->num_tets) index in the material table */
    const uint8_t *collided;     /* (mesh->num_tets) not 0: the tetrahedron is red */
    const double *strips;        /* (num_strips x 4 corners x 3) parallelograms that blades have swept, LPS [m] */
    int32_t num_strips;
    /* Nullable: (materials x 3) red, green, blue; black: picture_label_colour of index + 1 */
    const uint8_t *colors;
} picture_mesh;

/* Write folder/meshSUFFIX_axial.png, _coronal.png and _sagittal.png. Tetrahedra have dark edges and the colour of their
 * material; collided tetrahedra are red. White lines show the strips. The bounding box of the positions fills a
 * picture. Errors: FILE, MEMORY. */
pliant_status picture_mesh_write(const char *folder, const char *suffix, const picture_mesh *mesh,
                                 const double point[3]);

#ifdef __cplusplus
}
#endif
#endif
