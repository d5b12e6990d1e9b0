#include "ros/output/displacement_output.h"

#include "pliant/ros/convert.h"

#include "ros/sim/realtime_priority.h"

#include <cmath>

namespace pliant_ros {

namespace {

enum { MAX_RATE = 5 /* [Hz] */, MAX_POINTS = 32 /* along an axis */ };

/* Return a grid of fewer, cubic voxels that covers the scan. */
pliant_geometry coarse_grid(const pliant_geometry &scan)
{
    pliant_geometry out = scan;
    double edge = 0, corner[3], middle[3];
    for (int d = 0; d < 3; ++d) edge = std::max(edge, scan.size[d] * scan.spacing[d] / MAX_POINTS);
    for (int d = 0; d < 3; ++d) {
        const double length = scan.size[d] * scan.spacing[d];
        out.size[d] = std::max(1, static_cast<int>(std::lround(length / edge)));
        out.spacing[d] = length / out.size[d];
        corner[d] = 0.5 * out.spacing[d] / scan.spacing[d] - 0.5;
    }
    pliant_geometry_to_world(&scan, corner, middle);
    std::copy(middle, middle + 3, out.origin);
    return out;
}

} // namespace

DisplacementOutput::DisplacementOutput(ros::NodeHandle handle, const Parameters &parameters, Snapshots *snapshots)
    : frame_(parameters.tissue_frame), snapshots_(snapshots)
{
    publisher_ = handle.advertise<sensor_msgs::PointCloud2>("displacement", 1);
    thread_ = std::thread(&DisplacementOutput::run, this);
}

DisplacementOutput::~DisplacementOutput()
{
    stopping_ = true;
    thread_.join();
}

void DisplacementOutput::run()
{
    Snapshots::Reader reader(snapshots_);
    while (!stopping_) {
        const bool wanted = publisher_.getNumSubscribers() > 0;
        reader.want(wanted);
        if (!wanted) {
            problem_.set("");
            std::this_thread::sleep_for(poll_period);
            continue;
        }
        std::shared_ptr<const Snapshot> snapshot = reader.wait(poll_period);
        if (!snapshot || !rate_.due(MAX_RATE)) continue;
        try {
            publish(*snapshot);
            problem_.set("");
        } catch (const std::exception &failed) {
            problem_.set(std::string("no displacement: ") + failed.what());
            ROS_ERROR_THROTTLE(5, "no displacement: %s", failed.what());
        }
    }
}

void DisplacementOutput::publish(const Snapshot &snapshot)
{
    const pliant_geometry grid = coarse_grid(snapshot.loaded->scan->volume.geometry);
    pliant_displacement field{};
    check(pliant_displacement_create(snapshot.loaded->model, snapshot.body.get(), snapshot.positions.data(),
                                     PLIANT_DISPLACEMENT_TISSUE, &grid, &field));
    const std::unique_ptr<pliant_displacement, void (*)(pliant_displacement *)> freed(&field, pliant_displacement_free);
    auto cloud = boost::make_shared<sensor_msgs::PointCloud2>();
    cloud->header.stamp = snapshot.stamp;
    cloud->header.frame_id = frame_;
    displacement_message(field, cloud.get());
    publish_with_priority(publisher_, cloud);
}

} // namespace pliant_ros
