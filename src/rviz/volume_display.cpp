#include "rviz/volume_display.h"

#include "rviz/colour_bar.h"
#include "rviz/fit_view.h"
#include "rviz/material.h"
#include "rviz/side_marks.h"

#include <OgreCamera.h>
#include <OgreSceneNode.h>

#include <pluginlib/class_list_macros.hpp>
#include <ros/message_traits.h>
#include <rviz/display_context.h>
#include <rviz/frame_manager.h>
#include <rviz/properties/bool_property.h>
#include <rviz/properties/color_property.h>
#include <rviz/properties/enum_property.h>
#include <rviz/properties/float_property.h>
#include <rviz/properties/int_property.h>
#include <rviz/properties/ros_topic_property.h>
#include <rviz/properties/string_property.h>
#include <rviz/properties/vector_property.h>
#include <rviz/view_controller.h>
#include <rviz/view_manager.h>

#include <algorithm>
#include <cmath>

namespace pliant_rviz {

enum Mode { SLICES, ISOSURFACE };

// maximum number of bytes uploaded to the graphics card per frame
static const size_t UPLOAD_BYTES = size_t(32) << 20;
// time without motion after which the image is refined [s]
static const float STILL_AFTER = 0.4f;
// time between two requests [s]
static const float ASK_EVERY = 2;
// maximum time of a frame while something moves, and minimum number of slices to reach it [s]
static const double FRAME_TIME = 0.1, MIN_SLICES = 32;

VolumeDisplay::VolumeDisplay() { make_properties(); }

VolumeDisplay::~VolumeDisplay() { unsubscribe(); }

void VolumeDisplay::make_properties()
{
    topic_ = new rviz::RosTopicProperty("Topic", "volume",
                                        QString::fromStdString(ros::message_traits::datatype<pliant::Volume>()),
                                        "pliant/Volume to show.", this, SLOT(change_topic()));
    mode_ = new rviz::EnumProperty("Rendering", "Slices", "Semi-transparent slices, or the surface of one value.", this,
                                   SLOT(change_appearance()));
    mode_->addOption("Slices", SLICES);
    mode_->addOption("Isosurface", ISOSURFACE);
    preset_ = new rviz::EnumProperty("Preset", QString::fromStdString(presets().front().name), "Colours and opacities.",
                                     this, SLOT(change_preset()));
    for (size_t n = 0; n < presets().size(); n++) preset_->addOption(QString::fromStdString(presets()[n].name), int(n));
    points_ = new rviz::StringProperty(
        "Points", "",
        "Points of the transfer function: place in the window (0 to 1), red, green, blue, opacity, with "
        "commas in between, by semicolons; empty: the preset's. The panel Transfer Function edits them with the mouse.",
        this, SLOT(change_points()));
    automatic_ = new rviz::BoolProperty("Automatic", true, "Level, window and isosurface as the preset has them.", this,
                                        SLOT(change_preset()));
    level_ =
        new rviz::FloatProperty("Level", 0, "Middle of the window: the value (CT: Hounsfield) of the middle colour.",
                                this, SLOT(change_window()));
    window_ = new rviz::FloatProperty("Window", 1, "Width of the window.", this, SLOT(change_window()));
    window_->setMin(1e-6f);
    surface_ = new rviz::FloatProperty("Isosurface", 0, "Value of the surface.", this, SLOT(change_window()));
    surface_colour_ = new rviz::ColorProperty("Surface Color", QColor(224, 186, 160), "Colour of the isosurface.", this,
                                              SLOT(change_appearance()));
    opacity_ = new rviz::FloatProperty("Opacity", 1, "Times the preset's opacity; 1 as it is.", this,
                                       SLOT(change_appearance()));
    opacity_->setMin(0);
    opacity_->setMax(10);
    shading_ = new rviz::FloatProperty("Shading", 0.8f, "Light on the surfaces inside the volume: 0 none, 1 full.",
                                       this, SLOT(change_appearance()));
    shading_->setMin(0);
    shading_->setMax(1);
    slices_ = new rviz::IntProperty("Slices", 256, "Slices over the volume's diagonal when nothing moves.", this,
                                    SLOT(change_appearance()));
    slices_moving_ = new rviz::IntProperty("Slices While Moving", 96,
                                           "Most slices while the view or the tissue moves; fewer where "
                                           "they take longer than 0.1 s.",
                                           this, SLOT(change_appearance()));
    for (rviz::IntProperty *count : {slices_, slices_moving_}) {
        count->setMin(8);
        count->setMax(2048);
    }
    make_clip_properties();
    bar_shown_ = new rviz::BoolProperty("Color Bar", true, "Show which value has which colour.", this,
                                        SLOT(change_appearance()));
    sides_shown_ = new rviz::BoolProperty("Patient Sides", true, "Letters at the volume's sides: R L A P S I.", this,
                                          SLOT(change_appearance()));
    fit_ = new rviz::BoolProperty(
        "Fit View", false,
        "A scan that comes first, or another one, fills the view, from the side that it looks from. "
        "Switched on it fits at once.",
        this, SLOT(change_fit()));
    memory_ = new rviz::IntProperty("Texture Memory", 1024,
                                    "Most memory of the texture [MiB]; a larger volume is shown subsampled.", this,
                                    SLOT(change_limits()));
    memory_->setMin(1);
}

void VolumeDisplay::make_clip_properties()
{
    clip_box_ =
        new rviz::BoolProperty("Clip Box", false, "Show a box of the volume only.", this, SLOT(change_appearance()));
    clip_box_->setDisableChildrenIfFalse(true);
    box_low_ = new rviz::VectorProperty("From", Ogre::Vector3(0, 0, 0), "Fractions of the volume along i, j, k.",
                                        clip_box_, SLOT(change_appearance()), this);
    box_high_ = new rviz::VectorProperty("To", Ogre::Vector3(1, 1, 1), "Fractions of the volume along i, j, k.",
                                         clip_box_, SLOT(change_appearance()), this);
    clip_plane_ = new rviz::BoolProperty("Clip Plane", false, "Show what lies on one side of a plane only.", this,
                                         SLOT(change_appearance()));
    clip_plane_->setDisableChildrenIfFalse(true);
    plane_normal_ = new rviz::VectorProperty("Normal", Ogre::Vector3(0, 0, 1),
                                             "Points to the side that is kept; axes of the volume's frame.",
                                             clip_plane_, SLOT(change_appearance()), this);
    plane_point_ =
        new rviz::VectorProperty("Point", Ogre::Vector3(0, 0, 0), "A point of the plane in the volume's frame [m].",
                                 clip_plane_, SLOT(change_appearance()), this);
    cut_away_ =
        new rviz::BoolProperty("Cut Away", false, "Show all but a box of the volume, and so the faces of cuts inside.",
                               this, SLOT(change_appearance()));
    cut_away_->setDisableChildrenIfFalse(true);
    away_low_ = new rviz::VectorProperty("From", Ogre::Vector3(0.5f, 0, 0.5f), "Fractions of the volume along i, j, k.",
                                         cut_away_, SLOT(change_appearance()), this);
    away_high_ = new rviz::VectorProperty("To", Ogre::Vector3(1, 0.5f, 1), "Fractions of the volume along i, j, k.",
                                          cut_away_, SLOT(change_appearance()), this);
}

void VolumeDisplay::onInitialize()
{
    visual_.reset(new VolumeVisual(scene_manager_, scene_node_));
    bar_.reset(new ColourBar(ColourBar::RIGHT));
    sides_.reset(new SideMarks(scene_manager_, scene_node_));
    sides_->hide();
    {
        std::lock_guard<std::mutex> guard(received_.lock);
        received_.limits.edge = longest_texture_edge();
    }
    change_limits();
    change_preset();
}

void VolumeDisplay::load(const rviz::Config &config)
{
    // level and window from the file follow the preset; they are not edits by the user
    loading_ = true;
    Display::load(config);
    loading_ = false;
    change_preset();
}

void VolumeDisplay::setTopic(const QString &topic, const QString &) { topic_->setString(topic); }

void VolumeDisplay::onEnable() { subscribe(); }

void VolumeDisplay::onDisable()
{
    unsubscribe();
    reset();
}

void VolumeDisplay::change_topic()
{
    unsubscribe();
    reset();
    subscribe();
}

void VolumeDisplay::subscribe()
{
    if (!isEnabled() || topic_->getTopicStd().empty()) return;
    whole_wanted_ = false;
    try {
        // boxes must not be lost, so the queue is long; boxes are small, and a whole volume replaces them all
        subscriber_ = threaded_nh_.subscribe(topic_->getTopicStd(), 32, &VolumeDisplay::receive, this,
                                             ros::TransportHints().tcpNoDelay());
        if (!visual_ || !visual_->has_texture()) setStatus(rviz::StatusProperty::Warn, "Volume", "no data yet");
    } catch (const ros::Exception &error) {
        setStatus(rviz::StatusProperty::Error, "Volume", QString("cannot subscribe: ") + error.what());
    }
}

void VolumeDisplay::unsubscribe() { subscriber_.shutdown(); }

void VolumeDisplay::reset()
{
    Display::reset();
    bool subscribed = subscriber_;
    // without the lock, because unsubscribe() waits for receive()
    unsubscribe();
    {
        std::lock_guard<std::mutex> guard(received_.lock);
        received_.image = VolumeImage();
        received_.starts = received_.changed = received_.waits = false;
        received_.error.clear();
        received_.warning.clear();
        received_.messages = received_.refused = received_.lost = 0;
    }
    texture_error_.clear();
    if (visual_) visual_->clear();
    if (bar_) bar_->set_visible(false);
    if (sides_) sides_->hide();
    // rviz resets its displays when time jumps back; a new subscription delivers the current volume even if nothing
    // moves
    if (subscribed) subscribe();
}

static VolumeView view_of(const pliant::Volume &message)
{
    VolumeView view;
    view.scan_id = message.scan_id;
    for (int d = 0; d < 3; d++) {
        view.full_size[d] = message.full_size[d];
        view.box.offset[d] = message.offset[d];
        view.box.size[d] = message.size[d];
    }
    const geometry_msgs::Pose &pose = message.origin;
    view.position = {{pose.position.x, pose.position.y, pose.position.z}};
    view.orientation = {{pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w}};
    view.flipped = message.flipped;
    view.spacing = {{message.spacing.x, message.spacing.y, message.spacing.z}};
    view.encoding = message.encoding;
    view.slope = message.slope;
    view.intercept = message.intercept;
    view.data = message.data.data();
    view.bytes = message.data.size();
    return view;
}

void VolumeDisplay::receive(const pliant::Volume::ConstPtr &message)
{
    VolumeView view = view_of(*message);
    std::string error = check(view);
    std::lock_guard<std::mutex> guard(received_.lock);
    Received &to = received_;
    to.messages++;
    to.changed = true;
    if (!error.empty()) {
        to.refused++;
        to.error = error;
        return;
    }
    bool gap = !to.image.empty() && message->since > to.sequence;
    bool whole = view.box.size == view.full_size;
    VolumeImage::Result result = to.image.put(view, to.limits);
    if (result == VolumeImage::WAITS) {
        to.warning = "waiting for a whole volume: boxes only so far";
        to.waits = true;
        return;
    }
    to.lost = whole ? 0 : gap ? to.lost + message->sequence - to.sequence - 1 : to.lost;
    to.warning = to.lost ? std::to_string(to.lost) + " messages lost: parts are old until the next whole volume" : "";
    to.error.clear();
    to.waits = false;
    to.sequence = message->sequence;
    to.frame = message->header.frame_id;
    to.position = view.position;
    to.orientation = view.orientation;
    to.spacing = view.spacing;
    to.flipped = view.flipped;
    if (result == VolumeImage::WHOLE) to.starts = true;
}

void VolumeDisplay::change_limits()
{
    std::lock_guard<std::mutex> guard(received_.lock);
    received_.limits.bytes = size_t(memory_->getInt()) << 20;
}

void VolumeDisplay::change_preset()
{
    if (loading_) return;
    if (sender() == preset_) points_->setString("");
    take_points();
    window_wanted_ = automatic_->getBool();
    change_appearance();
}

void VolumeDisplay::change_window()
{
    // edited by the user
    if (!loading_ && !window_wanted_) automatic_->setBool(false);
    change_appearance();
}

void VolumeDisplay::take_points()
{
    transfer_ = presets()[size_t(preset_->getOptionInt())];
    std::string error;
    if (!points_->getStdString().empty()) error = points_from_text(points_->getStdString(), &transfer_.points);
    if (error.empty()) deleteStatus("Points");
    else setStatusStd(rviz::StatusProperty::Error, "Points", error);
}

void VolumeDisplay::change_points()
{
    if (loading_) return;
    take_points();
    change_appearance();
}

void VolumeDisplay::set_points(const std::vector<ControlPoint> &points) { points_->setStdString(points_text(points)); }

double VolumeDisplay::low() const { return level_->getFloat() - 0.5 * window_->getFloat(); }

double VolumeDisplay::high() const { return level_->getFloat() + 0.5 * window_->getFloat(); }

std::vector<double> VolumeDisplay::histogram(size_t bins)
{
    std::lock_guard<std::mutex> guard(received_.lock);
    return received_.image.histogram(low(), high(), bins);
}

void VolumeDisplay::change_fit()
{
    fit_wanted_ = !loading_ && fit_->getBool();
    change_appearance();
}

void VolumeDisplay::change_appearance()
{
    has_appearance_changed_ = true;
    if (context_) context_->queueRender();
}

// Take level, window and isosurface from the preset; relative ones need data.
void VolumeDisplay::take_window()
{
    const Preset &chosen = transfer_;
    double unit = 1;
    if (chosen.relative) {
        if (!visual_->has_texture()) return;
        std::lock_guard<std::mutex> guard(received_.lock);
        unit = received_.image.quantile(0.995);
    }
    level_->setFloat(float(unit * chosen.level));
    window_->setFloat(float(std::max(unit * chosen.window, 1e-6)));
    surface_->setFloat(float(unit * chosen.surface));
    window_wanted_ = false;
}

void VolumeDisplay::upload()
{
    std::lock_guard<std::mutex> guard(received_.lock);
    if (received_.starts) {
        texture_error_ = visual_->start(received_.image);
        if (!texture_error_.empty()) {
            // the texture is too large for the card: request the volume again with at most half the size
            received_.limits.bytes = std::max<size_t>(received_.image.bytes() / 2, size_t(1) << 20);
            received_.image = VolumeImage();
            whole_wanted_ = true;
        }
        received_.starts = false;
        window_wanted_ = window_wanted_ || automatic_->getBool();
        has_appearance_changed_ = is_new_ = true;
    }
    if (!visual_->has_texture()) return;
    if (received_.changed) {
        visual_->set_grid(received_.spacing, received_.flipped);
        still_for_ = 0;
    }
    size_t left = UPLOAD_BYTES;
    Box box;
    while (left > 0 && received_.image.next_change(left, box)) {
        visual_->upload(received_.image, box);
        left -= std::min(left, box.voxels() * size_t(received_.image.bits() / 8));
        uploaded_ = true;
    }
}

// Request the whole volume by a new subscription, after data were lost.
void VolumeDisplay::request_whole_volume(float wall_dt)
{
    since_asked_ += wall_dt;
    if (!whole_wanted_ || since_asked_ < ASK_EVERY) return;
    since_asked_ = 0;
    unsubscribe();
    subscribe();
}

bool VolumeDisplay::place()
{
    std::string frame;
    {
        std::lock_guard<std::mutex> guard(received_.lock);
        frame = received_.frame;
        Ogre::Vector3 old_position = volume_position_;
        Ogre::Quaternion old_orientation = volume_orientation_;
        volume_position_ =
            Ogre::Vector3(float(received_.position[0]), float(received_.position[1]), float(received_.position[2]));
        const std::array<double, 4> &q = received_.orientation;
        volume_orientation_ = Ogre::Quaternion(float(q[3]), float(q[0]), float(q[1]), float(q[2]));
        volume_orientation_.normalise();
        // the clip plane is given in the frame, the look in the volume's axes
        if (volume_position_ != old_position || volume_orientation_ != old_orientation) has_appearance_changed_ = true;
    }
    Ogre::Vector3 position;
    Ogre::Quaternion orientation;
    rviz::FrameManager *frames = context_->getFrameManager();
    if (!frames->getTransform(frame, ros::Time(), position, orientation)) {
        std::string error;
        if (!frames->transformHasProblems(frame, ros::Time(), error)) error = "no transform";
        setStatusStd(rviz::StatusProperty::Error, "Transform", "frame [" + frame + "]: " + error);
        visual_->set_visible(false);
        return false;
    }
    setStatus(rviz::StatusProperty::Ok, "Transform", "ok");
    visual_->set_pose(position + orientation * volume_position_, orientation * volume_orientation_);
    return true;
}

void VolumeDisplay::set_appearance(unsigned slices)
{
    VolumeAppearance appearance;
    appearance.isosurface = mode_->getOptionInt() == ISOSURFACE;
    appearance.transfer = transfer_;
    appearance.low = low();
    appearance.high = high();
    appearance.opacity = opacity_->getFloat();
    appearance.shading = shading_->getFloat();
    appearance.surface = surface_->getFloat();
    appearance.surface_colour = surface_colour_->getOgreColor();
    appearance.slices = slices;
    if (clip_box_->getBool())
        for (int d = 0; d < 3; d++) {
            appearance.clip_low[d] = box_low_->getVector()[d];
            appearance.clip_high[d] = box_high_->getVector()[d];
        }
    if (cut_away_->getBool())
        for (int d = 0; d < 3; d++) {
            appearance.away_low[d] = away_low_->getVector()[d];
            appearance.away_high[d] = away_high_->getVector()[d];
        }
    Ogre::Vector3 normal = plane_normal_->getVector();
    if (clip_plane_->getBool() && normal.squaredLength() > 0) {
        // transform from the frame of the message to the volume's axes
        normal = volume_orientation_.Inverse() * normal.normalisedCopy();
        Ogre::Vector3 point = volume_orientation_.Inverse() * (plane_point_->getVector() - volume_position_);
        appearance.planes.push_back({{{normal.x, normal.y, normal.z}}, normal.dotProduct(point)});
    }
    visual_->set_appearance(appearance);
}

bool VolumeDisplay::is_moving()
{
    const Ogre::Camera *camera = context_->getViewManager()->getCurrent()->getCamera();
    // exact comparison: a camera at rest gives identical numbers
    if (camera->getDerivedPosition() != camera_position_ || camera->getDerivedOrientation() != camera_orientation_)
        still_for_ = 0;
    camera_position_ = camera->getDerivedPosition();
    camera_orientation_ = camera->getDerivedOrientation();
    return still_for_ < STILL_AFTER;
}

// Adapt the number of slices to the duration of the last frame.
unsigned VolumeDisplay::slices_while_moving(float wall_dt)
{
    double maximum = std::min(slices_moving_->getInt(), slices_->getInt());
    if (moving_slices_ == 0) moving_slices_ = maximum;
    if (drawn_moving_ && wall_dt > FRAME_TIME) moving_slices_ *= std::max(0.5, FRAME_TIME / wall_dt);
    if (drawn_moving_ && wall_dt < 0.6 * FRAME_TIME) moving_slices_ *= 1.1;
    moving_slices_ = std::min(std::max(moving_slices_, MIN_SLICES), maximum);
    return unsigned(moving_slices_);
}

void VolumeDisplay::update(float wall_dt, float)
{
    if (!visual_ || !context_->getViewManager()->getCurrent()) return;
    still_for_ += wall_dt;
    upload();
    if (window_wanted_) take_window();
    bool moving = is_moving(), placed = visual_->has_texture() && place();
    unsigned slices = moving ? slices_while_moving(wall_dt) : unsigned(slices_->getInt());
    drawn_moving_ = moving;
    if (has_appearance_changed_ || slices != visual_->appearance().slices) set_appearance(slices);
    if (has_appearance_changed_) show_bar();
    if (has_appearance_changed_ || uploaded_) find_visible();
    if (placed) show_sides();
    else sides_->hide();
    has_appearance_changed_ = uploaded_ = false;
    if (placed && (is_new_ || fit_wanted_)) show_in_view();
    if (placed) visual_->draw(context_->getViewManager()->getCurrent()->getCamera());
    report();
    request_whole_volume(wall_dt);
}

// Move a new volume into the view if its centre is near the edge of the view or outside, because scanners have
// arbitrary origins.
void VolumeDisplay::show_in_view()
{
    is_new_ = fit_wanted_ = false;
    if (fit_->getBool()) {
        fit_view(context_, visual_->corners(sides_shown_->getBool() ? SideMarks::REACH : 0));
        return;
    }
    rviz::ViewController *view = context_->getViewManager()->getCurrent();
    const Ogre::Camera *camera = view->getCamera();
    Ogre::Vector3 seen = camera->getViewMatrix() * visual_->middle();
    Ogre::Vector3 place = camera->getProjectionMatrix() * seen; // inside the view if in [-1, 1]
    if (seen.z > 0 || std::max(std::fabs(place.x), std::fabs(place.y)) > 0.8f) view->lookAt(visual_->middle());
}

void VolumeDisplay::find_visible()
{
    if (!visual_->has_texture()) return;
    std::lock_guard<std::mutex> guard(received_.lock);
    visual_->find_visible(received_.image);
}

void VolumeDisplay::show_sides()
{
    const bool shown = sides_shown_->getBool() && visual_->draws();
    if (!shown) sides_->hide();
    else
        sides_->show(visual_->clipped(), visual_->node(), volume_orientation_,
                     context_->getViewManager()->getCurrent()->getCamera()->getDerivedDirection());
}

void VolumeDisplay::show_bar()
{
    const VolumeAppearance &appearance = visual_->appearance();
    bool shown = bar_shown_->getBool() && visual_->has_texture();
    if (shown) {
        bool grey = appearance.isosurface;
        QString title = QString::fromStdString(appearance.transfer.unit.empty() ? getName().toStdString()
                                                                                : appearance.transfer.unit);
        bar_->set(title, appearance.low, appearance.high, [&](double t) {
            if (grey) return QColor::fromRgbF(t, t, t);
            Colour colour = colour_at(appearance.transfer, t);
            return QColor::fromRgbF(colour.r, colour.g, colour.b);
        });
    }
    bar_->set_visible(shown);
}

void VolumeDisplay::report()
{
    std::lock_guard<std::mutex> guard(received_.lock);
    if (!received_.changed) return;
    received_.changed = false;
    whole_wanted_ = whole_wanted_ || received_.waits || received_.lost > 0;
    if (!received_.error.empty()) {
        // also log it once, because the status panel may be closed
        if (received_.error != logged_) ROS_WARN_STREAM("volume display: " << received_.error);
        setStatusStd(rviz::StatusProperty::Error, "Volume",
                     received_.error + " (" + std::to_string(received_.refused) + " messages refused)");
    } else if (!texture_error_.empty())
        setStatusStd(rviz::StatusProperty::Error, "Volume", "too large for the graphics card: " + texture_error_);
    else if (!received_.warning.empty())
        setStatusStd(rviz::StatusProperty::Warn, "Volume", received_.warning);
    else if (!received_.image.empty()) {
        const VolumeImage &image = received_.image;
        Size size = image.full_size();
        std::string text = std::to_string(size[0]) + " x " + std::to_string(size[1]) + " x " + std::to_string(size[2]) +
                           ", " + image.precision() + ", values " + QString::number(image.low(), 'g', 6).toStdString() +
                           " to " + QString::number(image.high(), 'g', 6).toStdString() + ", message " +
                           std::to_string(received_.sequence);
        if (image.not_numbers() > 0) text += ", " + std::to_string(image.not_numbers()) + " voxels are not numbers";
        bool has_warning = image.stride() > 1 || image.not_numbers() > 0;
        setStatusStd(has_warning ? rviz::StatusProperty::Warn : rviz::StatusProperty::Ok, "Volume",
                     (image.stride() > 1 ? "too large for the graphics card, shown subsampled: " : "") + text);
    }
    logged_ = received_.error;
}

bool VolumeDisplay::find_visible_point(const Ogre::Vector3 &origin, const Ogre::Vector3 &direction, double *distance,
                                       double *value)
{
    if (!isEnabled() || !visual_) return false;
    std::lock_guard<std::mutex> guard(received_.lock);
    return visual_->find_visible_point(received_.image, origin, direction, distance, value);
}

} // namespace pliant_rviz

PLUGINLIB_EXPORT_CLASS(pliant_rviz::VolumeDisplay, rviz::Display)
#include "moc_volume_display.cpp" // made by Qt, compiled with this file
