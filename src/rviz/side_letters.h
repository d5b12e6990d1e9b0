// Anatomical sides of a volume. No Ogre, no ROS.
#ifndef PLIANT_RVIZ_SIDE_LETTERS_H
#define PLIANT_RVIZ_SIDE_LETTERS_H

#include "rviz/slices.h"

#include <string>

namespace pliant_rviz {

// Return the letters of a direction in patient axes (LPS): R or L, A or P, I or S, the largest component first. They
// are the letters of DICOM's Patient Orientation (PS3.3 C.7.6.1.1.1), with I and S for its F and H. A direction within
// 15 degrees of an axis has one letter.
std::string side_letters(const Vector &direction);

} // namespace pliant_rviz
#endif
