/** @file scene.h
 *  The scene: all options of a simulation. One list of options defines the struct, its defaults and check, the YAML
 *  schema, the ROS parameter names and the table in src/scene/README.md.
 */
#ifndef PLIANT_SCENE_H
#define PLIANT_SCENE_H

#include "pliant/material.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- OPTIONS */

/* X(name in C, name in YAML) */
#define PLIANT_METHOD_LIST(X)                                                                         \
    X(PLIANT_FINE, fine) X(PLIANT_COARSE, coarse) X(PLIANT_SCHUR, schur) X(PLIANT_AVERAGED, averaged) \
    X(PLIANT_LOD, lod)
#define PLIANT_SUBMESH_EXTENT_LIST(X) X(PLIANT_SUBMESH_OVERLAP, overlap) X(PLIANT_SUBMESH_FACE, face)
#define PLIANT_BACKEND_LIST(X) X(PLIANT_AUTO, auto) X(PLIANT_CPU, cpu) X(PLIANT_CUDA, cuda)
#define PLIANT_PRECONDITIONER_LIST(X)                                                             \
    X(PLIANT_PRECONDITIONER_AUTO, auto) X(PLIANT_DIRECT, direct) X(PLIANT_MULTIGRID, multigrid)
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
#define PLIANT_ELASTICITY_LIST(X)                                                                 \
    X(PLIANT_ELASTICITY_COROTATIONAL, corotational) X(PLIANT_ELASTICITY_NEO_HOOKEAN, neo_hookean)
#define PLIANT_WARP_LIST(X) X(PLIANT_RASTERIZE, rasterize) X(PLIANT_FIT, fit)
#define PLIANT_SEGMENT_LIST(X) X(PLIANT_SEGMENT_NONE, none) X(PLIANT_SEGMENT_GMM, gmm)
#define PLIANT_CUT_LIST(X) X(PLIANT_CUT_NONE, none) X(PLIANT_CUT_SEVER, sever) X(PLIANT_CUT_SUBDIVIDE, subdivide)
#define PLIANT_TRIGGER_LIST(X)                                                                    \
    X(PLIANT_TRIGGER_ALWAYS, always) X(PLIANT_TRIGGER_JAW, jaw) X(PLIANT_TRIGGER_ENERGY, energy)  \
    X(PLIANT_TRIGGER_SERVICE, service)
#define PLIANT_GRASP_LIST(X) X(PLIANT_GRASP_AUTO, auto) X(PLIANT_GRASP_BLOB, blob) X(PLIANT_GRASP_CONTACT, contact)
#define PLIANT_RESPONSE_LIST(X) X(PLIANT_RESPONSE_PUSH, push) X(PLIANT_RESPONSE_PAPER, paper)
#define PLIANT_MEASURE_LIST(X) X(PLIANT_MEASURE_MAX, max) X(PLIANT_MEASURE_P95, p95) X(PLIANT_MEASURE_RMS, rms)

/** Value of a length option that follows from the size of the body. The scene of a model (pliant_model_get_scene) has
 *  the number. */
#define PLIANT_AUTO_LENGTH (-1.0)

#define PLIANT_CHOICE_ENUM(name, yaml) name,
/** Solved mesh and homogenization (model/method). */
typedef enum pliant_method { PLIANT_METHOD_LIST(PLIANT_CHOICE_ENUM) } pliant_method;
/** Submesh of model/method schur. */
typedef enum pliant_submesh_extent { PLIANT_SUBMESH_EXTENT_LIST(PLIANT_CHOICE_ENUM) } pliant_submesh_extent;
/** Processor that computes. */
typedef enum pliant_backend_choice { PLIANT_BACKEND_LIST(PLIANT_CHOICE_ENUM) } pliant_backend_choice;
/** Preconditioner of the quasi-static solver. */
typedef enum pliant_preconditioner_choice {
    PLIANT_PRECONDITIONER_LIST(PLIANT_CHOICE_ENUM)
} pliant_preconditioner_choice;
/** Scalar per node (output/scalar). */
typedef enum pliant_scalar { PLIANT_SCALAR_LIST(PLIANT_CHOICE_ENUM) } pliant_scalar;
/** Kind of solver. */
typedef enum pliant_solver_kind { PLIANT_SOLVER_LIST(PLIANT_CHOICE_ENUM) } pliant_solver_kind;
/** Strain energy of explicit dynamics. */
typedef enum pliant_law { PLIANT_LAW_LIST(PLIANT_CHOICE_ENUM) } pliant_law;
/** Kind of mesh. */
typedef enum pliant_mesh_kind { PLIANT_MESH_LIST(PLIANT_CHOICE_ENUM) } pliant_mesh_kind;
/** Kind of finite elements. */
typedef enum pliant_element_kind { PLIANT_ELEMENT_LIST(PLIANT_CHOICE_ENUM) } pliant_element_kind;
/** Law of the quasi-static solver's elements (element/law). */
typedef enum pliant_elasticity { PLIANT_ELASTICITY_LIST(PLIANT_CHOICE_ENUM) } pliant_elasticity;
/** How the deformed volume is made. */
typedef enum pliant_warp_kind { PLIANT_WARP_LIST(PLIANT_CHOICE_ENUM) } pliant_warp_kind;
/** Segmentation at load. */
typedef enum pliant_segment_kind { PLIANT_SEGMENT_LIST(PLIANT_CHOICE_ENUM) } pliant_segment_kind;
/** How blades cut. */
typedef enum pliant_cut_kind { PLIANT_CUT_LIST(PLIANT_CHOICE_ENUM) } pliant_cut_kind;
/** When a robot's blade cuts. */
typedef enum pliant_trigger { PLIANT_TRIGGER_LIST(PLIANT_CHOICE_ENUM) } pliant_trigger;
/** Norm of an error over the body. */
typedef enum pliant_measure { PLIANT_MEASURE_LIST(PLIANT_CHOICE_ENUM) } pliant_measure;
/** Effect of closing jaws. */
typedef enum pliant_grasp_kind { PLIANT_GRASP_LIST(PLIANT_CHOICE_ENUM) } pliant_grasp_kind;
/** Response to tissue that overlaps tissue. */
typedef enum pliant_response { PLIANT_RESPONSE_LIST(PLIANT_CHOICE_ENUM) } pliant_response;
#undef PLIANT_CHOICE_ENUM

/* C types of the kinds of options. INT3 and REAL3 have one default and one range for all three numbers. */
#define PLIANT_DECLARE_INT(name) int32_t name;
#define PLIANT_DECLARE_REAL(name) double name;
#define PLIANT_DECLARE_LENGTH(name) double name;
#define PLIANT_DECLARE_BOOL(name) bool name;
#define PLIANT_DECLARE_INT3(name) int32_t name[3];
#define PLIANT_DECLARE_REAL3(name) double name[3];
#define PLIANT_DECLARE_STRING(name) char name[256];
#define PLIANT_DECLARE_METHOD(name) pliant_method name;
#define PLIANT_DECLARE_SUBMESH(name) pliant_submesh_extent name;
#define PLIANT_DECLARE_BACKEND(name) pliant_backend_choice name;
#define PLIANT_DECLARE_PRECONDITIONER(name) pliant_preconditioner_choice name;
#define PLIANT_DECLARE_SCALAR(name) pliant_scalar name;
#define PLIANT_DECLARE_SOLVER(name) pliant_solver_kind name;
#define PLIANT_DECLARE_MESH(name) pliant_mesh_kind name;
#define PLIANT_DECLARE_ELEMENT(name) pliant_element_kind name;
#define PLIANT_DECLARE_ELASTICITY(name) pliant_elasticity name;
#define PLIANT_DECLARE_WARP(name) pliant_warp_kind name;
#define PLIANT_DECLARE_SEGMENT(name) pliant_segment_kind name;
#define PLIANT_DECLARE_CUT(name) pliant_cut_kind name;
#define PLIANT_DECLARE_TRIGGER(name) pliant_trigger name;
#define PLIANT_DECLARE_MEASURE(name) pliant_measure name;
#define PLIANT_DECLARE_GRASP(name) pliant_grasp_kind name;
#define PLIANT_DECLARE_RESPONSE(name) pliant_response name;
#define PLIANT_DECLARE_LAW(name) pliant_law name;

/* X(kind, name, default, low, high, unit, text) for every group. Strings have no range. */
#define PLIANT_SCENE_SCAN(X)                                                                \
    X(STRING, series, "", 0, 0, "",                                                         \
      "DICOM SeriesInstanceUID, or its unique ending, if a folder contains several series") \
    X(INT3, resample, 0, 0, 4096, "voxels",                                                 \
      "number of voxels after resampling the scan; 0 keeps an axis")
#define PLIANT_SCENE_SEGMENT(X)                                                                                  \
    X(SEGMENT, kind, PLIANT_SEGMENT_NONE, 0, 0, "",                                                              \
      "gmm: labels from a Gaussian mixture of intensities ([C] 4.1) instead of a label map; pliant_segment "     \
      "shows them")                                                                                              \
    X(INT, classes, 0, 0, 16, "",                                                                                \
      "number of classes of the mixture; 0: selected by BIC")                                                    \
    X(INT, max_classes, 12, 1, 16, "",                                                                           \
      "maximum number of classes that BIC may select")                                                           \
    X(REAL, coherence, 1.0, 0.0, 100.0, "",                                                                      \
      "Markov random field weight per neighbour of the same class; 0: voxels are independent")                   \
    X(LENGTH, min_volume, PLIANT_AUTO_LENGTH, 0.0, 1.0, "m^3",                                                   \
      "volume below which a piece is merged into its neighbours; auto: 1e-6, or 0.0005 of the scan's volume if " \
      "that is less")
#define PLIANT_SCENE_MATERIAL(X)                                                                             \
    X(STRING, file, "", 0, 0, "",                                                                            \
      "material table (YAML), relative to the scene file; empty: the built-in table")                        \
    X(STRING, labels, "", 0, 0, "",                                                                          \
      "label map, or segmentation whose segments name materials; empty: materials from intensities only")    \
    X(BOOL, deformable_bone, false, 0, 1, "",                                                                \
      "bone deforms instead of being fixed")                                                                 \
    X(STRING, slides, "", 0, 0, "",                                                                          \
      "names of materials, separated by commas, that slide along all others: they are cut free at load and " \
      "collide; needs cut/kind: sever")
#define PLIANT_SCENE_MESH(X)                                                                                     \
    X(MESH, kind, PLIANT_LATTICE, 0, 0, "",                                                                      \
      "lattice: cubes of equal size; octree: smaller cubes where materials meet ([C] 4.2), method fine")         \
    X(INT3, coarse_cells, 7, 1, 256, "cells",                                                                    \
      "number of coarse cubes along i, j, k")                                                                    \
    X(INT, ratio, 2, 1, 8, "",                                                                                   \
      "number of fine cubes along each edge of a coarse cube")                                                   \
    X(INT, depth, 2, 0, 6, "",                                                                                   \
      "octree: maximum number of times that a coarse cube is halved")                                            \
    X(REAL, purity, 0.95, 0.0, 1.0, "",                                                                          \
      "octree: a cube is split if less than this fraction of its voxels has the same material")                  \
    X(BOOL, keep_air, false, 0, 1, "",                                                                           \
      "keep tetrahedra without tissue as a filler that neither rotates nor tears; without them, the deformed "   \
      "volume there is the scan's background instead of its air")                                                \
    X(BOOL, bone_surface, false, 0, 1, "",                                                                       \
      "move nodes near fixed tissue (bone, regions) onto its surface ([H] 4.2)")                                 \
    X(STRING, file, "", 0, 0, "",                                                                                \
      "tetrahedral mesh instead of the lattice, LPS axes: .vtu, or .msh of Gmsh 4.1. Materials follow from its " \
      "regions by name or label, or else from the scan. Method fine, no cuts; empty: none")                      \
    X(REAL, unit, 1.0, 1e-6, 1.0, "m",                                                                           \
      "unit of lengths in mesh/file; 0.001 for millimetres")
#define PLIANT_SCENE_ELEMENT(X)                                                                                      \
    X(ELEMENT, kind, PLIANT_ELEMENT_AUTO, 0, 0, "",                                                                  \
      "hexahedra: cubes with one change of volume each; linear: the papers' tetrahedra, too stiff in bending "       \
      "and near incompressibility; auto: hexahedra, except for methods on tetrahedra (cut/kind: subdivide, "         \
      "nodal pressure) and for contact (contact/self, obstacles, tools with a shape); the log names the choice")     \
    X(ELASTICITY, law, PLIANT_ELASTICITY_COROTATIONAL, 0, 0, "",                                                     \
      "solver/kind: corotational: elastic law; corotational: for moderate strains; neo_hookean: for large strains, " \
      "on the fine mesh")
#define PLIANT_SCENE_MODEL(X)                                                                                     \
    X(METHOD, method, PLIANT_FINE, 0, 0, "",                                                                      \
      "fine: solve the fine mesh; all others: solve a coarse mesh, homogenized by this method")                   \
    X(SUBMESH, submesh, PLIANT_SUBMESH_OVERLAP, 0, 0, "",                                                         \
      "schur: submesh of fine tetrahedra that overlap the coarse one; face: also those that share a face with "   \
      "it")                                                                                                       \
    X(REAL, patch, 0.0, 0.0, 1.0, "m",                                                                            \
      "coarse methods: distance from a grasp or contact within which fine nodes are solved too; 0: no patches")   \
    X(INT, patch_delay, 0, 0, 100000, "steps",                                                                    \
      "number of steps from a grasp or contact to the use of its patch, which a step waits for if necessary; 0: " \
      "from its operation count, at 2 Gflop/s")                                                                   \
    X(INT, lod_layers, 1, 1, 3, "cubes",                                                                          \
      "lod: reach of the shape functions beyond a coarse cube")                                                   \
    X(REAL3, gravity, 0.0, -1e4, 1e4, "m/s^2",                                                                    \
      "gravity as an acceleration in scan axes (LPS)")
#define PLIANT_SCENE_SOLVER(X)                                                                                   \
    X(SOLVER, kind, PLIANT_COROTATIONAL, 0, 0, "",                                                               \
      "corotational: quasi-static, linear elasticity in rotated frames; tled: explicit dynamics, nonlinear, on " \
      "the fine mesh")                                                                                           \
    X(BACKEND, backend, PLIANT_AUTO, 0, 0, "",                                                                   \
      "auto: a GPU if there is one; cpu; cuda: a GPU, or an error")                                              \
    X(INT, threads, 0, 0, 1024, "",                                                                              \
      "number of threads; 0: the number of cores")                                                               \
    X(REAL, step, 0.02, 1e-5, 1.0, "s",                                                                          \
      "time between two steps")                                                                                  \
    X(INT, iterations, 6, 1, 1000, "",                                                                           \
      "maximum number of iterations per step")                                                                   \
    X(REAL, tolerance, 1e-3, 1e-12, 1.0, "",                                                                     \
      "a step stops when the estimated position error divided by the largest displacement is below this value")  \
    X(REAL, budget_ms, 0.0, 0.0, 1e6, "ms",                                                                      \
      "time limit for contact and iterations of a step: no iteration starts that would exceed it (on a GPU it "  \
      "limits only the work for contact); results then depend on the machine; 0: no limit")                      \
    X(INT, history, 6, 0, 20, "",                                                                                \
      "depth of Anderson acceleration; use more for steps with more iterations; 0: fixed-point iterations")      \
    X(PRECONDITIONER, preconditioner, PLIANT_PRECONDITIONER_AUTO, 0, 0, "",                                      \
      "direct: Cholesky factor; multigrid: V-cycle; auto: selected by the number of nodes")                      \
    X(INT, refresh_interval, 5, 0, 100000, "steps",                                                              \
      "minimum number of steps between the starts of two factorizations; 0: no refresh")                         \
    X(INT, refresh_delay, 0, 0, 100000, "steps",                                                                 \
      "number of steps from the start of a factorization to its use, which a step waits for if necessary, so "   \
      "that results do not depend on timing; 0: from its operation count, at 5 Gflop/s")
#define PLIANT_SCENE_CHOOSE(X)                                                                                   \
    X(REAL, budget_ms, 0.0, 0.0, 1e6, "ms",                                                                      \
      "time of a step without the volume: at load, candidates are measured on a pull, and the most accurate "    \
      "settings within this time are used; 0: use the scene's settings")                                         \
    X(REAL, max_error, 0.0, 0.0, 1.0, "",                                                                        \
      "warn if the error of the selected settings, as a fraction of the largest displacement, is above this "    \
      "value; 0: no warning")                                                                                    \
    X(MEASURE, measure, PLIANT_MEASURE_P95, 0, 0, "",                                                            \
      "error over the body: maximum, 95th percentile or root mean square; the maximum depends on the tool more " \
      "than on the mesh")                                                                                        \
    X(BOOL, method, true, 0, 1, "",                                                                              \
      "model/method, model/submesh and model/patch may vary")                                                    \
    X(BOOL, coarse_cells, true, 0, 1, "",                                                                        \
      "mesh/coarse_cells may vary")                                                                              \
    X(BOOL, ratio, true, 0, 1, "",                                                                               \
      "mesh/ratio may vary")                                                                                     \
    X(BOOL, iterations, true, 0, 1, "",                                                                          \
      "solver/iterations may vary")                                                                              \
    X(REAL, seconds, 60.0, 0.0, 1e5, "s",                                                                        \
      "time limit for measuring candidates; the rest are skipped")
#define PLIANT_SCENE_TLED(X)                                                                                    \
    X(LAW, law, PLIANT_LAW_NEO_HOOKEAN, 0, 0, "",                                                               \
      "strain energy: neo_hookean ([C] 10), compressible (isochoric and volumetric parts), "                    \
      "saint_venant_kirchhoff")                                                                                 \
    X(REAL, damping, 5.0, 0.0, 1e6, "1/s",                                                                      \
      "mass-proportional damping; 0: none")                                                                     \
    X(REAL, stiffness_damping, 0.0, 0.0, 10.0, "s",                                                             \
      "damping proportional to shear stiffness (Kelvin-Voigt): the damping ratio at frequency f is pi f times " \
      "this value; shortens sub-steps; 0: none")                                                                \
    X(REAL, safety, 0.9, 0.01, 10.0, "",                                                                        \
      "sub-step divided by the largest stable sub-step at rest")                                                \
    X(BOOL, nodal_pressure, false, 0, 1, "",                                                                    \
      "average nodal pressure, against locking of nearly incompressible tissue")                                \
    X(REAL3, prony_share, 0.0, 0.0, 1.0, "",                                                                    \
      "Prony series: fractions of the shear modulus that relax; their sum is below 1")                          \
    X(REAL3, prony_time, 1.0, 1e-6, 1e6, "s",                                                                   \
      "Prony series: relaxation times")                                                                         \
    X(REAL, loss_factor, 0.0, 0.0, 0.5, "",                                                                     \
      "loss factor of the shear modulus, twice the damping ratio, from a Prony series fitted to it between "    \
      "loss_low and loss_high; the material's modulus is the static one; 0: none")                              \
    X(REAL, loss_low, 2.0, 1e-3, 1e4, "Hz",                                                                     \
      "lowest frequency of loss_factor")                                                                        \
    X(REAL, loss_high, 20.0, 1e-3, 1e4, "Hz",                                                                   \
      "highest frequency of loss_factor, at most 100 times loss_low")                                           \
    X(BOOL, quasi_static, false, 0, 1, "",                                                                      \
      "no inertia: dynamic relaxation to the state at rest")                                                    \
    X(INT, relaxation_steps, 300, 1, 1000000, "",                                                               \
      "quasi_static: maximum number of relaxation steps per step of the scene")
#define PLIANT_SCENE_GROUND(X)                                                                               \
    X(REAL3, normal, 0.0, -1e6, 1e6, "",                                                                     \
      "tled, and detached pieces: outward normal of a plane that tissue does not cross; 0 0 0: no plane")    \
    X(REAL3, point, 0.0, -1e3, 1e3, "m",                                                                     \
      "point of the plane, LPS")                                                                             \
    X(REAL3, box_low, -1e3, -1e3, 1e3, "m",                                                                  \
      "tled, and detached pieces: low corner of a box that tissue does not leave, LPS")                      \
    X(REAL3, box_high, 1e3, -1e3, 1e3, "m",                                                                  \
      "high corner of the box, LPS")                                                                         \
    X(REAL, friction, 0.3, 0.0, 100.0, "",                                                                   \
      "coefficient of friction (Coulomb) on plane and box")                                                  \
    X(REAL, restitution, 0.0, 0.0, 1.0, "",                                                                  \
      "coefficient of restitution: normal speed of a node after a collision divided by the speed before it")
#define PLIANT_SCENE_GRASP(X)                                                                                  \
    X(GRASP, kind, PLIANT_GRASP_AUTO, 0, 0, "",                                                                \
      "effect of closing jaws: blob: the tissue around the tip is constrained to the tool; contact: friction " \
      "holds the tissue between the jaws (contact/friction); auto: contact for a shape with jaws, else blob")  \
    X(REAL, stiffness, 1000.0, 1e-3, 1e12, "N/m",                                                              \
      "stiffness of the spring between a tool and its grasped tissue")                                         \
    X(REAL, damping, 0.0, 0.0, 1e9, "N s/m",                                                                   \
      "damping of this spring")                                                                                \
    X(REAL, slip, 0.0, 0.0, 1e6, "N",                                                                          \
      "maximum force of this spring: above it the grasp slips, and it is lost after slipping by the width of " \
      "the blob; 0: no maximum")                                                                               \
    X(LENGTH, radius, PLIANT_AUTO_LENGTH, 0.0, 1.0, "m",                                                       \
      "radius of the grasped blob; 0: a point; auto: 0.006 for bodies of 50 to 600 mm (cube root of the "      \
      "tissue's volume), in proportion for smaller and larger bodies")
#define PLIANT_SCENE_CONTACT(X)                                                                                   \
    X(REAL, friction, 0.08, 0.0, 100.0, "",                                                                       \
      "coefficient of friction (Coulomb) of tissue on instruments, obstacles and tissue; measured 0.03 to 0.08, " \
      "peritoneum on smooth glass in saline (Loring et al., J. Biomech. 38:2390, 2005); toothed jaws have more")  \
    X(BOOL, self, false, 0, 1, "",                                                                                \
      "tissue collides with tissue: folds, pieces, the sides of a cut; always with material/slides")              \
    X(REAL, coupling_stiffness, 1e6, 1.0, 1e12, "N/m",                                                            \
      "stiffness of the virtual coupling (Colgate et al. 1995) from a measured tool with a shape to its proxy, "  \
      "the simulated tool")                                                                                       \
    X(REAL, coupling_stiffness_rotational, 1e3, 1e-3, 1e9, "N m/rad",                                             \
      "stiffness of the virtual coupling for rotations and for the angle of the jaws")                            \
    X(REAL, max_force, 20.0, 1e-3, 1e9, "N",                                                                      \
      "maximum force of a coupling; above it, the proxy stays behind the measured tool")                          \
    X(REAL, grip_torque, 0.1, 1e-6, 1e6, "N m",                                                                   \
      "maximum torque about the joint that opens or closes the jaws; 0.1: about 5 N at 20 mm")                    \
    X(REAL, max_proxy_error, 0.05, 1e-4, 10.0, "m",                                                               \
      "distance between a proxy and its measured tool above which the proxy jumps to the tool, unless the tool "  \
      "is in tissue")                                                                                             \
    X(REAL, guard_depth, 2e-3, 1e-6, 0.01, "m",                                                                   \
      "maximum penetration depth into a part's surface; its core below that is never penetrated; at most 0.4 of " \
      "the part's depth and 0.3 of the smallest cell")                                                            \
    X(STRING, obstacles, "", 0, 0, "",                                                                            \
      "YAML file of fixed obstacles, relative to the scene file: parts as of a tool's shape, also solids from "   \
      "STL files, in LPS")                                                                                        \
    X(RESPONSE, response, PLIANT_RESPONSE_PUSH, 0, 0, "",                                                         \
      "response to tissue that overlaps tissue: push: out along the shortest way; paper (tled): nodes of "        \
      "overlapping tetrahedra are slowed down ([C] 5.2), without effect at rest")                                 \
    X(REAL, overlap_damping, 0.5, 0.0, 1.0, "",                                                                   \
      "paper: fraction of a node's motion in a sub-step that its force removes")                                  \
    X(BOOL, delay, true, 0, 1, "",                                                                                \
      "paper: nodes that overlap at the end of the previous step are slowed down during the whole step ([C] "     \
      "algorithm 2); false: overlaps are found in every sub-step")
#define PLIANT_SCENE_CUT(X)                                                                                    \
    X(CUT, kind, PLIANT_CUT_NONE, 0, 0, "",                                                                    \
      "sever: blades cut links between the scan's voxels, and tetrahedra become fragments; subdivide: blades " \
      "cut edges, and tetrahedra are divided ([C] 5.2); none: no cuts")                                        \
    X(TRIGGER, trigger, PLIANT_TRIGGER_SERVICE, 0, 0, "",                                                      \
      "when a robot's tool with a blade cuts: always, while its jaws are closed, while it has energy, or by "  \
      "service only")                                                                                          \
    X(REAL, resistance, 1.0, 0.0, 1000.0, "",                                                                  \
      "factor on the fracture toughness of materials; 0: cutting needs no force")                              \
    X(LENGTH, drag, PLIANT_AUTO_LENGTH, 1e-6, 1.0, "m",                                                        \
      "displacement of tissue by a blade before it is cut, at least a voxel; auto: 0.003, scaled as "          \
      "grasp/radius")                                                                                          \
    X(INT, undo, 8, 0, 1000, "strokes",                                                                        \
      "maximum number of strokes that can be undone; each stores the previous topology")
#define PLIANT_SCENE_WARP(X)                                                                                      \
    X(WARP, kind, PLIANT_RASTERIZE, 0, 0, "",                                                                     \
      "rasterize: tetrahedra, exact inside them; fit: a smooth map through the nodes ([C] 12)")                   \
    X(LENGTH, margin, PLIANT_AUTO_LENGTH, 0.0, 10.0, "m",                                                         \
      "margin of the deformed volume around the tissue at rest; tissue beyond it is cut off; auto: 0.03, scaled " \
      "as grasp/radius, limited so that the volume has at most 4 times the scan's voxels")                        \
    X(BOOL, hide_empty, false, 0, 1, "",                                                                          \
      "draw voxels of empty materials as the scan's background: an organ without the air in its elements")        \
    X(REAL, rate, 10.0, 0.0, 1000.0, "Hz",                                                                        \
      "maximum rate of deformed volumes")
#define PLIANT_SCENE_OUTPUT(X)                                                                             \
    X(SCALAR, scalar, PLIANT_SCALAR_NONE, 0, 0, "",                                                        \
      "scalar per node on mesh/state: none, von_mises [Pa], strain_energy [J/m^3], volume_ratio, "         \
      "principal_stress (largest) [Pa], mass_change (rest volume divided by volume ratio, [C] 13) [m^3], " \
      "contact_force [N]")                                                                                 \
    X(REAL, mesh_rate, 30.0, 0.0, 1000.0, "Hz",                                                            \
      "maximum rate of mesh states")                                                                       \
    X(REAL, slice_rate, 15.0, 0.0, 1000.0, "Hz",                                                           \
      "maximum rate of slices")

/* G(group, list) */
#define PLIANT_SCENE_GROUPS(G)                                                                     \
    G(scan, PLIANT_SCENE_SCAN) G(segment, PLIANT_SCENE_SEGMENT) G(material, PLIANT_SCENE_MATERIAL) \
    G(mesh, PLIANT_SCENE_MESH) G(element, PLIANT_SCENE_ELEMENT) G(model, PLIANT_SCENE_MODEL)       \
    G(solver, PLIANT_SCENE_SOLVER) G(choose, PLIANT_SCENE_CHOOSE) G(tled, PLIANT_SCENE_TLED)       \
    G(ground, PLIANT_SCENE_GROUND) G(grasp, PLIANT_SCENE_GRASP) G(contact, PLIANT_SCENE_CONTACT)   \
    G(cut, PLIANT_SCENE_CUT) G(warp, PLIANT_SCENE_WARP) G(output, PLIANT_SCENE_OUTPUT)

/* ---- TYPES */

enum { PLIANT_MAX_FIXED = 32 /**< maximum number of boxes, and of planes, of a region */ };
/** An axis-parallel box, LPS [m]. */
typedef struct pliant_fixed_box { double low[3], high[3]; } pliant_fixed_box;
/** The half-space normal . (x - point) <= 0, LPS [m]. */
typedef struct pliant_fixed_plane { double point[3], normal[3]; } pliant_fixed_plane;

/** A union of boxes and half-spaces. */
typedef struct pliant_regions {
    pliant_fixed_box boxes[PLIANT_MAX_FIXED]; /**< (num_boxes) */
    uint32_t num_boxes;
    pliant_fixed_plane planes[PLIANT_MAX_FIXED]; /**< (num_planes) */
    uint32_t num_planes;
} pliant_regions;

/** A scene. Its fields are the options: scene.solver.iterations is solver/iterations. */
typedef struct pliant_scene {
#define PLIANT_SCENE_FIELD(kind, name, value, low, high, unit, text) PLIANT_DECLARE_##kind(name)
#define PLIANT_SCENE_GROUP(group, list) struct { list(PLIANT_SCENE_FIELD) } group;
    PLIANT_SCENE_GROUPS(PLIANT_SCENE_GROUP)
#undef PLIANT_SCENE_FIELD
#undef PLIANT_SCENE_GROUP
    pliant_regions fixed;     /**< nodes in these regions do not move */
    pliant_regions obstacles; /**< tissue stays out of these regions and slides along them with contact/friction */
} pliant_scene;

/** An option, for tables and parameter loaders. Texts are static. */
typedef struct pliant_option_info {
    const char *group, *name;
    const char *kind; /**< bool, int, int3, real, real3, length, string or choice */
    const char *default_value, *range, *unit, *text;
    double low, high; /**< inclusive range of int, int3, real, real3 and length */
} pliant_option_info;

/* ---- FUNCTIONS */

/** Set every option to its default.
 *  @param scene Out: the scene. */
PLIANT_API void pliant_scene_defaults(pliant_scene *scene);

/** Read a scene from a YAML file over the defaults. Unknown keys are errors. Relative paths become relative to the
 *  file's folder.
 *  @param path The file.
 *  @param out  Out: unchanged after an error.
 *  @return Errors: FILE, FORMAT, SCENE, MEMORY. The message names file, field and line. */
PLIANT_API pliant_status pliant_scene_read(const char *path, pliant_scene *out);

/** Read a scene from text, as pliant_scene_read does from a file.
 *  @param yaml              Text that ends with 0.
 *  @param name_for_messages Name of the text in error messages.
 *  @param base              Nullable: the working folder. Folder of relative paths.
 *  @param out               Out: unchanged after an error.
 *  @return Errors: FORMAT, SCENE, MEMORY. */
PLIANT_API pliant_status pliant_scene_parse(const char *yaml, const char *name_for_messages, const char *base,
                                            pliant_scene *out);

/** Set an option by its path, as ROS parameters and command lines do.
 *  @param scene  Unchanged after an error.
 *  @param option Path of the option, such as "solver/iterations".
 *  @param value  Text of the value; three numbers as "7 7 7" or "[7, 7, 7]".
 *  @return Errors: SCENE (unknown option, not a value, out of range). */
PLIANT_API pliant_status pliant_scene_set(pliant_scene *scene, const char *option, const char *value);

/** Check that every option is in its range.
 *  @param scene The scene.
 *  @return Errors: SCENE. The message names the option, its value and its range. */
PLIANT_API pliant_status pliant_scene_check(const pliant_scene *scene);

/** Prepare a scene for tools with a shape (contact.h): element/kind auto becomes linear, because sheets with one layer
 *  of hexahedra fold over small tools. For thick organs, set element/kind to hexahedra, which gives more accurate
 *  forces.
 *  @param scene In/out: the scene. */
PLIANT_API void pliant_scene_for_shapes(pliant_scene *scene);

/** Return all options.
 *  @param count Out: number of options.
 *  @return (count) static. */
PLIANT_API const pliant_option_info *pliant_scene_options(size_t *count);

#ifdef __cplusplus
}
#endif
#endif
