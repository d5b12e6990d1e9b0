/* Convert camera images and camera parameters to messages. */
#include "pliant/ros/convert.h"

#include <sensor_msgs/distortion_models.h>
#include <sensor_msgs/image_encodings.h>

#include <cmath>
#include <cstring>

namespace pliant_ros {

void camera_from_frame(const Rigid &tissue_from_frame, CameraConvention convention, double aside, pliant_camera *camera)
{
    /* camera axes (right, down, forward) expressed in the frame's axes */
    static const double axes[2][3][3] = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {{0, 1, 0}, {0, 0, -1}, {-1, 0, 0}}};
    for (int column = 0; column < 3; ++column) {
        double axis[3];
        rotate(tissue_from_frame.rotation, axes[convention][column], axis);
        for (int row = 0; row < 3; ++row) camera->pose[4 * row + column] = axis[row];
    }
    for (int row = 0; row < 3; ++row)
        camera->pose[4 * row + 3] = tissue_from_frame.translation[row] + aside * camera->pose[4 * row];
}

void camera_info_message(const pliant_camera &camera, double baseline, sensor_msgs::CameraInfo *out)
{
    out->width = static_cast<uint32_t>(camera.width);
    out->height = static_cast<uint32_t>(camera.height);
    out->distortion_model = sensor_msgs::distortion_models::PLUMB_BOB;
    out->D.assign(5, 0);
    out->K = {{camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1}};
    out->R = {{1, 0, 0, 0, 1, 0, 0, 0, 1}};
    out->P = {{camera.fx, 0, camera.cx, -camera.fx * baseline, 0, camera.fy, camera.cy, 0, 0, 0, 1, 0}};
}

bool camera_from_info(const sensor_msgs::CameraInfo &info, pliant_camera *camera)
{
    const uint32_t maximum = 8192; /* maximum image width and height, as for the parameters */
    if (info.width < 1 || info.height < 1 || info.width > maximum || info.height > maximum) return false;
    if (!(info.P[0] > 1e-3 && info.P[0] < 1e9 && info.P[5] > 1e-3 && info.P[5] < 1e9) || !std::isfinite(info.P[2]) ||
        !std::isfinite(info.P[6]))
        return false;
    camera->width = static_cast<int32_t>(info.width);
    camera->height = static_cast<int32_t>(info.height);
    camera->fx = info.P[0];
    camera->fy = info.P[5];
    camera->cx = info.P[2];
    camera->cy = info.P[6];
    return true;
}

void camera_image_message(const pliant_camera &camera, const std::string &encoding, const void *pixels,
                          sensor_msgs::Image *out)
{
    const size_t bytes = static_cast<size_t>(sensor_msgs::image_encodings::numChannels(encoding) *
                                             sensor_msgs::image_encodings::bitDepth(encoding) / 8);
    out->width = static_cast<uint32_t>(camera.width);
    out->height = static_cast<uint32_t>(camera.height);
    out->encoding = encoding;
    out->is_bigendian = false;
    out->step = static_cast<uint32_t>(bytes * out->width);
    out->data.resize(static_cast<size_t>(out->step) * out->height);
    std::memcpy(out->data.data(), pixels, out->data.size());
}

void camera_points_message(const pliant_camera &camera, CameraConvention convention, const uint8_t *rgb,
                           const float *depth, sensor_msgs::PointCloud2 *out)
{
    out->fields.clear();
    for (const char *name : {"x", "y", "z", "rgb"}) {
        sensor_msgs::PointField field;
        field.name = name;
        field.offset = static_cast<uint32_t>(out->fields.size() * sizeof(float));
        field.datatype = sensor_msgs::PointField::FLOAT32;
        field.count = 1;
        out->fields.push_back(field);
    }
    out->width = static_cast<uint32_t>(camera.width);
    out->height = static_cast<uint32_t>(camera.height);
    out->is_bigendian = false;
    out->is_dense = false;
    out->point_step = 4 * sizeof(float);
    out->row_step = out->point_step * out->width;
    out->data.resize(static_cast<size_t>(out->row_step) * out->height);
    for (size_t pixel = 0; pixel < static_cast<size_t>(out->width) * out->height; ++pixel) {
        const double z = static_cast<double>(depth[pixel]);
        const float right = static_cast<float>((static_cast<double>(pixel % out->width) - camera.cx) / camera.fx * z);
        const float down = static_cast<float>((static_cast<double>(pixel / out->width) - camera.cy) / camera.fy * z),
                    ahead = depth[pixel];
        const uint32_t colour = static_cast<uint32_t>(rgb[3 * pixel]) << 16 |
                                static_cast<uint32_t>(rgb[3 * pixel + 1]) << 8 | rgb[3 * pixel + 2];
        float row[4] = {right, down, ahead, 0};
        if (convention == AMBF) row[0] = -ahead, row[1] = right, row[2] = -down;
        std::memcpy(&row[3], &colour, sizeof colour);
        std::memcpy(&out->data[pixel * out->point_step], row, sizeof row);
    }
}

} // namespace pliant_ros
