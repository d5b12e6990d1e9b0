/** @file data.h
 *  A simulation: the step, its tools, its cuts and its results.
 *
 *  A simulation belongs to one thread at a time. Several simulations may share a model. Pointers that
 *  pliant_data_get_* return are valid until the next step, cut, reset or restore, even if it fails.
 */
#ifndef PLIANT_DATA_H
#define PLIANT_DATA_H

#include "pliant/cut.h"
#include "pliant/model.h"
#include "pliant/warp.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- TYPES */

/** X(name) for the stages of a step, in order. */
#define PLIANT_STEP_STAGE_LIST(X) X(cut) X(interact) X(contact) X(solve) X(upsample) X(patch) X(warp)
/** Stage of a step. */
typedef enum pliant_step_stage {
#define PLIANT_STAGE_ENUM(name) PLIANT_STEP_##name,
    PLIANT_STEP_STAGE_LIST(PLIANT_STAGE_ENUM)
#undef PLIANT_STAGE_ENUM
    PLIANT_NUM_STEP_STAGES
} pliant_step_stage;

enum { PLIANT_MAX_TOOLS = 8 /**< maximum number of tools of a simulation */ };

/** Constraint between a tool and the tissue that it grasps. */
typedef enum pliant_drive {
    PLIANT_DRIVE_SPRING, /**< a damped spring from the tool's tip to the grasped point (grasp/stiffness,
                          *   grasp/damping) */
    PLIANT_DRIVE_RIGID,  /**< the grasped point is at the tip: displacement control */
    PLIANT_DRIVE_FORCE,  /**< a given force, independent of the tip: force control */
    PLIANT_NUM_DRIVES
} pliant_drive;

/** State of a tool after the last step. */
typedef struct pliant_tool_state {
    char name[48];
    bool present;          /**< the tool has a pose */
    double tip[3];         /**< measured tip, LPS [m] */
    double rotation[4];    /**< measured rotation, quaternion x y z w */
    pliant_drive drive;
    double driving_force[3]; /**< PLIANT_DRIVE_FORCE: force on the tissue [N] */
    double stiffness;      /**< of the grasp's spring [N/m] */
    double damping;        /**< of the grasp's damper [N s/m] */
    double radius;         /**< of the grasped blob [m] */
    bool holding;          /**< the tool grasps tissue */
    uint64_t hold;         /**< number of grasps so far */
    int32_t num_held;      /**< number of fine nodes that share the grasp's force */
    double held_point[3];  /**< grasped point after the last step, LPS [m] */
    double force[3];       /**< force of the grasp or of the blade on the tissue, last step [N] */
    double contact_force[3];  /**< contact force of the tool's shape on the tissue, last step [N] */
    double contact_torque[3]; /**< torque of the contact force about the tip [N m] */
    double contact_force_error; /**< estimated error of the contact force, as a standard deviation [N]: by the size of
                               *   the cells and by the solver (src/contact/NUMERICS.md) */
    bool cutting;          /**< the blade is on */
    bool engaged;          /**< the blade is on and touches tissue */
    double engaged_length; /**< length of the edge in tissue [m] */
    double severed_area;   /**< area that this tool has severed since load, at rest [m^2] */
    uint64_t stroke;       /**< number of strokes so far */
    int32_t pieces;        /**< number of pieces of tissue after the tool's last cut; 0 before its first cut */
    double jaw;            /**< measured angle of the jaws [rad] */
    bool has_proxy;        /**< the tool has a shape and a pose, so that it has a proxy (simulated tool). The next
                            *   fields describe the proxy */
    double proxy_tip[3];   /**< LPS [m]; without a proxy, the measured tip */
    double proxy_rotation[4]; /**< quaternion x y z w */
    double proxy_jaw;      /**< [rad] */
    double proxy_error[3]; /**< measured tip minus the proxy's tip [m]; contains the dimple that the mesh
                            *   cannot form (src/contact/NUMERICS.md) */
    double jaw_error;      /**< measured angle minus the proxy's angle [rad] */
    bool saturated;        /**< the coupling pulls with contact/max_force, or the jaws close with contact/grip_torque */
    double advanced;       /**< completed fraction of the last leg */
} pliant_tool_state;

/** X(name, meaning) for the reasons why a step ends. */
#define PLIANT_STEP_END_LIST(X)                                                                    \
    X(NONE, "every proxy is at its tool")                                                          \
    X(BUDGET, "all evaluations (solver/iterations) are used")                                      \
    X(TIME, "all time (solver/budget_ms) is used")                                                 \
    X(BLOCKED, "tissue or a fixed obstacle blocks a tool")                                         \
    X(FORCE_LIMIT, "a tool presses with contact/max_force, or its jaws with contact/grip_torque")  \
    X(ELEMENTS, "the rest of the motion would invert an element")
#define PLIANT_STEP_END_VALUE(name, text) PLIANT_STEP_END_##name,
/** Reason why a step ends. */
typedef enum pliant_step_end { PLIANT_STEP_END_LIST(PLIANT_STEP_END_VALUE) PLIANT_NUM_STEP_ENDS } pliant_step_end;
#undef PLIANT_STEP_END_VALUE

/** Figures of the last step and totals since the start. */
typedef struct pliant_statistics {
    uint64_t step;              /**< number of steps so far */
    double seconds[PLIANT_NUM_STEP_STAGES]; /**< time of the last step by stage [s] */
    int32_t iterations;         /**< evaluations of the last step, including evaluations of patches */
    double residual;            /**< energy norm of the residual force divided by the norm of the load; the maximum over
                                 *   mesh and patches */
    double error;               /**< estimated distance of a node from its converged position [m]. Explicit dynamics:
                                 *   the error of its sub-steps at the worst free node, without walls and
                                 *   stiffness_damping. 0: unknown (dynamic relaxation) */
    double error_before;        /**< error of the previous step, as estimated in this step [m]; 0: unknown, or the first
                                 *   step */
    double residual_force;      /**< largest nodal residual force [N] */
    int32_t legs;               /**< number of straight motions of tissue and tools; 1 if nothing blocks them */
    double advanced;            /**< completed fraction of the last leg */
    double proxy_error;         /**< largest distance from a tool to its proxy [m] */
    int32_t ended;              /**< pliant_step_end: why the step ended before tissue and proxies reached their
                                 *   goals */
    int32_t contacts;           /**< number of contact points */
    double penetration;         /**< largest penetration depth [m] */
    int32_t rigid_pieces;            /**< number of moving detached pieces */
    int32_t patched;            /**< number of tools with a patch (model/patch) */
    int32_t patch_waiting;      /**< number of tools whose patch is not ready */
    int32_t patch_iterations;   /**< evaluations of patches */
    double patch_residual;      /**< residual of patches */
    double patch_moved;         /**< largest distance of a patch's node from its position in the coarse model [m] */
    uint64_t not_converged;     /**< total number of steps above the tolerance */
    uint64_t rejected;          /**< total number of Anderson steps that the safeguard rejected */
    uint64_t failed;            /**< total number of steps that failed and were rolled back */
    uint64_t factors;           /**< total number of factors in use so far; on a GPU, with rotations of its axes for
                                 *   springs */
    size_t bytes;               /**< memory of this simulation after its last step, cut, undo or reset, without shared
                                 *   memory [bytes] */
} pliant_statistics;

typedef struct pliant_data pliant_data; /**< opaque; pliant_data_get_* and pliant_tool_get return its parts */

/* ---- CREATE */

/** Create a simulation at rest, without tools.
 *  @param model Borrowed; must outlive the simulation.
 *  @param out   Out: free with pliant_data_free.
 *  @return Errors: MEMORY, UNAVAILABLE (no GPU for backend cuda). */
PLIANT_API pliant_status pliant_data_create(const pliant_model *model, pliant_data **out);

/** Free a simulation.
 *  @param data Nullable. */
PLIANT_API void pliant_data_free(pliant_data *data);

/** Reset positions, grasps, history, gravity, cuts and statistics to those at load. Tools keep their poses.
 *  @param model The model of the simulation.
 *  @param data  Unchanged after an error.
 *  @return Errors: MEMORY. */
PLIANT_API pliant_status pliant_data_reset(const pliant_model *model, pliant_data *data);

/** Create another simulation of the model in the same state (state.h), without a deformed volume until
 *  pliant_data_set_warp. The same steps give the same bits in two copies.
 *  @param model The model of the simulation.
 *  @param data  The simulation to copy.
 *  @param out   Out: free with pliant_data_free.
 *  @return Errors: MEMORY, NUMERIC, SCENE, ARGUMENT (another model). */
PLIANT_API pliant_status pliant_data_copy(const pliant_model *model, pliant_data *data, pliant_data **out);

/* ---- STEP */

/** Advance the simulation by one step of the scene: cut, interact, contact, solve, upsample, patch, warp. The solution
 *  is quasi-static, except for explicit dynamics with inertia (solver/kind tled). Positions are always finite.
 *  @param model The model of the simulation.
 *  @param data  After NUMERIC and MEMORY it is in the state before the step, with the step's cuts.
 *  @return NOT_CONVERGED: the state is the best one so far. Errors: NUMERIC, MEMORY. */
PLIANT_API pliant_status pliant_step(const pliant_model *model, pliant_data *data);

/** Set gravity from the next step on.
 *  @param data    The simulation.
 *  @param gravity (3) Acceleration, LPS [m/s^2].
 *  @return Errors: ARGUMENT (not finite). */
PLIANT_API pliant_status pliant_data_set_gravity(pliant_data *data, const double gravity[3]);

/** Return the gravity of a simulation.
 *  @param data The simulation.
 *  @param out  (3) Out: acceleration, LPS [m/s^2]. */
PLIANT_API void pliant_data_get_gravity(const pliant_data *data, double out[3]);

/** Replace solver/iterations and solver/tolerance of the scene from the next step on.
 *  @param data       The simulation.
 *  @param iterations Maximum number of iterations per step, at least 1.
 *  @param tolerance  As solver/tolerance, above 0.
 *  @return Errors: ARGUMENT. */
PLIANT_API pliant_status pliant_data_set_limits(pliant_data *data, int iterations, double tolerance);

/** Set the positions from which the next step starts. Fixed nodes stay. A coarse model reads the positions of its
 *  coarse nodes only.
 *  @param model     The model of the simulation.
 *  @param data      Unchanged after an error.
 *  @param positions (body's fine.num_nodes x 3) LPS [m].
 *  @return Errors: ARGUMENT (not finite). */
PLIANT_API pliant_status pliant_data_set_positions(const pliant_model *model, pliant_data *data,
                                                   const double *positions);

/** Enable or disable the deformed volume after every step.
 *  @param model  The model of the simulation.
 *  @param data   Unchanged after an error.
 *  @param target Nullable: no volume. Grid of the volume (pliant_warp_target), copied.
 *  @return Errors: ARGUMENT, MEMORY. */
PLIANT_API pliant_status pliant_data_set_warp(const pliant_model *model, pliant_data *data,
                                              const pliant_geometry *target);

/* ---- RESULTS of the last step */

/** Return the current body. Retain it (pliant_body_retain) to use it after the next step.
 *  @param data The simulation.
 *  @return The body, valid as the top of this file says. */
PLIANT_API const pliant_body *pliant_data_get_body(const pliant_data *data);

/** Return the positions of the fine nodes.
 *  @param data     The simulation.
 *  @param revision Nullable, out: revision of the body with these nodes.
 *  @return (body's fine.num_nodes x 3) LPS [m], valid as the top of this file says. */
PLIANT_API const double *pliant_data_get_positions(const pliant_data *data, uint64_t *revision);

/** Return the statistics.
 *  @param data The simulation.
 *  @return The statistics, valid as the top of this file says. */
PLIANT_API const pliant_statistics *pliant_data_get_statistics(const pliant_data *data);

/** Return the meaning of a pliant_step_end.
 *  @param end Any number.
 *  @return Static text; "" for other numbers. */
PLIANT_API const char *pliant_step_end_text(int32_t end);

/** Return the deformed volume (pliant_warp_volume) and its bricks.
 *  @param data The simulation.
 *  @return The warp, valid until pliant_data_set_warp; NULL without pliant_data_set_warp. */
PLIANT_API const pliant_warp *pliant_data_get_warp(const pliant_data *data);

/** Return the name of the current backend.
 *  @param data The simulation.
 *  @return "cpu" or "cuda", static. */
PLIANT_API const char *pliant_data_get_backend(const pliant_data *data);

/** Count the inverted fine tetrahedra.
 *  @param data The simulation.
 *  @return The number. */
PLIANT_API int32_t pliant_data_get_inverted(const pliant_data *data);

/** Compute a scalar at the fine nodes: the volume-weighted mean over their tetrahedra. Tetrahedra of a hexahedron have
 *  the hexahedron's value. Stresses belong to the tissue in a tetrahedron. Energies are per volume of the whole
 *  tetrahedron.
 *  @param model  The model of the simulation.
 *  @param data   The simulation.
 *  @param scalar The scalar; The unit is in the description of output/scalar. contact_force is the magnitude of the
 *                nodal contact force [N].
 *  @param out    (body's fine.num_nodes) Out.
 *  @return Errors: ARGUMENT (PLIANT_SCALAR_NONE), MEMORY. */
PLIANT_API pliant_status pliant_data_get_scalar(const pliant_model *model, const pliant_data *data,
                                                pliant_scalar scalar, float *out);

/* ---- TOOLS: pose and grasp */

/** Find a tool by its name, or add it.
 *  @param model The model of the simulation.
 *  @param data  The simulation.
 *  @param name  At most 47 bytes.
 *  @param index Out: number of the tool, valid until pliant_data_free.
 *  @return Errors: ARGUMENT (more than PLIANT_MAX_TOOLS, or a longer name). */
PLIANT_API pliant_status pliant_tool_add(const pliant_model *model, pliant_data *data, const char *name, int *index);

/** Return the number of tools.
 *  @param data The simulation.
 *  @return The number. */
PLIANT_API int pliant_data_get_num_tools(const pliant_data *data);

/** Copy the state of a tool.
 *  @param data The simulation.
 *  @param tool Number of the tool.
 *  @param out  Out: the state.
 *  @return Errors: ARGUMENT (no such tool). */
PLIANT_API pliant_status pliant_tool_get(const pliant_data *data, int tool, pliant_tool_state *out);

/** Set the measured pose of a tool.
 *  @param data     The simulation.
 *  @param tool     Number of the tool.
 *  @param tip      (3) LPS [m].
 *  @param rotation Nullable: identity. Quaternion x y z w of any length but 0.
 *  @return Errors: ARGUMENT (no such tool, not finite, rotation of length 0); the pose stays. */
PLIANT_API pliant_status pliant_tool_set_pose(pliant_data *data, int tool, const double tip[3],
                                              const double rotation[4]);

/** Remove the pose of a tool. The tool releases its tissue.
 *  @param data The simulation.
 *  @param tool Number of the tool. */
PLIANT_API void pliant_tool_remove_pose(pliant_data *data, int tool);

/** Grasp a blob of tissue around the tip at its current position.
 *  @param model The model of the simulation.
 *  @param data  The simulation.
 *  @param tool  Number of the tool.
 *  @param rest  Nullable: the tip. Point at rest to grasp instead, LPS [m].
 *  @return Errors: ARGUMENT (no tissue there; the tool then grasps nothing), MEMORY. */
PLIANT_API pliant_status pliant_tool_grasp(const pliant_model *model, pliant_data *data, int tool,
                                           const double rest[3]);

/** Release the grasped tissue.
 *  @param data The simulation.
 *  @param tool Number of the tool. */
PLIANT_API void pliant_tool_release(pliant_data *data, int tool);

/** Set the constraint between a tool and its grasped tissue.
 *  @param data  The simulation.
 *  @param tool  Number of the tool.
 *  @param drive The constraint.
 *  @param force (3) PLIANT_DRIVE_FORCE: force on the tissue, LPS [N]. Nullable otherwise.
 *  @return Errors: ARGUMENT. */
PLIANT_API pliant_status pliant_tool_set_drive(pliant_data *data, int tool, pliant_drive drive, const double force[3]);

/** Replace the scene's spring of a grasp (grasp/stiffness, grasp/damping).
 *  @param data      The simulation.
 *  @param tool      Number of the tool.
 *  @param stiffness [N/m].
 *  @param damping   [N s/m].
 *  @return Errors: ARGUMENT (no such tool, out of range). */
PLIANT_API pliant_status pliant_tool_set_spring(pliant_data *data, int tool, double stiffness, double damping);

/** Replace the scene's radius of the grasped blob (grasp/radius) from the next grasp on.
 *  @param data   The simulation.
 *  @param tool   Number of the tool.
 *  @param radius [m]; 0: a point.
 *  @return Errors: ARGUMENT (no such tool, out of range). */
PLIANT_API pliant_status pliant_tool_set_radius(pliant_data *data, int tool, double radius);

/** Attach a mass at the grasped point. Gravity pulls it, and dynamics accelerates it. A rigid drive ignores it.
 *  @param data The simulation.
 *  @param tool Number of the tool.
 *  @param mass [kg]; 0: no mass.
 *  @return Errors: ARGUMENT. */
PLIANT_API pliant_status pliant_tool_set_mass(pliant_data *data, int tool, double mass);

/** Compute the signed distance from a tool's tip to the surface that contact uses. There, the skin lies within the
 *  elements. The first call for a body prepares the surface.
 *  @param model The model of the simulation.
 *  @param data  The simulation.
 *  @param tool  Number of the tool.
 *  @return The distance [m]: negative inside the tissue, +infinity for a tool without a pose, NaN if memory is
 *          missing. */
PLIANT_API double pliant_tool_clearance(const pliant_model *model, const pliant_data *data, int tool);

/* ---- CUTS */

/** Set the blade of a tool. While it is on, it cuts along the surface that its edge sweeps.
 *  @param data The simulation.
 *  @param tool Number of the tool.
 *  @param from (3) End of the edge in the tool's frame [m].
 *  @param to   (3) Other end of the edge in the tool's frame [m]; equal to from: no blade.
 *  @return Errors: ARGUMENT (not finite, longer than 1 m). */
PLIANT_API pliant_status pliant_tool_set_blade(pliant_data *data, int tool, const double from[3], const double to[3]);

/** Return the edge of a blade by its name: scalpel, scissors or hook. The far end is at the tool's tip, and the
 *  instrument extends along z.
 *  @param name Name of the blade.
 *  @param from (3) Out: end of the edge in the tool's frame [m].
 *  @param to   (3) Out: other end of the edge in the tool's frame [m].
 *  @return Errors: ARGUMENT (unknown name; the message lists all names). */
PLIANT_API pliant_status pliant_blade_find(const char *name, double from[3], double to[3]);

/** Switch a blade on or off from the next step on. A stroke starts at the edge's pose in that step. It ends when the
 *  blade is off, or the tool is lost or faster than 2 m/s, which counts as a jump. A blade of a tool that grasps tissue
 *  cuts without a cutting force. With cut/kind subdivide, the step after the blade is switched off still cuts the faces
 *  in which the stroke ends.
 *  @param data The simulation.
 *  @param tool Number of the tool.
 *  @param on   Whether the blade cuts.
 *  @return Errors: ARGUMENT (no blade, or cut/kind none). */
PLIANT_API pliant_status pliant_tool_set_cutting(pliant_data *data, int tool, bool on);

/** Cut along a line of points in deformed space, without a tool and without a cutting force. The cut is one stroke for
 *  undo.
 *  @param model  The model of the simulation.
 *  @param data   Unchanged after an error.
 *  @param count  Number of points, at least 2.
 *  @param points (count x 3) LPS [m].
 *  @param depth  (3) Direction and depth of the cut, LPS [m].
 *  @param report Nullable, out: result of the cut.
 *  @return Errors: SCENE (cut/kind: none), ARGUMENT, MEMORY, NUMERIC. */
PLIANT_API pliant_status pliant_data_cut(const pliant_model *model, pliant_data *data, int32_t count,
                                         const double *points, const double depth[3], pliant_cut_report *report);

/** Undo the last stroke or pliant_data_cut. The topology is exactly the previous one, with the current positions.
 *  cut/undo limits the number of strokes that can be undone.
 *  @param model The model of the simulation.
 *  @param data  Unchanged after an error.
 *  @return Errors: ARGUMENT (nothing to undo), MEMORY, NUMERIC, SCENE. */
PLIANT_API pliant_status pliant_data_undo_cut(const pliant_model *model, pliant_data *data);

#ifdef __cplusplus
}
#endif
#endif
