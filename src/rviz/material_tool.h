// rviz tool that shows the material under the mouse and its properties. Edited properties are changed in the
// simulation.
#ifndef PLIANT_RVIZ_MATERIAL_TOOL_H
#define PLIANT_RVIZ_MATERIAL_TOOL_H

#ifndef Q_MOC_RUN
#include "rviz/picker.h"

#include <pliant/Session.h>
#include <pliant/SetMaterials.h>
#include <ros/subscriber.h>
#include <rviz/tool.h>
#endif

#include <memory>

namespace rviz {
class BoolProperty;
class FloatProperty;
class StringProperty;
}

namespace pliant_rviz {

class MaterialTool : public rviz::Tool {
    Q_OBJECT
public:
    MaterialTool();

    void activate() override;
    void deactivate() override;
    int processMouseEvent(rviz::ViewportMouseEvent &event) override;
    void update(float wall_dt, float ros_dt) override;

protected:
    void onInitialize() override;

private Q_SLOTS:
    void subscribe();
    void change_material();

private:
    struct Change; // a request to the node, sent in a separate thread

    std::string topic(const std::string &name) const;
    void receive_session(const pliant::Session::ConstPtr &message);
    void show_material();
    void take_answer();

    Picker picker_;
    std::shared_ptr<Change> change_;
    ros::Subscriber session_;
    std::string materials_, chosen_; // current table (YAML), and name of the selected material
    bool active_ = false, showing_ = false;

    rviz::StringProperty *namespace_, *material_;
    rviz::FloatProperty *threshold_, *young_modulus_, *poisson_ratio_, *density_, *toughness_;
    rviz::BoolProperty *fixed_;
};

} // namespace pliant_rviz
#endif
