#include "ros/output/camera_eye.h"

#include "ros/sim/realtime_priority.h"

#include <sensor_msgs/image_encodings.h>

#include <cmath>

namespace pliant_ros {

namespace {

ImagePublisher advertise(ros::NodeHandle &handle, const std::string &topic)
{
#ifdef PLIANT_WITH_IMAGE_TRANSPORT
    return image_transport::ImageTransport(handle).advertise(topic, 1);
#else
    return handle.advertise<sensor_msgs::Image>(topic, 1);
#endif
}

void send(ImagePublisher &publisher, const pliant_camera &camera, const std_msgs::Header &header,
          const std::string &encoding, const void *pixels)
{
    if (publisher.getNumSubscribers() == 0) return;
    auto image = boost::make_shared<sensor_msgs::Image>();
    image->header = header;
    camera_image_message(camera, encoding, pixels, image.get());
    publish_with_priority(publisher, image);
}

} // namespace

CameraEye::CameraEye(ros::NodeHandle handle, const CameraParameters &parameters, const std::string &side)
    : parameters_(parameters), aside_(side == "right" ? parameters.baseline : 0)
{
    ros::NodeHandle own(handle, parameters.name + (side.empty() ? "" : "/" + side));
    image_ = advertise(own, "image_raw");
    depth_ = advertise(own, "depth/image_rect");
    label_ = advertise(own, "label/image_raw");
    info_ = own.advertise<sensor_msgs::CameraInfo>("camera_info", 1, true);
    depth_info_ = own.advertise<sensor_msgs::CameraInfo>("depth/camera_info", 1, true);
    points_ = own.advertise<sensor_msgs::PointCloud2>("points", 1);
#ifdef PLIANT_WITH_CAMERA_INFO
    /* Without a file name, the manager would load any file in ~/.ros with this camera's name. */
    if (!parameters.info_url.empty())
        calibration_.reset(new camera_info_manager::CameraInfoManager(
            own, parameters.name + (side.empty() ? "" : "_" + side), parameters.info_url));
#else
    if (!parameters.info_url.empty())
        ROS_WARN("~camera/%s/info_url is not read: this was built without camera_info_manager",
                 parameters.name.c_str());
#endif
    publish_info(ros::Time::now());
}

bool CameraEye::is_wanted() const
{
    return image_.getNumSubscribers() > 0 || depth_.getNumSubscribers() > 0 || label_.getNumSubscribers() > 0 ||
           points_.getNumSubscribers() > 0;
}

pliant_camera CameraEye::camera() const
{
    pliant_camera camera;
    pliant_camera_of_view(parameters_.width, parameters_.height, parameters_.field_of_view * M_PI / 180, &camera);
    camera.near = parameters_.near;
    camera.far = parameters_.far;
#ifdef PLIANT_WITH_CAMERA_INFO
    if (calibration_ && calibration_->isCalibrated()) camera_from_info(calibration_->getCameraInfo(), &camera);
#endif
    return camera;
}

void CameraEye::publish_info(const ros::Time &stamp)
{
    sensor_msgs::CameraInfo info;
    camera_info_message(camera(), aside_, &info);
    info.header.stamp = stamp;
    info.header.frame_id = parameters_.frame;
    info_.publish(info);
    depth_info_.publish(info);
}

void CameraEye::apply(const LoadedModel &loaded, pliant_style *style) const
{
    const pliant_material_table *materials = pliant_model_get_materials(loaded.model);
    if (std::isfinite(parameters_.threshold)) style->threshold = static_cast<float>(parameters_.threshold);
    style->by_label = !parameters_.shown.empty();
    if (!style->by_label) return;
    std::fill(style->shown, style->shown + PLIANT_NUM_LABELS, uint8_t(0));
    for (const std::string &name : parameters_.shown) {
        uint32_t m = 0;
        while (m < materials->num_materials && name != materials->materials[m].name) ++m;
        if (m == materials->num_materials)
            throw Failure(PLIANT_ERROR_ARGUMENT,
                          "~camera/" + parameters_.name + "/shown: there is no material " + name);
        style->shown[m + 1] = 1;
    }
}

void CameraEye::render_images(pliant_view *view, const LoadedModel &loaded, const Rigid &tissue_from_frame,
                              const ros::Time &stamp, pliant_style style)
{
    const CameraConvention convention = parameters_.ambf ? AMBF : OPTICAL;
    const bool points = points_.getNumSubscribers() > 0;
    pliant_camera seen = camera();
    camera_from_frame(tissue_from_frame, convention, aside_, &seen);
    apply(loaded, &style);
    const size_t pixels = static_cast<size_t>(seen.width) * static_cast<size_t>(seen.height);
    std::vector<uint8_t> rgb(points || image_.getNumSubscribers() > 0 ? 3 * pixels : 0),
        label(label_.getNumSubscribers() > 0 ? pixels : 0);
    std::vector<float> depth(points || depth_.getNumSubscribers() > 0 ? pixels : 0);
    const pliant_image image = {rgb.empty() ? nullptr : rgb.data(), depth.empty() ? nullptr : depth.data(),
                                label.empty() ? nullptr : label.data()};
    check(pliant_view_render(view, &seen, &style, &image));

    std_msgs::Header header;
    header.stamp = stamp;
    header.frame_id = parameters_.frame;
    publish_info(stamp);
    /* Subscribers that connect during rendering receive the next image. */
    if (!rgb.empty()) send(image_, seen, header, sensor_msgs::image_encodings::RGB8, rgb.data());
    if (!depth.empty()) send(depth_, seen, header, sensor_msgs::image_encodings::TYPE_32FC1, depth.data());
    if (!label.empty()) send(label_, seen, header, sensor_msgs::image_encodings::TYPE_8UC1, label.data());
    if (!points) return;
    auto cloud = boost::make_shared<sensor_msgs::PointCloud2>();
    cloud->header = header;
    camera_points_message(seen, convention, rgb.data(), depth.data(), cloud.get());
    publish_with_priority(points_, cloud);
}

} // namespace pliant_ros
