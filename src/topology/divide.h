/* Stages that build the next body. */
#ifndef PLIANT_BODY_DIVIDE_H
#define PLIANT_BODY_DIVIDE_H

#include "topology/body.h"

/* ---- body.c: copy a body, except the neighbours across faces and the surface, which follow from the new corners.
 * Without with_cuts, the caller provides the cuts, and reports where it writes to the fine mesh, its parents and its
 * materials (base/buffer.h). */
pliant_status pliant_body_begin(const pliant_body *body, uint64_t revision, bool with_cuts, pliant_body **out);

/* ---- append.c: extend a list of count elements by copies of the elements in source (appended). */
pliant_status pliant_body_append(void *list, size_t size, int32_t count, int32_t appended, const int32_t *source);
/* Extend a list of parents in the same way. A NULL list is created first. */
pliant_status pliant_body_append_parents(int32_t **parent, int32_t count, int32_t appended, const int32_t *source);

/* Append copies of fine nodes to a body. */
pliant_status pliant_body_append_nodes(pliant_body *next, int32_t appended, const int32_t *source);

/* ---- face_neighbours.c */
/* Faces, as 4 tetrahedron + opposite corner, whose neighbour has changed. If not known, the list is not available. */
typedef struct body_faces {
    bool known;
    int32_t count, capacity, *face;
} body_faces;
/* Update next->across from next->changes.
 * cuts: cuts of next if its fragments consist of voxels, otherwise NULL
 * other: output; the caller frees its list */
pliant_status pliant_body_find_across(const pliant_body *before, const pliant_cuts *cuts, pliant_body *next,
                                      body_faces *other);
/* Build next->triangles from the previous triangles. The corners of next must be final. The list of `other` is sorted
 * and extended. */
pliant_status pliant_body_find_surface(const pliant_body *before, pliant_body *next, body_faces *other);

/* ---- subdivision.c */
void pliant_subdivision_free(pliant_subdivision *subdivision); /* Nullable */
/* nodes: number of nodes of the body */
pliant_status pliant_subdivision_copy(const pliant_subdivision *from, int32_t nodes, pliant_subdivision **out);
/* Append the edge positions of new nodes.
 * source: used if between is NULL: nodes whose entries are copied */
pliant_status pliant_subdivision_append(pliant_subdivision *subdivision, int32_t nodes, int32_t appended,
                                        const int32_t *source);

/* ---- pieces.c */
/* Find the pieces of next that nothing fixed holds any more; its topology must be complete. Their nodes become fixed,
 * and they get copies of the nodes that they share with other tissue.
 * next->changes: must list all other changes
 * rebuilt: output; whether nodes may have been copied */
pliant_status pliant_body_find_pieces(pliant_body *next, const pliant_division *division, bool *rebuilt);
pliant_status pliant_pieces_copy(const pliant_pieces *pieces, pliant_pieces **out);
void pliant_pieces_free(pliant_pieces *pieces); /* Nullable */

#endif
