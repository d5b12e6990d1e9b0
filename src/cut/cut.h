/* Cuts: the links between voxels that a blade severs, and the next body. */
#ifndef PLIANT_CUT_CUT_H
#define PLIANT_CUT_CUT_H

#include "pliant/cut.h"
#include "pliant/scan.h"
#include "topology/body.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A sweep of a blade's edge: a strip of triangles between the previous and the current edge. Deformed space, LPS
 * [m]. */
typedef struct pliant_cut_sweep {
    int32_t count;
    /* (count x 3) the same points of the edge, previous and current; `from` has moved with the tissue */
    const double *from, *to;
    /* Nullable; (voxels) for the report. Without it, the area in tissue is estimated from tetrahedra */
    const uint8_t *material_of_voxel;
    uint32_t blade, stroke;           /* a sweep continues the last sweep of the same stroke; stroke 0: a new start */
    bool ends;                        /* the stroke does not continue in the tissue that the edge has reached */
} pliant_cut_sweep;

/* Sever the links that a sweep passes through, and build the next body. The ends of a link move with their fragments.
 * A voxel, or less than about 3 % of a tetrahedron, that would be joined to nothing keeps its links to one side. A
 * sweep without area, with numbers that are not finite, or through air severs nothing.
 *   @param body      with voxels: body->cuts contains its fragments and its severed links. Or with a subdivision: the
 *                    sweep cuts edges, and tetrahedra separate at triangles whose three corners it has crossed. The
 *                    report then contains no links
 *   @param revision  as for pliant_body_next
 *   @param positions (body->fine.num_nodes x 3) [m]
 *   @param out       Nullable: compute only the report (pieces: 0). *out NULL: nothing was severed
 *   @param report    Nullable
 * Errors: MEMORY, ARGUMENT (a body without voxels), FORMAT. */
PLIANT_INTERNAL pliant_status pliant_body_cut(const pliant_body *body, uint64_t revision, const double *positions,
                                              const pliant_cut_sweep *sweep, pliant_body **out,
                                              pliant_cut_report *report);

/* Sever exactly these links and bridges, and build the next body. Repeating the log of another body's pliant_cuts from
 * the body at load gives bitwise identical bodies.
 *   @param severed (count) as in pliant_cuts, each for the first time
 * Errors: MEMORY, ARGUMENT (a body without voxels, an unknown link or bridge, severed earlier), FORMAT. */
PLIANT_INTERNAL pliant_status pliant_body_sever(const pliant_body *body, uint64_t revision, int32_t count,
                                                const uint32_t *severed, pliant_body **out);

/* Find the material points at points of the deformed body. If several tetrahedra contain a point, take the first one
 * that owns voxels there or has no fragments. All points share one search.
 *   @param points      (count x 3)
 *   @param tet         (count) out: fine tetrahedron of this body; -1: no tissue there
 *   @param barycentric (count x 4) out */
void pliant_body_locate_points(const pliant_body *body, const double *positions, int32_t count, const double *points,
                                          int32_t *tet, double *barycentric);

/* Find the material point at one point. Return whether tissue is there. */
bool pliant_body_locate(const pliant_body *body, const double *positions, const double point[3], int32_t *tet,
                        double barycentric[4]);

/* tissue_of_faces.c: return the nearest voxel; -1: outside of the scan.
 * point: in the frame of the scan [m] */
int64_t pliant_cut_voxel_at(const pliant_geometry *scan, const double point[3]);

#ifdef __cplusplus
}
#endif
#endif
