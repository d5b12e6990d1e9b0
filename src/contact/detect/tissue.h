/* Contact of tissue on tissue: folds of one piece, different pieces, and the two sides of a cut.
 *
 * Outer surfaces: a node of the surface can touch a triangle. The triangle's tetrahedron must not contain the node
 * or a neighbor of it. From outside, there is contact if the node is above the triangle within a margin. Inside, if
 * the node is in a tetrahedron, it is pushed out along the shortest direction. Two edges have contact within the
 * margin, or if they have crossed and no node of their tetrahedra has contact. The weights of the two sides have
 * opposite signs and sum to 0, so the forces on the two sides are opposite.
 *
 * Both sides keep a distance, the thickness. So the contact forces act before conservative advancement stops a leg
 * (tissue_pairs.c), or in explicit dynamics a sub-step (impact_zones.h). A pair at a fragment has no thickness, and
 * nothing stops for it.
 *
 * Cut faces, where voxels are separated (cut/kind: sever): fragments are copies of whole tetrahedra, and they
 * overlap at rest. Only their voxels differ. Their contact uses the severed links between them: the center of these
 * links is a point of both fragments, with the same position at rest. Fragments take no part in the contact of
 * outer surfaces. */
#ifndef PLIANT_CONTACT_TISSUE_H
#define PLIANT_CONTACT_TISSUE_H

#include "contact/contact.h"
#include "contact/settings.h"
#include "contact/detect/tet_grid.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A triangle of the surface, oriented outwards, and its tetrahedron. */
typedef struct pliant_surface_triangle {
    int32_t node[3], tet;
    int32_t adjacent[3];         /* adjacent triangle across the edge from node[k] to node[k + 1]; -1: none */
} pliant_surface_triangle;

/* The severed links between two fragments. */
typedef struct pliant_cut_face {
    int32_t tet[2];
    double at[2][4];           /* barycentric coordinates of the links' center in each fragment */
    /* two directions in the face, likewise (sum 0); the first times the second points to tet[0] */
    double along[2][2][4];
    double area;               /* at rest [m^2] */
} pliant_cut_face;

/* Contact of a node with a triangle. depth: distance from the surface, enlarged if the node's own surface does not
 * face the triangle */
typedef struct pliant_node_contact { int32_t triangle; double weight[3], gap, depth; } pliant_node_contact;
enum { PLIANT_MAX_NODE_CONTACTS = 3 /* maximum number for a node */ };

/* Search on another device (GPU) by the same rules (tissue_rules.h). */
typedef struct pliant_tissue pliant_tissue;
typedef struct pliant_tissue_rule pliant_tissue_rule;
struct pliant_advance_self;
typedef struct pliant_tissue_searcher {
    /* Find pairs of overlapping tetrahedra (pliant_grid_take_pairs). With a rule, also compute the normals and the
     * contacts of every node. *state: NULL at first, then kept. Errors: MEMORY, UNAVAILABLE; then the CPU searches. */
    pliant_status (*search)(void **state, pliant_tissue *tissue, const double *positions,
                            const pliant_tissue_rule *rule);
    /* Do the work of pliant_advance_audit_self with tissue->advance and tissue->exempt, at the positions of the last
     * search. The order of the pairs can differ. Errors: MEMORY, UNAVAILABLE; then the CPU lists them. */
    pliant_status (*list_pairs)(void *state, pliant_tissue *tissue, const struct pliant_advance_self *self);
    void (*free)(void *state); /* Nullable state */
} pliant_tissue_searcher;

struct pliant_tissue {
    const pliant_body *body;   /* retained */
    uint64_t revision;         /* revision of the topology; 0: none */
    int threads;
    /* ---- topology */
    int32_t *across;           /* (tetrahedra x 4), borrowed from the topology if it has them */
    int32_t *own_across;
    uint8_t *inside;       /* (tetrahedra) contains tissue */
    uint8_t *is_candidate; /* (tetrahedra) takes part: contains tissue and is no fragment */
    int32_t num_triangles;
    pliant_surface_triangle *triangle;
    int32_t num_tets, *tet;    /* tetrahedra with a triangle of the surface, ascending */
    int32_t *triangle_start;       /* (num_tets + 1) offsets into triangle, which is sorted by tetrahedron */
    int32_t num_nodes, *node;  /* nodes of the surface, ascending */
    int32_t *index_of;         /* (fine nodes) index into that list; -1: not on the surface */
    int32_t *around_start, *around; /* (num_nodes + 1) offsets, and nodes that share a surface edge with each node */
    int32_t *node_triangle_start, *node_triangles;  /* (num_nodes + 1) offsets, and triangles of each node */
    double *area;              /* (num_nodes) at rest [m^2] */
    double shortest;           /* shortest edge of the surface at rest [m] */
    int32_t *piece;            /* (fine nodes) rigid detached piece, or -1; NULL: no pieces, or pieces that deform */
    int32_t num_faces;
    pliant_cut_face *face;
    uint8_t *has_slid;             /* (num_faces) whether its sides have slid apart at the start of the step */
    /* ---- step */
    pliant_grid grid;
    double (*normal)[3];                /* (num_triangles) */
    int32_t *count;                     /* (num_nodes) number of triangles in contact */
    pliant_node_contact *node_contacts; /* (num_nodes x PLIANT_MAX_NODE_CONTACTS) smallest depth first */
    int32_t *last;                      /* (num_nodes) triangle of the previous contact; -1: none */
    bool has_place;
    double *place;             /* (num_nodes x 3) positions at the start of the previous step [m] */
    int32_t num_overlaps;      /* number of overlapping pairs of tetrahedra */
    /* ---- pairs that keep a distance (tissue_pairs.c); all NULL before the first search with a thickness */
    struct pliant_advance *advance;
    bool is_apart;             /* no node was inside tissue, and no edge crossed a triangle, in the last search */
    double listed;             /* distance up to which the advance lists all pairs [m] */
    bool is_listed_at_start;   /* at the start of the leg */
    int32_t *triangles;        /* (num_triangles x 3) nodes */
    double *rest;              /* (fine nodes x 3) surface at rest [m] */
    uint8_t *seam;             /* (fine nodes) at a cut */
    uint8_t *exempt;           /* (fine nodes) at a cut, or part of a penetration at the start of the leg */
    /* ---- other devices */
    const pliant_tissue_searcher *searcher; /* Nullable: the CPU searches */
    const pliant_tissue_searcher *failed;   /* it has failed for this topology and is not tried again */
    void *searcher_state;
};

void pliant_tissue_free(pliant_tissue *tissue); /* frees its contents */
/* Set the topology. Do nothing if it is the current one. solid: (tetrahedra) whether the surface encloses it; NULL:
 * all with tissue. Errors: MEMORY, FORMAT; nothing changes. */
pliant_status pliant_tissue_set_body(pliant_tissue *tissue, const pliant_body *body, const uint8_t *solid, int threads);
/* Discard the contacts of the previous step. */
void pliant_tissue_discard(pliant_tissue *tissue);

/* Copy the contacts of the previous step. Errors: MEMORY, FORMAT; nothing changes. */
pliant_status pliant_tissue_copy(const pliant_tissue *from, pliant_tissue *to);

struct pliant_tissue_rule {
    double margin; /* search distance outside the surface; the motion of nodes in the previous step is added [m] */
    double recovery;           /* maximum reduction of the penetration depth in a step [m] */
    double friction;
    /* quasi-static: maximum motion of detached pieces in this step, which enlarges their search distance [m] */
    double max_piece_motion;
    /* (nodes x 3) positions of the nodes, for the fragments of cuts; NULL: as the surface's corners [m] */
    const double *nodes;
    double remaining_depth_fraction; /* fraction of the penetration depth that remains (pliant_contact_permitted_gap) */
    const pliant_contact_settings *settings; /* Nullable: the defaults */
    double thickness;          /* distance that two surfaces keep (contact/advance/advance.h) [m] */
    /* explicit dynamics: limit of the search distance; 0: the shortest edge of the surface [m] */
    double max_margin;
};

/* ---- tissue_pairs.c */
/* Set the surface at rest once for a topology. rest: (nodes x 3) [m]. Errors: MEMORY. */
pliant_status pliant_tissue_set_rest(pliant_tissue *tissue, const double *rest);
/* Find the exempt nodes and all near pairs. The contacts of every node must be known. Errors: MEMORY. */
pliant_status pliant_tissue_find_pairs(pliant_tissue *tissue, const double *positions, const pliant_tissue_rule *rule);
/* List all pairs that are nearer than a distance. The exempt nodes must be known. Errors: MEMORY. */
pliant_status pliant_tissue_list_pairs(pliant_tissue *tissue, const double *positions, double distance);
/* Append a point for each of these pairs that consists of two edges, or is nearest at a corner. Errors: MEMORY. */
pliant_status pliant_tissue_append_edges(pliant_tissue *tissue, const double *positions,
                                         const pliant_tissue_rule *rule, pliant_contacts *out);
/* Append the contact point of two edges. The edge with the lower number becomes the first side, in any order of the
 * search.
 * @param at fractions of the edges at their closest points
 * Errors: MEMORY. */
pliant_status pliant_tissue_append_edge_point(const pliant_tissue_rule *rule, const uint64_t edge[2],
                                              const int32_t node[4], const double at[2], const double normal[3],
                                              double gap, double thickness, double area, pliant_contacts *out);
/* Return the thickness of a node and a triangle [m]. */
double pliant_tissue_node_thickness(const pliant_tissue *tissue, const pliant_tissue_rule *rule, int32_t node,
                                    const pliant_surface_triangle *triangle);
/* Compute the largest fraction of a leg in which the surface does not pass through itself. pliant_tissue_find must
 * have found the points at the leg's start. Errors: MEMORY. */
pliant_status pliant_tissue_advance(pliant_tissue *tissue, const double *from, const double *to,
                                    const pliant_tissue_rule *rule, double *out);
struct pliant_advance_self_pair;
/* Return the thickness of a listed pair [m]. */
double pliant_tissue_pair_thickness(const pliant_tissue *tissue, const pliant_tissue_rule *rule,
                                    const struct pliant_advance_self_pair *pair);
/* Compute the fraction of a leg that is free for one listed pair, and store it in the pair. */
double pliant_tissue_advance_pair(pliant_tissue *tissue, const double *from, const double *to,
                                  const pliant_tissue_rule *rule, struct pliant_advance_self_pair *pair);

/* ---- tissue.c */
/* Set the point's position so that a step reduces the penetration depth gradually.
 * thickness: distance that the sides keep [m] */
PLIANT_INLINE void pliant_tissue_set_place(pliant_contact_point *point, double gap, double thickness,
                                           const pliant_tissue_rule *rule)
{
    const double left =
        thickness + pliant_contact_permitted_gap(gap - thickness, rule->recovery, rule->remaining_depth_fraction);
    for (int d = 0; d < 3; d++) point->place[d] = left * point->normal[d];
}
/* Find contact points and append them, sorted by feature. The top byte is PLIANT_TISSUE_NODE, _EDGE, _CORNER, _CUT or
 * _SLID (update_sides.h).
 * @param positions (nodes x 3) of the surface's corners at the start of the step [m]
 * Errors: MEMORY. */
pliant_status pliant_tissue_find(pliant_tissue *tissue, const double *positions, const pliant_tissue_rule *given,
                                 pliant_contacts *out);

/* Set the device that searches from now on; NULL: the CPU. */
void pliant_tissue_set_searcher(pliant_tissue *tissue, const pliant_tissue_searcher *searcher);
/* Search on the other device. Return whether it succeeded. rule: NULL: find pairs only */
bool pliant_tissue_search_on_device(pliant_tissue *tissue, const double *positions, const pliant_tissue_rule *rule);
/* List pairs on the other device, at the positions of its search. Return whether it succeeded. */
bool pliant_tissue_list_on_device(pliant_tissue *tissue, const struct pliant_advance_self *self);

/* ---- tissue_paper.c */
/* Find the nodes of overlapping tetrahedra. overlaps: (nodes) out. Errors: MEMORY. */
pliant_status pliant_tissue_overlapping(pliant_tissue *tissue, const double *positions, uint8_t *overlaps);
/* Append a point for each of these nodes that can move, ascending (update_sides.h). Errors: MEMORY. */
pliant_status pliant_tissue_find_slowed(const pliant_tissue *tissue, const uint8_t *overlaps, double overlap_damping,
                                        pliant_contacts *out);

/* ---- tissue_cut.c */
/* Compute the cut faces of a topology. The caller frees them with pliant_free; NULL: no cut face. Errors:
 * MEMORY. */
pliant_status pliant_cut_faces(const pliant_body *body, pliant_cut_face **out, int32_t *count);
/* Compute the point of a cut face. Return whether its sides are nearer than the margin. has_slid: out: the sides have
 * slid apart */
bool pliant_cut_face_point(const pliant_body *body, const pliant_cut_face *face, const double *positions,
                           const pliant_tissue_rule *rule, bool *has_slid, pliant_contact_point *out);
/* Compute the largest fraction of a leg in which no face overlaps by more than a depth. The opening of a face is the
 * distance of its sides along their normals. An overlap that is deeper at the start does not grow. Slid faces are left
 * out. piece: (nodes) rigid piece, Nullable; from, to: (nodes x 3) positions at both ends of the leg [m] */
double pliant_cut_advance(const pliant_body *body, int32_t num_faces, const pliant_cut_face *faces,
                          const uint8_t *has_slid, const int32_t *piece, const double *from, const double *to,
                          double depth);
/* Append points of sides that have slid, with the parts of the cut that they are now opposite to, ascending. piece:
 * (nodes) rigid piece, Nullable. Errors: MEMORY. */
pliant_status pliant_cut_slid_points(const pliant_body *body, int32_t num_faces, const pliant_cut_face *faces,
                                     const uint8_t *has_slid, const int32_t *piece, const double *positions,
                                     const pliant_tissue_rule *rule, pliant_contacts *out);

#ifdef __cplusplus
}
#endif
#endif
