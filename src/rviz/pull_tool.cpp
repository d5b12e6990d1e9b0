#include "rviz/pull_tool.h"

#include "rviz/material.h"

#include <OgreCamera.h>
#include <OgreManualObject.h>
#include <OgreMaterialManager.h>
#include <OgreMath.h>
#include <OgrePass.h>
#include <OgrePlane.h>
#include <OgreSceneManager.h>
#include <OgreSceneNode.h>
#include <OgreViewport.h>

#include <pluginlib/class_list_macros.hpp>
#include <rviz/display_context.h>
#include <rviz/frame_manager.h>
#include <rviz/properties/float_property.h>
#include <rviz/properties/string_property.h>
#include <rviz/view_controller.h>
#include <rviz/view_manager.h>
#include <rviz/viewport_mouse_event.h>

#include <cmath>

namespace pliant_rviz {

PullTool::PullTool() { shortcut_key_ = 'u'; }

PullTool::~PullTool()
{
    if (!mark_) return;
    scene_manager_->destroyManualObject(mark_);
    Ogre::MaterialManager::getSingleton().remove(mark_material_->getName());
}

void PullTool::onInitialize()
{
    setName("Pull");
    setDescription("Left button: grasp the visible tissue and pull it; the wheel moves it towards you or away. "
                   "Alt: turn the view.");
    namespace_ = new rviz::StringProperty("Namespace", "", "Of the tissue's topics and services; empty: as rviz's own.",
                                          getPropertyContainer(), SLOT(connect_topics()), this);
    tool_name_ = new rviz::StringProperty("Tool", "mouse", "Name of the tool that the mouse is; the node must know it.",
                                          getPropertyContainer(), SLOT(connect_topics()), this);
    threshold_ = new rviz::FloatProperty(
        "Threshold", -300, "Value of the surface that is picked where no volume display is shown (CT: Hounsfield).",
        getPropertyContainer());
    std::string name = unique_name("pull");
    mark_material_ = Ogre::MaterialManager::getSingleton().create(name, RESOURCE_GROUP);
    pass_of(mark_material_)->setLightingEnabled(false);
    pass_of(mark_material_)->setDepthCheckEnabled(false);
    pass_of(mark_material_)->setDepthWriteEnabled(false);
    pass_of(mark_material_)->setCullingMode(Ogre::CULL_NONE);
    mark_ = scene_manager_->createManualObject(name);
    mark_->setDynamic(true);
    mark_->setRenderQueueGroup(Ogre::RENDER_QUEUE_9);
    mark_->setVisible(false);
    scene_manager_->getRootSceneNode()->attachObject(mark_);
}

std::string PullTool::topic(const std::string &name) const
{
    std::string space = namespace_->getStdString();
    return space.empty() ? name : space + "/" + name;
}

// Connect on activation: the first tool of a configuration is active before its properties are read.
void PullTool::connect_topics()
{
    if (!active_) return;
    connected_ = false;
    try {
        ros::NodeHandle handle;
        robot_.connect(topic(tool_name_->getStdString()), context_->getFixedFrame().toStdString());
        contact_ =
            handle.subscribe(topic(tool_name_->getStdString() + "/contact"), 1, &PullTool::receive_contact, this);
        connected_ = true;
    } catch (const ros::Exception &error) {
        setStatus(QString("No such topics: ") + error.what());
    }
}

void PullTool::activate()
{
    active_ = true;
    connect_topics();
    setStatus("Grasp the tissue with the left button.");
}

void PullTool::deactivate()
{
    active_ = false;
    let_go();
    contact_.shutdown();
}

void PullTool::take_answer()
{
    pliant::Pick::Response answer;
    QString problem;
    if (!picker_.take(&answer, &problem)) return;
    if (!problem.isEmpty()) {
        setStatus(problem);
        return;
    }
    picked_ = tip_ = held_ = Ogre::Vector3(float(answer.point.x), float(answer.point.y), float(answer.point.z));
    has_held_point_ = gripped_ = false;
    robot_.connect(topic(tool_name_->getStdString()), context_->getFixedFrame().toStdString());
    robot_.grasp({{picked_.x, picked_.y, picked_.z}});
    setStatus(
        QString("Pulling tetrahedron %1, value %2.").arg(answer.tetrahedron).arg(double(answer.intensity), 0, 'f', 0));
}

void PullTool::let_go()
{
    picker_.forget();
    robot_.release();
    draw();
}

// Move the tip in the plane through itself that faces the viewer.
void PullTool::drag(rviz::ViewportMouseEvent &event)
{
    view_direction_ = event.viewport->getCamera()->getDerivedDirection();
    Ogre::Vector3 eye = event.viewport->getCamera()->getDerivedPosition();
    if (event.wheel_delta != 0)
        tip_ -= view_direction_ * (float(event.wheel_delta) / 120 * 0.01f * (tip_ - eye).length());
    Ogre::Ray ray = ray_of(event);
    std::pair<bool, Ogre::Real> hit = ray.intersects(Ogre::Plane(view_direction_, tip_));
    if (hit.first) tip_ = ray.getPoint(hit.second);
    robot_.move({{tip_.x, tip_.y, tip_.z}});
    draw();
}

int PullTool::processMouseEvent(rviz::ViewportMouseEvent &event)
{
    if (event.leftDown() && !event.alt() && !robot_.holding() && !picker_.is_waiting() && connected_) {
        picker_.ask(context_, ray_of(event), topic("pick"), threshold_->getFloat());
        return Render;
    }
    if (event.leftUp() && (robot_.holding() || picker_.is_waiting())) {
        let_go();
        return Render;
    }
    if (robot_.holding()) {
        drag(event);
        return Render;
    }
    if (!picker_.is_waiting() && context_->getViewManager()->getCurrent())
        context_->getViewManager()->getCurrent()->handleMouseEvent(event);
    return 0;
}

void PullTool::receive_contact(const pliant::ContactState::ConstPtr &message)
{
    if (!robot_.holding()) return;
    robot_.set_tool_state(message->present, message->grasped);
    if (gripped_ && !message->grasped) {
        let_go();
        setStatus("The grip was lost: the node did not hear from the tool in time (~tool_max_age).");
    }
    gripped_ = message->grasped;
    if (!message->grasped) return;
    Ogre::Vector3 position;
    Ogre::Quaternion orientation;
    has_held_point_ =
        context_->getFrameManager()->getTransform(message->header.frame_id, ros::Time(), position, orientation);
    held_ = position + orientation * Ogre::Vector3(float(message->held_point.x), float(message->held_point.y),
                                                   float(message->held_point.z));
}

void PullTool::draw()
{
    const rviz::ViewController *view = context_->getViewManager()->getCurrent();
    mark_->setVisible(robot_.holding() && view);
    if (!robot_.holding() || !view) return;
    const Ogre::Camera *camera = view->getCamera();
    // 0.8 % of the distance to the viewer
    float radius = camera->getProjectionType() == Ogre::PT_PERSPECTIVE
                       ? 0.008f * (tip_ - camera->getDerivedPosition()).length()
                       : 0.005f;
    Ogre::Vector3 right = radius * camera->getDerivedRight(), up = radius * camera->getDerivedUp();
    const Ogre::ColourValue yellow(1.0f, 0.85f, 0.1f);
    mark_->clear();
    mark_->begin(mark_material_->getName(), Ogre::RenderOperation::OT_LINE_LIST, RESOURCE_GROUP);
    for (const Ogre::Vector3 &end : {has_held_point_ ? held_ : picked_, tip_}) {
        mark_->position(end);
        mark_->colour(yellow);
    }
    mark_->end();
    mark_->begin(mark_material_->getName(), Ogre::RenderOperation::OT_TRIANGLE_FAN, RESOURCE_GROUP);
    for (int n = 0; n < 24; n++) {
        float angle = float(n) * Ogre::Math::TWO_PI / 24;
        mark_->position(tip_ + std::cos(angle) * right + std::sin(angle) * up);
        mark_->colour(yellow);
    }
    mark_->end();
    setStatus(QString("Pulled by %1 mm.").arg(1000 * double((tip_ - picked_).length()), 0, 'f', 1));
}

void PullTool::update(float, float)
{
    take_answer();
    if (robot_.holding()) draw();
}

} // namespace pliant_rviz

PLUGINLIB_EXPORT_CLASS(pliant_rviz::PullTool, rviz::Tool)
#include "moc_pull_tool.cpp" // made by Qt, compiled with this file
