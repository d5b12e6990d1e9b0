/* One eye of a camera: its topics and its calibration. */
#ifndef PLIANT_ROS_OUTPUT_CAMERA_EYE_H
#define PLIANT_ROS_OUTPUT_CAMERA_EYE_H

#include "ros/params/params.h"
#include "ros/sim/snapshot.h"

#include <ros/node_handle.h>
#ifdef PLIANT_WITH_IMAGE_TRANSPORT
#include <image_transport/image_transport.h>
#endif
#ifdef PLIANT_WITH_CAMERA_INFO
#include <camera_info_manager/camera_info_manager.h>
#endif

namespace pliant_ros {

/* Use image_transport where it is installed, so that subscribers can request compressed images. */
#ifdef PLIANT_WITH_IMAGE_TRANSPORT
using ImagePublisher = image_transport::Publisher;
#else
using ImagePublisher = ros::Publisher;
#endif

class CameraEye {
public:
    /* @param side left, right, or empty for a monocular camera */
    CameraEye(ros::NodeHandle handle, const CameraParameters &parameters, const std::string &side);

    bool is_wanted() const;
    /* Render the subscribed images and publish them.
     * @param style defaults: pliant_style_defaults
     * Throws Failure. */
    void render_images(pliant_view *view, const LoadedModel &loaded, const Rigid &tissue_from_frame,
                       const ros::Time &stamp, pliant_style style);

private:
    pliant_camera camera() const;
    void publish_info(const ros::Time &stamp);
    void apply(const LoadedModel &loaded, pliant_style *style) const;

    const CameraParameters parameters_;
    const double aside_; /* offset of the eye to the right of the frame [m] */
    ImagePublisher image_, depth_, label_;
    ros::Publisher info_, depth_info_, points_;
#ifdef PLIANT_WITH_CAMERA_INFO
    std::unique_ptr<camera_info_manager::CameraInfoManager> calibration_;
#endif
};

} // namespace pliant_ros

#endif
