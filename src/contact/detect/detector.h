/* Data of the search for contacts with rigid parts (detector.c, part_contacts.c). */
#ifndef PLIANT_CONTACT_DETECTOR_H
#define PLIANT_CONTACT_DETECTOR_H

#include "contact/detect/part_broad_phase.h"
#include "contact/detect/part_contacts.h"

/* A node, edge or triangle of the surface, and the nearest point of a part. */
typedef struct pliant_feature {
    uint64_t key;
    int32_t count, node[3];
    double outwards[3];     /* outward normal of the tissue, times twice the area of its triangles */
    double gap;             /* gap at the end of the leg if the tissue does not move [m]; INFINITY: no contact */
    bool is_in_contact;
    double weight[3], normal[3], place[3], drift[3], area;
} pliant_feature;

struct pliant_contact_detector {
    pliant_contact_settings settings;
    const pliant_near_finder *finder; /* Nullable */
    pliant_broad broad;
    int32_t *triangle;      /* triangles near a part */
    pliant_feature *face, *edge, *node;
    int32_t *edge_of;       /* (triangles x 3) index of each edge */
    uint64_t *order;        /* (3 x triangles) */
    int32_t *slot;          /* (fine nodes) index of the node's feature for this part */
    bool has_delayed;       /* a point of the last search is delayed (part_contacts.c) */
};

/* Compare structs that begin with a key, for sorting. */
static inline int pliant_compare_keys(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

/* Reserve memory for the triangles near the parts. Errors: MEMORY. */
pliant_status pliant_contact_detector_reserve(pliant_contact_detector *detector, const pliant_body *body);

#endif
