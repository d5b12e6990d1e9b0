// Adjust the view so that given points fill it.
#ifndef PLIANT_RVIZ_FIT_VIEW_H
#define PLIANT_RVIZ_FIT_VIEW_H

#include <OgreCamera.h>

#include <vector>

namespace rviz {
class DisplayContext;
}

namespace pliant_rviz {

// Return the distance in front of the centre at which a camera with this orientation sees all points, with a margin
// [m].
double distance_for(const Ogre::Camera &camera, const std::vector<Ogre::Vector3> &points, const Ogre::Vector3 &middle);

// Adjust rviz's current view without changing its direction: its focal point or position, and its distance or scale. A
// view without these properties is turned to the points.
// @param points in the fixed frame
void fit_view(rviz::DisplayContext *context, const std::vector<Ogre::Vector3> &points);

} // namespace pliant_rviz
#endif
