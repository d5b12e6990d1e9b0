/* The contact points of a simulation: data that the files of the contact stage share. */
#ifndef PLIANT_SIM_CONTACT_WORKSPACE_H
#define PLIANT_SIM_CONTACT_WORKSPACE_H

#include "contact/detect/contact_surface.h"
#include "contact/detect/impact_zones.h"
#include "contact/detect/tissue.h"
#include "contact/shapes/solid.h"
#include "sim/step/contact.h"
#include "sim/step/legs.h"

enum { PLIANT_CONTACT_PARTS = PLIANT_MAX_TOOLS * PLIANT_MAX_PARTS + 2 * PLIANT_MAX_FIXED + PLIANT_MAX_PARTS };

struct pliant_contact_search {
    pliant_contact_settings settings;
    pliant_contact_detector *detector;
    pliant_tissue tissue;      /* contact/self: tissue on tissue */
    pliant_impact_zones zones; /* the same, in the sub-steps of explicit dynamics */
    pliant_contact_surface outside;
    pliant_contacts point_buffer; /* buffer: the points of the previous leg while this leg's points are in use */
    int32_t num_parts;
    pliant_moving_part part[PLIANT_CONTACT_PARTS];
    pliant_advance_part advance_part[PLIANT_CONTACT_PARTS];
    pliant_part obstacle[2 * PLIANT_MAX_FIXED];
    pliant_advance *advance; /* Nullable buffer */
    double *surface;  /* (nodes x 3) corners of the surface at the start of the leg [m] */
    bool has_surface; /* they are computed for all triangles; otherwise only for the triangles near the parts */
    bool has_box;
    uint64_t surface_revision; /* of the topology whose nodes are listed; 0: none */
    int32_t num_surface_nodes, *surface_node; /* nodes of the surface's triangles, ascending */
    double low[3], high[3];                   /* if has_box: bounding box of the surface [m] */
    /* REUSE OF POINTS: the configuration in which the points were found */
    bool found;
    uint64_t found_revision; /* of the topology */
    int32_t found_parts, found_nodes /* of the surface */;
    uint64_t found_key[PLIANT_CONTACT_PARTS];
    pliant_tool_pose found_pose[PLIANT_MAX_TOOLS];
    double *found_at;  /* (found_nodes x 3) corners of the surface, in the order of surface_node [m] */
    uint8_t *overlaps; /* (nodes) for contact/response: paper */
    double *place;     /* (nodes x 3) likewise */
};

/* ---- contact_parameters.c */
/* Create the search at its first use. Errors: MEMORY. */
pliant_status pliant_contact_search_create(const pliant_contact_settings *settings, pliant_contact_search **out);
/* Contact happens at the boundary of the tissue within the elements. When cuts subdivide elements, the elements'
 * faces are that boundary. */
bool pliant_contact_is_within_elements(const pliant_model *model);
/* Return whether the scene lets tissue touch tissue. */
bool pliant_contact_touches_itself(const pliant_model *model);
/* Return the distance by which the core of a part is enlarged: the error of a distance field (contact/advance) [m]. */
double pliant_contact_core_offset(const pliant_part *part);
/* Return the guard depth of a part. A distance field's error reduces the guard zone, so the guard depth is increased
 * until a fraction of the zone remains (settings.guard_left). */
double pliant_contact_guard(const pliant_model *model, const pliant_data *data, const pliant_part *part);
/* Return the largest penetration depth that a leg corrects [m]. */
double pliant_contact_max_recovery(const pliant_model *model, const pliant_data *data);
/* Return the fraction of the penetration depth that remains after a leg; 0 without inertia. */
double pliant_contact_remaining_depth_fraction(const pliant_model *model, const pliant_data *data);
/* Return the rule for tissue on tissue. max_piece_motion: largest motion of detached pieces in this step [m] */
pliant_tissue_rule pliant_contact_tissue_rule(const pliant_model *model, const pliant_data *data,
                                              double max_piece_motion);

/* ---- contact_advance.c */
/* Choose the surface for collision detection, and compute its corners. Errors: MEMORY.
 * @param body, positions out: its topology and its positions */
pliant_status pliant_contact_find_surface(const pliant_model *model, pliant_data *data, const pliant_body **body,
                                          const double **positions);
/* Choose the surface of a leg. Its corners at the start are computed when they are needed. Errors: MEMORY. */
pliant_status pliant_contact_begin_surface(const pliant_model *model, pliant_data *data, const pliant_body **body);
/* Compute all corners at the start of the leg, if they are missing. positions: (nodes x 3) at that time [m] */
void pliant_contact_complete_surface(const pliant_model *model, pliant_data *data, const double *positions);
/* Context of a pliant_near_finder. */
typedef struct pliant_contact_near {
    const pliant_model *model;
    pliant_data *data;
    bool in_leg;
} pliant_contact_near;
/* List triangles by the backend, and compute their corners at the start of the leg, and in a leg also at its end. If
 * the backend has no list, compute all corners. */
bool pliant_contact_find_near(void *context, int32_t count, const pliant_near_region *regions,
                              pliant_triangle_list *out);

/* ---- contact_islands.c */
/* Find the islands of a blocked leg, from the pairs that pliant_advance_find found. An island contains all nodes of
 * a pair's triangle and the pair's tool. So nodes and tools of different islands do not meet in this leg, and each
 * island can move by its own fraction. A pair with a fixed obstacle limits all islands. So no node of tissue that
 * bounces moves against its neighbors, and thrown tissue gains no energy. The results are data->legs->fraction and
 * the tools' free_fraction. Errors: MEMORY. */
pliant_status pliant_contact_find_islands(const pliant_model *model, pliant_data *data, const pliant_body *surface);

/* ---- contact_reuse.c */
/* Save the configuration in which the points are found, unless a tool moves farther than settings.hysteresis in this
 * leg. Errors: MEMORY. */
pliant_status pliant_contact_keep_found(const pliant_model *model, pliant_data *data);
/* Copy that configuration. Errors: MEMORY. */
pliant_status pliant_contact_copy_found(const pliant_contact_search *from, pliant_contact_search *to);
/* Reuse the points of the last saved search if nothing has moved farther than settings.hysteresis since then, and no
 * tool is to. They are written to search->point_buffer. Errors: MEMORY.
 * @param are_reused out: whether the points are reused */
pliant_status pliant_contact_reuse(const pliant_model *model, pliant_data *data, bool *are_reused);

#endif
