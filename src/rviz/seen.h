// Where a ray meets what is seen of a volume. No Ogre, no ROS.
#ifndef PLIANT_RVIZ_SEEN_H
#define PLIANT_RVIZ_SEEN_H

#include "rviz/slices.h"

#include <functional>
#include <vector>

namespace pliant_rviz {

// A number at a distance along the ray [m].
using Along = std::function<double(double)>;

// Through what is partly transparent: the layer that the eye gets most light from, after Wiebel, Vos, Foerster and Hege, "WYSIWYP: What You See
// Is What You Pick", IEEE TVCG 18:2236, 2012; in it the depth that half of this light comes from. False: next to nothing is seen.
// @param parts    of the ray, the nearest first
// @param step     [m]
// @param opacity  of a step there
bool find_seen(const std::vector<Part> &parts, double step, const Along &opacity, double *distance);

// The first place where a surface is met: the number reaches 0 there, or a part begins above it.
bool find_surface(const std::vector<Part> &parts, double step, const Along &above, double *distance);

} // namespace pliant_rviz
#endif
