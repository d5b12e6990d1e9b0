/* Export a recorded session as arrays for robot learning: tool motions, forces, and camera images. */
#ifndef PLIANT_ROS_RECORD_EXPORT_H
#define PLIANT_ROS_RECORD_EXPORT_H

#include <rosbag/bag.h>

#include <string>

namespace pliant_ros {

/* Write arrays to an existing folder at fps rows per second. Each load or reset starts an episode. A row contains the
 * most recent values at its time.
 *   times.npy       seconds since the start of the bag
 *   episodes.npy    episode number, from 0
 *   steps.npy       step number as in the Step message
 *   state.npy       for each tool: pose in the tissue frame, jaw, contact, and wrench in tool axes; 0 while it is
 *                   absent. grasped is 1 for a grasp constraint (ContactState) and 0 for jaws that hold by friction
 *                   (grasp/kind contact)
 *   action.npy      for each tool: pose and jaw of the episode's next row; the last row repeats its own
 *   image_NAME.npy  for each image topic: pictures x height x width, for colour images also x 3 (red, green, blue)
 *   index_NAME.npy  index of the picture that a row shows, from 0
 *   columns.json    column names of state and action, and names of the image topics
 * Return a summary for the user. Throws Failure. */
std::string export_numpy(const rosbag::Bag &bag, const std::string &name, int fps, const std::string &folder);

} // namespace pliant_ros

#endif
