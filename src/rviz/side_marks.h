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

    // Beside a box in the axes of a volume that lies on this node [m]; sides that face the viewer, or away, have none.
    // @param to_patient  from these axes to the patient's
    // @param ahead       direction of the view in the fixed frame
    void show(const Bounds &box, const Ogre::SceneNode &volume, const Ogre::Quaternion &to_patient, const Ogre::Vector3 &ahead);
    void hide();
    // How far letters reach beyond a box: part of its diagonal.
    static const double REACH;

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
