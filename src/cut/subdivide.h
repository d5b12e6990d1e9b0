/* Cuts that subdivide tetrahedra ([C] 5.2): the parts, in the order in which they run. */
#ifndef PLIANT_CUT_SUBDIVIDE_H
#define PLIANT_CUT_SUBDIVIDE_H

#include "cut/work.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The mesh while it is cut: nodes and tetrahedra of the body, then those appended. */
typedef struct cut_splitting {
    const pliant_body *body;
    const double *positions;       /* of the body's nodes */
    const cut_strip *strip;
    double slack;                  /* [m] */
    int32_t num_nodes, node_room;
    double *rest;                  /* (num_nodes x 3) */
    pliant_between *between;       /* (num_nodes) of those appended */
    uint8_t *fixed;                /* (num_nodes) pliant_fixing */
    uint8_t *on;                   /* (num_nodes) the stroke passes through it */
    int32_t *first;                /* (num_nodes) a corner that it is at, 4 tetrahedron + corner; -1: none */
    int32_t num_tets, tet_room;
    int32_t *corners;              /* (num_tets x 4) nodes */
    int32_t *next;                 /* (num_tets x 4) the next corner of the same node */
    int32_t *source;               /* (num_tets) tetrahedron of the body */
    int32_t *severed;              /* (num_tets x 4) of the face opposite a corner: 0, or 1 + the corner across it, from which it parts */
    int32_t num_around, around_room;
    int32_t *around;               /* (num_around) room for corners, or tetrahedra */
} cut_splitting;

/* A copy of the body's mesh. Errors: MEMORY. */
pliant_status pliant_split_begin(const pliant_body *body, const double *positions, const cut_strip *strip, cut_splitting *out);
void pliant_split_end(cut_splitting *work);
/* One more node, at no corner yet. Errors: MEMORY. */
pliant_status pliant_split_add_node(cut_splitting *work, pliant_between between, uint8_t fixed);
/* Errors: MEMORY. */
pliant_status pliant_split_add_tet(cut_splitting *work, const int32_t nodes[4], int32_t source);
void pliant_split_set_corner(cut_splitting *work, int32_t tet, int corner, int32_t node);
/* work->around: the corners of a node, ascending. Errors: MEMORY. */
pliant_status pliant_split_around(cut_splitting *work, int32_t node);

/* split_edges.c: cuts the edges that the strip passes through, or lays it through their ends. Errors: MEMORY. */
pliant_status pliant_split_edges(cut_splitting *work);
/* split_faces.c: faces at which the stroke parts tetrahedra, and copies of the nodes that then have two sides. Errors: MEMORY. */
pliant_status pliant_split_faces(cut_splitting *work, const pliant_cut_sweep *sweep, pliant_cut_report *report);

static inline double pliant_split_volume(const double *a, const double *b, const double *c, const double *d)
{
    double u[3], v[3], w[3];
    for (int i = 0; i < 3; i++) {
        u[i] = b[i] - a[i];
        v[i] = c[i] - a[i];
        w[i] = d[i] - a[i];
    }
    return (u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2]) + u[2] * (v[0] * w[1] - v[1] * w[0])) / 6;
}

#ifdef __cplusplus
}
#endif
#endif
