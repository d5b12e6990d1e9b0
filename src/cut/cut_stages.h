/* Stages of a cut, in their order. */
#ifndef PLIANT_CUT_CUT_STAGES_H
#define PLIANT_CUT_CUT_STAGES_H

#include "topology/links.h"
#include "topology/sorted_numbers.h"
#include "cut/sparse.h"
#include "cut/cut.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A triangle swept by a blade.
 * normal: of any length */
typedef struct cut_triangle {
    double corner[9], normal[3], low[3], high[3];
} cut_triangle;

/* Triangles between the previous and the current position of a blade's edge, without degenerate ones. */
typedef struct cut_strip {
    int32_t count;
    cut_triangle *triangles;
    double low[3], high[3]; /* bounding box of all triangles */
} cut_strip;

/* A fragment with a smaller fraction of its tetrahedron's voxels is a chip unless it connects other elements. A
 * component without connections below this fraction is dust. */
#define CUT_MIN_FRACTION 0.03

/* Connected voxels of a touched tetrahedron. */
typedef struct cut_fragment {
    int32_t tet;      /* tetrahedron of the initial mesh */
    int32_t source;   /* fine tetrahedron of the previous body that contains it */
    int32_t voxels;
    int32_t host;     /* element with which it moved before the cut: source, or a fragment of another tetrahedron */
    bool was_chip;    /* whether it is a chip that moved with a fragment of another tetrahedron */
    bool stays;       /* whether it keeps the number of its source */
    int32_t receiver; /* element that received its voxels: a fragment or an untouched tetrahedron; -1: none */
    int32_t number;   /* number in the next body's fine tetrahedra */
} cut_fragment;

/* Two elements, and the number of unsevered links, diagonals and bridges between them. An element is a fragment
 * (numbered from the body's number of tetrahedra on) or an untouched tetrahedron (below). */
typedef struct cut_edge {
    int32_t end[2], weight;
} cut_edge;

typedef struct cut_work {
    const pliant_body *body;
    const pliant_voxels *voxels;
    const pliant_cuts *cuts;         /* cuts of the previous body; Nullable */
    const double *positions;
    uint32_t stroke[2];              /* blade and stroke of the sweep; 0 0: no stroke */
    /* ---- find_severed_links.c: newly severed links and bridges, ascending */
    int32_t num_links, num_bridges, link_capacity, bridge_capacity;
    uint32_t *link;
    double *link_area;               /* area at rest [m^2] */
    int32_t *bridge;
    /* ---- find_fragments.c */
    pliant_cuts *next;               /* all severed links after the cut; store_fragments.c adds the rest */
    /* per initial tetrahedron: > 0: 1 + index of a touched one; < 0: -1 - index in cuts; 0: neither (cut_state) */
    cut_sparse state;
    int32_t num_touched, touched_capacity, *touched; /* tetrahedra of the initial mesh, ascending */
    int32_t *start;                  /* (num_touched + 1) first index into voxel and part */
    int32_t *first;                  /* (num_touched + 1) first fragment of each */
    int32_t *voxel, *part;           /* voxels of touched tetrahedra, and their fragments */
    pliant_links links;              /* table of severed links around the touched tetrahedra */
    int32_t *place;                  /* (box of links) 1 + index into voxel; 0: no touched tetrahedron owns the voxel */
    /* (box of links) whether a link of the voxel, or of one of its 26 neighbours, is severed */
    uint8_t *is_near_severed_link;
    int32_t num_fragments;
    cut_fragment *fragment;
    /* ---- join_fragments.c */
    int32_t num_edges, edge_capacity, table_size;
    cut_edge *edge;
    int32_t *table;                  /* hash table: 1 + edge */
    /* ---- assign_nodes.c */
    int32_t num_tets, num_nodes;     /* counts of the next body */
    int32_t num_changed, *changed;   /* tetrahedra of the body that become fragments or have other corners; ascending */
    int32_t *corners;                /* (num_changed and appended tetrahedra x 4) nodes */
    int32_t *tet_source;             /* (appended tetrahedra) */
    uint8_t *copy_fixed;             /* (appended nodes) */
    int32_t num_joints, joint_capacity;
    int32_t *joint;                  /* (num_joints x 2) as in pliant_division */
    bool is_still_connected;         /* the surroundings of the touched tetrahedra are still connected by faces */
    /* ---- fragment_materials.c */
    pliant_tet_material *material;   /* (num_changed and appended tetrahedra) */
} cut_work;

/* Return the state of an initial tetrahedron. */
static inline int32_t cut_state(const cut_work *work, int32_t tet) { return cut_sparse_get(&work->state, tet); }
/* Return the initial tetrahedron of a fine one of the previous body. */
static inline int32_t cut_parent(const cut_work *work, int32_t tet)
{
    return work->body->tet_parent ? work->body->tet_parent[tet] : tet;
}
/* Return the initial tetrahedron of an element. */
static inline int32_t cut_tet_of(const cut_work *work, int32_t end)
{
    return end < work->body->fine.num_tets ? cut_parent(work, end)
                                           : work->fragment[end - work->body->fine.num_tets].tet;
}
/* Return the element that finally received a fragment's voxels: itself, another fragment, or an untouched
 * tetrahedron. */
static inline int32_t cut_receiver(const cut_work *work, int32_t end)
{
    while (end >= work->body->fine.num_tets && work->fragment[end - work->body->fine.num_tets].receiver >= 0)
        end = work->fragment[end - work->body->fine.num_tets].receiver;
    return end;
}
/* Return the number of an element in the next body's fine tetrahedra. */
static inline int32_t cut_number(const cut_work *work, int32_t end)
{
    end = cut_receiver(work, end);
    return end < work->body->fine.num_tets ? end : work->fragment[end - work->body->fine.num_tets].number;
}
/* Return the row of a tetrahedron of the next body in corners; -1: unchanged. */
static inline int32_t cut_row(const cut_work *work, int32_t tet)
{
    if (tet >= work->body->fine.num_tets) return work->num_changed + tet - work->body->fine.num_tets;
    return place_of(work->changed, work->num_changed, tet);
}
/* Return the nodes of a tetrahedron of the next body. */
static inline const int32_t *cut_corners(const cut_work *work, int32_t tet)
{
    const int32_t row = cut_row(work, tet);
    return row < 0 ? work->body->fine.tets + 4 * (size_t)tet : work->corners + 4 * (size_t)row;
}
/* Return whether two initial tetrahedra have a common face. */
static inline bool cut_share_face(const cut_work *work, int32_t a, int32_t b)
{
    const int32_t *across = work->voxels->across + 4 * (size_t)a;
    return across[0] == b || across[1] == b || across[2] == b || across[3] == b;
}

/* Build the strip of a sweep.
 * aside: shift of the strip [m]
 * out: free with pliant_free(out->triangles)
 * Errors: MEMORY. */
pliant_status pliant_cut_strip(const pliant_cut_sweep *sweep, const double aside[3], cut_strip *out);
/* subdivide.c: pliant_body_cut for a body with a subdivision. *out is NULL if nothing changes. */
pliant_status pliant_cut_subdivide(const pliant_body *body, uint64_t revision, const double *positions,
                                   const pliant_cut_sweep *sweep, pliant_body **out, pliant_cut_report *report);
/* cut.c: count the pieces with tissue; common nodes or joints connect tetrahedra to a piece. */
pliant_status pliant_cut_count_pieces(const pliant_body *body, int32_t *pieces);

/* find_near_tets.c: find the tetrahedra that a strip may touch. Each tetrahedron's box grows by `reach` times its
 * extent plus slack [m].
 * out: (fine.num_tets) 1: may touch; owned by the caller, also after an error
 * Errors: MEMORY. */
pliant_status pliant_cut_find_near_tets(const pliant_body *body, const double *positions, const cut_strip *strip,
                                        double reach, double slack, uint8_t **out);
/* Find the links and bridges that the sweep severs. */
pliant_status pliant_cut_sever(cut_work *work, const pliant_cut_sweep *sweep);
/* Append a newly severed link.
 * area: at rest [m^2] */
pliant_status pliant_cut_add_link(cut_work *work, uint32_t link, double area);
/* close_gaps.c: append the links that this sweep and earlier sweeps of the stroke have missed, in ascending order. */
pliant_status pliant_cut_close_seam(cut_work *work);
/* Sort the newly severed links and bridges, and remove duplicates. */
pliant_status pliant_cut_sort_severed(cut_work *work);
/* Find the tetrahedra that own an end of a severed link, and their fragments. */
pliant_status pliant_cut_find_touched(cut_work *work);
/* Find the edges between elements. */
pliant_status pliant_cut_find_edges(cut_work *work);
/* Restore newly severed links of components of a few voxels. If *changed, touch and find_edges must run again. */
pliant_status pliant_cut_restore_small_components(cut_work *work, bool *changed);
/* Assign chips to the elements that they move with. */
pliant_status pliant_cut_assign_chips(cut_work *work);
/* Return the element of a voxel that has an owner. */
int32_t pliant_cut_end_of(const cut_work *work, int32_t voxel);
/* Return the weight of the edge between two elements; 0: none. */
int32_t pliant_cut_edge(const cut_work *work, int32_t a, int32_t b);
/* Assign nodes to corners, and number tetrahedra and nodes. */
pliant_status pliant_cut_corners(cut_work *work);
/* Sever links between elements that no node connects. If *changed, all stages must run again. */
pliant_status pliant_cut_sever_unrepresentable(cut_work *work, bool *changed);
pliant_status pliant_cut_materials(cut_work *work);
/* Store the fragments and joins in work->next. */
pliant_status pliant_cut_gather(cut_work *work);

#ifdef __cplusplus
}
#endif
#endif
