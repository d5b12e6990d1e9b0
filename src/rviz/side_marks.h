// Letters at the sides of a volume: R L A P S I.
#ifndef PLIANT_RVIZ_SIDE_MARKS_H
#define PLIANT_RVIZ_SIDE_MARKS_H

#include "rviz/slices.h"

#include <OgreQuaternion.h>
#include <OgreSceneManager.h>

#include <array>
#include <memory>

namespace Ogre {
class SceneNode;
}

namespace rviz {
class MovableText;
}

namespace pliant_rviz {

class SideMarks {
public:
    SideMarks(Ogre::SceneManager *manager, Ogre::SceneNode *parent);
    ~SideMarks();
    SideMarks(const SideMarks &) = delete;
    SideMarks &operator=(const SideMarks &) = delete;

    // Beside a box in the axes of a volume that lies on this node [m]. to_patient: from these axes to the patient's.
    void set(const Bounds &box, const Ogre::SceneNode &volume, const Ogre::Quaternion &to_patient);
    void set_visible(bool visible);

private:
    struct Mark {
        Ogre::SceneNode *node;
        std::unique_ptr<rviz::MovableText> text;
    };
    Ogre::SceneManager *manager_;
    std::array<Mark, 6> marks_; // low and high along each axis
};

} // namespace pliant_rviz
#endif
