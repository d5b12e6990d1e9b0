// rviz tool: grasp the visible tissue with the mouse and pull ([H] 3.2).
#ifndef PLIANT_RVIZ_PULL_TOOL_H
#define PLIANT_RVIZ_PULL_TOOL_H

#ifndef Q_MOC_RUN
#include "rviz/mouse_robot.h"
#include "rviz/picker.h"

#include <OgreMaterial.h>
#include <OgreQuaternion.h>
#include <pliant/ContactState.h>
#include <ros/subscriber.h>
#include <rviz/tool.h>
#endif

namespace Ogre {
class ManualObject;
class Viewport;
}

namespace rviz {
class FloatProperty;
class StringProperty;
}

namespace pliant_rviz {

class PullTool : public rviz::Tool {
    Q_OBJECT
public:
    PullTool();
    ~PullTool() override;

    void activate() override;
    void deactivate() override;
    int processMouseEvent(rviz::ViewportMouseEvent &event) override;
    void update(float wall_dt, float ros_dt) override;

protected:
    void onInitialize() override;

private Q_SLOTS:
    void connect_topics();

private:
    std::string topic(const std::string &name) const;
    void take_answer();
    void drag(rviz::ViewportMouseEvent &event);
    void let_go();
    void receive_contact(const pliant::ContactState::ConstPtr &message);
    void draw();

    Picker picker_;
    MouseRobot robot_;
    ros::Subscriber contact_;
    Ogre::Vector3 picked_, tip_, held_, view_direction_;
    bool has_held_point_ = false, gripped_ = false, active_ = false, connected_ = false;

    // line from the grasped point to the tip, and a disc at the tip; drawn over everything
    Ogre::ManualObject *mark_ = nullptr;
    Ogre::MaterialPtr mark_material_;
    rviz::StringProperty *namespace_, *tool_name_;
    rviz::FloatProperty *threshold_;
};

} // namespace pliant_rviz
#endif
