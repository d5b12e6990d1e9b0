/* What the search for contacts with rigid parts works on: finder.c, find.c. */
#ifndef PLIANT_CONTACT_FINDER_H
#define PLIANT_CONTACT_FINDER_H

#include "contact/detect/broad.h"
#include "contact/detect/find.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A node, an edge or a triangle of the surface, and where a part is nearest to it. */
typedef struct pliant_feature {
    uint64_t key;
    int32_t count, node[3];
    double outwards[3];     /* of the tissue; twice the area of its triangles */
    double gap;             /* as the leg ends, if the tissue stays where it is [m]; INFINITY: it is left out */
    bool touches;
    double weight[3], normal[3], place[3], drift[3], area;
} pliant_feature;

struct pliant_finder {
    pliant_contact_settings settings;
    pliant_broad broad;
    int32_t room_triangles;
    int32_t *triangle;      /* near a part */
    pliant_feature *face, *edge, *node;
    int32_t *edge_of;       /* (triangles x 3) */
    uint64_t *order;        /* (3 x triangles) */
    int32_t room_nodes;
    int32_t *slot;          /* (fine nodes) which feature of a part */
};

/* Of what begins with its key. */
static inline int pliant_compare_keys(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

/* Room for the triangles near the parts. Errors: MEMORY. */
pliant_status pliant_finder_room(pliant_finder *finder, const pliant_body *body);

#ifdef __cplusplus
}
#endif
#endif
