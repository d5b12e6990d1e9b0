/* The topology of tissue that cuts change: voxels and their links, fragments, pieces; and how the next body is made. */
#ifndef PLIANT_TOPOLOGY_BODY_H
#define PLIANT_TOPOLOGY_BODY_H

#include "base/export.h"
#include "pliant/body.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Which voxels are joined at load: the finest level of a body, made only where a scene may cut (pliant_voxels_create), constant, shared by
 *  all bodies of a load and counted by reference. A fragment of a fine tetrahedron is a set of its voxels.
 *
 *  Neighbours along an axis are joined by a link, unless it is severed (pliant_cuts); neighbours across an edge by one of the two ways over
 *  links through a voxel that a tetrahedron owns, where neither of its links is severed. Bridges join what these leave apart: within an uncut
 *  tetrahedron, across a face, and at a node where tetrahedra meet that no faces join. */
struct pliant_voxels {
    pliant_geometry geometry;
    int32_t num_tets, num_nodes; /* of the fine mesh at load */
    int32_t *owner;            /* (voxels) the tetrahedron at load that owns it, ties to the central one; -1: none */
    int32_t *start, *voxel;    /* (num_tets + 1), (those that are owned): by tetrahedron, ascending */
    uint8_t *material;         /* (those that are owned, in this order) index into of_material */
    int32_t num_materials;
    pliant_tet_material *of_material; /* (num_materials) of a single voxel */
    uint8_t *fixed_material;   /* (num_materials) does not move */
    pliant_tet_material *load; /* (num_tets) of the tetrahedra at load */
    int32_t num_bridges;
    int32_t *bridge;           /* (num_bridges x 2) voxels; those within a tetrahedron first, by tetrahedron */
    int32_t *bridge_start;     /* (num_tets + 1) into those within */
    int32_t *beside_start, *beside; /* (num_tets + 1), the other bridges of every tetrahedron, ascending */
    int32_t *across;           /* (num_tets x 4) the tetrahedron across each face at load (pliant_mesh_neighbours) */
    int32_t *around_start, *around; /* (num_nodes + 1), (4 x num_tets) corners of tetrahedra at load, 4 tetrahedron + corner, of every node */
    struct pliant_voxels_holders *holders; /* how many there are (src/topology) */
};

/* What has been severed since load, and the fragments that it leaves. NULL in a body of which nothing is severed. */
struct pliant_cuts {
    int32_t num_links;
    uint32_t *link;            /* (num_links) 4 voxel + axis: to the next voxel along the axis; ascending */
    int32_t num_bridges;
    int32_t *bridge;           /* (num_bridges) of pliant_voxels.bridge; ascending */
    int32_t num_tets;          /* tetrahedra at load that own an end of what is severed, or a voxel that moves with one of them */
    int32_t *tet;              /* (num_tets) ascending */
    int32_t *start, *fragment; /* (num_tets + 1), (start[num_tets]) the fine tetrahedra that each is now, ascending, so itself the first */
    int32_t *voxel_start;      /* (num_tets) where those of each begin in voxel_fragment */
    int32_t *voxel_fragment;   /* (voxels of each, as pliant_voxels lists them) the fine tetrahedron that each moves with: a fragment of
                                *   its own one, or, of a chip that hangs on nothing else, of another */
    struct pliant_cuts_pool *pool; /* what voxel_fragment is of, shared with bodies before and after (src/topology); NULL: num_tets is 0 */
    int32_t num_chips;
    int32_t *chip;             /* (num_chips x 2) tetrahedron at load, fine tetrahedron of another one that some of its voxels move with */
    int32_t num_joins;
    int32_t *join;             /* (num_joins x 2) fine tetrahedra that links or bridges join, the first below the second, one at least of those
                                *   in fragment; ascending */
    int32_t num_cuts;          /* bodies from the one at load to this one, which pliant_body_sever makes again */
    int32_t *cut_end;          /* (num_cuts) into severed: what each of them severed */
    uint32_t *stroke;          /* (num_cuts x 2) blade and stroke that each of them was of, as its sweep said; stroke 0: of none */
    uint32_t *severed;         /* (num_links + num_bridges) of each cut, 4 voxel + axis of its links, ascending, and 4 bridge + 3 of its bridges */
    int32_t num_pieces;        /* with tissue, that hang together at a node at least */
};

/* Where a node is that a cut has put on an edge: end[0] + share (end[1] - end[0]), at rest and in the state that it takes after them. Both have
 *  lower numbers. Of a copy: twice its source, and 0. */
typedef struct pliant_between {
    int32_t end[2];
    double share;
} pliant_between;

/* A node that lies on the way of a blade's stroke, which may go on. */
typedef struct pliant_cut_mark {
    uint32_t blade, stroke;
    int32_t node;
} pliant_cut_mark;

/* Of a body whose tetrahedra cuts subdivide (cut/kind: subdivide). Each is a tetrahedron of its own, all of whose inside is its own. */
struct pliant_subdivision {
    int32_t load_nodes;        /* nodes at load */
    double least_edge;         /* nearer to a node than this no edge is cut: the node itself is [m] */
    double least_volume;       /* no tetrahedron that a cut makes has less [m^3] */
    pliant_between *between;   /* (fine.num_nodes - load_nodes) of those appended since load; NULL: none */
    int32_t num_marks;
    pliant_cut_mark *mark;     /* (num_marks) the last stroke of every blade */
};

/* Pieces that have come off since load: nothing that is fixed holds them any more. Those that touch, if only at a node, count as one. */
struct pliant_pieces {
    int32_t count;
    int32_t *start, *node;     /* (count + 1), (start[count]) fine nodes of each, ascending; no other piece or tissue has them */
    int32_t num_joints;        /* what a piece hangs on where it is a node or two */
    int32_t num_inner;         /* after those: what has come off hanging on one another, one piece now */
    int32_t *joint;            /* ((num_joints + num_inner) x 2) its own node, and the one that it hangs on; twice its own: that stays where it
                                *   was at rest */
};

/* An empty body of a revision, with one holder. Errors: MEMORY. */
pliant_status pliant_body_create(uint64_t revision, pliant_body **out);

/* The next body, with the topology of this one: everything copied, nothing touched. Who makes it changes it before anybody else
 *  holds it. @param revision a simulation's last_revision + 1. Errors: MEMORY, ARGUMENT (not above this one's). */
pliant_status pliant_body_next(const pliant_body *body, uint64_t revision, pliant_body **out);

/* Whether a scene may cut this body. */
bool pliant_body_may_be_cut(const pliant_body *body);

/* What a cut makes of the fine mesh. Elements keep their shape, unless it is subdivided; a node's copies lie where it does. */
typedef struct pliant_division {
    int32_t num_tets;          /* of the next body: those of the body before, and fragments of them that are appended */
    const int32_t *tet_source; /* (those appended) tetrahedron of the body before that each is a fragment of; NULL: none are appended */
    int32_t num_changed;
    const int32_t *changed;    /* (num_changed) ascending tetrahedra of the body before: corners and material list only these, then those
                                *   appended; NULL: all of them */
    const int32_t *corners;    /* (those listed x 4) node of every corner: the one of the body before, or a copy, numbered from there on.
                                *   Every node keeps a corner at least */
    const pliant_tet_material *material; /* (those listed) means over the whole tetrahedron of what is in the fragment; NULL: as before, no
                                *   fragments */
    const uint8_t *copy_fixed; /* (nodes appended) pliant_fixing; NULL: as their sources */
    const pliant_between *between; /* (nodes appended) of a body with a subdivision: corners may be any nodes then, and sources are whose
                                *   material and state a tetrahedron takes; NULL: all that is appended is copies */
    int32_t num_touched;       /* tetrahedra of the body before whose voxels changed, too, where nothing else tells */
    const int32_t *touched;    /* (num_touched) ascending */
    int32_t num_joints;
    const int32_t *joint;      /* (num_joints x 2) corners, 4 tetrahedron + corner, of what is left of the joints of its pieces; NULL: all of it */
    bool same_pieces;          /* no piece comes off another: it is not looked for what falls */
    pliant_cuts *cuts;         /* of the next body, which takes them; NULL: as before */
} pliant_division;

/* The next body: nodes and fragments appended with their parents, masses, what is fixed, and surface. Pieces that nothing holds any more are
 *  listed.
 *  Errors: MEMORY, ARGUMENT (not a division of this body), FORMAT (faces of three tetrahedra). */
PLIANT_INTERNAL pliant_status pliant_body_divide(const pliant_body *body, uint64_t revision, const pliant_division *division, pliant_body **out);

/* A fourth of the mass of a tetrahedron to each of its nodes ([H] 2.1). @param mass (fine.num_nodes) out [kg] */
void pliant_body_masses(const pliant_body *body, double *mass);

/* Of pieces that nothing holds at load, the stiffness is taken down to this part: they keep their place in the picture. */
#define PLIANT_LOOSE_STIFFNESS 1e-6

/* The voxels of a body at load, with one holder. @param material_of_voxel (voxels) index into the table.
 *  Errors: MEMORY, FORMAT, SCENE (more than 2^30 voxels). */
pliant_status pliant_voxels_create(const pliant_body *body, const pliant_geometry *geometry, const uint8_t *material_of_voxel,
                                              const pliant_material_table *table, const pliant_voxels **out);

/* One more holder. @return voxels */
const pliant_voxels *pliant_voxels_retain(const pliant_voxels *voxels);

/* One holder less; the last one frees them. Nullable. */
void pliant_voxels_release(const pliant_voxels *voxels);

/* Whether two voxels that are owned are joined, by a link or across an edge; only neighbours are. @param cuts Nullable */
bool pliant_voxels_joined(const pliant_voxels *voxels, const pliant_cuts *cuts, int32_t a, int32_t b);

/* Parts of a tetrahedron at load: its voxels that hang together within it, numbered by their first ones.
 *  @param cuts Nullable
 *  @param part (start[tet + 1] - start[tet]) out, of each of its voxels. @return how many there are */
int32_t pliant_voxels_parts(const pliant_voxels *voxels, const pliant_cuts *cuts, int32_t tet, int32_t *part);

/* The fine tetrahedron that a voxel moves with; -1: none. @param cuts Nullable */
int32_t pliant_voxels_fragment(const pliant_voxels *voxels, const pliant_cuts *cuts, int32_t voxel);

pliant_status pliant_cuts_copy(const pliant_cuts *cuts, pliant_cuts **out); /* Errors: MEMORY */

void pliant_cuts_free(pliant_cuts *cuts); /* Nullable */

/* Whether nothing but the revision differs. */
PLIANT_INTERNAL bool pliant_body_same(const pliant_body *a, const pliant_body *b);

/* Which node and tetrahedron of another body each one takes its state from: itself, or what it is a copy of. */
typedef struct pliant_body_map {
    int32_t *node, *tet;               /* (of the body `to`) */
    int32_t num_nodes;                 /* of the body `to` */
    int32_t num_same;                  /* of these, from the first one on, that are the other body's node of their own number */
    pliant_between *between;           /* (num_nodes) of nodes that lie between others of the body `to`; end[0] < 0: it is as `node` says; NULL: all are */
} pliant_body_map;

/* Errors: MEMORY, ARGUMENT (bodies of different loads). */
pliant_status pliant_body_map_create(const pliant_body *from, const pliant_body *to, pliant_body_map *out);

void pliant_body_map_free(pliant_body_map *map);

/* Vectors at the fine nodes of the body `to`, from those of the other. @param from, out (nodes x 3) of each; where num_same are all that there were they
 *  may be the same array */
void pliant_body_map_vectors(const pliant_body_map *map, const double *from, double *out);

/* Room for what cuts leave in a body at load that they subdivide. @param snap part of the shortest edge that no cut goes below.
 *  Errors: MEMORY. */
pliant_status pliant_subdivision_create(const pliant_mesh *fine, double snap, pliant_subdivision **out);

#ifdef __cplusplus
}
#endif
#endif
