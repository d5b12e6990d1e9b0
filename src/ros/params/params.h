/* Node parameters. Private ROS parameters override the scene file, which overrides the defaults. */
#ifndef PLIANT_ROS_PARAMS_PARAMS_H
#define PLIANT_ROS_PARAMS_PARAMS_H

#include "pliant/ros/convert.h"
#include "model_data/background.h"

#include <XmlRpcValue.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <string>
#include <vector>

namespace pliant_ros {

struct ToolParameters {
    std::string name;
    bool grasps;      /* mode grasp; false for mode probe, which only measures forces */
    std::string frame; /* frame of poses without a frame; empty: the parent frame */
    bool jaw_setpoint; /* the jaw topic carries set points: the last one stays valid without new messages */
    double blade_from[3], blade_to[3]; /* blade edge in the tool frame [m]; both ends equal: no blade */
    std::shared_ptr<const void> solids; /* owns the solids of `shape` */
    pliant_tool_shape shape;           /* collision shape; no parts: no contact */
    bool shape_follows;                /* the shape follows the instrument that the topic tool_type names */

    bool has_blade() const { return !std::equal(blade_from, blade_from + 3, blade_to); }
};

/* A camera that renders the tissue. Angles are in degrees, as in camera data sheets. */
struct CameraParameters {
    std::string name;
    std::string frame;          /* tf frame of the camera; empty: the camera's name */
    /* the frame's axes are AMBF's (x backwards, y right, z up); false: optical (z forward, x right, y down) */
    bool ambf = false;
    int width = 640, height = 480; /* [pixels] */
    double field_of_view = 60;  /* horizontal [degrees] */
    double rate = 30;           /* [Hz] */
    double near = 0, far = 0;   /* clipping distances [m]; far 0: no limit */
    /* distance between the eyes of a stereo camera, whose left eye is at the frame [m]; 0: mono */
    double baseline = 0;
    /* surface threshold [values of the scan]; NaN: pliant_style_defaults */
    double threshold = std::numeric_limits<double>::quiet_NaN();
    std::vector<std::string> shown; /* names of the only visible materials; empty: use the threshold */
    std::string info_url;       /* calibration URL for camera_info_manager */
};

struct Parameters {
    pliant_scene scene;
    std::string scan;                       /* path as for pliant_inputs_read */
    std::string scan_root, output_root;     /* empty: services may name no file */
    std::string parent_frame, tissue_frame; /* parent empty: no transform is published */
    Rigid tissue_pose;                      /* pose of the tissue frame in the parent frame */
    /* file with the pose, written by the service register; overrides tissue_pose; empty: none */
    std::string registration;
    /* "FRAME=FILE ...": files with the poses of arm bases, in the format of dVRK's camera registration */
    std::string hand_eye;
    std::string checkpoint;                 /* file from which a restarted node restores the simulation; empty: none */
    double checkpoint_period;               /* [s] */
    std::vector<ToolParameters> tools;
    std::vector<CameraParameters> cameras;
    /* live: steps never wait for background work; planned: results are the same on every machine */
    pliant_background_kind background;
    double tool_max_age;                    /* [s] */
    double tool_hold;                       /* added to tool_max_age for a present tool and a closed jaw [s] */
    double tool_max_pause;                  /* maximum time without poses while /clock stands still [s, wall clock] */
    double jaw_close, jaw_release;          /* [rad] */
    /* cutoff frequency of the low-pass filter for measured poses [Hz]; 0: no filter */
    double pose_filter;
    double wrench_rate;                     /* rate of forces between steps [Hz]; 0: one force per step */
    double wrench_bound;                    /* maximum difference from the force of the last step [N] */
    double slice[3];                        /* axial, coronal, sagittal: fraction of the volume's box */
    /* a brick whose voxels have all changed by less than this is sent only at rest [values of the scan]; NaN: the
     * scan's noise */
    double volume_threshold;
    double volume_low[3], volume_high[3];   /* region of the volume that is sent, LPS [m]; infinite: everything */
    int preview_step;                       /* volume/preview contains every preview_step-th voxel */
};

/* Read the tree of private parameters (a struct; invalid without parameters). The tree is not changed, but XmlRpcValue
 * has no constant access. Every scene option is a parameter of the same path, for example solver/iterations. An unknown
 * parameter is an error whose message suggests the nearest name. In addition to scene options:
 * - files: scene, scan or scan/path, scan_root, output_root, registration, hand_eye, checkpoint, checkpoint_period
 * - frames: parent_frame, tissue_frame, tissue_pose
 * - tools: tools, tool/<name>/{mode,blade,shape,frame,jaw}, tool_max_age, tool_hold, tool_max_pause, jaw_close,
 *   jaw_release, pose_filter, wrench_rate, wrench_bound
 * - cameras: cameras,
 *   camera/<name>/{frame,convention,width,height,field_of_view,rate,near,far,baseline,threshold,shown,info_url}
 * - volume: slice/{axial,coronal,sagittal}, volume_threshold, volume_region/{low,high}, preview_step
 * - other parameters: background, respawn (the program restarts after every exit) */
bool read_parameters(XmlRpc::XmlRpcValue tree, Parameters *out, std::string *why);

} // namespace pliant_ros

#endif
