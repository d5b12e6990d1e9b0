/* Settings of contact, of the legs of a step, and of blades. A model holds one set of them (model_data/model.h). The
 * scene options contact/... are described in pliant/scene.h. The option contact/guard_depth sets the field guard_depth.
 *
 * Not listed here: capacities of arrays, limits of iterations, calibrations, and tolerances of exact algorithms. They
 * stand in the code of these algorithms. settings_test lists them. Results depend on tolerances only within the
 * tolerance.
 *
 * Effects are measured with one setting at half or twice its default, on one thread. They name the figures that change.
 * No sweep tunneled in any of these runs. All effects are of one version of the code. Changes of the solver shift the
 * figures of the defaults and of the effects alike, by up to 6 %. The defaults of sweeps, jaws, soft and blade are of
 * a later version.
 *
 * sweeps: PLIANT_SWEEPS=100 PLIANT_SWEEPS_STEPS=1 swept_test --gtest_filter=*NothingIsSweptThroughTheSheet. The
 *     defaults take 647 steps, 6220 evaluations and 1120 legs. 19 steps end early. No element is inverted. Proxies are
 *     0.038 mm (mean) and 5.6 mm (maximum) behind their targets.
 * inertia: PLIANT_SWEEPS=12 PLIANT_SWEEPS_STEPS=1 swept_dynamics_test with the same filter. 80 steps, 4228 legs.
 * jaws: pliant_deform launch/scenes/grasp.yaml --tools launch/scenes/grasp_path.yaml. The 96 steps take 229
 *     evaluations and 96 legs. The largest force is 0.55 N. The proxy is at most 1.06 mm behind.
 * soft: the same with contact/grip_torque=0.003. It takes 179 evaluations and 96 legs. 61 steps end at the force limit.
 *     The largest force is 0.115 N. Soft with inertia: the same with solver/kind=tled. It takes 957 legs. 61 steps end
 *     at the limit. The largest force is 0.114 N, and the proxy is at most 0.84 mm behind.
 * rest: bench_force linear 10, and for two settings bench_force hexahedra 10. 12 and 24 of 46 forces vary by
 *     more than 0.1 %, by up to 1.48 and 4.46 %. Errors of the sphere are -1.0 to +6.3 % and -0.6 to
 *     +13.5 %. Errors of the punch are +1.8 to +6.8 % and +0.1 to +5.0 %.
 * press: bench_press FOLDER element/kind=hexahedra, with the test data. With six evaluations, errors of forces are
 *     0.00 / 0.00 % (95th percentile / maximum). The largest force is 1.626 N.
 * self: bench_self 3 0 flaps, and fold. 3 of 53 and 11 of 81 steps end early. A step takes 5.5 and 7.9 evaluations.
 * blade: pliant_deform launch/scenes/resect.yaml --tools launch/scenes/resect_path.yaml. 51 steps, 42 evaluations. */
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
            "sweeps: 6252 evaluations, 1187 legs, 23 steps end early; jaws: 232 evaluations, 0.551 N",                 \
            "sweeps and jaws: the same")                                                                               \
    SETTING(double, guard_of_part, 0.4, "depth of the part",                                                           \
            "The same.",                                                                                               \
            "A fifth of a part's depth on each side stays for the core of thin blades.",                               \
            "sweeps: 6278 evaluations, 1165 legs, 31 steps end early, 0.054 mm behind, at most 3.9 mm; jaws: 232 "     \
            "evaluations, 0.551 N; inertia: 7135 evaluations, 4209 legs",                                              \
            "sweeps: 6028 evaluations, 1129 legs, 14 steps end early, 0.023 mm behind, at most 5.0 mm; jaws: 0.549 "   \
            "N; inertia: 4240 legs")                                                                                   \
    SETTING(double, guard_of_cell, 0.3, "smallest cell",                                                               \
            "The same.",                                                                                               \
            "Tissue at rest in the guard zone is a fraction of an element deep.",                                      \
            "sweeps: 6311 evaluations, 1194 legs, 25 steps end early, 0.044 mm behind; jaws: 228 evaluations, 0.549 "  \
            "N; rest: linear 12 forces vary by up to 1.6 %, sphere -1.0 to +6.4 %",                                    \
            "sweeps: 6233 evaluations, 0.036 mm behind; jaws and rest: the same")                                      \
    /* ---- length of a leg (advance/advance.h) */                                                                     \
    SETTING(double, advance_keep, 0.1, "core distance at the start of the leg",                                        \
            "Core distance that a leg leaves, and step of a plane (plane_distance) through the guard zone.",           \
            "Li et al., Incremental Potential Contact, ACM Trans. Graph. 39(4), 2020, keep 0.2.",                      \
            "sweeps: 6164 evaluations, 1137 legs, 18 steps end early, 0.035 mm behind; self: fold 9 steps end "        \
            "early, 7.8 evaluations, 0.502 N; inertia: 4227 legs; jaws: the same",                                     \
            "sweeps: 6208 evaluations, 1129 legs, 24 steps end early, 0.046 mm behind; jaws and inertia: the same")    \
    SETTING(double, advance_stop, 0.5, "guard depth",                                                                  \
            "Core distance that a leg may reach from any distance. The error of a distance field leaves as much of "   \
            "the zone. Edges nearer than this fraction of the thickness touch at any angle.",                          \
            "Half of the zone is for approach, half for sliding.",                                                     \
            "sweeps: 6203 evaluations, 1125 legs, 20 steps end early, 0.037 mm behind; jaws and inertia: the same",    \
            "sweeps: 6158 evaluations, 1217 legs, 29 steps end early, 0.047 mm behind, at most 5.0 mm; jaws and "      \
            "inertia: the same")                                                                                       \
    /* ---- volume of elements (volume/volume_bound.h) */                                                              \
    SETTING(double, volume_near, 0.3, "volume at rest",                                                                \
            "Volume of an element below which a contact point may push it open.",                                      \
            "Three times volume_stop: the point is there before it is needed.",                                        \
            "sweeps: 6241 evaluations, 1180 legs, 24 steps end early; jaws: the same",                                 \
            "sweeps: 6203 evaluations, 1148 legs, 19 steps end early, 0.034 mm behind; jaws: the same")                \
    SETTING(double, volume_stop, 0.1, "volume at rest",                                                                \
            "Volume that these contact points keep. No leg makes an element smaller than half of it.",                 \
            "Elements far below a tenth of their volume are beyond the range of the materials.",                       \
            "sweeps: 6239 evaluations; jaws: the same",                                                                \
            "sweeps: 6252 evaluations, 23 steps end early; jaws: the same")                                            \
    /* ---- contact points with rigid parts (detect/part_contacts.c) */                                                \
    SETTING(double, search_margin, 1e-3, "m",                                                                          \
            "Distance from the swept part up to which tissue gets contact points.",                                    \
            "Tissue moves by less than this in most legs.",                                                            \
            "sweeps: 6262 evaluations, 1135 legs, 21 steps end early; jaws: 231 evaluations",                          \
            "sweeps: 6169 evaluations, 1139 legs, 20 steps end early; jaws: 237 evaluations")                          \
    SETTING(double, hysteresis, 0.25, "1",                                                                             \
            "Motion, divided by the guard depth, up to which contact points serve the next leg, too. max_sag is "      \
            "limited to the same depth. A pressed point stays until another one is deeper by this fraction of "        \
            "max_sag.",                                                                                                \
            "Resting boxes pull with 0.19356 N in each of 190 steps, and with 0.191 to 0.199 N if points serve one "   \
            "leg (NUMERICS.md).",                                                                                      \
            "sweeps: 6251 evaluations, 1246 legs, 25 steps end early; jaws: 231 evaluations; rest: linear 14 forces "  \
            "vary by up to 1.67 %, punch +1.7 to +6.8 %",                                                              \
            "sweeps: 6178 evaluations, 1183 legs; jaws: 0.551 N; rest: linear 14 forces vary by up to 1.83 %, "        \
            "sphere -1.1 to +6.3 %, punch +2.2 to +6.9 %")                                                             \
    SETTING(double, plane_distance, 0.6, "guard depth",                                                                \
            "After a blocked leg, planes keep triangles out that are nearer to the core. Below half of it they push "  \
            "them out.",                                                                                               \
            "Above advance_stop, so that all pairs that may block have a plane.",                                      \
            "sweeps: 6166 evaluations, 1140 legs, 21 steps end early, 0.046 mm behind; jaws: the same",                \
            "sweeps: 6190 evaluations, 1192 legs, 21 steps end early, 0.044 mm behind; jaws: the same")                \
    SETTING(double, max_sag, 5e-5, "m",                                                                                \
            "Depth beyond its neighbors at which an edge or a triangle gets a contact point, at most.",                \
            "A fortieth of the guard depth.",                                                                          \
            "sweeps: 6239 evaluations, 1247 legs, 25 steps end early, 0.035 mm behind; jaws: 225 evaluations, 0.553 "  \
            "N; rest: linear 14 forces vary by up to 1.48 %, sphere -1.2 to +6.3 %",                                   \
            "sweeps: 6218 evaluations, 1169 legs, 0.037 mm behind; jaws: 223 evaluations, 0.55 N; rest: linear 13 "    \
            "forces vary by up to 1.86 %, sphere -1.4 to +6.1 %, punch +1.9 to +6.7 %")                                \
    SETTING(double, point_follow, 0.3, "distance to the nearest point",                                                \
            "Motion of a pressed point along its edge or triangle in a leg, under a part at rest, unless it stays.",   \
            "Smaller steps settle slower, and larger ones overshoot.",                                                 \
            "sweeps: 6205 evaluations, 1207 legs, 23 steps end early; jaws: 239 evaluations; rest: linear 13 forces "  \
            "vary by up to 1.48 %, sphere -1.0 to +6.4 %; hexahedra 22 forces vary by up to 2.65 %, sphere -1.0 to "   \
            "+13.0 %, punch +0.1 to +4.9 %",                                                                           \
            "sweeps: 6283 evaluations, 1153 legs, 21 steps end early; jaws: 244 evaluations; rest: linear 19 forces "  \
            "vary by up to 8.87 %, sphere -1.2 to +6.2 %, punch +1.8 to +6.7 %; hexahedra 32 forces vary by up to "    \
            "15.3 %, sphere -1.6 to +13.4 %, punch +0.1 to +4.9 %")                                                    \
    SETTING(double, facing_cosine, 0.25, "1",                                                                          \
            "Cosine between the normals of part and tissue above which the part is behind the surface. Cosine above "  \
            "which two surfaces of tissue face each other.",                                                           \
            "Edges of boxes and rims of rods touch surfaces that are tilted by up to 75 degrees against them "         \
            "(contact_find_test). Walls of blocks that lie flush do not face each other.",                             \
            "sweeps: 1188 legs, 24 steps end early, 0.040 mm behind; self: fold 0.505 N; jaws: the same",              \
            "sweeps: 6296 evaluations, 1201 legs, 26 steps end early, 0.050 mm behind, at most 7.5 mm; jaws and "      \
            "self: the same")                                                                                          \
    SETTING(double, same_cosine, 0.7, "1",                                                                             \
            "Cosine above which two normals push the same way, so that one contact point is enough. Cosine above "     \
            "which two sides of a cut are opposite each other.",                                                       \
            "45 degrees: the edge of a box has points of both faces, and both ends of a wedge are not opposite.",      \
            "sweeps: 6290 evaluations, 1274 legs, 25 steps end early, 0.052 mm behind; self: fold 10 steps end "       \
            "early, 0.497 N; jaws: the same",                                                                          \
            "sweeps: 5969 evaluations, 1152 legs, 14 steps end early, 0.018 mm behind, at most 3.6 mm; jaws: 223 "     \
            "evaluations, 0.572 N, 1.09 mm behind; self: flaps 6 steps end early, 5.8 evaluations, 0.664 N; fold 25 "  \
            "steps end early, 6.4 evaluations, 0.423 N; no normals are the same")                                      \
    SETTING(double, recovery_speed, 0.1, "m/s",                                                                        \
            "Speed at which overlapping tissue is pushed out.",                                                        \
            "A step of 20 ms undoes 2 mm, the guard depth.",                                                           \
            "sweeps: 6156 evaluations, 1181 legs, 23 steps end early, 0.046 mm behind; inertia: 6551 evaluations, "    \
            "4232 legs; jaws: the same",                                                                               \
            "sweeps: 6232 evaluations, 1145 legs, 0.046 mm behind; inertia: 7146 evaluations, 4233 legs; jaws: the "   \
            "same")                                                                                                    \
    SETTING(double, recovery_time, 0.15, "s",                                                                          \
            "With inertia: time in which an overlap decays to 1/e.",                                                   \
            "Slower than a collision: recovery uses energy that contacts have dissipated (substep_contact.h).",        \
            "sweeps, jaws and inertia: the same",                                                                      \
            "sweeps, jaws and inertia: the same")                                                                      \
    /* ---- the surface in hexahedra (detect/contact_surface.h) */                                                     \
    SETTING(double, min_cube_tissue, 0.2, "volume of the cube",                                                        \
            "Tissue in a hexahedron below which no corner of the surface is embedded in it.",                          \
            "Four lattices of bench_press converge (NUMERICS.md); with 0.15, one has errors of up to 35 %. "           \
            "Extrapolation from fuller cubes softens contact, by 9 % at a fraction of 0.25.",                          \
            "press: 26.79 / 36.92 %, 1.306 N; sweeps, jaws and rest: the same",                                        \
            "press: 1.720 N; sweeps, jaws and rest: the same")                                                         \
    /* ---- legs of a step (sim/step/legs.c, proxy.c), and blades (cut.c) */                                           \
    SETTING(double, max_tool_speed, 2.0, "m/s",                                                                        \
            "Speed of a tool or a blade above which it counts as placed anew. Speed of tissue that returns over a "    \
            "blade, at most.",                                                                                         \
            "Twice the 1 m/s of a fast hand.",                                                                         \
            "sweeps, jaws and inertia: the same; faster tools jump over tissue",                                       \
            "sweeps, jaws and inertia: the same; a jump of 40 mm in 20 ms is swept through tissue")                    \
    SETTING(double, long_stroke, 0.3, "cut/drag",                                                                      \
            "Motion of a blade in a step above which it cuts free tissue, and drags none.",                            \
            "A saw-tooth of the force has at least three steps.",                                                      \
            "sweeps, jaws and blade: the same; knife_test: passes",                                                    \
            "sweeps, jaws and blade: the same; knife_test: far steps do not take toughness times area")                \
    SETTING(double, leg_distance, 0.5, "largest cell; explicit dynamics: depth of the part",                           \
            "Distance of a tool near tissue in a leg; in explicit dynamics, of the tool and the tissue together. "     \
            "After a blocked leg, nodes move by up to twice as much.",                                                 \
            "A leg is linear in all positions: half an element. It ends before tissue passes the middle of a part.",   \
            "sweeps: 6303 evaluations, 1718 legs, 31 steps end early, 0.021 mm behind, at most 1.6 mm; jaws: 102 "     \
            "legs; inertia: 7155 evaluations, 4970 legs; soft: 183 evaluations, 102 legs, 0.117 N, 1.11 mm behind",    \
            "sweeps: 7375 evaluations, 1034 legs, 72 steps end early, 0.430 mm behind, at most 9.7 mm; inertia: "      \
            "7141 evaluations, 2793 legs; soft: 178 evaluations, 0.115 N; jaws: the same")                             \
    SETTING(double, resolved_radius, 1.5, "cell",                                                                      \
            "Radius of a contact at which half of the missing depth counts.",                                          \
            "NUMERICS.md: three cells across.",                                                                        \
            "jaws: 232 evaluations; rest: linear 15 forces vary by up to 1.97 %, sphere -2.7 to +9.8 %, punch +2.2 "   \
            "to +7.2 %; hexahedra 26 forces vary by up to 2.7 %, sphere -0.5 to +13.1 %, punch +0.4 to +5.4 %; "       \
            "sweeps: the same",                                                                                        \
            "jaws: 236 evaluations, 0.551 N; rest: linear 13 forces vary by up to 1.57 %, sphere -0.4 to +6.0 %, "     \
            "punch +1.4 to +6.4 %; hexahedra 19 forces vary by up to 3.77 %, sphere -0.9 to +13.7 %, punch -0.1 to "   \
            "+4.5 %; sweeps: the same")                                                                                \
    SETTING(double, missing_follow, 0.5, "change",                                                                     \
            "How far the missing compliance changes from leg to leg.",                                                 \
            "On coarse cells the contact points change with it, so that the whole change overshoots.",                 \
            "jaws: 232 evaluations, 0.545 N, 1.47 mm behind; rest: linear 43 forces vary by up to 7.47 %, sphere "     \
            "-1.2 to +5.9 %, punch +1.8 to +6.9 %; soft: 188 evaluations, 60 steps end early, 1.35 mm behind; "        \
            "sweeps: the same",                                                                                        \
            "jaws: 228 evaluations, 0.545 N, 0.90 mm behind; rest: linear 11 forces vary by up to 2.25 %, sphere "     \
            "-1.0 to +6.2 %; soft: 179 evaluations, 62 steps end early, 0.90 mm behind; sweeps: the same")             \
    SETTING(double, soft_begin, 0.75, "force limit",                                                                   \
            "Load above which a coupling is softer at the start of a leg (c in NUMERICS.md).",                         \
            "Couplings keep their stiffness in normal use (NUMERICS.md).",                                             \
            "soft: 179 evaluations, 62 steps end early; sweeps and jaws: the same",                                    \
            "soft: 3219 evaluations, 1460 legs, 53 steps end early, 21 do not converge, 0.276 N; sweeps and jaws: "    \
            "the same")                                                                                                \
    SETTING(double, soft_width, 0.2, "force limit",                                                                    \
            "Range of loads over which it softens until it keeps the limit.",                                          \
            "The load settles inside the range (NUMERICS.md).",                                                        \
            "soft: 179 evaluations, 62 steps end early; sweeps and jaws: the same",                                    \
            "soft: 192 evaluations, 0 steps end early, 0.115 N; sweeps and jaws: the same")                            \
    SETTING(double, yield_fraction, 0.25, "compliance of the tissue",                                                  \
            "Explicit dynamics: motion of a proxy in a step per load beyond its limit.",                               \
            "The load stays below the limit in tissue that becomes up to four times stiffer.",                         \
            "soft with inertia: 976 legs, 49 steps end early, 0.113 N, 0.59 mm behind; sweeps and jaws: the same",     \
            "soft with inertia: 954 legs, 60 steps end early, 0.112 N, 0.92 mm behind; sweeps and jaws: the same")     \
    SETTING(double, force_overshoot, 1.02, "force limit",                                                              \
            "Load at which a leg ends early.",                                                                         \
            "2 %: above it a force limit counts as violated.",                                                         \
            "soft: 194 evaluations, 108 legs; sweeps and jaws: the same",                                              \
            "sweeps, jaws and soft: the same")                                                                         \
    /* ---- tissue on tissue (detect/tissue.c, tissue_cut.c, tissue_rules.h) */                                        \
    SETTING(double, self_margin, 0.25, "shortest edge",                                                                \
            "Distance up to which tissue gets contact points on tissue.",                                              \
            "Nodes that move further in a step extend it by their motion.",                                            \
            "self: the same",                                                                                          \
            "self: the same")                                                                                          \
    SETTING(double, self_thickness, 0.05, "smallest cell",                                                             \
            "Distance that two surfaces of tissue keep.",                                                              \
            "A tenth of a leg (leg_distance): a leg is linear, so its end misses the distance by some of it.",         \
            "self: flaps 7 steps end early, 6.4 evaluations, 0.659 N; fold 18 steps end early, 7.8 evaluations, "      \
            "0.499 N",                                                                                                 \
            "self: flaps 0 steps end early, 4.7 evaluations, 0.690 N; fold 6 steps end early, 7.6 evaluations, "       \
            "0.513 N")                                                                                                 \
    SETTING(double, flat_cosine, 0.95, "1",                                                                            \
            "Cosine between the normals of two triangles above which they have no edge.",                              \
            "18 degrees: their nodes touch first.",                                                                    \
            "self: fold 9 steps end early, 8.0 evaluations, 0.501 N",                                                  \
            "self: flaps 0 steps end early, 6.2 evaluations, 0.668 N; fold 3 steps end early, 7.4 evaluations, "       \
            "0.504 N; no edge is flat")                                                                                \
    SETTING(double, self_border, 0.02, "shortest edge, or barycentric weight",                                         \
            "How far beyond its triangle, and how deep, a contact of the last step persists.",                         \
            "Blocks whose corners meet come to rest: 1e-14 J instead of 1e-6 J (NUMERICS.md).",                        \
            "self: flaps 5.6 evaluations; fold 12 steps end early, 8.0 evaluations, 0.497 N",                          \
            "self: fold 9 steps end early, 7.8 evaluations, 0.491 N")

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