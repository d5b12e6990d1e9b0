/* Proxies: simulated tools (god objects: Zilles and Salisbury, Proc. IROS 1995; Ruspini, Kolarov, Khatib, Proc. SIGGRAPH 1997). A virtual coupling (Colgate, Stanley,
 * Brown, Proc. IROS 1995) pulls each one towards the measured tool. Contact is with the proxy, and the force that is told is the one on it. */
#ifndef PLIANT_SIM_PROXY_H
#define PLIANT_SIM_PROXY_H

#include "contact/advance/advance.h"
#include "contact/shapes/shapes.h"
#include "fem/quasistatic/piece_rules.h"
#include "state/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Where a tool is measured, where its proxy is, and a pose in between. */
pliant_tool_pose pliant_tool_measured(const pliant_tool *tool);
pliant_tool_pose pliant_tool_proxy(const pliant_tool *tool);
void pliant_tool_set_proxy(pliant_tool *tool, const pliant_tool_pose *pose);
pliant_tool_pose pliant_pose_partway(const pliant_tool_pose *from, const pliant_tool_pose *to, double share);
/* How far no point of a part of the tool goes beyond between the two [m]; of the whole tool, its tip counts, too. */
double pliant_part_way(const pliant_tool_shape *shape, const pliant_part *part, const pliant_tool_pose *from, const pliant_tool_pose *to);
double pliant_tool_way(const pliant_tool *tool, const pliant_tool_pose *from, const pliant_tool_pose *to);

/* The joint of the jaws [m], and their axis, of length 1, in a pose. */
void pliant_tool_joint(const pliant_tool *tool, const pliant_tool_pose *pose, double joint[3], double axis[3]);
/* Force and torque about the tip, and torque that opens the jaws, of the tissue on a proxy that is in a pose [N, N m]. */
typedef struct pliant_proxy_load { double wrench[6], jaw; } pliant_proxy_load;
void pliant_proxy_find_load(const pliant_data *data, int tool, const pliant_tool_pose *pose, pliant_proxy_load *out);
/* The coupling in a leg, of the tool about its tip and of its jaws about their joint, to first order around where the load of the leg before lets it go. A coupling
 * whose error times its stiffness is above a limit (contact/max_force at the tip and at the tool's far end, contact/grip_torque) is as soft as that limit asks for.
 * @param goal where it shall go; gives: more that it gives way (pliant_contact_gives). *ahead: around which it is linear; axis: of the jaws there */
void pliant_proxy_couple(const pliant_model *model, const pliant_tool *tool, const pliant_tool_pose *begin, const pliant_tool_pose *goal, const pliant_proxy_load *before,
                         const double gives[2], pliant_tool_pose *ahead, pliant_touch_piece out[2], double axis[3]);
/* Where the coupling lets the proxy go under a load. from: around which it is linear */
pliant_tool_pose pliant_proxy_yield(const pliant_tool *tool, const pliant_tool_pose *from, const pliant_touch_piece couple[2], const pliant_proxy_load *load);
/* How much of a load's change may come before a limit is reached, as a fraction; sets whether the proxy is saturated. */
double pliant_proxy_limit(const pliant_model *model, pliant_tool *tool, const pliant_proxy_load *before, const pliant_proxy_load *after);

#ifdef __cplusplus
}
#endif

#endif
