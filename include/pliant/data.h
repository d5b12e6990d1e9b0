/** @file data.h
 *  Everything that changes from step to step, ordered by the stage that writes it; and the step itself.
 */
#ifndef PLIANT_DATA_H
#define PLIANT_DATA_H

#include "pliant/cut.h"
#include "pliant/model.h"
#include "pliant/warp.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Stages of a step, in order. */
#define PLIANT_STEP_STAGE_LIST(X) X(cut) X(interact) X(contact) X(solve) X(upsample) X(patch) X(warp)
typedef enum pliant_step_stage {
#define PLIANT_STAGE_ENUM(name) PLIANT_STEP_##name,
    PLIANT_STEP_STAGE_LIST(PLIANT_STAGE_ENUM)
#undef PLIANT_STAGE_ENUM
    PLIANT_NUM_STEP_STAGES
} pliant_step_stage;

enum { PLIANT_MAX_TOOLS = 8 };

/** How a tool that has hold of the tissue acts on it. */
typedef enum pliant_drive {
    PLIANT_DRIVE_SPRING, /**< a damped spring between tool tip and held point (grasp/stiffness, grasp/damping) */
    PLIANT_DRIVE_RIGID,  /**< the held point is at the tip: displacement control */
    PLIANT_DRIVE_FORCE   /**< a given force, wherever the tip is: force control */
} pliant_drive;

/** What pliant_tool_get tells. */
typedef struct pliant_tool_state {
    char name[48];
    bool present;          /**< has a pose */
    double tip[3];         /**< LPS [m] */
    double rotation[4];    /**< quaternion x y z w */
    pliant_drive drive;
    double driving_force[3]; /**< PLIANT_DRIVE_FORCE: on the tissue [N] */
    double stiffness, damping, radius; /**< [N/m, N s/m, m] */
    bool holding;
    uint64_t hold;         /**< how many times it has taken hold */
    int32_t num_held;      /**< fine nodes that share the force */
    double held_point[3];  /**< where the held point is after the last step, LPS [m] */
    double force[3];       /**< of the tool on the tissue in the last step, by its hold or its blade [N] */
    double contact_force[3];  /**< and by its shape (contact.h) [N] */
    double contact_torque[3]; /**< the same about its tip [N m] */
    bool cutting;          /**< its blade is on */
    bool engaged;          /**< and in tissue */
    double engaged_length; /**< of its edge that is [m] */
    double severed_area;   /**< by it since load, at rest [m^2] */
    uint64_t stroke;       /**< how many times it has begun to cut */
    int32_t pieces;        /**< of the tissue after its last cut; 0: it has cut nothing yet */
    double jaw;            /**< measured angle of its jaws [rad] */
    bool has_proxy;        /**< it has a shape, and is in the scene: what follows is of its proxy, the simulated tool. Without a shape it is where it is measured */
    double proxy_tip[3];   /**< LPS [m] */
    double proxy_rotation[4]; /**< quaternion x y z w */
    double proxy_jaw;      /**< [rad] */
    double proxy_error[3]; /**< measured tip minus proxy's tip [m] */
    double jaw_error;      /**< measured angle minus the proxy's [rad] */
    bool saturated;        /**< its coupling pulls with contact/max_force, or its jaws with contact/grip_torque */
    double advanced;       /**< fraction of the last leg that was possible */
} pliant_tool_state;

/** Why a step ended. */
#define PLIANT_STEP_END_LIST(X)                                                            \
    X(NONE, "everything is where it should be")                                            \
    X(BUDGET, "its evaluations (solver/iterations) were used up")                          \
    X(TIME, "its time (solver/budget_ms) was used up")                                     \
    X(BLOCKED, "tissue or what stands still is in the way of a tool")                      \
    X(FORCE_LIMIT, "a tool presses with contact/max_force, or its jaws with contact/grip_torque")
#define PLIANT_STEP_END_VALUE(name, text) PLIANT_STEP_END_##name,
typedef enum pliant_step_end { PLIANT_STEP_END_LIST(PLIANT_STEP_END_VALUE) PLIANT_NUM_STEP_ENDS } pliant_step_end;
#undef PLIANT_STEP_END_VALUE
/** "" for other numbers. */
PLIANT_API const char *pliant_step_end_text(int32_t end);

typedef struct pliant_statistics {
    uint64_t step;              /**< steps done */
    double seconds[PLIANT_NUM_STEP_STAGES];
    int32_t iterations;         /**< of the last step, those of a patch among them */
    double residual;            /**< energy norm of the residual force over that of the load, last step; of a patch where that is larger */
    double error;               /**< [m] how far a node still is from where the step would converge to, estimated where it ended (with
                                 *   solver/budget_ms and no time for that, from the evaluation before). Explicit dynamics: what its
                                 *   sub-steps left in this step at the farthest node that no tool holds, without walls and stiffness_damping.
                                 *   0: not known (dynamic relaxation) */
    double error_before;        /**< [m] the same of the step before, as this one has it; 0: not known, or the first step */
    double residual_force;      /**< largest nodal residual force [N] */
    int32_t legs;               /**< straight motions of tissue and tools in the last step; 1 where nothing was in the way */
    double advanced;            /**< fraction of the last leg that was possible; 1: all of it */
    double proxy_error;         /**< [m] largest distance between a tool with a shape and its proxy after the last step */
    int32_t ended;              /**< pliant_step_end: why the last step ended before tools were where they are measured */
    int32_t contacts;           /**< points at which tissue is pressed, last step */
    double penetration;         /**< [m] how deep the deepest of them lies in what it touches */
    int32_t falling;            /**< pieces that have come off and move */
    int32_t patched;            /**< tools that pull at a patch (model/patch), last step */
    int32_t patch_waiting;      /**< tools whose patch is still being made */
    int32_t patch_iterations;   /**< of the patch, last step */
    double patch_residual;      /**< as residual, of the patch alone */
    double patch_moved;         /**< [m] the farthest that a patch has moved a node from where the coarse model has it */
    uint64_t not_converged;     /**< steps that ended above the tolerance */
    uint64_t rejected;          /**< Anderson steps refused by the safeguard */
    uint64_t failed;            /**< steps that broke down and were undone */
    uint64_t factors;           /**< factors put to use since the start; on the GPU, times that its preconditioner was turned for springs */
    size_t bytes;               /**< of what was made for this data and is still held, as of its last step, cut, undo or reset; what it shares with its
                                 *   model, or with what it was copied from, is theirs [bytes] */
} pliant_statistics;

typedef struct pliant_data pliant_data; /**< opaque: asked by pliant_data_get_* and pliant_tool_get */

/** At rest, no tools. Errors: MEMORY. */
PLIANT_API pliant_status pliant_data_create(const pliant_model *model, pliant_data **out);
PLIANT_API void pliant_data_free(pliant_data *data); /**< Nullable */

/** Back to rest: positions, holds, history, gravity, statistics. Tools keep their poses. Errors: MEMORY (nothing changed). */
PLIANT_API pliant_status pliant_data_reset(const pliant_model *model, pliant_data *data);

/** Create another simulation of the model in this one's state (state.h). It has no deformed volume until pliant_data_set_warp. In two copies the
 *  same steps give the same bits. Errors: MEMORY, NUMERIC, SCENE, ARGUMENT (of another model). */
PLIANT_API pliant_status pliant_data_copy(const pliant_model *model, pliant_data *data, pliant_data **out);

/** What is true after the last step: valid until the next call that takes this data and may change it (a step, a cut, a reset; one that fails, too). Retain the body
 *  (pliant_body_retain) to keep it for longer. */
PLIANT_API const pliant_body *pliant_data_get_body(const pliant_data *data);
/** (body's fine.num_nodes x 3) LPS [m], valid as the body is.
 *  @param revision Nullable: of the body whose nodes these are */
PLIANT_API const double *pliant_data_get_positions(const pliant_data *data, uint64_t *revision);
/** Valid as the body is. */
PLIANT_API const pliant_statistics *pliant_data_get_statistics(const pliant_data *data);
/** The deformed volume and its bricks (warp.h), NULL unless pliant_data_set_warp asked for it. Valid until that is called again. */
PLIANT_API const pliant_warp *pliant_data_get_warp(const pliant_data *data);
PLIANT_API void pliant_data_get_gravity(const pliant_data *data, double out[3]);
PLIANT_API int pliant_data_get_num_tools(const pliant_data *data);

/** Who runs the stages now: "cpu" or "cuda". */
PLIANT_API const char *pliant_data_get_backend(const pliant_data *data);

/** Ask for the deformed volume after every step (or no longer: target NULL). Errors: ARGUMENT, MEMORY. */
PLIANT_API pliant_status pliant_data_set_warp(const pliant_model *model, pliant_data *data, const pliant_geometry *target);

/** A new direction or size of gravity, from the next step on. Errors: ARGUMENT (not finite). */
PLIANT_API pliant_status pliant_data_set_gravity(pliant_data *data, const double gravity[3]);

/** Other limits of a step than those of the scene (solver/iterations, solver/tolerance), from the next step on.
 *  Errors: ARGUMENT (iterations < 1, tolerance not above 0). */
PLIANT_API pliant_status pliant_data_set_limits(pliant_data *data, int iterations, double tolerance);

/** Put the body where it is said to be, however unlikely; the next step goes on from there. Of a coarse model only the
 *  positions at coarse nodes count; fixed nodes stay. Errors: ARGUMENT (not finite; nothing is changed).
 *  @param positions (body->fine.num_nodes x 3) LPS [m] */
PLIANT_API pliant_status pliant_data_set_positions(const pliant_model *model, pliant_data *data, const double *positions);

/** One step of the scene: cut, interact, contact, solve, upsample, warp; quasi-static, but for tled with inertia. NOT_CONVERGED keeps the best state reached so far;
 *  NUMERIC and MEMORY restore the state before the step; a cut that the step has made stays. Positions are never NaN. */
PLIANT_API pliant_status pliant_step(const pliant_model *model, pliant_data *data);

/** A tool of this name, added if there is room. *index stays valid. Errors: ARGUMENT (more than PLIANT_MAX_TOOLS). */
PLIANT_API pliant_status pliant_tool_add(const pliant_model *model, pliant_data *data, const char *name, int *index);
/** @param rotation Nullable: identity. Errors: ARGUMENT (not finite, or a rotation of length 0), the tool stays where it was. */
PLIANT_API pliant_status pliant_tool_set_pose(pliant_data *data, int tool, const double tip[3], const double rotation[4]);
/** Copied. Errors: ARGUMENT (no such tool). */
PLIANT_API pliant_status pliant_tool_get(const pliant_data *data, int tool, pliant_tool_state *out);
/** Another spring and damper, or another blob, than the scene's; the blob from the next grasp on. Errors: ARGUMENT (no such tool, out of
 *  range). */
PLIANT_API pliant_status pliant_tool_set_spring(pliant_data *data, int tool, double stiffness, double damping);
PLIANT_API pliant_status pliant_tool_set_radius(pliant_data *data, int tool, double radius);
/** The tool is gone: it lets go. */
PLIANT_API void pliant_tool_lost(pliant_data *data, int tool);
/** Take hold of the tissue around the tip, as it lies now. With a rest point, of that point of the scan instead.
 *  @param rest Nullable: LPS [m]
 *  Errors: ARGUMENT: no tissue there (the tool holds nothing). */
PLIANT_API pliant_status pliant_tool_grasp(const pliant_model *model, pliant_data *data, int tool, const double rest[3]);
PLIANT_API void pliant_tool_release(pliant_data *data, int tool);
/** Drive by force, rigidly or by the spring. @param force Nullable unless drive is FORCE [N] */
PLIANT_API pliant_status pliant_tool_set_drive(pliant_data *data, int tool, pliant_drive drive, const double force[3]);
/** A mass at what the tool holds [kg], which gravity pulls at and dynamics swings; 0: none. Without effect on a rigid tool. Errors: ARGUMENT. */
PLIANT_API pliant_status pliant_tool_set_mass(pliant_data *data, int tool, double mass);

/** A blade of this tool: its edge, in the tool's frame [m]; both ends equal: none. It parts what its edge is swept through while it is on.
 *  Errors: ARGUMENT (not finite, longer than 1 m). */
PLIANT_API pliant_status pliant_tool_set_blade(pliant_data *data, int tool, const double from[3], const double to[3]);
/** The edge of a blade by its name: scalpel, scissors or hook; its far end is at the tool's tip, the instrument along the frame's z.
 *  Errors: ARGUMENT (another name; the message lists them). */
PLIANT_API pliant_status pliant_blade_find(const char *name, double from[3], double to[3]);
/** Whether it cuts, from the next step on. A stroke begins where the edge is in that step, and ends when the blade is off, lost, or goes more
 *  than 2 m/s, which is taken for a jump. A blade of a tool that holds tissue cuts without being felt.
 *  Errors: ARGUMENT (no blade, or a scene that does not cut). */
PLIANT_API pliant_status pliant_tool_set_cutting(pliant_data *data, int tool, bool on);

/** Cut at once along a line of points, as deep as one direction goes; deformed space, LPS [m]. Nothing is felt. One stroke to undo.
 *  @param points (count x 3); @param report Nullable: what was severed. Errors: SCENE (cut/kind is none), ARGUMENT, MEMORY, NUMERIC. */
PLIANT_API pliant_status pliant_data_cut(const pliant_model *model, pliant_data *data, int32_t count, const double *points, const double depth[3],
                                         pliant_cut_report *report);
/** The body from before the last stroke (or pliant_data_cut): its topology bit for bit, under positions as they are; up to cut/undo of them.
 *  Errors: ARGUMENT (nothing to undo), and as of pliant_data_set_body. */
PLIANT_API pliant_status pliant_data_undo_cut(const pliant_model *model, pliant_data *data);

/** Return the signed distance from a tool's tip to the surface that contact uses, where the skin is within the elements [m]. It is negative inside the tissue,
 *  +infinity when the tool is not present, and NaN without memory. The first call for a body prepares the surface. */
PLIANT_API double pliant_tool_clearance(const pliant_model *model, const pliant_data *data, int tool);

/** Fine tetrahedra of a simulation that are turned inside out now. */
PLIANT_API int32_t pliant_data_get_inverted(const pliant_data *data);

/** The same of a simulation as its last step left it; contact_force is of one alone: how large the force by contact on a node is [N].
 *  Errors: MEMORY; of pliant_data_scalar for contact_force ARGUMENT. */
PLIANT_API pliant_status pliant_data_get_scalar(const pliant_model *model, const pliant_data *data, pliant_scalar scalar, float *out);

#ifdef __cplusplus
}
#endif
#endif
