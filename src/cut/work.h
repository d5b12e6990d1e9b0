/* The parts of a cut, in the order in which they run. */
#ifndef PLIANT_CUT_WORK_H
#define PLIANT_CUT_WORK_H

#include "topology/links.h"
#include "topology/parts.h"
#include "cut/sparse.h"
#include "pliant/cut.h"

#ifdef __cplusplus
extern "C" {
#endif

/* One that a blade sweeps. normal: of any length */
typedef struct cut_triangle {
    double corner[9], normal[3], low[3], high[3];
} cut_triangle;

/* Between where a blade's edge was and where it is; without those that have no area. */
typedef struct cut_strip {
    int32_t count;
    cut_triangle *triangles;
    double low[3], high[3]; /* of all of them */
} cut_strip;

/* Of its tetrahedron's voxels, a fragment with less is a chip, if nobody needs it between them; what nobody holds, dust. */
#define CUT_LEAST_SHARE 0.03

/* Voxels of a touched tetrahedron that hang together within it. */
typedef struct cut_fragment {
    int32_t tet;      /* at load */
    int32_t source;   /* fine tetrahedron of the body before that it is a part of */
    int32_t voxels;
    int32_t host;     /* the one that it moved with: source, or of another tetrahedron */
    bool came_back;   /* a chip that moved with a fragment of another tetrahedron */
    bool stays;       /* it keeps the number of its source */
    int32_t into;     /* what took its voxels over: a fragment or an untouched tetrahedron; -1: it stands for itself */
    int32_t number;   /* fine tetrahedron of the next body */
} cut_fragment;

/* Two that unsevered links, diagonals or bridges join, and how many: fragments (from the body's number of tetrahedra on) or untouched
 * tetrahedra (below). */
typedef struct cut_edge {
    int32_t end[2], weight;
} cut_edge;

typedef struct cut_work {
    const pliant_body *body;
    const pliant_voxels *voxels;
    const pliant_cuts *cuts;         /* of the body before; Nullable */
    const double *positions;
    uint32_t stroke[2];              /* blade and stroke of the sweep; 0 0: of none */
    /* ---- sever.c: what is newly severed, ascending */
    int32_t num_links, num_bridges, link_room, bridge_room;
    uint32_t *link;
    double *link_area;               /* [m^2], at rest */
    int32_t *bridge;
    /* ---- touch.c */
    pliant_cuts *next;               /* what is severed then; the rest follows in gather.c */
    cut_sparse state;                /* of tetrahedra at load; > 0: touched, from 1 on; < 0: in cuts, from -1 on; 0: neither (cut_state) */
    int32_t num_touched, touched_room, *touched; /* tetrahedra at load, ascending */
    int32_t *start;                  /* (num_touched + 1) into voxel, part */
    int32_t *first;                  /* (num_touched + 1) fragments of each */
    int32_t *voxel, *part;           /* of touched tetrahedra; part: fragment */
    pliant_links links;              /* with a table of what is severed around them */
    int32_t *place;                  /* (its box) 1 + index into voxel; 0: no touched tetrahedron owns it */
    uint8_t *doubtful;               /* (its box) whether a link is severed of it or of one of the 26 around it */
    int32_t num_fragments;
    cut_fragment *fragment;
    /* ---- join.c */
    int32_t num_edges, edge_room, table_size;
    cut_edge *edge;
    int32_t *table;                  /* hash: 1 + edge */
    /* ---- corners.c */
    int32_t num_tets, num_nodes;     /* of the next body */
    int32_t num_changed, *changed;   /* tetrahedra of the body that are fragments now, or have other corners; ascending */
    int32_t *corners;                /* (num_changed and those appended x 4) */
    int32_t *tet_source;             /* (appended) */
    uint8_t *copy_fixed;             /* (appended nodes) */
    int32_t num_joints, joint_room;
    int32_t *joint;                  /* (num_joints x 2) of pliant_division */
    bool in_one;                     /* all around what is touched still hangs together by faces there */
    /* ---- materials.c */
    pliant_tet_material *material;   /* (num_changed and those appended) */
} cut_work;

/* what is known of a tetrahedron at load */
static inline int32_t cut_state(const cut_work *work, int32_t tet) { return cut_sparse_get(&work->state, tet); }
/* the tetrahedron at load of a fine one of the body before */
static inline int32_t cut_parent(const cut_work *work, int32_t tet) { return work->body->tet_parent ? work->body->tet_parent[tet] : tet; }
/* of an end of an edge */
static inline int32_t cut_tet_of(const cut_work *work, int32_t end)
{
    return end < work->body->fine.num_tets ? cut_parent(work, end) : work->fragment[end - work->body->fine.num_tets].tet;
}
/* what a fragment's voxels went to in the end: itself, another, or an untouched tetrahedron */
static inline int32_t cut_final(const cut_work *work, int32_t end)
{
    while (end >= work->body->fine.num_tets && work->fragment[end - work->body->fine.num_tets].into >= 0)
        end = work->fragment[end - work->body->fine.num_tets].into;
    return end;
}
/* the fine tetrahedron of the next body */
static inline int32_t cut_number(const cut_work *work, int32_t end)
{
    end = cut_final(work, end);
    return end < work->body->fine.num_tets ? end : work->fragment[end - work->body->fine.num_tets].number;
}
/* where a tetrahedron of the next body is listed in corners; -1: it is as it was */
static inline int32_t cut_row(const cut_work *work, int32_t tet)
{
    if (tet >= work->body->fine.num_tets) return work->num_changed + tet - work->body->fine.num_tets;
    return place_of(work->changed, work->num_changed, tet);
}
/* its nodes */
static inline const int32_t *cut_corners(const cut_work *work, int32_t tet)
{
    const int32_t row = cut_row(work, tet);
    return row < 0 ? work->body->fine.tets + 4 * (size_t)tet : work->corners + 4 * (size_t)row;
}
/* whether two tetrahedra at load have a face in common */
static inline bool cut_share_face(const cut_work *work, int32_t a, int32_t b)
{
    const int32_t *across = work->voxels->across + 4 * (size_t)a;
    return across[0] == b || across[1] == b || across[2] == b || across[3] == b;
}

/* aside: all of it is moved by that [m]; freed with pliant_free(out->triangles). Errors: MEMORY. */
pliant_status pliant_cut_strip(const pliant_cut_sweep *sweep, const double aside[3], cut_strip *out);
/* subdivide.c: pliant_body_cut for a body with a subdivision; *out is NULL where nothing changes */
pliant_status pliant_cut_subdivide(const pliant_body *body, uint64_t revision, const double *positions, const pliant_cut_sweep *sweep, pliant_body **out,
                                   pliant_cut_report *report);
/* cut.c: pieces with tissue; they hang together where they have nodes in common, or joints */
pliant_status pliant_cut_count_pieces(const pliant_body *body, int32_t *pieces);

/* near.c: tetrahedra whose boxes, each reaching further by `reach` of its own extent and slack [m], may meet that of the strip. out: (fine.num_tets) 1:
 * may; the caller's to free, also on an error. Errors: MEMORY. */
pliant_status pliant_cut_near(const pliant_body *body, const double *positions, const cut_strip *strip, double reach, double slack, uint8_t **out);
/* Links and bridges that the sweep severs; slack: [m] */
pliant_status pliant_cut_sever(cut_work *work, const pliant_cut_sweep *sweep);
/* One more that is newly severed; area: at rest [m^2] */
pliant_status pliant_cut_add_link(cut_work *work, uint32_t link, double area);
/* seam.c: what this sweep of a stroke and those before it have missed, beside what is newly severed, ascending */
pliant_status pliant_cut_close_seam(cut_work *work);
/* what is newly severed, ascending, each once */
pliant_status pliant_cut_sort_severed(cut_work *work);
/* Tetrahedra that own an end of them, and their fragments. */
pliant_status pliant_cut_touch(cut_work *work);
/* Who is joined to whom. */
pliant_status pliant_cut_find_edges(cut_work *work);
/* What is nobody's keeps links that were newly severed. changed: then touch, and find edges, again */
pliant_status pliant_cut_keep_dust(cut_work *work, bool *changed);
/* Chips move with those that they hang on. */
pliant_status pliant_cut_give_chips(cut_work *work);
/* the end of edges that a voxel with an owner belongs to */
int32_t pliant_cut_end_of(const cut_work *work, int32_t voxel);
/* weight of the edge between two; 0: none */
int32_t pliant_cut_edge(const cut_work *work, int32_t a, int32_t b);
/* Which corners are one node; numbers of tetrahedra and nodes. */
pliant_status pliant_cut_corners(cut_work *work);
/* What no node holds is severed, too. changed: then all of it again */
pliant_status pliant_cut_part_unheld(cut_work *work, bool *changed);
pliant_status pliant_cut_materials(cut_work *work);
/* The fragments and joins of work->next. */
pliant_status pliant_cut_gather(cut_work *work);

#ifdef __cplusplus
}
#endif
#endif
