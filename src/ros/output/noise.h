/* Estimate the noise of a scan. */
#ifndef PLIANT_ROS_OUTPUT_NOISE_H
#define PLIANT_ROS_OUTPUT_NOISE_H

#include "pliant/scan.h"

namespace pliant_ros {

/* Return the standard deviation of a scan's noise in values of the scan; 0 if it has no noise. Thread-safe. The
 * estimate is the median absolute second difference along the first axis, divided by the same quantity for white noise
 * with standard deviation 1. Consecutive voxels with equal values are ignored, because clipped air and padding have no
 * noise. Edges raise the estimate: by 15 % if one of eight voxels lies at an edge. */
double noise_of(const pliant_volume &scan);

} // namespace pliant_ros

#endif
