/* The surface of a body as it is seen. The surface of the mesh (pliant_body.triangles) is that of whole tetrahedra, of which those that a cut
 *  passes through lie on both of its sides; this one ends where the scan is cut.
 *
 *  Each fragment has the part of its tetrahedron that is nearer to its own voxels. Every vertex is bound to a fragment, so that the surface
 *  moves with the nodes and parts where they do. It is closed wherever the mesh is: every edge has as many triangles on one side as on the other.
 */
#ifndef PLIANT_TOPOLOGY_VISIBLE_SURFACE_H
#define PLIANT_TOPOLOGY_VISIBLE_SURFACE_H

#include "base/export.h"
#include "topology/body.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_surface {
    const pliant_body *body;   /**< one holder of it */
    int32_t num_vertices;      /**< beside the nodes of the fine mesh */
    int32_t *tet;              /**< (num_vertices) fine tetrahedron that each moves with */
    double *weight;            /**< (num_vertices x 4) of its corners: none below 0, together 1 */
    uint16_t *material;        /**< (num_vertices) in the table: of the nearest voxel that moves with it */
    int32_t num_triangles;
    int32_t *triangle;         /**< (num_triangles x 3) outwards: a node of the fine mesh, or fine.num_nodes + a vertex */
    int32_t first_cut;         /**< triangles from there on are faces that cuts have made */
    struct pliant_surface_kept *kept; /**< what the next one takes over (src/topology) */
} pliant_surface;

/** The surface of a body. Of one that is not cut, or whose tetrahedra cuts subdivide, it is that of the mesh, without vertices of its own.
 *  @param before Nullable: of another body of the same load; what is the same is taken from there. The outcome is the same, bit for bit;
 *                the time is that of what differs, and of copying the rest.
 *  Errors: MEMORY. */
PLIANT_INTERNAL pliant_status pliant_surface_create(const pliant_body *body, const pliant_surface *before, pliant_surface **out);
PLIANT_INTERNAL void pliant_surface_free(pliant_surface *surface); /**< Nullable */

/** Numbers at the vertices from those at the nodes: positions, scalars.
 *  @param nodes (fine.num_nodes x size)
 *  @param out   (num_vertices x size) */
PLIANT_INTERNAL void pliant_surface_at_vertices(const pliant_surface *surface, int size, const double *nodes, double *out);

/** A file (PLY, text) that other programs show: where every point is, its rest position and material, and numbers; of every triangle whether a cut
 *  has made it. Points that no triangle has are left out.
 *  @param positions (fine.num_nodes x 3) [m]
 *  @param unit      of lengths in the file [m]: 1, or 1e-3 for millimetres
 *  @param values    (num_values x fine.num_nodes) one after the other; NULL where there are none
 *  @param names     (num_values) what they are called in the file: letters, digits and _
 *  Errors: ARGUMENT (unit), MEMORY, FILE. */
PLIANT_INTERNAL pliant_status pliant_surface_write(const char *path, const pliant_surface *surface, const double *positions, double unit, int num_values,
                                              const char *const *names, const float *values);

#ifdef __cplusplus
}
#endif
#endif
