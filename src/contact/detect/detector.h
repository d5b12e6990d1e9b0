/* Data of the search for contacts with rigid parts (detector.c, part_contacts.c). */
#ifndef PLIANT_CONTACT_DETECTOR_H
#define PLIANT_CONTACT_DETECTOR_H

#include "contact/detect/part_broad_phase.h"
#include "contact/detect/part_contacts.h"

/* A node, edge or triangle of the surface, and the nearest point of a part. */
typedef struct pliant_feature {
    uint64_t key;
    int32_t count, node[3];
    int32_t next_edge;      /* of a node: its first edge to a higher node; of an edge: the next one; -1: none */
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
    int32_t num_slots, *slot; /* (num_slots) of a fine node: index of its feature, if that is of this node */
    bool has_delayed;       /* a point of the last search is delayed (part_contacts.c) */
};

/* Reserve memory for the triangles near the parts. Errors: MEMORY. */
pliant_status pliant_contact_detector_reserve(pliant_contact_detector *detector, const pliant_body *body);

#endif
