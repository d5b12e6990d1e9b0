// Where the sides of a volume lie in the patient. No Ogre, no ROS.
#ifndef PLIANT_RVIZ_PATIENT_H
#define PLIANT_RVIZ_PATIENT_H

#include "rviz/slices.h"

#include <string>

namespace pliant_rviz {

// Letters of a direction in the patient's axes (LPS): R or L, A or P, I or S, the most prominent first, as DICOM's Patient Orientation has
// them (PS3.3 C.7.6.1.1.1; its F and H are I and S here). What is less than 15 degrees off an axis has one letter.
std::string side_letters(const Vector &direction);

} // namespace pliant_rviz
#endif
