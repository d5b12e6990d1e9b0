/* Settings of contact and of the legs of a step. A model holds one set of them (state/model.h). The scene options
 * contact/... are described in pliant/scene.h. The option contact/guard_depth sets the field guard_depth.
 *
 * Capacities of arrays, iteration limits and tolerances of exact algorithms are not listed here. They are defined
 * next to those algorithms, and results do not depend on them beyond the tolerance. */
#ifndef PLIANT_CONTACT_SETTINGS_H
#define PLIANT_CONTACT_SETTINGS_H

#include "pliant/scene.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* SETTING(type, name, default, unit, meaning, source) */
#define PLIANT_CONTACT_SETTING_LIST(SETTING)                                                                          \
    /* ---- the core of a part */                                                                                     \
    SETTING(double, guard_depth, 2e-3, "m", "depth of a part's core below its surface, at most",                     \
            "curved motion leaves tangent planes by 0.2 mm in a leg; option contact/guard_depth")                    \
    SETTING(double, guard_of_part, 0.4, "depth of the part", "depth of the core below the surface, at most",          \
            "the core keeps a fifth of a part's diameter")                                                            \
    SETTING(double, guard_of_cell, 0.3, "smallest cell", "depth of the core below the surface, at most",              \
            "tissue that rests in the guard zone is a fraction of an element deep")                                   \
    SETTING(double, guard_left, 0.5, "guard depth",                                                                   \
            "part of the guard zone that the error of a distance field leaves, at least",                             \
            "a leg may use half of the zone (advance_stop)")                                                          \
    /* ---- limits of a leg (advance/advance.h) */                                                                    \
    SETTING(double, advance_keep, 0.1, "distance at the start of the leg", "core distance that a leg leaves",         \
            "Li et al., Incremental Potential Contact, 2020, keep 0.2")                                               \
    SETTING(double, advance_stop, 0.5, "guard depth", "core distance that a leg may reach from any distance",         \
            "design of the contact scheme")                                                                           \
    SETTING(double, advance_floor, 0.02, "guard depth", "core distance below which a pair may only separate",         \
            "design of the contact scheme")                                                                           \
    /* ---- detection of contact points with rigid parts (detect/find.c) */                                           \
    SETTING(double, search_margin, 1e-3, "m", "distance from the swept part up to which tissue gets contact points",  \
            "tissue moves by less in a leg")                                                                          \
    SETTING(double, reuse_motion, 0.25, "guard depth", "motion up to which contact points are used again",            \
            "jaws that hold a bar: forces vary by 1e-5 instead of 4 %")                                               \
    SETTING(double, plane_distance, 0.6, "guard depth",                                                               \
            "core distance below which plane constraints keep a triangle out, after a blocked leg",                   \
            "design of the contact scheme; planes that lie nearer than half of this push tissue out")                 \
    SETTING(double, plane_step, 0.05, "guard depth, or core distance",                                                \
            "how far a plane constraint pushes tissue out, or lets it in", "design of the contact scheme")            \
    SETTING(double, sag_of_edge, 0.02, "length of the edge",                                                          \
            "depth beyond its neighbors at which an edge or a triangle gets a contact point", "contact_find_test")    \
    SETTING(double, sag_of_part, 0.1, "depth of the part", "limit of that depth", "thin parts")                       \
    SETTING(double, sag_of_guard, 0.35, "guard depth", "limit of that depth", "parts with small cores")               \
    SETTING(double, max_sag, 5e-5, "m", "limit of that depth", "long edges")                                          \
    SETTING(double, behind_cosine, 0.25, "1",                                                                         \
            "cosine between the normals of part and tissue above which the part is behind the surface",               \
            "contact_find_test")                                                                                      \
    SETTING(double, same_cosine, 0.7, "1", "cosine above which two normals push the same way", "45 degrees")          \
    SETTING(double, recovery_speed, 0.1, "m/s", "speed at which overlapping tissue is pushed out",                    \
            "a step of 20 ms undoes 2 mm")                                                                            \
    SETTING(double, recovery_time, 0.15, "s", "with inertia: time in which an overlap decays to 1/e",                 \
            "1000 collisions of blocks: energy at most 1.05 times the initial one (contact/NUMERICS.md)")             \
    /* ---- legs of a step (sim/step/legs.c, proxy.c) */                                                              \
    SETTING(double, max_tool_speed, 2.0, "m/s", "speed of a tool or blade above which it counts as placed anew",      \
            "hands move laparoscopic instruments at up to 1 m/s")                                                     \
    SETTING(double, leg_distance, 0.5, "largest cell",                                                                \
            "distance of a tool near tissue in a leg; nodes move by up to twice as much after a blocked leg",         \
            "design of the contact scheme: half an element")                                                          \
    SETTING(double, leg_of_part, 0.5, "depth of the part",                                                            \
            "explicit dynamics: distance of a tool and the tissue near it together in a leg", "swept_dynamics_test")  \
    SETTING(double, min_progress, 1e-3, "1", "fraction of a leg below which the leg counts as blocked", "rounding")   \
    SETTING(int32_t, max_legs, 32, "1", "legs of a step, at most", "as solver/iterations")                            \
    SETTING(int32_t, max_blocked_legs, 4, "1", "successive blocked legs after which the step ends",                   \
            "the third leg passes what blocked the first, or none does")                                              \
    SETTING(double, soft_begin, 0.75, "force limit", "load above which a coupling softens", "contact/NUMERICS.md")    \
    SETTING(double, soft_width, 0.2, "force limit", "range of loads in which it softens to the limit",                \
            "contact/NUMERICS.md")                                                                                    \
    SETTING(double, force_overshoot, 1.02, "force limit", "load at which a leg ends early", "contact/NUMERICS.md")    \
    /* ---- tissue on tissue (detect/tissue.c, tissue_cut.c, tissue_rules.h) */                                       \
    SETTING(double, self_margin, 0.25, "shortest edge", "distance up to which tissue gets contact points on tissue",  \
            "self_contact_test")                                                                                      \
    SETTING(double, edge_depth, 0.5, "shortest edge", "depth up to which crossed edges push",                         \
            "deeper ones belong to nodes")                                                                            \
    SETTING(double, flat_cosine, 0.95, "1", "cosine between the normals of two triangles above which no edge is between them", \
            "18 degrees")                                                                                             \
    SETTING(double, facing_cosine, 0.1, "1", "cosine above which two surfaces face each other", "84 degrees")         \
    SETTING(double, border, 0.02, "shortest edge, or barycentric weight",                                             \
            "how far beyond its triangle a contact of the last step persists",                                        \
            "blocks come to rest on each other (contact/NUMERICS.md)")                                                \
    SETTING(double, opposite, 3, "1", "squared sum of the unit normals of two opposite cut faces, at least",          \
            "60 degrees")                                                                                             \
    SETTING(double, slide_depth, 0.02, "element edge", "depth up to which sides of a cut slide along each other",     \
            "self_contact_test")                                                                                      \
    SETTING(double, piece_compliance, 1e-3, "1 / (E sqrt(area))", "compliance of a contact point of a detached piece", \
            "a fraction of that of a flat punch (Johnson, Contact Mechanics, 3.4)")

#define PLIANT_SETTING_MEMBER(type, name, ...) type name;
typedef struct pliant_contact_settings {
    PLIANT_CONTACT_SETTING_LIST(PLIANT_SETTING_MEMBER)
} pliant_contact_settings;
#undef PLIANT_SETTING_MEMBER

pliant_contact_settings pliant_contact_settings_default(void);
/* Return the defaults, changed by the options of the scene. */
pliant_contact_settings pliant_contact_settings_of(const pliant_scene *scene);

#ifdef __cplusplus
}
#endif
#endif
