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

    // Show the letters around a box in the axes of a volume's scene node [m]. Sides that face the viewer, or the
    // opposite direction, have no letter.
    // @param to_patient rotation from these axes to the patient's axes
    // @param ahead view direction in the fixed frame
    void show(const Bounds &box, const Ogre::SceneNode &volume, const Ogre::Quaternion &to_patient,
              const Ogre::Vector3 &ahead);
    void hide();
    // Extent of the letters beyond the box, as a fraction of its diagonal.
    static const double REACH;

private:
    struct Mark {
        Ogre::SceneNode *node;
        std::unique_ptr<rviz::MovableText> text;
    };
    Ogre::SceneManager *manager_;
    std::array<Mark, 6> marks_; // low and high side of each axis
};

} // namespace pliant_rviz
#endif
