/* What the node is told at its start: private ROS parameters over a scene file over the defaults. */
#ifndef PLIANT_ROS_PARAMS_PARAMS_H
#define PLIANT_ROS_PARAMS_PARAMS_H

#include "pliant/ros/convert.h"

#include <XmlRpcValue.h>

#include <algorithm>
#include <limits>
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
    bool shape_follows;                /* that of the instrument which its topic tool_type names */

    bool has_blade() const { return !std::equal(blade_from, blade_from + 3, blade_to); }
};

/* What looks at the tissue. Angles in degrees, as cameras are sold. */
struct CameraParameters {
    std::string name;
    std::string frame;          /* of tf, where it is; empty: its name */
    bool ambf = false;          /* the frame's axes are AMBF's (x backwards, y right, z up), else optical (z forward, x right, y down) */
    int width = 640, height = 480; /* [pixels] */
    double field_of_view = 60;  /* along the width [degrees] */
    double rate = 30;           /* [Hz] */
    double near = 0, far = 0;   /* [m]; far 0: without end */
    double baseline = 0;        /* of a stereo camera, whose left eye is at the frame [m]; 0: mono */
    double threshold = std::numeric_limits<double>::quiet_NaN(); /* of the surface [values of the scan]; NaN: pliant_style_defaults */
    std::vector<std::string> shown; /* names of materials that alone are seen; none: by the threshold */
    std::string info_url;       /* a calibration, as of camera_info_manager */
};

struct Parameters {
    pliant_scene scene;
    std::string scan;                       /* as of pliant_inputs_read */
    std::string scan_root, output_root;     /* empty: services may name no file */
    std::string parent_frame, tissue_frame; /* parent empty: no transform is published */
    Rigid tissue_pose;                      /* of the tissue frame in the parent */
    std::string registration;               /* file that has it instead, once the service register has written it; empty: none */
    std::string hand_eye;                   /* "FRAME=FILE ...": files that say where the bases of arms lie, as dVRK's camera registration writes them */
    std::string checkpoint;                 /* file to go on from after the node was killed; empty: none is kept */
    double checkpoint_period;               /* [s] */
    std::vector<ToolParameters> tools;
    std::vector<CameraParameters> cameras;
    pliant_background_kind background;      /* live: no step waits; planned: the same on every machine */
    double tool_max_age;                    /* [s] */
    double tool_hold;                       /* what holds stays so for as long after that [s] */
    double tool_max_pause;                  /* of the machine's clock, without poses while /clock stands still [s] */
    double jaw_close, jaw_release;          /* [rad] */
    double pose_filter;                     /* cutoff of a low-pass over measured poses [Hz]; 0: none */
    double wrench_rate;                     /* of forces between steps [Hz]; 0: forces come with steps alone */
    double wrench_bound;                    /* that they may differ from those of the last step [N] */
    double slice[3];                        /* axial, coronal, sagittal: fraction of the volume's box */
    double volume_threshold;                /* bricks whose voxels have all changed by less since they were sent are sent at rest only [values of the scan]; NaN: the scan's noise */
    double volume_low[3], volume_high[3];   /* what of the volume is sent, LPS [m]; infinite: all */
    int preview_step;                       /* every so many-th voxel is in volume/preview */
};

/* From the tree of private parameters (a struct, or invalid for none). Every option of a scene is a parameter of its
   path, solver/iterations; beside them: scene (file), scan or scan/path, scan_root, output_root, parent_frame,
   tissue_frame, tissue_pose, registration, hand_eye, checkpoint, checkpoint_period, background, tools, tool/<name>/{mode,blade,shape,frame,jaw}, tool_max_age, tool_hold, tool_max_pause, jaw_close, jaw_release, pose_filter,
   wrench_rate, wrench_bound, cameras,
   camera/<name>/{frame,convention,width,height,field_of_view,rate,near,far,baseline,threshold,shown,info_url}, slice/{axial,coronal,sagittal}, volume_threshold,
   volume_region/{low,high}, preview_step, respawn (of the program: it is started again whenever it ends). Anything else is an error that names the nearest known one.
   The tree is not changed; XmlRpcValue has no constant access. */
bool read_parameters(XmlRpc::XmlRpcValue tree, Parameters *out, std::string *why);

} // namespace pliant_ros

#endif
