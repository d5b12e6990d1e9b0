/* The visible surface of a cut body. The mesh's surface (pliant_body.triangles) consists of faces of whole tetrahedra,
 * so a cut tetrahedron lies on both sides of the cut. The visible surface ends where the scan is cut.
 *
 * Each fragment gets the part of its tetrahedron that is nearest to the fragment's voxels. Each vertex is bound to a
 * fragment, so the surface moves with the nodes and separates with them. It is closed wherever the mesh is closed: each
 * edge has the same number of triangles on both sides. */
#ifndef PLIANT_TOPOLOGY_VISIBLE_SURFACE_H
#define PLIANT_TOPOLOGY_VISIBLE_SURFACE_H

#include "base/export.h"
#include "topology/body.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_surface {
    const pliant_body *body;   /**< holds a reference */
    int32_t num_vertices;      /**< in addition to the nodes of the fine mesh */
    int32_t *tet;              /**< (num_vertices) fine tetrahedron that moves each vertex */
    double *weight;            /**< (num_vertices x 4) weights of its corners: at least 0, with sum 1 */
    /** (num_vertices) index into the table: material of the nearest voxel that moves with the vertex */
    uint16_t *material;
    int32_t num_triangles;
    /** (num_triangles x 3) outwards: a node of the fine mesh, or fine.num_nodes + a vertex */
    int32_t *triangle;
    int32_t first_cut;         /**< first triangle that is a cut face; all later ones are cut faces too */
    struct pliant_surface_kept *kept; /**< data that the next surface reuses (src/topology) */
} pliant_surface;

/** Create the visible surface of a body. For an uncut body, or with subdivision, it is the mesh's surface, without
 * additional vertices.
 *   @param before Nullable: the surface of another body of the same load. Equal parts are copied from it, which saves
 *                 time. The result is bitwise identical.
 * Errors: MEMORY. */
PLIANT_INTERNAL pliant_status pliant_surface_create(const pliant_body *body, const pliant_surface *before,
                                                    pliant_surface **out);
PLIANT_INTERNAL void pliant_surface_free(pliant_surface *surface); /**< Nullable */

/** Interpolate node values, such as positions or scalars, to the vertices.
 *   @param nodes (fine.num_nodes x size)
 *   @param out   (num_vertices x size) */
PLIANT_INTERNAL void pliant_surface_at_vertices(const pliant_surface *surface, int size, const double *nodes,
                                                double *out);

/** Write the surface to a file for other programs (PLY, text). Each point has its position, rest position, material and
 * values. Each triangle has a flag for cut faces. Points without triangles are omitted.
 *   @param positions (fine.num_nodes x 3) [m]
 *   @param unit      unit of lengths in the file [m]: 1, or 1e-3 for millimetres
 *   @param values    (num_values x fine.num_nodes) one after the other; NULL: none
 *   @param names     (num_values) names of the values in the file: letters, digits and _
 * Errors: ARGUMENT (unit), MEMORY, FILE. */
PLIANT_INTERNAL pliant_status pliant_surface_write(const char *path, const pliant_surface *surface,
                                                   const double *positions, double unit, int num_values,
                                                   const char *const *names, const float *values);

#ifdef __cplusplus
}
#endif
#endif
