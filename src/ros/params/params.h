/* What the node is told at its start: private ROS parameters over a scene file over the defaults. */
#ifndef PLIANT_ROS_PARAMS_PARAMS_H
#define PLIANT_ROS_PARAMS_PARAMS_H

#include "pliant/ros/convert.h"

#include <XmlRpcValue.h>

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

namespace pliant_ros {

struct ToolParameters {
    std::string name;
    bool grasps;      /* mode grasp; false: probe, it only feels */
    std::string frame; /* of poses that name none; empty: the parent frame */
    bool jaw_setpoint; /* its jaw topic tells what the jaw is to do: what came last stays true, with or without a stamp */
    double blade_from[3], blade_to[3]; /* edge of its blade in its frame [m]; both equal: none */
    std::shared_ptr<const void> solids; /* holds those of its shape */
    pliant_tool_shape shape;           /* what of it touches tissue; no parts: nothing */

    bool has_blade() const { return !std::equal(blade_from, blade_from + 3, blade_to); }
};

struct Parameters {
    pliant_scene scene;
    std::string scan;                       /* as of pliant_inputs_read */
    std::string scan_root, output_root;     /* empty: services may name no file */
    std::string parent_frame, tissue_frame; /* parent empty: no transform is published */
    Rigid tissue_pose;                      /* of the tissue frame in the parent */
    std::string registration;               /* file that has it instead, once the service register has written it; empty: none */
    std::string checkpoint;                 /* file to go on from after the node was killed; empty: none is kept */
    double checkpoint_period;               /* [s] */
    std::vector<ToolParameters> tools;
    pliant_background_kind background;      /* live: no step waits; planned: the same on every machine */
    double tool_max_age;                    /* [s] */
    double tool_hold;                       /* what holds stays so for as long after that [s] */
    double jaw_close, jaw_release;          /* [rad] */
    double wrench_rate;                     /* of forces between steps [Hz]; 0: forces come with steps alone */
    double wrench_bound;                    /* that they may differ from those of the last step [N] */
    double slice[3];                        /* axial, coronal, sagittal: fraction of the volume's box */
};

/* From the tree of private parameters (a struct, or invalid for none). Every option of a scene is a parameter of its
   path, solver/iterations; beside them: scene (file), scan or scan/path, scan_root, output_root, parent_frame,
   tissue_frame, tissue_pose, registration, checkpoint, checkpoint_period, background, tools, tool/<name>/{mode,blade,shape,frame,jaw}, tool_max_age, tool_hold, jaw_close, jaw_release,
   wrench_rate, wrench_bound, slice/{axial,coronal,sagittal}. Anything else is an error that names the nearest known one.
   The tree is not changed; XmlRpcValue has no constant access. */
bool read_parameters(XmlRpc::XmlRpcValue tree, Parameters *out, std::string *why);

} // namespace pliant_ros

#endif
