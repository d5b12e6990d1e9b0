/** @file scene.h
 *  What the user asks for. One list of options makes the struct, its defaults and check, the YAML schema, the ROS
 *  parameter names and the table in the README, so that they cannot drift apart.
 */
#ifndef PLIANT_SCENE_H
#define PLIANT_SCENE_H

#include "pliant/material.h"

#ifdef __cplusplus
extern "C" {
#endif

/** name in C, name in YAML */
#define PLIANT_METHOD_LIST(X) \
    X(PLIANT_FINE, fine) X(PLIANT_COARSE, coarse) X(PLIANT_SCHUR, schur) X(PLIANT_AVERAGED, averaged) \
    X(PLIANT_CALIBRATED, calibrated) X(PLIANT_LOD, lod)
#define PLIANT_TOUCH_LIST(X) X(PLIANT_TOUCH_OVERLAP, overlap) X(PLIANT_TOUCH_FACE, face)
#define PLIANT_BACKEND_LIST(X) X(PLIANT_AUTO, auto) X(PLIANT_CPU, cpu) X(PLIANT_CUDA, cuda)
#define PLIANT_PRECONDITIONER_LIST(X) X(PLIANT_PRECONDITIONER_AUTO, auto) X(PLIANT_DIRECT, direct) X(PLIANT_MULTIGRID, multigrid)
#define PLIANT_SCALAR_LIST(X)                                                                     \
    X(PLIANT_SCALAR_NONE, none) X(PLIANT_SCALAR_VON_MISES, von_mises)                             \
    X(PLIANT_SCALAR_STRAIN_ENERGY, strain_energy) X(PLIANT_SCALAR_VOLUME_RATIO, volume_ratio)     \
    X(PLIANT_SCALAR_PRINCIPAL_STRESS, principal_stress) X(PLIANT_SCALAR_MASS_CHANGE, mass_change) \
    X(PLIANT_SCALAR_CONTACT_FORCE, contact_force)
#define PLIANT_SOLVER_LIST(X) X(PLIANT_COROTATIONAL, corotational) X(PLIANT_TLED, tled)
#define PLIANT_LAW_LIST(X)                                                                        \
    X(PLIANT_LAW_NEO_HOOKEAN, neo_hookean) X(PLIANT_LAW_COMPRESSIBLE, compressible)               \
    X(PLIANT_LAW_SAINT_VENANT_KIRCHHOFF, saint_venant_kirchhoff)
#define PLIANT_MESH_LIST(X) X(PLIANT_LATTICE, lattice) X(PLIANT_OCTREE, octree)
#define PLIANT_ELEMENT_LIST(X) X(PLIANT_ELEMENT_AUTO, auto) X(PLIANT_LINEAR, linear) X(PLIANT_HEXAHEDRA, hexahedra)
#define PLIANT_WARP_LIST(X) X(PLIANT_RASTERIZE, rasterize) X(PLIANT_FIT, fit)
#define PLIANT_SEGMENT_LIST(X) X(PLIANT_SEGMENT_NONE, none) X(PLIANT_SEGMENT_GMM, gmm)
#define PLIANT_CUT_LIST(X) X(PLIANT_CUT_NONE, none) X(PLIANT_CUT_SEVER, sever) X(PLIANT_CUT_SUBDIVIDE, subdivide)
#define PLIANT_TRIGGER_LIST(X)                                                                    \
    X(PLIANT_TRIGGER_ALWAYS, always) X(PLIANT_TRIGGER_JAW, jaw) X(PLIANT_TRIGGER_ENERGY, energy)  \
    X(PLIANT_TRIGGER_SERVICE, service)
#define PLIANT_GRASP_LIST(X) X(PLIANT_GRASP_AUTO, auto) X(PLIANT_GRASP_BLOB, blob) X(PLIANT_GRASP_CONTACT, contact)
#define PLIANT_RESPONSE_LIST(X) X(PLIANT_RESPONSE_PUSH, push) X(PLIANT_RESPONSE_PAPER, paper)
#define PLIANT_MEASURE_LIST(X) X(PLIANT_MEASURE_MAX, max) X(PLIANT_MEASURE_P95, p95) X(PLIANT_MEASURE_RMS, rms)

#define PLIANT_CHOICE_ENUM(name, yaml) name,
typedef enum pliant_method { PLIANT_METHOD_LIST(PLIANT_CHOICE_ENUM) } pliant_method;
typedef enum pliant_touch { PLIANT_TOUCH_LIST(PLIANT_CHOICE_ENUM) } pliant_touch;
typedef enum pliant_backend_choice { PLIANT_BACKEND_LIST(PLIANT_CHOICE_ENUM) } pliant_backend_choice;
typedef enum pliant_preconditioner_choice { PLIANT_PRECONDITIONER_LIST(PLIANT_CHOICE_ENUM) } pliant_preconditioner_choice;
typedef enum pliant_scalar { PLIANT_SCALAR_LIST(PLIANT_CHOICE_ENUM) } pliant_scalar;
typedef enum pliant_solver_kind { PLIANT_SOLVER_LIST(PLIANT_CHOICE_ENUM) } pliant_solver_kind;
typedef enum pliant_law { PLIANT_LAW_LIST(PLIANT_CHOICE_ENUM) } pliant_law;
typedef enum pliant_mesh_kind { PLIANT_MESH_LIST(PLIANT_CHOICE_ENUM) } pliant_mesh_kind;
typedef enum pliant_element_kind { PLIANT_ELEMENT_LIST(PLIANT_CHOICE_ENUM) } pliant_element_kind;
typedef enum pliant_warp_kind { PLIANT_WARP_LIST(PLIANT_CHOICE_ENUM) } pliant_warp_kind;
typedef enum pliant_segment_kind { PLIANT_SEGMENT_LIST(PLIANT_CHOICE_ENUM) } pliant_segment_kind;
typedef enum pliant_cut_kind { PLIANT_CUT_LIST(PLIANT_CHOICE_ENUM) } pliant_cut_kind;
typedef enum pliant_trigger { PLIANT_TRIGGER_LIST(PLIANT_CHOICE_ENUM) } pliant_trigger;
typedef enum pliant_measure { PLIANT_MEASURE_LIST(PLIANT_CHOICE_ENUM) } pliant_measure;
typedef enum pliant_grasp_kind { PLIANT_GRASP_LIST(PLIANT_CHOICE_ENUM) } pliant_grasp_kind;
typedef enum pliant_response { PLIANT_RESPONSE_LIST(PLIANT_CHOICE_ENUM) } pliant_response;
#undef PLIANT_CHOICE_ENUM

/** C types of the kinds of option. INT3 and REAL3 take one default and one range for all three numbers. */
#define PLIANT_DECLARE_INT(name) int32_t name;
#define PLIANT_DECLARE_REAL(name) double name;
/** A number that follows from the size of the body where it is PLIANT_AUTO_LENGTH. A model's own scene (pliant_model_get_scene) has the number. */
#define PLIANT_AUTO_LENGTH (-1.0)
#define PLIANT_DECLARE_LENGTH(name) double name;
#define PLIANT_DECLARE_BOOL(name) bool name;
#define PLIANT_DECLARE_INT3(name) int32_t name[3];
#define PLIANT_DECLARE_REAL3(name) double name[3];
#define PLIANT_DECLARE_STRING(name) char name[256];
#define PLIANT_DECLARE_METHOD(name) pliant_method name;
#define PLIANT_DECLARE_TOUCH(name) pliant_touch name;
#define PLIANT_DECLARE_BACKEND(name) pliant_backend_choice name;
#define PLIANT_DECLARE_PRECONDITIONER(name) pliant_preconditioner_choice name;
#define PLIANT_DECLARE_SCALAR(name) pliant_scalar name;
#define PLIANT_DECLARE_SOLVER(name) pliant_solver_kind name;
#define PLIANT_DECLARE_MESH(name) pliant_mesh_kind name;
#define PLIANT_DECLARE_ELEMENT(name) pliant_element_kind name;
#define PLIANT_DECLARE_WARP(name) pliant_warp_kind name;
#define PLIANT_DECLARE_SEGMENT(name) pliant_segment_kind name;
#define PLIANT_DECLARE_CUT(name) pliant_cut_kind name;
#define PLIANT_DECLARE_TRIGGER(name) pliant_trigger name;
#define PLIANT_DECLARE_MEASURE(name) pliant_measure name;
#define PLIANT_DECLARE_GRASP(name) pliant_grasp_kind name;
#define PLIANT_DECLARE_RESPONSE(name) pliant_response name;
#define PLIANT_DECLARE_LAW(name) pliant_law name;

/* X(kind, name, default, low, high, unit, text) for every group; strings have no range */
#define PLIANT_SCENE_SCAN(X)                                                                                           \
    X(STRING, series, "", 0, 0, "", "DICOM SeriesInstanceUID, or its unique ending, where a folder holds several")     \
    X(INT3, resample, 0, 0, 4096, "voxels", "resample the scan to this many voxels; 0 keeps an axis as it is")
#define PLIANT_SCENE_SEGMENT(X)                                                                                        \
    X(SEGMENT, kind, PLIANT_SEGMENT_NONE, 0, 0, "", "gmm: labels by a Gaussian mixture ([C] 4.1) instead of a label map; pliant_segment shows them") \
    X(INT, classes, 0, 0, 16, "", "of the mixture; 0: by BIC")                                                        \
    X(INT, most_classes, 12, 1, 16, "", "that BIC may choose")                                                        \
    X(REAL, coherence, 1.0, 0.0, 100.0, "", "what a neighbour in the same class weighs; 0: voxels stand alone")       \
    X(LENGTH, smallest, PLIANT_AUTO_LENGTH, 0.0, 1.0, "m^3", "pieces below this volume join their neighbours; auto: 1e-6, or 0.0005 of the scan's volume where that is less")
#define PLIANT_SCENE_MATERIAL(X)                                                                                       \
    X(STRING, file, "", 0, 0, "", "material table (YAML), relative to the scene file; empty: the built-in one")       \
    X(STRING, labels, "", 0, 0, "", "label map, or segmentation whose segments name materials; empty: intensity ranges only") \
    X(BOOL, deformable_bone, false, 0, 1, "", "bone deforms instead of being fixed")                                  \
    X(STRING, slides, "", 0, 0, "", "materials that slide along all others, by name, with commas between: they are parted at load, as by cuts, and touch; with cut/kind: sever")
#define PLIANT_SCENE_MESH(X)                                                                                           \
    X(MESH, kind, PLIANT_LATTICE, 0, 0, "", "lattice: cubes of one size; octree: smaller ones where materials meet ([C] 4.2), method fine") \
    X(INT3, coarse_cells, 7, 1, 256, "cells", "coarse cubes along i, j, k")                                           \
    X(INT, ratio, 2, 1, 8, "", "fine cubes along each edge of a coarse one")                                          \
    X(INT, depth, 2, 0, 6, "", "octree: how often a coarse cube may be halved")                                       \
    X(REAL, purity, 0.95, 0.0, 1.0, "", "octree: a cube is split unless this part of its voxels is of one material")  \
    X(BOOL, keep_air, false, 0, 1, "", "keep tetrahedra that hold no tissue, as a filler that neither turns nor tears; without them the deformed volume has the scan's background there, not its air") \
    X(BOOL, bone_surface, false, 0, 1, "", "nodes beside what is fixed (bone, regions) are moved onto its surface ([H] 4.2)") \
    X(STRING, file, "", 0, 0, "", "tetrahedral mesh instead of the lattice, LPS axes: .vtu, or .msh of Gmsh 4.1. Materials follow from its regions by name or label, or else from the scan. Method fine, no cuts; empty: none") \
    X(REAL, unit, 1.0, 1e-6, 1.0, "m", "unit of lengths in mesh/file; 0.001 for millimetres")
#define PLIANT_SCENE_ELEMENT(X)                                                                                        \
    X(ELEMENT, kind, PLIANT_ELEMENT_AUTO, 0, 0, "", "hexahedra: cubes with one change of volume each; linear: the papers' tetrahedra, too stiff where tissue bends or is nearly incompressible; auto: hexahedra but for what is made of tetrahedra (cuts that subdivide, nodal pressure) and where tissue is touched (contact/self, obstacles, tools with a shape); the log says which")
#define PLIANT_SCENE_MODEL(X)                                                                                          \
    X(METHOD, method, PLIANT_FINE, 0, 0, "", "what is solved: the fine mesh, or a coarse one by one of these methods") \
    X(TOUCH, touch, PLIANT_TOUCH_OVERLAP, 0, 0, "", "schur: fine tetrahedra that overlap the coarse one, or share a face with it too") \
    X(REAL, patch, 0.0, 0.0, 1.0, "m", "coarse methods: fine nodes within this distance of what a tool holds or presses on are solved on their own, those around them by the fine mesh's response; 0: not") \
    X(INT, patch_delay, 0, 0, 100000, "steps", "a patch is put to use this long after a tool has taken hold or begun to press, ready or waited for; 0: from its operation count, at 2 Gflop/s") \
    X(INT, lod_layers, 1, 1, 3, "cubes", "lod: how far its shape functions reach beyond a coarse cube")                \
    X(REAL, lod_seconds, 300.0, 0.0, 1e6, "s", "lod: what preparing it may take, estimated beforehand; beyond it the model is refused") \
    X(REAL, lod_memory, 4096.0, 0.0, 1e6, "MiB", "lod: what it may hold, likewise")                                   \
    X(REAL3, gravity, 0.0, -1e4, 1e4, "m/s^2", "acceleration in scan axes (LPS)")
#define PLIANT_SCENE_SOLVER(X)                                                                                         \
    X(SOLVER, kind, PLIANT_COROTATIONAL, 0, 0, "", "corotational: quasi-static, linear in turned frames; tled: explicit dynamics, nonlinear, on the fine mesh") \
    X(BACKEND, backend, PLIANT_AUTO, 0, 0, "", "auto, cpu or cuda")                                                   \
    X(INT, threads, 0, 0, 1024, "", "0: as many as the machine has cores")                                            \
    X(REAL, step, 0.02, 1e-5, 1.0, "s", "time between two steps")                                                     \
    X(INT, iterations, 6, 1, 1000, "", "most iterations of a step")                                                   \
    X(REAL, tolerance, 1e-3, 1e-12, 1.0, "", "error of positions over the largest displacement, as a step estimates it, at which it ends") \
    X(REAL, budget_ms, 0.0, 0.0, 1e6, "ms", "time for the iterations of a step, which ends before the next would go beyond it (on a GPU only what contact adds keeps to it: a new inverse, solves again, parts); results then depend on the machine; 0: no limit") \
    X(INT, history, 6, 0, 20, "", "Anderson depth; more where a step makes more evaluations; 0: plain iterations")    \
    X(PRECONDITIONER, preconditioner, PLIANT_PRECONDITIONER_AUTO, 0, 0, "", "direct (a factor), multigrid (a V-cycle), or auto: by the number of nodes") \
    X(INT, refresh_interval, 5, 0, 100000, "steps", "a new factor is started at most this often; 0: never")           \
    X(INT, refresh_delay, 0, 0, 100000, "steps", "a new factor is put to use this long after its start, ready or waited for, so that results do not depend on timing; 0: from its operation count, at 5 Gflop/s")
#define PLIANT_SCENE_CHOOSE(X)                                                                                         \
    X(REAL, budget_ms, 0.0, 0.0, 1e6, "ms", "time of a step without the volume: at load, settings are tried on a pull, and the most accurate ones within it are taken; 0: the scene's own are") \
    X(REAL, max_error, 0.0, 0.0, 1.0, "", "warn when the error of what was taken is above this part of the largest displacement; 0: never") \
    X(MEASURE, measure, PLIANT_MEASURE_P95, 0, 0, "", "of the error over the body: largest, 95th percentile, root mean square; the largest is the tool's own more than a mesh's") \
    X(BOOL, method, true, 0, 1, "", "model/method, touch and patch may vary")                                                \
    X(BOOL, coarse_cells, true, 0, 1, "", "mesh/coarse_cells may vary")                                               \
    X(BOOL, ratio, true, 0, 1, "", "mesh/ratio may vary")                                                             \
    X(BOOL, iterations, true, 0, 1, "", "solver/iterations may vary")                                                 \
    X(REAL, seconds, 60.0, 0.0, 1e5, "s", "time for trying; what was not tried by then is left out")
#define PLIANT_SCENE_TLED(X)                                                                                           \
    X(LAW, law, PLIANT_LAW_NEO_HOOKEAN, 0, 0, "", "strain energy: neo_hookean as in [C] 10, compressible (isochoric and volumetric parts), saint_venant_kirchhoff") \
    X(REAL, damping, 5.0, 0.0, 1e6, "1/s", "damping in proportion to mass; 0: none")                                  \
    X(REAL, stiffness_damping, 0.0, 0.0, 10.0, "s", "damping in proportion to shear stiffness (Kelvin and Voigt): a swing of frequency f has the ratio pi f times this, whatever hangs on it; makes sub-steps shorter; 0: none") \
    X(REAL, safety, 0.9, 0.01, 10.0, "", "time step over the largest stable one at rest")                             \
    X(BOOL, nodal_pressure, false, 0, 1, "", "average nodal pressure, against locking of nearly incompressible tissue") \
    X(REAL3, prony_share, 0.0, 0.0, 1.0, "", "viscoelastic: parts of the shear modulus that relax; together less than 1") \
    X(REAL3, prony_time, 1.0, 1e-6, 1e6, "s", "and the times that they take")                                         \
    X(BOOL, quasi_static, false, 0, 1, "", "no inertia: dynamic relaxation to rest")                                  \
    X(INT, relaxation_steps, 300, 1, 1000000, "", "quasi_static: most of its steps in one step of the scene")
#define PLIANT_SCENE_GROUND(X)                                                                                         \
    X(REAL3, normal, 0.0, -1e6, 1e6, "", "tled, and what a cut takes off: the tissue stays on this side of a plane; 0 0 0: no plane") \
    X(REAL3, point, 0.0, -1e3, 1e3, "m", "of the plane, LPS")                                                         \
    X(REAL3, box_low, -1e3, -1e3, 1e3, "m", "tled, and what a cut takes off: the tissue stays in a box, LPS")                                   \
    X(REAL3, box_high, 1e3, -1e3, 1e3, "m", "its other corner")                                                       \
    X(REAL, friction, 0.3, 0.0, 100.0, "", "Coulomb's coefficient on plane and box")                                  \
    X(REAL, restitution, 0.0, 0.0, 1.0, "", "normal speed of a node after it hits them over that before")
#define PLIANT_SCENE_GRASP(X)                                                                                          \
    X(GRASP, kind, PLIANT_GRASP_AUTO, 0, 0, "", "what a robot's jaws do as they close: blob: the tissue around the tip is tied to the tool; contact: nothing is, friction holds what lies between the jaws of its shape (contact/friction); auto: contact where its shape has jaws, else blob") \
    X(REAL, stiffness, 1000.0, 1e-3, 1e12, "N/m", "spring between a grasping tool and the tissue")                    \
    X(REAL, damping, 0.0, 0.0, 1e9, "N s/m", "damper beside the spring")                                              \
    X(REAL, slip, 0.0, 0.0, 1e6, "N", "a grip by a spring that would take more than this slips, and is lost once it has slipped as far as the blob is wide; 0: it holds whatever comes") \
    X(LENGTH, radius, PLIANT_AUTO_LENGTH, 0.0, 1.0, "m", "the grasped blob; 0: a point; auto: 0.006 for bodies of 50 to 600 mm (cube root of the tissue's volume), in proportion to smaller and larger bodies")
#define PLIANT_SCENE_CONTACT(X)                                                                                        \
    X(REAL, friction, 0.08, 0.0, 100.0, "", "Coulomb's coefficient between tissue and instruments or obstacles, and between tissue and tissue; measured 0.03 to 0.08, peritoneum on smooth glass in saline (Loring et al., J. Biomech. 38:2390, 2005); toothed jaws hold more") \
    X(BOOL, self, false, 0, 1, "", "tissue touches tissue: what folds, pieces, the sides of a cut; with material/slides always") \
    X(REAL, coupling_stiffness, 1e6, 1.0, 1e12, "N/m", "spring of the virtual coupling (Colgate et al. 1995) that pulls a simulated tool, its proxy, towards the measured pose; tools with a shape alone") \
    X(REAL, coupling_stiffness_rotational, 1e3, 1e-3, 1e9, "N m/rad", "the same of rotations, and of the angle of jaws") \
    X(REAL, max_force, 20.0, 1e-3, 1e9, "N", "largest force of a coupling: at more the proxy stays behind the measured tool") \
    X(REAL, grip_torque, 0.1, 1e-6, 1e6, "N m", "largest torque about the joint that closes or opens jaws; 0.1: about 5 N at 20 mm") \
    X(REAL, max_proxy_error, 0.05, 1e-4, 10.0, "m", "distance between a proxy and its measured tool above which the proxy is placed there, if no tissue is in the way") \
    X(REAL, guard_depth, 2e-3, 1e-6, 0.01, "m", "how deep tissue may enter a part's surface before its core, which it never enters; at most 0.4 of the part's depth and 0.3 of the smallest cell") \
    X(STRING, obstacles, "", 0, 0, "", "YAML file of what stands still, relative to the scene file: parts as a tool's shape has them, solids from STL files among them, in LPS")       \
    X(RESPONSE, response, PLIANT_RESPONSE_PUSH, 0, 0, "", "of tissue that overlaps tissue: push: out, the shortest way; paper (tled): nodes of tetrahedra that overlap are slowed down ([C] 5.2), which does nothing at rest") \
    X(REAL, punishment, 0.5, 0.0, 1.0, "", "of paper, which names no size: the part of such a node's way in a sub-step that its force takes away") \
    X(BOOL, delay, true, 0, 1, "", "of paper: what overlapped as the step before ended is slowed down in all of this one ([C] algorithm 2); false: looked for in every sub-step")
#define PLIANT_SCENE_CUT(X)                                                                                            \
    X(CUT, kind, PLIANT_CUT_NONE, 0, 0, "", "sever: blades part the scan's voxels, and tetrahedra fall into fragments; subdivide: blades cut edges, and tetrahedra into smaller ones ([C] 5.2); none: nothing is cut, and nothing is kept for it") \
    X(REAL, snap, 0.1, 0.01, 0.45, "", "of subdivide: part of the shortest edge below which no edge is cut; the node that is so near is parted itself") \
    X(TRIGGER, trigger, PLIANT_TRIGGER_SERVICE, 0, 0, "", "when a robot's tool with a blade cuts: always, while its jaw is closed, while it has energy, or by service alone") \
    X(REAL, resistance, 1.0, 0.0, 1000.0, "", "factor on the materials' toughness: what the tissue takes to part; 0: it parts without a force") \
    X(LENGTH, drag, PLIANT_AUTO_LENGTH, 1e-6, 1.0, "m", "how far a blade drags the tissue along before it parts; a voxel at least; auto: 0.003, scaled as grasp/radius")                       \
    X(INT, undo, 8, 0, 1000, "strokes", "that can be undone; each keeps the meshes from before it")
#define PLIANT_SCENE_WARP(X)                                                                                           \
    X(WARP, kind, PLIANT_RASTERIZE, 0, 0, "", "rasterize: tetrahedra, exact on them; fit: a smooth map through the nodes ([C] 12)") \
    X(INT, fit_step, 4, 1, 64, "voxels", "fit: distance of the points that are fitted; linear in between")            \
    X(LENGTH, margin, PLIANT_AUTO_LENGTH, 0.0, 10.0, "m", "room that the deformed volume has around the tissue at rest; what is moved further is cut off; auto: 0.03, scaled as grasp/radius, or the largest margin with which the volume has at most 4 times the scan's voxels") \
    X(BOOL, hide_empty, false, 0, 1, "", "voxels of empty materials are drawn as the scan's background: an organ alone, without what its elements hold beside it") \
    X(REAL, rate, 10.0, 0.0, 1000.0, "Hz", "most deformed volumes a second")
#define PLIANT_SCENE_OUTPUT(X)                                                                                         \
    X(SCALAR, scalar, PLIANT_SCALAR_NONE, 0, 0, "", "number per node on mesh/state: none, von_mises [Pa], strain_energy [J/m^3], volume_ratio, principal_stress (largest) [Pa], mass_change (rest volume over volume ratio, [C] 13) [m^3], contact_force [N]") \
    X(REAL, mesh_rate, 30.0, 0.0, 1000.0, "Hz", "most mesh states a second")                                          \
    X(REAL, slice_rate, 15.0, 0.0, 1000.0, "Hz", "most slices a second")

/* G(group, list) */
#define PLIANT_SCENE_GROUPS(G)                                                                                         \
    G(scan, PLIANT_SCENE_SCAN) G(segment, PLIANT_SCENE_SEGMENT) G(material, PLIANT_SCENE_MATERIAL) G(mesh, PLIANT_SCENE_MESH)                           \
    G(element, PLIANT_SCENE_ELEMENT) G(model, PLIANT_SCENE_MODEL) G(solver, PLIANT_SCENE_SOLVER) G(choose, PLIANT_SCENE_CHOOSE)                         \
    G(tled, PLIANT_SCENE_TLED) G(ground, PLIANT_SCENE_GROUND) G(grasp, PLIANT_SCENE_GRASP) G(contact, PLIANT_SCENE_CONTACT) G(cut, PLIANT_SCENE_CUT) G(warp, PLIANT_SCENE_WARP)          \
    G(output, PLIANT_SCENE_OUTPUT)

enum { PLIANT_MAX_FIXED = 32 };
/** An axis-parallel box. [m], LPS. */
typedef struct pliant_fixed_box { double low[3], high[3]; } pliant_fixed_box;
/** What lies behind a plane: normal . (x - point) <= 0. [m], LPS. */
typedef struct pliant_fixed_plane { double point[3], normal[3]; } pliant_fixed_plane;

typedef struct pliant_regions {
    pliant_fixed_box boxes[PLIANT_MAX_FIXED];
    uint32_t num_boxes;
    pliant_fixed_plane planes[PLIANT_MAX_FIXED];
    uint32_t num_planes;
} pliant_regions;

typedef struct pliant_scene {
#define PLIANT_SCENE_FIELD(kind, name, value, low, high, unit, text) PLIANT_DECLARE_##kind(name)
#define PLIANT_SCENE_GROUP(group, list) struct { list(PLIANT_SCENE_FIELD) } group;
    PLIANT_SCENE_GROUPS(PLIANT_SCENE_GROUP)
#undef PLIANT_SCENE_FIELD
#undef PLIANT_SCENE_GROUP
    pliant_regions fixed;     /**< nodes in them do not move */
    pliant_regions obstacles; /**< tissue stays out of them, and slides along with contact/friction */
} pliant_scene;

/** Every option at its default. */
PLIANT_API void pliant_scene_defaults(pliant_scene *scene);

/** Read a YAML scene over the defaults. Unknown keys are errors. Relative paths in it are made relative to its
 *  folder. Errors name file, field and line: FILE, FORMAT, SCENE. *out untouched on error. */
PLIANT_API pliant_status pliant_scene_read(const char *path, pliant_scene *out);
/** The same from text; base is the folder for relative paths (Nullable: the working folder). */
PLIANT_API pliant_status pliant_scene_parse(const char *yaml, const char *name_for_messages, const char *base, pliant_scene *out);

/** Set one option by its path, as ROS parameters and command lines do: "solver/iterations", "4";
 *  three numbers as "7 7 7" or "[7, 7, 7]". Errors: SCENE (unknown option, not a value, out of range); the scene is
 *  then unchanged. */
PLIANT_API pliant_status pliant_scene_set(pliant_scene *scene, const char *option, const char *value);

/** Every option is in its range. Errors: SCENE, naming the option, its value and its range. */
PLIANT_API pliant_status pliant_scene_check(const pliant_scene *scene);

/** The scene will have tools with a shape (contact.h): auto elements become linear, since sheets one cube thick fold over what presses
 *  them. Organs that are thicker tell nearer forces as hexahedra by name. */
PLIANT_API void pliant_scene_for_shapes(pliant_scene *scene);

/** Every option, for tables and parameter loaders. Strings are static. */
typedef struct pliant_option_info {
    const char *group, *name;
    const char *kind; /**< bool, int, int3, real, real3, string or choice */
    const char *default_value, *range, *unit, *text;
    double low, high; /**< of int, int3, real and real3, inclusive */
} pliant_option_info;
PLIANT_API const pliant_option_info *pliant_scene_options(size_t *count);

#ifdef __cplusplus
}
#endif
#endif
