#include "rviz/side_marks.h"

#include "rviz/side_letters.h"

#include <OgreSceneNode.h>

#include <rviz/ogre_helpers/movable_text.h>

#include <cmath>

namespace pliant_rviz {

// fractions of the box's diagonal
static const double LETTER_HEIGHT = 0.05, AWAY = 0.04;
const double SideMarks::REACH = AWAY + 0.5 * LETTER_HEIGHT;
// cosine of the angle to the view direction above which a side faces the viewer
static const float FACING = 0.85f;

SideMarks::SideMarks(Ogre::SceneManager *manager, Ogre::SceneNode *parent) : manager_(manager)
{
    for (Mark &mark : marks_) {
        mark.node = parent->createChildSceneNode();
        mark.text.reset(new rviz::MovableText("?"));
        mark.text->setTextAlignment(rviz::MovableText::H_CENTER, rviz::MovableText::V_CENTER);
        mark.text->showOnTop();
        mark.node->attachObject(mark.text.get());
    }
}

SideMarks::~SideMarks()
{
    for (Mark &mark : marks_) {
        mark.node->detachAllObjects();
        manager_->destroySceneNode(mark.node);
    }
}

void SideMarks::show(const Bounds &box, const Ogre::SceneNode &volume, const Ogre::Quaternion &to_patient,
                     const Ogre::Vector3 &ahead)
{
    double diagonal = 0;
    for (size_t d = 0; d < 3; d++) diagonal += std::pow(box.high[d] - box.low[d], 2);
    diagonal = std::sqrt(diagonal);
    for (size_t side = 0; side < 6; side++) {
        const size_t axis = side / 2;
        const double sign = side % 2 ? 1 : -1;
        Ogre::Vector3 direction = Ogre::Vector3::ZERO, place;
        direction[axis] = float(sign);
        for (size_t d = 0; d < 3; d++) place[d] = float(0.5 * (box.low[d] + box.high[d]));
        place[axis] = float((side % 2 ? box.high : box.low)[axis] + sign * AWAY * diagonal);
        marks_[side].node->setVisible(std::fabs((volume.getOrientation() * direction).dotProduct(ahead)) < FACING);
        direction = to_patient * direction;
        marks_[side].node->setPosition(volume.getPosition() + volume.getOrientation() * place);
        marks_[side].text->setCaption(side_letters({{direction.x, direction.y, direction.z}}));
        marks_[side].text->setCharacterHeight(float(LETTER_HEIGHT * diagonal));
    }
}

void SideMarks::hide()
{
    for (Mark &mark : marks_) mark.node->setVisible(false);
}

} // namespace pliant_rviz
