#include "rviz/fit_view.h"

#include <OgreViewport.h>

#include <rviz/display_context.h>
#include <rviz/frame_manager.h>
#include <rviz/properties/float_property.h>
#include <rviz/properties/vector_property.h>
#include <rviz/view_controller.h>
#include <rviz/view_manager.h>

#include <algorithm>
#include <cmath>

namespace pliant_rviz {

// fraction of the view to fill
static const double FILLED = 0.9;

double distance_for(const Ogre::Camera &camera, const std::vector<Ogre::Vector3> &points, const Ogre::Vector3 &middle)
{
    const double up = std::tan(0.5 * camera.getFOVy().valueRadians()) * FILLED, aside = up * camera.getAspectRatio();
    double distance = 0;
    for (const Ogre::Vector3 &point : points) {
        const Ogre::Vector3 from = point - middle;
        const double ahead = from.dotProduct(camera.getDerivedDirection());
        distance = std::max({distance, std::fabs(from.dotProduct(camera.getDerivedRight())) / aside - ahead,
                             std::fabs(from.dotProduct(camera.getDerivedUp())) / up - ahead});
    }
    return distance;
}

// Return the scale, in pixels per metre, at which an orthographic camera shows all points.
static double scale_for(const Ogre::Camera &camera, const std::vector<Ogre::Vector3> &points,
                        const Ogre::Vector3 &middle)
{
    double aside = 1e-6, up = 1e-6;
    for (const Ogre::Vector3 &point : points) {
        aside = std::max<double>(aside, std::fabs((point - middle).dotProduct(camera.getDerivedRight())));
        up = std::max<double>(up, std::fabs((point - middle).dotProduct(camera.getDerivedUp())));
    }
    const Ogre::Viewport *port = camera.getViewport();
    return 0.5 * FILLED * std::min(port->getActualWidth() / aside, port->getActualHeight() / up);
}

// Transform a point from the fixed frame to the frame of the view's properties.
static Ogre::Vector3 in_target_frame(rviz::DisplayContext *context, rviz::ViewController *view,
                                     const Ogre::Vector3 &point)
{
    const QString frame = view->subProp("Target Frame")->getValue().toString();
    Ogre::Vector3 position;
    Ogre::Quaternion orientation;
    if (frame.isEmpty() || frame.startsWith('<') ||
        !context->getFrameManager()->getTransform(frame.toStdString(), ros::Time(), position, orientation))
        return point;
    return orientation.Inverse() * (point - position);
}

void fit_view(rviz::DisplayContext *context, const std::vector<Ogre::Vector3> &points)
{
    rviz::ViewController *view = context->getViewManager()->getCurrent();
    const Ogre::Camera &camera = *view->getCamera();
    if (points.empty() || !camera.getViewport()) return;
    Ogre::Vector3 low = points[0], high = points[0];
    for (const Ogre::Vector3 &point : points) {
        low.makeFloor(point);
        high.makeCeil(point);
    }
    const Ogre::Vector3 middle = 0.5 * (low + high);
    const double distance = distance_for(camera, points, middle);
    auto *focus = dynamic_cast<rviz::VectorProperty *>(view->subProp("Focal Point"));
    auto *away = dynamic_cast<rviz::FloatProperty *>(view->subProp("Distance"));
    auto *place = dynamic_cast<rviz::VectorProperty *>(view->subProp("Position"));
    auto *scale = dynamic_cast<rviz::FloatProperty *>(view->subProp("Scale"));
    if (focus && away) {
        focus->setVector(in_target_frame(context, view, middle));
        away->setFloat(float(distance));
    } else if (place) {
        place->setVector(in_target_frame(context, view, middle - float(distance) * camera.getDerivedDirection()));
    } else {
        if (scale) scale->setFloat(float(scale_for(camera, points, middle)));
        view->lookAt(middle);
    }
    context->queueRender();
}

} // namespace pliant_rviz
