#include "rviz/mesh_display.h"

#include "rviz/colour_bar.h"
#include "rviz/material.h"
#include "rviz/service.h"
#include "rviz/shaders.h"

#include "pliant/scene.h"

#include <OgreCamera.h>
#include <OgreManualObject.h>
#include <OgrePass.h>
#include <OgreSceneManager.h>
#include <OgreSceneNode.h>

#include <dynamic_reconfigure/Reconfigure.h>
#include <pluginlib/class_list_macros.hpp>
#include <rviz/display_context.h>
#include <rviz/frame_manager.h>
#include <rviz/properties/bool_property.h>
#include <rviz/properties/color_property.h>
#include <rviz/properties/enum_property.h>
#include <rviz/properties/float_property.h>
#include <rviz/properties/ros_topic_property.h>
#include <rviz/properties/string_property.h>
#include <rviz/properties/vector_property.h>
#include <rviz/view_controller.h>
#include <rviz/view_manager.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <thread>

namespace pliant_rviz {

enum Mode { SURFACE, WIREFRAME, CUT_AWAY };
enum ColourBy { BY_SCALAR, BY_MATERIAL, BY_ONE_COLOUR, BY_DISPLACEMENT };

static const char *const DISPLACEMENT = "displacement";
// time after the answer within which a state with the requested scalar must arrive [s]
static const double PATIENCE = 1;
// names of the scene option's values
static const char *const SCALARS[] = {
#define SCALAR_NAME(value, name) #name,
    PLIANT_SCALAR_LIST(SCALAR_NAME)
#undef SCALAR_NAME
};

struct MeshDisplay::ScalarRequest {
    dynamic_reconfigure::Reconfigure service;
    std::string name, scalar;
    bool reached = false;
    ros::WallTime answered_at;
    std::atomic<bool> answered{false};
};

MeshDisplay::MeshDisplay() { make_properties(); }

MeshDisplay::~MeshDisplay()
{
    unsubscribe();
    if (!object_) return;
    scene_manager_->destroyManualObject(object_);
    remove_material(face_material_);
    remove_material(line_material_);
}

void MeshDisplay::make_properties()
{
    auto type = [](const std::string &name) { return QString::fromStdString(name); };
    topology_topic_ = new rviz::RosTopicProperty(
        "Topology Topic", "mesh/topology", type(ros::message_traits::datatype<pliant::MeshTopology>()),
        "pliant/MeshTopology: nodes at rest, tetrahedra, surface.", this, SLOT(change_topic()));
    state_topic_ = new rviz::RosTopicProperty("State Topic", "mesh/state",
                                              type(ros::message_traits::datatype<pliant::MeshState>()),
                                              "pliant/MeshState: where the nodes are now.", this, SLOT(change_topic()));
    mode_ =
        new rviz::EnumProperty("Rendering", "Surface", "What is drawn of the mesh.", this, SLOT(change_appearance()));
    mode_->addOption("Surface", SURFACE);
    mode_->addOption("Wireframe", WIREFRAME);
    mode_->addOption("Cut Away", CUT_AWAY);
    plane_normal_ = new rviz::VectorProperty(
        "Cut Normal", Ogre::Vector3(0, 0, 1),
        "Cut Away: tetrahedra on the side that it points to are kept; axes of the mesh's frame.", this,
        SLOT(change_appearance()));
    plane_point_ =
        new rviz::VectorProperty("Cut Point", Ogre::Vector3(0, 0, 0), "A point of the cut in the mesh's frame [m].",
                                 this, SLOT(change_appearance()));
    edges_ = new rviz::BoolProperty("Edges", true, "Draw the edges of the faces too.", this, SLOT(change_appearance()));
    colour_by_ = new rviz::EnumProperty("Color By", "Scalar", "What the colour shows.", this, SLOT(change_colour()));
    colour_by_->addOption("Scalar", BY_SCALAR);
    colour_by_->addOption("Material", BY_MATERIAL);
    colour_by_->addOption("One Color", BY_ONE_COLOUR);
    colour_by_->addOption("Displacement", BY_DISPLACEMENT);
    scalar_ = new rviz::EnumProperty(
        "Scalar", "none",
        "The scalar that the node publishes for each mesh node. The choice applies to all subscribers.", this,
        SLOT(change_scalar()));
    for (const char *name : SCALARS) scalar_->addOption(name);
    scalar_->setShouldBeSaved(false); /* not saved: it is the node's setting */
    node_ = new rviz::StringProperty("Node", "sim", "Name of the node, with which its settings begin.", this);
    colour_ = new rviz::ColorProperty("Color", QColor(200, 150, 130), "Without a scalar or material.", this,
                                      SLOT(change_appearance()));
    opacity_ = new rviz::FloatProperty("Opacity", 1, "0 is not seen, 1 hides what is behind.", this,
                                       SLOT(change_appearance()));
    opacity_->setMin(0);
    opacity_->setMax(1);
    automatic_ = new rviz::BoolProperty("Automatic Range", true, "The colours follow the smallest and largest number.",
                                        this, SLOT(change_appearance()));
    range_low_ = new rviz::FloatProperty("Low", 0, "Number of the first colour.", this, SLOT(change_range()));
    range_high_ = new rviz::FloatProperty("High", 1, "Number of the last colour.", this, SLOT(change_range()));
    legend_ =
        new rviz::BoolProperty("Legend", true, "Show which number has which colour.", this, SLOT(change_appearance()));
}

void MeshDisplay::onInitialize()
{
    std::string name = unique_name("mesh");
    object_ = scene_manager_->createManualObject(name);
    object_->setDynamic(true);
    scene_node_->attachObject(object_);
    face_material_ = make_material(name + "/faces", mesh_vertex_shader, mesh_fragment_shader, true);
    line_material_ = make_material(name + "/lines", mesh_vertex_shader, mesh_fragment_shader, true);
    for (Ogre::Pass *pass : {pass_of(face_material_), pass_of(line_material_)}) {
        pass->setCullingMode(Ogre::CULL_NONE);
        Ogre::GpuProgramParametersSharedPtr numbers = pass->getVertexProgramParameters();
        numbers->setNamedAutoConstant("worldviewproj", Ogre::GpuProgramParameters::ACT_WORLDVIEWPROJ_MATRIX);
        numbers->setNamedAutoConstant("worldview", Ogre::GpuProgramParameters::ACT_WORLDVIEW_MATRIX);
    }
    // depth bias, so that faces do not hide their own edges
    pass_of(face_material_)->setDepthBias(-1, -1);
    bar_.reset(new ColourBar(ColourBar::LEFT));
}

// derive the topic of states from the topic of the topology
void MeshDisplay::setTopic(const QString &topic, const QString &)
{
    topology_topic_->setString(topic);
    state_topic_->setString(topic.left(topic.lastIndexOf('/') + 1) + "state");
}

void MeshDisplay::onEnable() { subscribe(); }

void MeshDisplay::onDisable()
{
    unsubscribe();
    reset();
}

void MeshDisplay::change_topic()
{
    unsubscribe();
    reset();
    subscribe();
}

void MeshDisplay::subscribe()
{
    if (!isEnabled() || topology_topic_->getTopicStd().empty() || state_topic_->getTopicStd().empty()) return;
    try {
        topology_subscriber_ =
            update_nh_.subscribe(topology_topic_->getTopicStd(), 2, &MeshDisplay::receive_topology, this);
        state_subscriber_ = update_nh_.subscribe(state_topic_->getTopicStd(), 1, &MeshDisplay::receive_state, this,
                                                 ros::TransportHints().tcpNoDelay());
        setStatus(rviz::StatusProperty::Warn, "Topology", "no data yet");
        setStatus(rviz::StatusProperty::Warn, "State", "no data yet");
    } catch (const ros::Exception &error) {
        setStatus(rviz::StatusProperty::Error, "Topology", QString("cannot subscribe: ") + error.what());
    }
}

void MeshDisplay::unsubscribe()
{
    topology_subscriber_.shutdown();
    state_subscriber_.shutdown();
}

void MeshDisplay::reset()
{
    Display::reset();
    bool subscribed = topology_subscriber_;
    unsubscribe();
    mesh_.clear();
    early_.reset();
    last_.reset();
    dropped_ = states_ = 0;
    range_known_ = changed_ = false;
    if (object_) object_->clear();
    if (bar_) bar_->set_visible(false);
    // rviz resets its displays when time jumps back; only new subscribers receive the topology
    if (subscribed) subscribe();
}

void MeshDisplay::receive_topology(const pliant::MeshTopology::ConstPtr &message)
{
    Topology topology;
    topology.scan_id = message->scan_id;
    topology.revision = message->revision;
    topology.rest = message->rest_nodes;
    topology.rest_parent = message->rest_parent;
    topology.tetrahedra = message->tetrahedra;
    topology.triangles = message->triangles;
    topology.first_cut = message->first_cut;
    topology.vertex_tetrahedron = message->vertex_tetrahedron;
    topology.vertex_weight = message->vertex_weight;
    topology.vertex_material = message->vertex_material;
    topology.material = message->material;
    std::string error = check(topology);
    if (!error.empty()) {
        setStatusStd(rviz::StatusProperty::Error, "Topology",
                     "revision " + std::to_string(message->revision) + " refused: " + error);
        return;
    }
    const bool same_scan = !mesh_.empty() && mesh_.topology().scan_id == topology.scan_id;
    mesh_.start(std::move(topology));
    frame_ = message->header.frame_id;
    setStatusStd(rviz::StatusProperty::Ok, "Topology",
                 "revision " + std::to_string(message->revision) + ": " +
                     std::to_string(message->rest_nodes.size() / 3) + " nodes, " +
                     std::to_string(message->tetrahedra.size() / 4) + " tetrahedra");
    if (!same_scan) range_known_ = false; // after a cut the colours keep their meaning
    last_.reset();
    change_appearance();
    if (early_ && early_->revision == message->revision) receive_state(pliant::MeshState::ConstPtr(early_));
}

void MeshDisplay::receive_state(const pliant::MeshState::ConstPtr &message)
{
    // a state may arrive before its topology, which is larger
    early_ = message->revision != mesh_.topology().revision ? message : nullptr;
    const bool moved = colour_by_->getOptionInt() == BY_DISPLACEMENT;
    const std::string name = moved ? DISPLACEMENT : message->scalar_name;
    const MeshShape::Result result =
        mesh_.put(message->revision, message->nodes,
                  moved ? displacements(mesh_.topology().rest, message->nodes) : message->scalar);
    states_++;
    if (result == MeshShape::SHOWN) {
        frame_ = message->header.frame_id;
        last_ = message;
        if (scalar_name_ != name) {
            range_known_ = false;
            bar_changed_ = true;
        }
        scalar_name_ = name;
        follow_scalar();
        follow_range();
        changed_ = true;
    } else {
        dropped_++;
    }
    report_state(result, message->revision);
}

void MeshDisplay::report_state(MeshShape::Result result, uint32_t revision)
{
    std::string reason;
    if (result == MeshShape::NO_TOPOLOGY) reason = "no topology yet";
    else if (result == MeshShape::OTHER_REVISION)
        reason = "revision " + std::to_string(revision) + " differs from the revision of the topology (" +
                 std::to_string(mesh_.topology().revision) + ")";
    else if (result == MeshShape::WRONG_SIZE) reason = "the number of nodes or of scalars does not match the topology";
    else if (result == MeshShape::NOT_FINITE) reason = "nodes hold NaN or infinite numbers";
    std::string count = std::to_string(states_) + " states, " + std::to_string(dropped_) + " dropped";
    setStatusStd(result == MeshShape::SHOWN ? rviz::StatusProperty::Ok : rviz::StatusProperty::Warn, "State",
                 reason.empty() ? count : "dropped: " + reason + "; " + count);
}

// Adapt the automatic range: widen immediately and narrow slowly, so that colours do not flicker.
void MeshDisplay::follow_range()
{
    if (!automatic_->getBool()) {
        low_ = range_low_->getFloat();
        high_ = range_high_->getFloat();
        return;
    }
    float low, high;
    if (!mesh_.scalar_range(&low, &high)) return;
    if (scalar_name_ == "volume_ratio") {
        // symmetric around 1, which means no compression
        float maximum = std::max(std::fabs(high - 1), std::fabs(low - 1));
        low = 1 - maximum;
        high = 1 + maximum;
    }
    low_ = !range_known_ || low < low_ ? low : low_ + 0.05f * (low - low_);
    high_ = !range_known_ || high > high_ ? high : high_ + 0.05f * (high - high_);
    if (!(high_ > low_)) high_ = low_ + std::max(1e-6f, 1e-6f * std::fabs(low_));
    range_known_ = true;
}

void MeshDisplay::change_range()
{
    automatic_->setBool(false);
    change_appearance();
}

void MeshDisplay::change_appearance()
{
    follow_range();
    changed_ = bar_changed_ = true;
    if (context_) context_->queueRender();
}

void MeshDisplay::change_colour()
{
    change_appearance();
    if (!last_) return;
    states_--; /* the same state is received again */
    receive_state(pliant::MeshState::ConstPtr(last_));
}

// Show the scalar that the node publishes, except while a request for another one is pending.
void MeshDisplay::follow_scalar()
{
    if (scalar_request_ && scalar_request_->answered) {
        const bool granted = last_->scalar_name == scalar_request_->scalar ||
                             (scalar_request_->scalar == SCALARS[0] && last_->scalar_name.empty());
        if (!scalar_request_->reached)
            setStatusStd(rviz::StatusProperty::Error, "Scalar",
                         "no answer from " + scalar_request_->name + ": see the property Node");
        const bool refused = ros::WallTime::now() - scalar_request_->answered_at > ros::WallDuration(PATIENCE);
        if (granted || refused || !scalar_request_->reached) scalar_request_.reset();
    }
    if (scalar_request_) return;
    following_ = true;
    scalar_->setStdString(last_->scalar_name.empty() ? SCALARS[0] : last_->scalar_name);
    following_ = false;
}

void MeshDisplay::change_scalar()
{
    if (following_) return;
    deleteStatus("Scalar");
    /* the node's services have the same namespace as the mesh topics */
    const std::string topic = state_topic_->getTopicStd(), space = topic.substr(0, topic.rfind("mesh/state"));
    scalar_request_ = std::make_shared<ScalarRequest>();
    scalar_request_->name = space + node_->getStdString() + "/set_parameters";
    scalar_request_->scalar = scalar_->getStdString();
    dynamic_reconfigure::StrParameter choice;
    choice.name = "scalar";
    choice.value = scalar_request_->scalar;
    scalar_request_->service.request.config.strs.push_back(choice);
    std::shared_ptr<ScalarRequest> wish = scalar_request_;
    std::thread([wish] {
        wish->reached = call_service(wish->name, &wish->service);
        wish->answered_at = ros::WallTime::now();
        wish->answered = true;
    }).detach();
}

bool MeshDisplay::coloured_by_scalar() const
{
    const int by = colour_by_->getOptionInt();
    return (by == BY_SCALAR || by == BY_DISPLACEMENT) && !mesh_.scalar().empty();
}

Rgb MeshDisplay::scalar_colour(double t) const
{
    return scalar_name_ == "volume_ratio" ? diverging_colour(t) : sequential_colour(t);
}

Rgb MeshDisplay::colour_of(uint32_t node, uint16_t material) const
{
    if (coloured_by_scalar()) {
        float value = mesh_.scalar_of(node);
        if (!std::isfinite(value)) return {{0.5, 0.5, 0.5}};
        return scalar_colour((value - low_) / (high_ - low_));
    }
    if (colour_by_->getOptionInt() == BY_MATERIAL && !mesh_.topology().material.empty())
        return material_colour(material);
    QColor one = colour_->getColor();
    return {{one.redF(), one.greenF(), one.blueF()}};
}

void MeshDisplay::add_section(const Shape &shape, const std::vector<uint32_t> &indices, bool lines)
{
    if (indices.empty()) return;
    bool dark = lines && mode_->getOptionInt() != WIREFRAME;
    const Ogre::MaterialPtr &material = lines ? line_material_ : face_material_;
    object_->estimateVertexCount(shape.nodes.size());
    object_->estimateIndexCount(indices.size());
    object_->begin(material->getName(),
                   lines ? Ogre::RenderOperation::OT_LINE_LIST : Ogre::RenderOperation::OT_TRIANGLE_LIST,
                   RESOURCE_GROUP);
    for (size_t n = 0; n < shape.nodes.size(); n++) {
        const float *x = &shape.vertices[3 * n], *normal = &shape.normals[3 * n];
        Rgb colour = colour_of(shape.nodes[n], shape.material[n]);
        double shade = dark ? 0.35 : 1;
        object_->position(x[0], x[1], x[2]);
        object_->normal(normal[0], normal[1], normal[2]);
        object_->colour(float(shade * colour[0]), float(shade * colour[1]), float(shade * colour[2]));
    }
    for (uint32_t index : indices) object_->index(index);
    object_->end();
}

void MeshDisplay::draw()
{
    object_->clear();
    if (mesh_.empty()) return;
    int mode = mode_->getOptionInt();
    Shape shape;
    Ogre::Vector3 normal = plane_normal_->getVector(), point = plane_point_->getVector();
    if (mode == CUT_AWAY && normal.squaredLength() > 0)
        shape = mesh_.cut({{{normal.x, normal.y, normal.z}}, normal.dotProduct(point)});
    else
        shape = mesh_.surface();
    float opacity = opacity_->getFloat();
    for (Ogre::Pass *pass : {pass_of(face_material_), pass_of(line_material_)}) {
        bool lit = pass == pass_of(face_material_);
        pass->setSceneBlending(opacity < 0.999f ? Ogre::SBT_TRANSPARENT_ALPHA : Ogre::SBT_REPLACE);
        pass->setDepthWriteEnabled(opacity >= 0.999f);
        Ogre::GpuProgramParametersSharedPtr numbers = pass->getFragmentProgramParameters();
        numbers->setNamedConstant("opacity", opacity);
        numbers->setNamedConstant("lit", lit ? 1.0f : 0.0f);
    }
    if (mode != WIREFRAME) add_section(shape, shape.triangles, false);
    if (mode == WIREFRAME || edges_->getBool()) add_section(shape, shape.edges, true);
}

void MeshDisplay::show_bar()
{
    bool shown = legend_->getBool() && coloured_by_scalar();
    float range = std::fabs(high_ - low_);
    if (shown &&
        (bar_changed_ || std::fabs(low_ - bar_low_) > 0.01f * range || std::fabs(high_ - bar_high_) > 0.01f * range)) {
        const QString unit = QString::fromUtf8(scalar_unit(scalar_name_));
        const QString title =
            QString::fromStdString(scalar_name_).replace('_', ' ') + (unit.isEmpty() ? "" : " [" + unit + "]");
        bar_->set(title, low_, high_, [this](double t) {
            Rgb colour = scalar_colour(t);
            return QColor::fromRgbF(colour[0], colour[1], colour[2]);
        });
        bar_low_ = low_;
        bar_high_ = high_;
        bar_changed_ = false;
    }
    bar_->set_visible(shown);
}

bool MeshDisplay::place()
{
    Ogre::Vector3 position;
    Ogre::Quaternion orientation;
    rviz::FrameManager *frames = context_->getFrameManager();
    bool found = frames->getTransform(frame_, ros::Time(), position, orientation);
    if (found) {
        setStatus(rviz::StatusProperty::Ok, "Transform", "ok");
        scene_node_->setPosition(position);
        scene_node_->setOrientation(orientation);
    } else {
        std::string error;
        if (!frames->transformHasProblems(frame_, ros::Time(), error)) error = "no transform";
        setStatusStd(rviz::StatusProperty::Error, "Transform", "frame [" + frame_ + "]: " + error);
    }
    object_->setVisible(found);
    return found;
}

void MeshDisplay::update(float, float)
{
    if (!object_ || mesh_.empty() || !place() || !context_->getViewManager()->getCurrent()) return;
    const Ogre::Camera *camera = context_->getViewManager()->getCurrent()->getCamera();
    float orthographic = camera->getProjectionType() == Ogre::PT_ORTHOGRAPHIC ? 1.0f : 0.0f;
    for (const Ogre::MaterialPtr &material : {face_material_, line_material_})
        pass_of(material)->getFragmentProgramParameters()->setNamedConstant("orthographic", orthographic);
    if (!changed_) return;
    changed_ = false;
    draw();
    show_bar();
}

} // namespace pliant_rviz

PLUGINLIB_EXPORT_CLASS(pliant_rviz::MeshDisplay, rviz::Display)
#include "moc_mesh_display.cpp" // made by Qt, compiled with this file
