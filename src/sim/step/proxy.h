/* Proxies: simulated tools, also called god objects (Zilles and Salisbury, Proc. IROS 1995; Ruspini, Kolarov,
 * Khatib, Proc. SIGGRAPH 1997). A virtual coupling (Colgate, Stanley, Brown, Proc. IROS 1995) pulls each proxy
 * towards the measured tool. Contact happens at the proxy, and the published force is the contact force at the
 * proxy. */
#ifndef PLIANT_SIM_PROXY_H
#define PLIANT_SIM_PROXY_H

#include "contact/advance/advance.h"
#include "contact/shapes/shapes.h"
#include "fem/quasistatic/contact.h"
#include "tool/pose.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Return an upper bound of the distance that any point of a part moves between two poses [m]. */
double pliant_part_max_motion(const pliant_tool_shape *shape, const pliant_part *part, const pliant_tool_pose *from,
                              const pliant_tool_pose *to);
/* Return an upper bound of the distance that the tip and any point of the tool move between two poses [m]. */
double pliant_tool_max_motion(const pliant_tool *tool, const pliant_tool_pose *from, const pliant_tool_pose *to);

/* Compute the joint of the jaws [m] and their unit axis at a pose. */
void pliant_tool_joint(const pliant_tool *tool, const pliant_tool_pose *pose, double joint[3], double axis[3]);
/* Compute the load on a proxy at a pose, from the forces of the contact points. */
void pliant_proxy_find_load(const pliant_data *data, int tool, const pliant_tool_pose *pose, pliant_proxy_load *out);
/* Linearize the coupling for one leg: of the tool about its tip, and of the jaws about their joint. The
 * linearization point is where the coupling yields to the load of the previous leg, or before it. Near a force limit
 * the coupling is softened, so that its load stays below the limit. The limits are contact/max_force at the tip, the
 * same force at the tool's farthest point, and contact/grip_torque.
 * The added compliance is the sum of pliant_proxy_compliance and pliant_missing_compliance.
 * @param goal desired pose at the end of the leg
 * @param yields pliant_proxy_estimate_tissue_compliance; 0: unknown
 * @param longest maximum distance of the linearization point from `begin`, as the tool's points move [m]
 * @param ahead out: the pose at the linearization point
 * @param limit out: limits of force, torque, and jaws, which the solver on the CPU keeps exactly */
void pliant_proxy_linearize(const pliant_model *model, const pliant_tool *tool, const pliant_tool_pose *begin,
                            const pliant_tool_pose *goal, const pliant_proxy_load *before,
                            const double added[2], const double yields[3], double longest,
                            pliant_tool_pose *ahead, pliant_contact_body out[2], pliant_touch_limit limit[3]);
/* Explicit dynamics: estimate the compliance of the tissue against a proxy, for force, torque, and jaws
 * [m/N, rad/(N m)]. It is the pressed points' displacement per load.
 * @param farthest the displacement counts up to this distance [m] */
void pliant_proxy_estimate_tissue_compliance(const pliant_data *data, int tool, const pliant_tool_pose *pose,
                                             const pliant_proxy_load *load, double farthest, double out[3]);
/* Return the pose that the coupling yields to under a load.
 * @param from pose at the linearization point */
pliant_tool_pose pliant_proxy_pose_under_load(const pliant_tool *tool, const pliant_tool_pose *from,
                                              const pliant_contact_body couple[2], const pliant_proxy_load *load);
/* Return the fraction of a load's change at which the first limit is reached. Also set whether the proxy is
 * saturated. */
double pliant_proxy_fraction_to_limit(const pliant_model *model, pliant_tool *tool, const pliant_proxy_load *before,
                                      const pliant_proxy_load *after);
/* Compute the compliance that rigid pieces under a tool add to its coupling. For translations it is the compliance
 * of a cube of the piece's volume V, 1 / (E V^(1/3)) [m/N]. For the jaws it follows from the levers of the points
 * [rad/(N m)]. 0: the tool is on no piece.
 * @param pressing use the points that have carried a force; otherwise the points that overlap */
void pliant_proxy_compliance(const pliant_data *data, int tool, bool pressing, const double joint[3],
                             const double axis[3], double out[2]);

#ifdef __cplusplus
}
#endif

#endif
