/* Linear model of a tool's wrench near the pose of the last step, for haptic loops that are faster than the steps. */
#ifndef PLIANT_SIM_BUILD_LINEAR_WRENCH_H
#define PLIANT_SIM_BUILD_LINEAR_WRENCH_H

#include "base/export.h"
#include "pliant/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/** wrench(pose) = wrench + stiffness (pose - pose of the step). Zero it before its first use. */
typedef struct pliant_tool_linear {
    bool known;            /**< false: the tool has no pose, or no step was made */
    bool by_secants; /**< there is no linearization: the stiffness follows from the forces of the last steps alone */
    uint64_t step;         /**< of pliant_statistics */
    uint64_t hold;         /**< of pliant_tool_state */
    double tip[3];         /**< LPS [m] */
    double rotation[4];    /**< quaternion x y z w */
    double wrench[6];      /**< force [N] and torque about the tip [N m] of the whole tool on the tissue */
    /** derivative of the wrench by translation [m] and rotation vector [rad]; symmetric positive semidefinite */
    double stiffness[36];
    double correction[9];  /**< correction of the translational part by secants of the last steps [N/m] */
} pliant_tool_linear;

/** Compute the wrench of the last step and its derivative by the tool's pose; all other tools stand still.
 * The stiffness is G' (c I + W K^-1 W')^-1 G. W are the constraint rows of grasp and contact, and c is the spring's
 * compliance. G is the motion of the rows with the tool. K is the stiffness that the preconditioner approximates.
 * Sliding contacts resist along their normals only.
 * Secants correct the errors of this model: an old preconditioner, rows that turn, contacts that begin or end. A
 * secant is the change of the force between two steps (Powell's symmetric Broyden update, translations only). To
 * use secants, pass the same struct after every step. Explicit dynamics, GPU solvers, and simulations with detached
 * pieces have no K^-1; they use secants alone.
 * @param at in: the result of the previous step, or zeros for no secants; out: the new one
 * Errors: ARGUMENT (no such tool), MEMORY. */
PLIANT_INTERNAL pliant_status pliant_tool_linearize(const pliant_data *data, int tool, pliant_tool_linear *at);

/** Compute the wrench at another pose. Any thread may call this.
 * @param maximum limit of the change of the force [N], may be infinite; the torque is scaled by the same factor */
PLIANT_INTERNAL void pliant_tool_linear_wrench(const pliant_tool_linear *at, const double tip[3],
                                               const double rotation[4], double maximum, double out[6]);

#ifdef __cplusplus
}
#endif

#endif
