/* A recorded session as arrays, for who learns from it: what tools did and felt, where they went next, what cameras saw. */
#ifndef PLIANT_ROS_RECORD_EXPORT_H
#define PLIANT_ROS_RECORD_EXPORT_H

#include <rosbag/bag.h>

#include <string>

namespace pliant_ros {

/* Into a folder that is there, fps rows a second; every load and reset begins an episode. A row is what was newest by its time:
 *   times.npy (s since the start of the bag), episodes.npy (number, from 0), steps.npy (as in Step)
 *   state.npy   of each tool its pose in the tissue's frame, jaw, what it holds, and the wrench in its own axes; 0 while it is absent. grasped: a blob
 *               of nodes is tied to it (ContactState); jaws that hold by friction (grasp/kind contact) leave it 0: closed and the wrench tell
 *   action.npy  of each tool pose and jaw of the episode's next row; the last row's are its own
 *   image_NAME.npy  of each recorded topic of pictures, each once: pictures x height x width, of colours also x 3 (red, green, blue)
 *   index_NAME.npy  which of them a row shows, from 0
 *   columns.json    names of the columns of state and action, and of the pictures
 * Returns what was written, for a person. Throws Failure. */
std::string export_numpy(const rosbag::Bag &bag, const std::string &name, int fps, const std::string &folder);

} // namespace pliant_ros

#endif
