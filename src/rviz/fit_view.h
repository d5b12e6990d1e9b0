// A view that is filled by what is to be seen.
#ifndef PLIANT_RVIZ_FIT_VIEW_H
#define PLIANT_RVIZ_FIT_VIEW_H

#include <OgreCamera.h>

#include <vector>

namespace rviz {
class DisplayContext;
}

namespace pliant_rviz {

// How far before the middle of some points a camera that looks as this one does sees all of them, with a margin [m].
double distance_for(const Ogre::Camera &camera, const std::vector<Ogre::Vector3> &points, const Ogre::Vector3 &middle);

// rviz's current view, from the side that it looks from: its focal point, or its own place, its distance or scale. A view without any of
// these turns to the points.
// @param points  in the fixed frame
void fit_view(rviz::DisplayContext *context, const std::vector<Ogre::Vector3> &points);

} // namespace pliant_rviz
#endif
