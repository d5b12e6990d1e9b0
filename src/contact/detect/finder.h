/* What the search for contacts with rigid parts keeps and works on: finder.c, find.c, passed.c. */
#ifndef PLIANT_CONTACT_FINDER_H
#define PLIANT_CONTACT_FINDER_H

#include "contact/detect/broad.h"
#include "contact/detect/find.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A node, an edge or a triangle of the surface, and where a part meets it. */
typedef struct pliant_feature {
    uint64_t key;
    int32_t count, node[3];
    double outwards[3];     /* of the tissue; twice the area of its triangles */
    double flat;            /* length of that, over twice the sum of their areas: 1 where they lie in a plane; of parts of a frame alone */
    double way;             /* how far it goes in the step, as the part sees it; of what passes alone [m] */
    double gap;             /* as the step ends, if the tissue stays where it is [m]; INFINITY: it is left out */
    bool touches;
    double weight[3], normal[3], place[3], drift[3], found[3], area;
} pliant_feature;

/* A point of the last step, in the part's frame: what it has not held back yet is still to be held, wherever it is now. */
typedef struct pliant_kept_point {
    uint64_t feature;
    int32_t count, node[3];
    double weight[3], normal[3], place[3], area;
    double found[3]; /* its normal when it was found, not in the part's frame */
    bool pressed;    /* a force was found for it */
} pliant_kept_point;

/* Which side of a part a node is on: the normal of their last contact, in the part's frame. */
typedef struct pliant_side {
    uint64_t key; /* part, node */
    double normal[3];
    bool pressed; /* of points that pressed alone */
} pliant_side;

enum { PLIANT_NODE_BITS = 26 /* of a key */ };
static inline uint64_t pliant_side_key(uint64_t part, int32_t node) { return part << PLIANT_NODE_BITS | (uint64_t)node; }

struct pliant_finder {
    pliant_broad broad;
    int32_t room_triangles;
    int32_t *triangle;      /* near a part */
    pliant_feature *face, *edge, *node;
    int32_t *edge_of;       /* (triangles x 3) */
    uint64_t *order;        /* (3 x triangles) */
    int32_t room_nodes;
    int32_t *slot;          /* (fine nodes) which feature of a part */
    int32_t num_sides, room_sides, num_next, room_next;
    pliant_side *sides, *next;     /* ascending by key; of this step */
    int32_t num_kept, room_kept, num_keep, room_keep;
    pliant_kept_point *kept, *keep;      /* ascending by feature; of this step */
    bool more;              /* pliant_finder_remember_more was called since the search, and this is how much was known before */
    int32_t sides_before, kept_before;
};

/* A part and the tissue around it, while they are searched. */
typedef struct pliant_search {
    pliant_finder *finder;
    const pliant_body *body;
    const double *positions; /* as the step begins */
    const double *to;        /* Nullable: as it ends; NULL: the tissue stays where it is */
    const pliant_moving_part *part;
    uint64_t part_key;
    int32_t triangles, edges, nodes;
} pliant_search;


enum { PLIANT_FEATURE_POINTS = 4 /* of a node, an edge or a triangle, at most: the last two bits of their keys */ };

/* Of what begins with its key. */
static inline int pliant_compare_keys(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

/* ---- finder.c */
/* Room for the triangles near the parts, and for so many more points. Errors: MEMORY. */
pliant_status pliant_finder_room(pliant_finder *finder, const pliant_body *body);
pliant_status pliant_finder_reserve(pliant_finder *finder, int32_t points, pliant_contacts *out);
/* What the next step asks for: the points that were written, and the sides of their nodes. */
void pliant_finder_remember(pliant_finder *finder);
/* The same of more points of the same step, which come before those that there are. Errors: MEMORY. */
pliant_status pliant_finder_remember_more(pliant_finder *finder, pliant_contacts *out);

/* ---- find.c */
uint64_t pliant_search_key(const pliant_moving_part *part);
/* Nodes, edges and triangles of the triangles near the part */
void pliant_search_gather(pliant_search *on);
/* what neither moves nor is to be moved by this part */
bool pliant_search_leaves_out(const pliant_search *on, const pliant_feature *of);
/* on which side of the part the feature's point was; false: that is not known */
bool pliant_search_remembers(const pliant_search *on, const pliant_feature *of, double normal[3]);
/* The feature's least distance in one of the part's poses, where so much of the tissue's way is done, or a lower bound above `enough`. */
double pliant_search_distance(const pliant_search *on, pliant_feature *of, const pliant_pose *pose, double share, double enough, double normal[3]);
/* Whether a triangle lies on an edge or a corner of the part, where the part's own normal hangs on rounding, and the tissue's counts. */
bool pliant_search_is_flush(const pliant_feature *of, double distance, const double world[3]);
/* Whether the feature's point is one of next to nothing that can move: to bring it out, that would have to go many times as far. */
bool pliant_search_is_stuck(const pliant_search *on, const pliant_feature *of);
/* Whether the normal that is nearest out of a part is not that of the side that the tissue is on, by the cosine between the two. */
bool pliant_search_misleads(const pliant_search *on, double distance, double cosine);
/* Whether a part whose surface has that normal there is behind the tissue's. */
bool pliant_search_is_behind(const pliant_feature *of, const double world[3]);
/* an edge or a triangle touches where it is deeper than what borders it */
void pliant_search_keep_deeper(const pliant_search *on);
/* A triangle's area goes to its corners, and to its edges and itself where they touch, in equal parts. */
void pliant_search_share_areas(const pliant_search *on);
/* touching features in order, of two with one key the deeper. @return how many */
int32_t pliant_search_compact(pliant_feature *features, int32_t count);
void pliant_search_write(const pliant_search *on, const pliant_feature *of, pliant_contact_point *out);

#ifdef __cplusplus
}
#endif
#endif
