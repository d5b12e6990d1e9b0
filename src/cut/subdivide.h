/* Stages of a cut that subdivides tetrahedra ([C] 5.2), in their order. */
#ifndef PLIANT_CUT_SUBDIVIDE_H
#define PLIANT_CUT_SUBDIVIDE_H

#include "cut/cut_stages.h"

/* Bits of cut_splitting.on. The stroke's surface is the surface that the stroke sweeps, and its continuation within the
 * tetrahedra at its border. */
enum {
    CUT_ON_SURFACE = 1, /* on the stroke's surface */
    CUT_PASSED = 2,     /* on the stroke's surface, where the blade has passed */
    CUT_ON_SWEEP = 4,   /* on the surface of this sweep */
    CUT_ON_BORDER = 8   /* on the border of this sweep that is being trimmed */
};

/* Borders of a sweep: the paths of both ends of the blade's edge, and the edge at the beginning and end of a stroke. */
enum { CUT_FIRST_SIDE, CUT_LAST_SIDE, CUT_BEGINNING, CUT_END, CUT_NUM_BORDERS };

/* Mesh during the cut: nodes and tetrahedra of the body, followed by the appended ones. */
typedef struct cut_splitting {
    const pliant_body *body;
    const pliant_cut_sweep *sweep;
    const cut_strip *strip;
    bool has_border[CUT_NUM_BORDERS]; /* whether the swept surface ends there */
    bool is_trial;                 /* only find the area of the severed faces, and copy no nodes */
    double normal[3];              /* sum of the normals of the strip's triangles */
    double slack;                  /* [m] */
    double min_height;             /* minimum height of a tetrahedron [m] */
    int32_t num_nodes, node_capacity;
    int32_t first_copy;            /* nodes from this one on are copies */
    double *rest;                  /* (num_nodes x 3) rest positions */
    double *positions;             /* (num_nodes x 3) deformed positions */
    pliant_between *between;       /* (num_nodes) edge positions of the appended nodes */
    uint8_t *fixed;                /* (num_nodes) pliant_fixing */
    uint8_t *on;                   /* (num_nodes) CUT_ON_SURFACE and others */
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
pliant_status pliant_split_begin(const pliant_body *body, const double *positions, const pliant_cut_sweep *sweep,
                                 const cut_strip *strip, cut_splitting *out);
void pliant_split_end(cut_splitting *work);
/* Append a node that has no corner yet. Errors: MEMORY. */
pliant_status pliant_split_add_node(cut_splitting *work, pliant_between between, uint8_t fixed);
/* Append a tetrahedron. Errors: MEMORY. */
pliant_status pliant_split_add_tet(cut_splitting *work, const int32_t nodes[4], int32_t source);
void pliant_split_set_corner(cut_splitting *work, int32_t tet, int corner, int32_t node);
/* Collect the corners of a node in work->around, ascending. Errors: MEMORY. */
pliant_status pliant_split_around(cut_splitting *work, int32_t node);

/* An edge, and where it is cut. */
typedef struct cut_edge_point {
    int32_t end[2];  /* node numbers, ascending */
    double fraction; /* position of the intersection as a fraction of the edge */
    double length;   /* rest length [m] */
    uint8_t bits;    /* CUT_ON_SURFACE and others, of the node there */
} cut_edge_point;

typedef struct cut_edge_points {
    int32_t count, capacity;
    cut_edge_point *edges;
} cut_edge_points;

/* split_edges.c: cut the edges that the sweep crosses, or mark their ends as on the sweep. Errors: MEMORY. */
pliant_status pliant_split_edges(cut_splitting *work);
/* Append an edge. Errors: MEMORY. */
pliant_status pliant_split_list_edge(cut_edge_points *list, int32_t a, int32_t b, double fraction);
/* Order edges by their ends, then by the fraction (qsort). */
int pliant_split_by_ends(const void *a, const void *b);
/* Set the bits of listed edges at ends near which they are cut. Then bisect the other edges, the longest first, and set
 * the bits of the new nodes. Edges with `except` at an end are not bisected. Sorts the list. Errors: MEMORY. */
pliant_status pliant_split_listed(cut_splitting *work, cut_edge_points *list, uint8_t except);
/* Return whether the parts of an edge would be large enough. Errors: MEMORY. */
pliant_status pliant_split_can_bisect(cut_splitting *work, const cut_edge_point *one, bool *out);
/* enter_tets.c: compute the signed distances of a tetrahedron's corners from the part of the strip in it [m]. Return
 * false if the strip does not enter it.
 * at_border: out: whether the strip ends in it */
bool pliant_split_enters(const cut_splitting *work, int32_t tet, double distance[4], bool *at_border);
/* Return the number of segments of a border, and find the ends of one. */
int32_t pliant_split_border(const cut_splitting *work, int border, int32_t index, const double *end[2]);
/* Return whether the strip passes a node that is on its surface. */
bool pliant_split_passes(const cut_splitting *work, int32_t node);
/* trim_sweep.c: cut the edges in the sweep's surface that the borders of the sweep cross. Errors: MEMORY. */
pliant_status pliant_split_trim(cut_splitting *work);
/* split_faces.c: separate tetrahedra at faces on the stroke, and copy the nodes that both sides use. Errors: MEMORY. */
pliant_status pliant_split_faces(cut_splitting *work, const pliant_cut_sweep *sweep, pliant_cut_report *report);

/* parts_of_node.c: return whether a severed face has one of the corners in work->around. */
bool pliant_split_has_severed(const cut_splitting *work);
/* Group the corners around a node (work->around), and return the number of groups after the cut. Groups that only an
 * edge or the node connected before the cut stay connected.
 *
 * part: (num_around) out: groups connected by faces after the cut (pliant_set_root)
 * whole: (num_around) out: groups connected by faces before the cut */
int32_t pliant_split_find_parts(const cut_splitting *work, int32_t *part, int32_t *whole);
/* open_faces.c: bisect edges of severed faces that would stay closed because all their corners are on the border of the
 * cut. changed: out: whether faces must be severed again. Errors: MEMORY. */
pliant_status pliant_split_open_faces(cut_splitting *work, bool *changed);
/* tissue_of_faces.c: add a face's area in voxels of tissue to a report.
 * face: 4 tetrahedron + opposite corner
 * area: of the whole face at rest [m^2] */
void pliant_split_report_voxels(const cut_splitting *work, int32_t face, const uint8_t *material_of_voxel, double area,
                                pliant_cut_report *report);

/* Return the corner of another tetrahedron that is opposite a given face; -1 if it does not have that face. */
static inline int pliant_split_opposite(const int32_t *nodes, int corner, const int32_t *other)
{
    int found = 0, last = 6;
    for (int w = 0; w < 4; w++)
        for (int v = 0; v < 4; v++)
            if (v != corner && nodes[v] == other[w]) {
                found++;
                last -= w;
            }
    return found == 3 ? last : -1;
}

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

#endif
