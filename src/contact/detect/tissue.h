/* Tissue that meets tissue: of one piece that folds, of pieces, of the two sides of a cut.
 *
 * Outer surfaces: a node of the surface touches a triangle of it, of tetrahedra that have no node in common with the node or those beside it. From
 * outside it does where it lies above the triangle, within a margin; inside, where it lies in a tetrahedron, it is pushed out along the shortest way.
 * Edges that cross, of overlapping tetrahedra none of whose nodes touch anything, touch one another. Weights are those of the node or the edge, and
 * less those of the point across from it: they sum to 0, and the force of one side is that on the other.
 *
 * Cut faces, where voxels are parted (cut/kind sever): fragments are copies of whole tetrahedra, which overlap at rest; all that they own is voxels.
 * They touch, therefore, by the links that were severed between them: the middle of those is a point of either fragment, the same one at rest.
 * Fragments have no part in the contact of outer surfaces. */
#ifndef PLIANT_CONTACT_TISSUE_H
#define PLIANT_CONTACT_TISSUE_H

#include "contact/contact.h"
#include "contact/settings.h"
#include "contact/detect/grid.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A triangle of the surface, outwards, and its tetrahedron. */
typedef struct pliant_skin {
    int32_t node[3], tet;
    int32_t beside[3];         /* across the edge from node[k] to node[k + 1]; -1: none */
} pliant_skin;

/* What two fragments have between them: the links that are severed. */
typedef struct pliant_cut_face {
    int32_t tet[2];
    double at[2][4];           /* the middle, barycentric in either */
    double along[2][2][4];     /* two directions in the face, likewise (sum 0); the first times the second points to tet[0] */
    double area;               /* at rest [m^2] */
} pliant_cut_face;

/* deep: how far from the surface, and more where the node's own surface does not face that of the triangle */
typedef struct pliant_touching { int32_t skin; double weight[3], gap, deep; } pliant_touching;
enum { PLIANT_TOUCHINGS = 3 /* at most, of a node */ };

/* Who searches in place of the CPU, by the same rules (tissue_rules.h): a GPU. */
typedef struct pliant_tissue pliant_tissue;
typedef struct pliant_tissue_rule pliant_tissue_rule;
typedef struct pliant_tissue_searcher {
    /* Pairs of tetrahedra that overlap (pliant_grid_take_pairs); with a rule, whose margin is that of this step, also normals and what every node touches.
     * *state: NULL at first, kept. Errors: MEMORY, UNAVAILABLE: the CPU searches. */
    pliant_status (*search)(void **state, pliant_tissue *tissue, const double *positions, const pliant_tissue_rule *rule);
    void (*free)(void *state); /* Nullable state */
} pliant_tissue_searcher;

struct pliant_tissue {
    const pliant_body *body;   /* retained */
    uint64_t revision;         /* of it; 0: none */
    int threads;
    /* ---- of the body */
    int32_t *across;           /* (tetrahedra x 4), borrowed from the body where it has them */
    int32_t *own_across;
    uint8_t *inside;           /* (tetrahedra) with tissue */
    uint8_t *apart;            /* (tetrahedra) neither a fragment nor without tissue: it takes part */
    int32_t num_skins;
    pliant_skin *skin;
    int32_t num_tets, *tet;    /* with a skin, ascending */
    int32_t *skin_start;       /* (num_tets + 1) into skin, which are by tetrahedron */
    int32_t num_nodes, *node;  /* of the surface, ascending */
    int32_t *index_of;         /* (fine nodes) in that list; -1: not of the surface */
    int32_t *around_start, *around; /* (num_nodes + 1): nodes that share an edge of the surface with each */
    int32_t *fan_start, *fan;  /* (num_nodes + 1): skins that have each */
    double *area;              /* (num_nodes) at rest [m^2] */
    double shortest;           /* edge of the surface at rest [m] */
    int32_t *piece;            /* (fine nodes) of pieces that have come off which one, and -1; NULL: none, or they move as everything */
    int32_t num_faces;
    pliant_cut_face *face;
    uint8_t *slid;             /* (num_faces) its sides are not opposite each other any more, as the step begins */
    /* ---- of a step */
    pliant_grid grid;
    double (*normal)[3];       /* (num_skins) */
    int32_t *count;            /* (num_nodes) how many triangles each touches */
    pliant_touching *touching; /* (num_nodes x PLIANT_TOUCHINGS) shallowest first */
    int32_t *last;             /* (num_nodes) the triangle that it touched in the step before; -1: none */
    bool has_place;
    double *place;             /* (num_nodes x 3) where nodes were as the step before began [m] */
    int32_t num_overlaps;      /* pairs of tetrahedra */
    /* ---- of who searches */
    const pliant_tissue_searcher *searcher; /* Nullable: the CPU */
    const pliant_tissue_searcher *failed;   /* has failed on this body: not tried again */
    void *searcher_state;
};

void pliant_tissue_free(pliant_tissue *tissue); /* what it holds */
/* Another body, unless it is this one. solid: Nullable: (tetrahedra) what of it has a surface; NULL: all with tissue. Errors: MEMORY, FORMAT; nothing changes. */
pliant_status pliant_tissue_set_body(pliant_tissue *tissue, const pliant_body *body, const uint8_t *solid, int threads);
/* Nothing has touched yet. */
void pliant_tissue_forget(pliant_tissue *tissue);

/* What is known of the step before. Errors: MEMORY, FORMAT; nothing changes. */
pliant_status pliant_tissue_copy(const pliant_tissue *from, pliant_tissue *to);

struct pliant_tissue_rule {
    double margin;             /* outside of the surface, points are found so far away, and as far as nodes went in the step before [m] */
    double recovery;           /* of how deep tissue lies in tissue as a step begins, at most this is undone [m] */
    double friction;
    double pieces_go;          /* quasi-static: how far pieces that have come off may go in this step, which are looked for so far away [m] */
    const double *nodes;       /* Nullable: (nodes x 3) where nodes are, by which fragments of a cut are; NULL: as the surface's corners [m] */
    double stays;              /* and this share of it is left (pliant_contact_left) */
    const pliant_contact_settings *settings; /* Nullable: the defaults */
};

/* Appends the points, ascending by feature: its top byte is PLIANT_TISSUE_NODE, _EDGE, _CUT or _SLID (follow.h).
 * @param positions (nodes x 3) of the surface's corners, as the step begins [m]. Errors: MEMORY. */
pliant_status pliant_tissue_find(pliant_tissue *tissue, const double *positions, const pliant_tissue_rule *given, pliant_contacts *out);

/* From now on; NULL: the CPU. */
void pliant_tissue_set_searcher(pliant_tissue *tissue, const pliant_tissue_searcher *searcher);
/* Whether somebody else has searched. rule: NULL: for pairs alone */
bool pliant_tissue_searched(pliant_tissue *tissue, const double *positions, const pliant_tissue_rule *rule);

/* ---- tissue_slowed.c */
/* Which nodes are of a tetrahedron that overlaps. @param overlaps (nodes) out. Errors: MEMORY. */
pliant_status pliant_tissue_overlapping(pliant_tissue *tissue, const double *positions, uint8_t *overlaps);
/* Appends a point for each of them that can move, ascending (follow.h). Errors: MEMORY. */
pliant_status pliant_tissue_find_slowed(const pliant_tissue *tissue, const uint8_t *overlaps, double punishment, pliant_contacts *out);

/* ---- tissue_cut.c */
/* The cut faces of a body, freed with pliant_free; none: NULL. Errors: MEMORY. */
pliant_status pliant_cut_faces(const pliant_body *body, pliant_cut_face **out, int32_t *count);
/* Whether the sides are nearer than that, and their point. slid: they are not opposite each other any more */
bool pliant_cut_face_point(const pliant_body *body, const pliant_cut_face *face, const double *positions, const pliant_tissue_rule *rule, bool *slid,
                           pliant_contact_point *out);
/* Appends points of sides that have slid along the cut, with what they are opposite now, ascending. piece: Nullable: (nodes) which rigid piece. Errors: MEMORY. */
pliant_status pliant_cut_slid_points(const pliant_body *body, int32_t num_faces, const pliant_cut_face *faces, const uint8_t *slid, const int32_t *piece,
                                     const double *positions, const pliant_tissue_rule *rule, pliant_contacts *out);

#ifdef __cplusplus
}
#endif
#endif
