/* What a blade severs: links between voxels, and the next body that follows from it. */
#ifndef PLIANT_CUT_CUT_H
#define PLIANT_CUT_CUT_H

#include "pliant/cut.h"
#include "topology/body.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Of a blade's edge: a strip of triangles between where the edge was and where it is. Deformed space, LPS [m]. */
typedef struct pliant_cut_sweep {
    int32_t count;
    const double *from, *to;          /* (count x 3) the same points along the edge, before and now; `from` has moved with the tissue */
    const uint8_t *material_of_voxel; /* Nullable; (voxels) for the report */
    uint32_t blade, stroke;           /* sweeps of one stroke of one blade go on from where the last one ended; stroke 0: from nowhere */
} pliant_cut_sweep;

/* The next body, of which the sweep has severed what it passes through: every end of a link is where its fragment has moved it.
 *  What would be joined to nobody, a voxel or less than about 3 % of a tetrahedron, keeps its links to one side.
 *  Sweeps without an area, with numbers that are none, or through air sever nothing.
 *  @param body      with voxels; its fragments and what was severed before are in body->cuts. Or with a subdivision: edges that the sweep
 *                   passes through are cut, and its tetrahedra part at triangles of which it has crossed all corners; the report tells no links
 *  @param revision  as for pliant_body_next
 *  @param positions (body->fine.num_nodes x 3) [m]
 *  @param out       Nullable: then only the report is made (pieces: 0). *out NULL: nothing was severed
 *  @param report    Nullable
 *  Errors: MEMORY, ARGUMENT (a body without voxels), FORMAT. */
PLIANT_INTERNAL pliant_status pliant_body_cut(const pliant_body *body, uint64_t revision, const double *positions, const pliant_cut_sweep *sweep,
                                         pliant_body **out, pliant_cut_report *report);

/* The next body once more, of which just these links and bridges have been severed, as another one's pliant_cuts tells of each of its cuts:
 *  a recording makes the same bodies again, bit for bit, from the one at load on.
 *  @param severed (count) as in pliant_cuts, each for the first time
 *  Errors: MEMORY, ARGUMENT (a body without voxels, no such link or bridge, severed before), FORMAT. */
PLIANT_INTERNAL pliant_status pliant_body_sever(const pliant_body *body, uint64_t revision, int32_t count, const uint32_t *severed, pliant_body **out);

/* The material points under points of the deformed body: of tetrahedra that hold a point, the first whose own voxels are there, or
 *  that is in no fragments. One search for all.
 *  @param points      (count x 3)
 *  @param tet         (count) out: fine tetrahedron of this body; -1: no tissue there
 *  @param barycentric (count x 4) out */
void pliant_body_locate_points(const pliant_body *body, const double *positions, int32_t count, const double *points,
                                          int32_t *tet, double *barycentric);

/* The same for one. @return whether tissue is there */
bool pliant_body_locate(const pliant_body *body, const double *positions, const double point[3], int32_t *tet, double barycentric[4]);

#ifdef __cplusplus
}
#endif
#endif
