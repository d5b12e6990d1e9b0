/* Data of the advancement, for the files of this folder: the pairs of triangles and parts that can come near each
 * other during a leg (broad_phase.c), and the pairs of the surface with itself (self_contact.c). */
#ifndef PLIANT_CONTACT_ADVANCE_ADVANCE_WORKSPACE_H
#define PLIANT_CONTACT_ADVANCE_ADVANCE_WORKSPACE_H

#include "contact/advance/pair.h"
#include "contact/advance/bounding_box_tree.h"

/* Pair of a node and a triangle, or of two edges. */
typedef struct pliant_advance_self_pair {
    int32_t node[4], iterations;
    int32_t feature[2];  /* a node's owner and the triangle; of edges: 3 times the owner plus the edge's number */
    bool is_edges, ends; /* ends: t can increase no further */
    /* fraction that is certainly free; smallest permitted distance, or after an audit a lower bound of the distance
     * [m] */
    double t, limit;
} pliant_advance_self_pair;

/* A pair, and the fraction that is certainly free. */
typedef struct pliant_advance_pair_time {
    double t;
    int32_t pair;
} pliant_advance_pair_time;

struct pliant_advance {
    pliant_contact_settings settings;
    const pliant_near_finder *finder; /* Nullable */
    int32_t num_pairs, max_pairs, max_parts, max_triangles;
    pliant_advance_pair *pair; /* (max_pairs) in ascending order of parts, then triangles */
    int32_t max_pair_times;
    pliant_advance_pair_time *pair_time; /* (max_pair_times) pairs that may limit the leg */
    pliant_advance_motion *motion; /* (max_parts) */
    pliant_near_region *region;    /* (max_parts) */
    int32_t *near;                 /* (max_triangles) triangles that are near any part, ascending */
    pliant_advance_box *box;       /* (max_triangles) around those */
    int32_t *group;                /* (max_triangles) indices into near: triangles near one tool */
    int32_t num_self, max_self;
    pliant_advance_self_pair *self; /* (max_self) of the surface with itself */
    pliant_advance_tree tree;
};

/* Return the thickness of a pair; 0: the pair is exempt, or coincides at rest [m]. */
double pliant_advance_thickness(const pliant_advance_self *self, const int32_t node[4], bool is_edges);
/* Return the distance of a pair [m]. */
double pliant_advance_self_distance(const pliant_advance_self_pair *pair, const double *positions);
/* Compute the closest points of a pair at the fraction pair->t of a leg: weights of its nodes, which sum to 1 and to -1
 * on its sides, and the unit vector towards the first side. */
void pliant_advance_self_contact(const pliant_advance_self_pair *pair, const double *from, const double *to,
                                 double weight[4], double normal[3]);
/* Compute the fraction of a leg that is free for one pair, as pliant_advance_find_self, and store it in pair->t. */
double pliant_advance_self_time(pliant_advance *advance, const double *from, const double *to,
                                const pliant_advance_self *self, pliant_advance_self_pair *pair);

/* Grow the capacity for ranks. Errors: MEMORY. */
pliant_status pliant_advance_reserve_times(pliant_advance *advance, int32_t count);
/* Sort by fraction, then by pair: the first pairs shorten the leg for the others. */
void pliant_advance_sort(int32_t count, pliant_advance_pair_time *times);

/* Fill motion and pair with all pairs whose core distance can reach `margin` or less during the leg. Held triangles
 * are left out.
 * @param still parts stay at their first poses
 * @param finder Nullable: lists the triangles to test
 * Errors: MEMORY. */
pliant_status pliant_advance_broad_phase(pliant_advance *advance, int32_t num_triangles, const int32_t *triangles,
                                         const double *from, const double *to, int32_t count,
                                         const pliant_advance_part *parts, double margin, bool still, int num_threads,
                                         const pliant_near_finder *finder);

#endif
