// rviz display of mesh/topology and mesh/state: the deformed tetrahedral mesh, coloured by a scalar of each node.
#ifndef PLIANT_RVIZ_MESH_DISPLAY_H
#define PLIANT_RVIZ_MESH_DISPLAY_H

#ifndef Q_MOC_RUN
#include "rviz/mesh_shape.h"

#include <OgreMaterial.h>
#include <pliant/MeshState.h>
#include <pliant/MeshTopology.h>
#include <ros/subscriber.h>
#include <rviz/display.h>
#endif

#include <memory>

namespace Ogre {
class ManualObject;
}

namespace rviz {
class BoolProperty;
class ColorProperty;
class EnumProperty;
class FloatProperty;
class RosTopicProperty;
class StringProperty;
class VectorProperty;
}

namespace pliant_rviz {

class ColourBar;

class MeshDisplay : public rviz::Display {
    Q_OBJECT
public:
    MeshDisplay();
    ~MeshDisplay() override;

    void setTopic(const QString &topic, const QString &datatype) override;
    void reset() override;
    void update(float wall_dt, float ros_dt) override;

protected:
    void onInitialize() override;
    void onEnable() override;
    void onDisable() override;

private Q_SLOTS:
    void change_topic();
    void change_appearance();
    void change_range();
    void change_colour();
    void change_scalar();

private:
    void make_properties();
    void subscribe();
    void unsubscribe();
    void receive_topology(const pliant::MeshTopology::ConstPtr &message);
    void receive_state(const pliant::MeshState::ConstPtr &message);
    void follow_scalar();
    void report_state(MeshShape::Result result, uint32_t revision);
    void follow_range();
    void draw();
    void add_section(const Shape &shape, const std::vector<uint32_t> &indices, bool lines);
    void show_bar();
    bool place();
    Rgb colour_of(uint32_t node, uint16_t material) const;
    Rgb scalar_colour(double t) const;
    bool coloured_by_scalar() const;

    struct ScalarRequest; // a request to the node, sent in a separate thread

    ros::Subscriber topology_subscriber_, state_subscriber_;
    MeshShape mesh_;
    pliant::MeshState::ConstPtr early_; // a state whose topology has not arrived yet
    pliant::MeshState::ConstPtr last_;  // last shown state
    std::shared_ptr<ScalarRequest> scalar_request_;
    std::string frame_, scalar_name_;
    bool changed_ = false, bar_changed_ = false, range_known_ = false, following_ = false;
    uint64_t dropped_ = 0, states_ = 0;
    float low_ = 0, high_ = 1; // current range of the colours
    float bar_low_ = 0, bar_high_ = 0;

    Ogre::ManualObject *object_ = nullptr;
    Ogre::MaterialPtr face_material_, line_material_;
    std::unique_ptr<ColourBar> bar_;

    rviz::RosTopicProperty *topology_topic_, *state_topic_;
    rviz::EnumProperty *mode_, *colour_by_, *scalar_;
    rviz::StringProperty *node_;
    rviz::ColorProperty *colour_;
    rviz::FloatProperty *opacity_, *range_low_, *range_high_;
    rviz::BoolProperty *edges_, *automatic_, *legend_;
    rviz::VectorProperty *plane_normal_, *plane_point_;
};

} // namespace pliant_rviz
#endif
