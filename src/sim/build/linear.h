/* A tool's wrench near the pose of the last step: what answers a hand faster than steps come.
 */
#ifndef PLIANT_SIM_LINEAR_H
#define PLIANT_SIM_LINEAR_H

#include "base/export.h"
#include "pliant/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/** wrench(pose) = wrench + stiffness (pose - pose of the step). Zero it before its first use. */
typedef struct pliant_tool_linear {
    bool known;            /**< false: the tool has no pose, or no step was made */
    bool by_secants;       /**< no linearization was at hand: stiffness is what forces of the last steps tell, and that alone */
    uint64_t step;         /**< of pliant_statistics */
    uint64_t hold;         /**< of pliant_tool_state */
    double tip[3];         /**< LPS [m] */
    double rotation[4];    /**< quaternion x y z w */
    double wrench[6];      /**< of the tool on the tissue, by all that it has: force [N], torque about the tip [N m] */
    double stiffness[36];  /**< of that over translation [m] and rotation vector [rad] of the tool; symmetric, no eigenvalue below 0 */
    double correction[9];  /**< what of its part by translations the last steps have told beyond the linearization [N/m] */
} pliant_tool_linear;

/** After a step: the wrench of that step and how it changes with the tool's pose. With the rows W of what the tool holds and touches, and the
 *  spring's compliance c, the other tools holding still,  stiffness = G' (c I + W K^-1 W')^-1 G,  G the motion of those rows with the tool;
 *  K is the stiffness that the solver's preconditioner stands for, and contacts that slide resist along their normals alone. What that leaves out
 *  (the preconditioner is of a while ago, rows turn, contacts come and go) is told by secants: changes of the force from step to step (Powell's
 *  symmetric Broyden update, translations alone), where the same struct is given after every step. Explicit dynamics, solvers on a GPU, and pieces
 *  that came off have no K^-1 at hand, and secants alone. Errors: ARGUMENT (no such tool), MEMORY.
 *  @param at in: that of the last step, or zeros: no secants */
PLIANT_INTERNAL pliant_status pliant_tool_linearize(const pliant_data *data, int tool, pliant_tool_linear *at);

/** The wrench at another pose, changed by no more than a bound in force, and in the same proportion in torque. Any thread.
 *  @param most [N]; infinite: none */
PLIANT_INTERNAL void pliant_tool_linear_wrench(const pliant_tool_linear *at, const double tip[3], const double rotation[4], double most, double out[6]);

#ifdef __cplusplus
}
#endif

#endif
