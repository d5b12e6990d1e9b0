/* Settings of contact and of the legs of a step. A model holds one set of them (model_data/model.h). The scene options
 * contact/... are described in pliant/scene.h. The option contact/guard_depth sets the field guard_depth.
 *
 * Not listed here: capacities of arrays, limits of iterations, and tolerances of exact algorithms. They stand in the
 * code of these algorithms. Results depend on them only within the tolerance.
 *
 * Effects are measured with one setting at half or twice its default. No sweep tunneled in any of these runs. The
 * figures of sweeps, bar and soft are without the volume bound (volume/volume_bound.h).
 *
 * sweeps: PLIANT_SWEEPS=40 PLIANT_SWEEPS_STEPS=1 swept_test --gtest_filter=*NothingIsSweptThroughTheSheet. The defaults
 *     take 258 steps, 2542 evaluations and 450 legs. 8 steps end early. At most 2 elements are inverted. Proxies are
 *     0.035 mm (mean) and 2.3 mm (maximum) behind their targets.
 * bar: two boxes squeeze a bar of 30 x 30 x 80 mm by 2 mm each and lift it. 80 steps: 152 evaluations, 2.05 N.
 * soft: the same with contact/max_force 0.8 N. 60 steps: 120 evaluations, 60 legs, 0.80 N.
 * jaws: a forceps closes on the phantom's liver (launch/scenes/grasp.yaml). 55 steps: 189 evaluations, 55 legs, 1.35 N.
 * rest: bench_force linear 10 and bench_force hexahedra 10. Of 26 forces each, 0 and 6 forces vary by more than
 *     0.1 %. The largest variation is 4.5 %.
 * self: self_contact_test. */
#ifndef PLIANT_CONTACT_SETTINGS_H
#define PLIANT_CONTACT_SETTINGS_H

#include "pliant/scene.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* SETTING(type, name, default, unit, meaning, source, effect of half the default, effect of twice the default).
 * "NUMERICS.md" means src/contact/NUMERICS.md. */
#define PLIANT_CONTACT_SETTING_LIST(SETTING)                                                                           \
    /* ---- the core of a part */                                                                                      \
    SETTING(double, guard_depth, 2e-3, "m",                                                                            \
            "Depth of a part's core below its surface, at most. Option contact/guard_depth.",                          \
            "A ball that slides along faces of 5 mm by 1.5 mm a step leaves its tangent planes by 0.2 mm "             \
            "(NUMERICS.md).",                                                                                          \
            "bar: 2.11 N; sweeps: 0.037 mm behind",                                                                    \
            "bar and sweeps: the same, since parts and cells limit the core first")                                    \
    SETTING(double, guard_of_part, 0.4, "depth of the part",                                                           \
            "The same.",                                                                                               \
            "A fifth of a part's depth on each side stays for the core of thin blades.",                               \
            "sweeps: 462 legs, 3 % fewer evaluations",                                                                 \
            "sweeps: 434 legs, 0.014 mm behind, but a core of a fifth of the part")                                    \
    SETTING(double, guard_of_cell, 0.3, "smallest cell",                                                               \
            "The same.",                                                                                               \
            "Tissue at rest in the guard zone is a fraction of an element deep.",                                      \
            "bar: 2.12 N; sweeps: 0.048 mm behind",                                                                    \
            "bar: 1.98 N, 135 evaluations, tissue rests deeper; sweeps: 0.031 mm behind")                              \
    /* ---- length of a leg (advance/advance.h) */                                                                     \
    SETTING(double, advance_keep, 0.1, "core distance at the start of the leg",                                        \
            "Core distance that a leg leaves, and step of a plane (plane_distance) through the guard zone.",           \
            "Li et al., Incremental Potential Contact, ACM Trans. Graph. 39(4), 2020, keep 0.2.",                      \
            "sweeps: 0.037 mm behind",                                                                                 \
            "sweeps: 0.049 mm behind")                                                                                 \
    SETTING(double, advance_stop, 0.5, "guard depth",                                                                  \
            "Core distance that a leg may reach from any distance. The error of a distance field leaves as much "      \
            "of the zone.",                                                                                            \
            "Half of the zone is for approach, half for sliding.",                                                     \
            "sweeps: 1 evaluation fewer of 2542",                                                                      \
            "sweeps: 0.057 mm behind, 3.4 mm at most")                                                                 \
    /* ---- volume of elements (volume/volume_bound.h) */                                                              \
    SETTING(double, volume_near, 0.3, "volume at rest",                                                                \
            "Volume of an element below which a contact point may push it open.",                                      \
            "Three times volume_stop: the point is there before it is needed.",                                        \
            "jaws: 210 evaluations, 58 legs",                                                                          \
            "jaws: the same")                                                                                          \
    SETTING(double, volume_stop, 0.1, "volume at rest",                                                                \
            "Volume that these contact points keep. No leg makes an element smaller than half of it.",                 \
            "Elements far below a tenth of their volume are beyond the range of the materials.",                       \
            "jaws: 204 evaluations, 1.32 N",                                                                           \
            "jaws: 187 evaluations, 1.40 N")                                                                           \
    /* ---- contact points with rigid parts (detect/part_contacts.c) */                                                \
    SETTING(double, search_margin, 1e-3, "m",                                                                          \
            "Distance from the swept part up to which tissue gets contact points.",                                    \
            "Tissue moves by less than this in most legs.",                                                            \
            "bar: 150 evaluations; sweeps: 2576 evaluations",                                                          \
            "sweeps: 2539 evaluations, more points to test")                                                           \
    SETTING(double, reuse_motion, 0.25, "guard depth",                                                                 \
            "Motion up to which contact points serve the next leg, too.",                                              \
            "Resting boxes pull with 0.19356 N in each of 190 steps, and with 0.191 to 0.199 N without reuse "         \
            "(NUMERICS.md).",                                                                                          \
            "bar: 155 evaluations; sweeps: 2559",                                                                      \
            "bar: 147 evaluations, force 0.2 % off; sweeps: 2494")                                                     \
    SETTING(double, plane_distance, 0.6, "guard depth",                                                                \
            "After a blocked leg, planes keep triangles out that are nearer to the core. Below half of it they "       \
            "push them out.",                                                                                          \
            "Above advance_stop, so that all pairs that may block have a plane.",                                      \
            "sweeps: 0.053 mm behind, 4.9 mm at most",                                                                 \
            "sweeps: 2 % fewer evaluations; planes without friction replace contact points")                           \
    SETTING(double, max_sag, 5e-5, "m",                                                                                \
            "Depth beyond its neighbors at which an edge or a triangle gets a contact point, at most. "                \
            "A pressed point stays within a quarter of it.",                                                           \
            "A fortieth of the guard depth.",                                                                          \
            "sweeps: 445 legs, 0.025 mm behind",                                                                       \
            "sweeps: 447 legs, 0.027 mm behind, 4 elements inverted")                                                  \
    SETTING(double, sag_of_guard, 0.25, "guard depth",                                                                 \
            "The same.",                                                                                               \
            "A tenth of the depth of a thin part (guard_of_part).",                                                    \
            "sweeps: 20 evaluations fewer of 2542",                                                                    \
            "sweeps: 2543 evaluations")                                                                                \
    SETTING(double, point_follow, 0.3, "distance to the nearest point",                                                \
            "Motion of a pressed point along its edge or triangle in a leg, under a part at rest, unless it stays.",   \
            "Smaller steps settle slower, and larger ones overshoot.",                                                 \
            "rest: 1 and 6 forces vary",                                                                               \
            "rest: 7 and 14 forces vary, by up to 9.7 %")                                                              \
    SETTING(double, behind_cosine, 0.25, "1",                                                                          \
            "Cosine between the normals of part and tissue above which the part is behind the surface.",               \
            "Edges of boxes and rims of rods touch surfaces that are tilted by up to 75 degrees against them "         \
            "(contact_find_test).",                                                                                    \
            "sweeps: 0.037 mm behind",                                                                                 \
            "sweeps: 456 legs, 0.030 mm behind")                                                                       \
    SETTING(double, same_cosine, 0.7, "1",                                                                             \
            "Cosine above which two normals push the same way, so that one contact point is enough.",                  \
            "45 degrees: the edge of a box has points of both faces.",                                                 \
            "sweeps: 0.051 mm behind, 4.6 mm at most",                                                                 \
            "none are the same: bar: 246 evaluations, 14 of 80 steps do not converge")                                 \
    SETTING(double, recovery_speed, 0.1, "m/s",                                                                        \
            "Speed at which overlapping tissue is pushed out.",                                                        \
            "A step of 20 ms undoes 2 mm, the guard depth.",                                                           \
            "sweeps: 9 steps end early, of 258",                                                                       \
            "sweeps: 0.050 mm behind, 3.2 mm at most")                                                                 \
    SETTING(double, recovery_time, 0.15, "s",                                                                          \
            "With inertia: time in which an overlap decays to 1/e.",                                                   \
            "Slower than a collision: recovery uses energy that contacts have dissipated (substep_contact.h).",        \
            "overlap in a squeezed hollow (hollow_test): 0.29 instead of 0.31 %; energy of bench_energy 50: the same", \
            "overlap in a squeezed hollow: 0.33 %; energy: the same")                                                  \
    /* ---- legs of a step (sim/step/legs.c, proxy.c) */                                                               \
    SETTING(double, max_tool_speed, 2.0, "m/s",                                                                        \
            "Speed of a tool or a blade above which it counts as placed anew.",                                        \
            "Twice the 1 m/s of a fast hand.",                                                                         \
            "sweeps at 1 m/s: the same; faster tools jump over tissue",                                                \
            "sweeps: the same; a jump of 40 mm in 20 ms is swept through tissue")                                      \
    SETTING(double, leg_distance, 0.5, "largest cell; explicit dynamics: depth of the part",                           \
            "Distance of a tool near tissue in a leg; in explicit dynamics, of the tool and the tissue together. "     \
            "After a blocked leg, nodes move by up to twice as much.",                                                 \
            "A leg is linear in all positions: half an element. It ends before tissue passes the middle of a part.",   \
            "sweeps: 729 legs, 0.006 mm behind; 12 sweeps with inertia: 1858 legs instead of 1755 in 80 steps",        \
            "sweeps: 405 legs, 17 % more evaluations, 0.44 mm behind, 8.9 mm at most; with inertia: 1599 legs")        \
    SETTING(double, missing_follow, 0.5, "change",                                                                     \
            "How far the missing compliance changes from leg to leg.",                                                 \
            "On coarse cells the contact points change with it, so that the whole change overshoots.",                 \
            "rest, where points do not stay: 26 and 20 forces vary instead of 1 and 14, since they settle slower",     \
            "the same: 6 and 18")                                                                                      \
    SETTING(double, soft_begin, 0.75, "force limit",                                                                   \
            "Load above which a coupling is softer at the start of a leg (c in NUMERICS.md).",                         \
            "Couplings keep their stiffness in normal use (NUMERICS.md).",                                             \
            "soft: the same",                                                                                          \
            "where c stays: the coupling never softens: soft: 2.1 N, 8 of 60 steps do not converge")                   \
    SETTING(double, soft_width, 0.2, "force limit",                                                                    \
            "Range of loads over which it softens until it keeps the limit.",                                          \
            "The load settles inside the range (NUMERICS.md).",                                                        \
            "where c stays: soft: 119 evaluations instead of 120",                                                     \
            "where c stays: soft: 0.95 N, 2 of 60 steps do not converge")                                              \
    SETTING(double, force_overshoot, 1.02, "force limit",                                                              \
            "Load at which a leg ends early.",                                                                         \
            "2 %: above it a force limit counts as violated.",                                                         \
            "where c stays, at 0.51: soft: 67 legs, 2 of 60 steps do not converge",                                    \
            "soft: the same")                                                                                          \
    /* ---- tissue on tissue (detect/tissue.c, tissue_cut.c, tissue_rules.h) */                                        \
    SETTING(double, self_margin, 0.25, "shortest edge",                                                                \
            "Distance up to which tissue gets contact points on tissue.",                                              \
            "Nodes that move further in a step extend it by their motion.",                                            \
            "self: passes",                                                                                            \
            "self: passes; more points to test")                                                                       \
    SETTING(double, self_thickness, 0.05, "smallest cell",                                                             \
            "Distance that two surfaces of tissue keep.",                                                              \
            "A tenth of a leg (leg_distance): a leg is linear, so its end misses the distance by some of it.",         \
            "bench_self 12, flaps: 35 of 234 steps end early instead of 23; none crosses",                             \
            "bench_self 12, flaps: 10 of 234 steps end early; none crosses")                                           \
    SETTING(double, flat_cosine, 0.95, "1",                                                                            \
            "Cosine between the normals of two triangles above which they have no edge.",                              \
            "18 degrees: their nodes touch first.",                                                                    \
            "self: passes",                                                                                            \
            "no edge is flat; self: passes")                                                                           \
    SETTING(double, facing_cosine, 0.1, "1",                                                                           \
            "Cosine above which two surfaces face each other.",                                                        \
            "84 degrees: walls of blocks that lie flush do not.",                                                      \
            "self: passes",                                                                                            \
            "self: passes")                                                                                            \
    SETTING(double, self_border, 0.02, "shortest edge, or barycentric weight",                                         \
            "How far beyond its triangle, and how deep, a contact of the last step persists.",                         \
            "Blocks whose corners meet come to rest: 1e-14 J instead of 1e-6 J (NUMERICS.md).",                        \
            "self: passes",                                                                                            \
            "self: passes")                                                                                            \
    SETTING(double, opposite_cosine, 0.5, "1",                                                                         \
            "Cosine above which two sides of a cut are opposite each other.",                                          \
            "60 degrees: both ends of a wedge are not.",                                                               \
            "self: passes",                                                                                            \
            "none are opposite each other; self: a slab that slides off sinks")

#define PLIANT_SETTING_MEMBER(type, name, ...) type name;
typedef struct pliant_contact_settings {
    PLIANT_CONTACT_SETTING_LIST(PLIANT_SETTING_MEMBER)
} pliant_contact_settings;
#undef PLIANT_SETTING_MEMBER

pliant_contact_settings pliant_contact_settings_default(void);
/* Return the defaults with the options of the scene. */
pliant_contact_settings pliant_contact_settings_of(const pliant_scene *scene);

#ifdef __cplusplus
}
#endif
#endif
