// Find where a ray meets the visible part of a volume. No Ogre, no ROS.
#ifndef PLIANT_RVIZ_VISIBLE_DEPTH_H
#define PLIANT_RVIZ_VISIBLE_DEPTH_H

#include "rviz/slices.h"

#include <functional>
#include <vector>

namespace pliant_rviz {

// A value at a distance along the ray [m].
using ValueAlongRay = std::function<double(double)>;

// Find the visible depth in a semi-transparent volume: the layer that contributes most light, and in it the depth that
// half of its light comes from (Wiebel, Vos, Foerster and Hege, "WYSIWYP: What You See Is What You Pick", IEEE TVCG
// 18:2236, 2012). Return false if almost nothing is visible.
// @param parts segments of the ray, the nearest first
// @param step [m]
// @param opacity opacity of one step at a distance
bool find_visible_depth(const std::vector<Part> &parts, double step, const ValueAlongRay &opacity, double *distance);

// Find the first intersection with a surface: the value reaches 0, or a segment begins above 0.
bool find_surface(const std::vector<Part> &parts, double step, const ValueAlongRay &above, double *distance);

} // namespace pliant_rviz
#endif
