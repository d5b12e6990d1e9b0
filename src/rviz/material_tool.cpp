#include "rviz/material_tool.h"

#include "material/material.h"
#include "rviz/service.h"

#include <pluginlib/class_list_macros.hpp>
#include <ros/node_handle.h>
#include <rviz/display_context.h>
#include <rviz/properties/bool_property.h>
#include <rviz/properties/float_property.h>
#include <rviz/properties/string_property.h>
#include <rviz/view_controller.h>
#include <rviz/view_manager.h>
#include <rviz/viewport_mouse_event.h>

#include <atomic>
#include <thread>

namespace pliant_rviz {

struct MaterialTool::Change {
    pliant::SetMaterials service;
    std::string name;
    bool reached = false;
    std::atomic<bool> answered{false};
};

namespace {

struct MaterialTable {
    pliant_material_table table{};
    explicit MaterialTable(const std::string &yaml)
    {
        pliant_material_table_parse(yaml.c_str(), "the session", &table);
    }
    ~MaterialTable() { pliant_material_table_free(&table); }
    MaterialTable(const MaterialTable &) = delete;
    MaterialTable &operator=(const MaterialTable &) = delete;
    pliant_material *find(const std::string &name)
    {
        for (uint32_t n = 0; n < table.num_materials; n++)
            if (name == table.materials[n].name) return &table.materials[n];
        return nullptr;
    }
    std::string text() const
    {
        std::string out(pliant_material_table_text(&table, 0, nullptr), '\0');
        pliant_material_table_text(&table, out.size() + 1, &out[0]);
        return out;
    }
};

} // namespace

MaterialTool::MaterialTool() { shortcut_key_ = 'a'; }

void MaterialTool::onInitialize()
{
    setName("Material");
    setDescription(
        "Left button: which material is seen there. Its numbers are below Tool Properties; those that are changed are "
        "the simulation's from then on. Alt: turn the view.");
    rviz::Property *all = getPropertyContainer();
    namespace_ = new rviz::StringProperty("Namespace", "", "Of the tissue's topics and services; empty: as rviz's own.",
                                          all, SLOT(subscribe()), this);
    threshold_ = new rviz::FloatProperty(
        "Threshold", -300, "Value of the surface that is met where no volume display is shown (CT: Hounsfield).", all);
    material_ = new rviz::StringProperty("Material", "", "That was clicked at.", all);
    material_->setReadOnly(true);
    auto number = [&](const char *name, const char *text) {
        rviz::FloatProperty *made = new rviz::FloatProperty(name, 0, text, all, SLOT(change_material()), this);
        made->setMin(0);
        return made;
    };
    young_modulus_ = number("Young's Modulus", "[Pa]");
    poisson_ratio_ = number("Poisson Ratio", "0 to 0.499");
    density_ = number("Density", "[kg/m3]");
    toughness_ = number("Toughness", "Work that it takes to part an area [J/m2].");
    fixed_ = new rviz::BoolProperty("Fixed", false, "Does not move, as bone.", all, SLOT(change_material()), this);
    for (rviz::Property *each :
         {(rviz::Property *)material_, (rviz::Property *)young_modulus_, (rviz::Property *)poisson_ratio_,
          (rviz::Property *)density_, (rviz::Property *)toughness_, (rviz::Property *)fixed_})
        each->setShouldBeSaved(false);
}

std::string MaterialTool::topic(const std::string &name) const
{
    const std::string space = namespace_->getStdString();
    return space.empty() ? name : space + "/" + name;
}

void MaterialTool::subscribe()
{
    if (!active_) return;
    try {
        session_ = ros::NodeHandle().subscribe(topic("session"), 1, &MaterialTool::receive_session, this);
    } catch (const ros::Exception &error) {
        setStatus(QString("No such topic: ") + error.what());
    }
}

void MaterialTool::activate()
{
    active_ = true;
    subscribe();
    setStatus("Click at the tissue.");
}

void MaterialTool::deactivate()
{
    active_ = false;
    picker_.forget();
    session_.shutdown();
}

void MaterialTool::receive_session(const pliant::Session::ConstPtr &message)
{
    materials_ = message->materials;
    show_material();
}

int MaterialTool::processMouseEvent(rviz::ViewportMouseEvent &event)
{
    if (event.leftDown() && !event.alt()) {
        if (!picker_.is_waiting()) picker_.ask(context_, ray_of(event), topic("pick"), threshold_->getFloat());
        return Render;
    }
    /* pass only rotation and zoom to the view: with other events it would overwrite the status text */
    const bool turns =
        event.alt() || event.middle() || event.right() || event.middleUp() || event.rightUp() || event.wheel_delta != 0;
    if (turns && context_->getViewManager()->getCurrent())
        context_->getViewManager()->getCurrent()->handleMouseEvent(event);
    return 0;
}

void MaterialTool::show_material()
{
    MaterialTable now(materials_);
    const pliant_material *material = now.find(chosen_);
    if (!material) return;
    showing_ = true;
    material_->setStdString(chosen_);
    young_modulus_->setFloat(float(material->young_modulus));
    poisson_ratio_->setFloat(float(material->poisson_ratio));
    density_->setFloat(float(material->density));
    toughness_->setFloat(float(material->toughness));
    fixed_->setBool(material->fixed);
    showing_ = false;
}

void MaterialTool::take_answer()
{
    pliant::Pick::Response answer;
    QString problem;
    if (!picker_.take(&answer, &problem)) return;
    MaterialTable now(materials_);
    if (problem.isEmpty() && answer.material >= now.table.num_materials)
        problem = "The node has not published its materials yet.";
    if (!problem.isEmpty()) {
        setStatus(problem);
        return;
    }
    chosen_ = now.table.materials[answer.material].name;
    show_material();
    setStatus(QString("%1, value %2.").arg(QString::fromStdString(chosen_)).arg(double(answer.intensity), 0, 'f', 0));
}

void MaterialTool::change_material()
{
    MaterialTable next(materials_);
    pliant_material *material = next.find(chosen_);
    if (showing_ || !material) return;
    /* only the edited property: properties have single precision */
    if (sender() == young_modulus_) material->young_modulus = young_modulus_->getFloat();
    if (sender() == poisson_ratio_) material->poisson_ratio = poisson_ratio_->getFloat();
    if (sender() == density_) material->density = density_->getFloat();
    if (sender() == toughness_) material->toughness = toughness_->getFloat();
    if (sender() == fixed_) material->fixed = fixed_->getBool();
    change_ = std::make_shared<Change>();
    change_->name = topic("set_materials");
    change_->service.request.yaml = next.text();
    setStatus(QString("%1: a model with it is built.").arg(QString::fromStdString(chosen_)));
    std::shared_ptr<Change> change = change_;
    std::thread([change] {
        change->reached = call_service(change->name, &change->service);
        change->answered = true;
    }).detach();
}

void MaterialTool::update(float, float)
{
    take_answer();
    if (!change_ || !change_->answered) return;
    const std::shared_ptr<Change> change = change_;
    change_.reset();
    if (!change->reached)
        setStatus(QString::fromStdString("There is no answer from the service " + change->name + "."));
    else setStatus(QString::fromStdString(change->service.response.message));
    if (!change->reached || !change->service.response.success) show_material(); /* show the unchanged material */
}

} // namespace pliant_rviz

PLUGINLIB_EXPORT_CLASS(pliant_rviz::MaterialTool, rviz::Tool)
#include "moc_material_tool.cpp" // made by Qt, compiled with this file
