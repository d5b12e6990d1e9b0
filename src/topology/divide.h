/* The parts of a division. */
#ifndef PLIANT_BODY_DIVIDE_H
#define PLIANT_BODY_DIVIDE_H

#include "pliant/body.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- body.c: what a next body has of this one, but for what follows from its corners: who is across faces, and the surface. Without cuts, which are
 * another's then, who writes to the fine mesh, its parents and its materials tells where (base/room.h). */
pliant_status pliant_body_begin(const pliant_body *body, uint64_t revision, bool with_cuts, pliant_body **out);

/* ---- append.c: a list with count elements at first, made longer; copies of the elements that source (those appended) names */
pliant_status pliant_body_append(void *list, size_t size, int32_t count, int32_t appended, const int32_t *source);
/* likewise: the parents; a list that is NULL is made first */
pliant_status pliant_body_append_parents(int32_t **parent, int32_t count, int32_t appended, const int32_t *source);

/* copies of fine nodes of next, at its end */
pliant_status pliant_body_append_nodes(pliant_body *next, int32_t appended, const int32_t *source);

/* ---- across.c */
/* Faces, 4 tetrahedron + opposite corner, of which another is across than before; none are known: not which. */
typedef struct body_faces {
    bool known;
    int32_t count, room, *face;
} body_faces;
/* next->across, by what next->changes lists; cuts: of next, where fragments are of voxels, else NULL. other: out, its list is the caller's to free */
pliant_status pliant_body_find_across(const pliant_body *before, const pliant_cuts *cuts, pliant_body *next, body_faces *other);
/* next->triangles from those before, its corners being what they will be; other's list is sorted, and longer. */
pliant_status pliant_body_find_surface(const pliant_body *before, pliant_body *next, body_faces *other);

/* ---- subdivision.c */
void pliant_subdivision_free(pliant_subdivision *subdivision); /* Nullable */
/* nodes: of the body that has it */
pliant_status pliant_subdivision_copy(const pliant_subdivision *from, int32_t nodes, pliant_subdivision **out);
/* Nodes appended to those that were there: what each lies between. source: where between is NULL, copies of these */
pliant_status pliant_subdivision_append(pliant_subdivision *subdivision, int32_t nodes, int32_t appended, const int32_t *source);

/* ---- pieces.c */
/* Lists what nothing holds any more in next, of which the topology is there; fixes its nodes, and gives it copies of those that it hangs on.
 * next->changes: lists all but that. anew: out, whether anything may have got such copies */
pliant_status pliant_body_find_pieces(pliant_body *next, const pliant_division *division, bool *anew);
pliant_status pliant_pieces_copy(const pliant_pieces *pieces, pliant_pieces **out);
void pliant_pieces_free(pliant_pieces *pieces); /* Nullable */

#ifdef __cplusplus
}
#endif
#endif
