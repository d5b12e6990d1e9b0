/* Stages of a cut that subdivides tetrahedra ([C] 5.2), in their order. */
#ifndef PLIANT_CUT_SUBDIVIDE_H
#define PLIANT_CUT_SUBDIVIDE_H

#include "cut/cut_stages.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Mesh during the cut: nodes and tetrahedra of the body, followed by the appended ones. */
typedef struct cut_splitting {
    const pliant_body *body;
    const double *positions;       /* deformed positions of the body's nodes */
    const cut_strip *strip;
    double normal[3];              /* sum of the normals of the strip's triangles */
    double slack;                  /* [m] */
    int32_t num_nodes, node_capacity;
    int32_t first_copy;            /* nodes from this one on are copies */
    double *rest;                  /* (num_nodes x 3) rest positions */
    pliant_between *between;       /* (num_nodes) edge positions of the appended nodes */
    uint8_t *fixed;                /* (num_nodes) pliant_fixing */
    uint8_t *on;                   /* (num_nodes) whether the stroke passes through the node */
    int32_t *first;                /* (num_nodes) a corner of the node, 4 tetrahedron + corner; -1: none */
    int32_t num_tets, tet_capacity;
    int32_t *corners;              /* (num_tets x 4) nodes */
    int32_t *next;                 /* (num_tets x 4) next corner of the same node */
    int32_t *source;               /* (num_tets) source tetrahedron of the body */
    /* (num_tets x 4) for the face opposite each corner: 0, or 1 + the corner on its other side if the face is
     * severed */
    int32_t *severed;
    int32_t num_around, around_capacity;
    int32_t *around;               /* (num_around) buffer for corners or tetrahedra */
} cut_splitting;

/* Copy the body's mesh. Errors: MEMORY. */
pliant_status pliant_split_begin(const pliant_body *body, const double *positions, const cut_strip *strip,
                                 cut_splitting *out);
void pliant_split_end(cut_splitting *work);
/* Append a node that has no corner yet. Errors: MEMORY. */
pliant_status pliant_split_add_node(cut_splitting *work, pliant_between between, uint8_t fixed);
/* Append a tetrahedron. Errors: MEMORY. */
pliant_status pliant_split_add_tet(cut_splitting *work, const int32_t nodes[4], int32_t source);
void pliant_split_set_corner(cut_splitting *work, int32_t tet, int corner, int32_t node);
/* Collect the corners of a node in work->around, ascending. Errors: MEMORY. */
pliant_status pliant_split_around(cut_splitting *work, int32_t node);

/* split_edges.c: cut the edges that the strip passes through, or mark their ends as on the stroke. Errors: MEMORY. */
pliant_status pliant_split_edges(cut_splitting *work);
/* split_faces.c: separate tetrahedra at faces on the stroke, and copy the nodes that both sides use. Errors: MEMORY. */
pliant_status pliant_split_faces(cut_splitting *work, const pliant_cut_sweep *sweep, pliant_cut_report *report);

static inline double pliant_split_volume(const double *a, const double *b, const double *c, const double *d)
{
    double u[3], v[3], w[3];
    for (int i = 0; i < 3; i++) {
        u[i] = b[i] - a[i];
        v[i] = c[i] - a[i];
        w[i] = d[i] - a[i];
    }
    return (u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2]) +
            u[2] * (v[0] * w[1] - v[1] * w[0])) /
           6;
}

#ifdef __cplusplus
}
#endif
#endif
