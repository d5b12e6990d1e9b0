// rviz display of the topic `volume`: a medical scan during its deformation.
#ifndef PLIANT_RVIZ_VOLUME_DISPLAY_H
#define PLIANT_RVIZ_VOLUME_DISPLAY_H

#ifndef Q_MOC_RUN
#include "rviz/volume_image.h"
#include "rviz/volume_visual.h"

#include <pliant/Volume.h>
#include <ros/subscriber.h>
#include <rviz/display.h>
#endif

#include <memory>
#include <mutex>

namespace rviz {
class BoolProperty;
class ColorProperty;
class EnumProperty;
class FloatProperty;
class IntProperty;
class RosTopicProperty;
class StringProperty;
class VectorProperty;
}

namespace pliant_rviz {

class ColourBar;
class SideMarks;

class VolumeDisplay : public rviz::Display {
    Q_OBJECT
public:
    VolumeDisplay();
    ~VolumeDisplay() override;

    void load(const rviz::Config &config) override;
    void setTopic(const QString &topic, const QString &datatype) override;
    void reset() override;
    void update(float wall_dt, float ros_dt) override;

    bool is_shown() const { return isEnabled() && visual_ && visual_->has_texture(); }
    // Find where a ray in the fixed frame meets the visible part of the volume [m], and the value there; false: nothing
    // visible.
    bool find_visible_point(const Ogre::Vector3 &origin, const Ogre::Vector3 &direction, double *distance,
                            double *value);

    // The displayed transfer function and its window, for editors.
    const Preset &transfer() const { return transfer_; }
    double low() const;
    double high() const;
    std::vector<double> histogram(size_t bins); // histogram over the window; fractions of the maximum
    void set_points(const std::vector<ControlPoint> &points);

protected:
    void onInitialize() override;
    void onEnable() override;
    void onDisable() override;

private Q_SLOTS:
    void change_topic();
    void change_preset();
    void change_window();
    void change_appearance();
    void change_limits();
    void change_fit();
    void change_points();

private:
    void make_properties();
    void make_clip_properties();
    void subscribe();
    void unsubscribe();
    void receive(const pliant::Volume::ConstPtr &message); // called in rviz's second thread
    void take_window();
    void upload();
    void find_visible();
    void show_in_view();
    void show_sides();
    bool place();
    void request_whole_volume(float wall_dt);
    void show_bar();
    void report();
    void take_points();
    bool is_moving();
    unsigned slices_while_moving(float wall_dt);
    void set_appearance(unsigned slices);

    // data from the receiving thread for update()
    struct Received {
        std::mutex lock;
        TextureLimits limits;
        VolumeImage image;
        bool starts = false, changed = false, waits = false; // waits: for a whole volume
        std::string frame, error, warning;
        std::array<double, 3> position, spacing;
        std::array<double, 4> orientation;
        bool flipped = false;
        uint64_t messages = 0, refused = 0, sequence = 0, lost = 0;
    };
    Received received_;
    Preset transfer_; // the preset, with edited points if any

    ros::Subscriber subscriber_;
    std::unique_ptr<VolumeVisual> visual_;
    std::unique_ptr<ColourBar> bar_;
    std::unique_ptr<SideMarks> sides_;
    std::string texture_error_, logged_;
    bool has_appearance_changed_ = true, window_wanted_ = false, loading_ = false, whole_wanted_ = false,
         uploaded_ = false, is_new_ = false, fit_wanted_ = false;
    bool drawn_moving_ = false;
    double moving_slices_ = 0; // number of slices that this machine draws in time
    Ogre::Vector3 camera_position_ = Ogre::Vector3::ZERO, volume_position_ = Ogre::Vector3::ZERO;
    Ogre::Quaternion camera_orientation_, volume_orientation_; // initially the identity
    float still_for_ = 0, since_asked_ = 0; // [s]

    rviz::RosTopicProperty *topic_;
    rviz::EnumProperty *mode_, *preset_;
    rviz::StringProperty *points_;
    rviz::BoolProperty *automatic_, *clip_box_, *clip_plane_, *cut_away_, *bar_shown_, *sides_shown_, *fit_;
    rviz::FloatProperty *level_, *window_, *opacity_, *shading_, *surface_;
    rviz::ColorProperty *surface_colour_;
    rviz::IntProperty *slices_, *slices_moving_, *memory_;
    rviz::VectorProperty *box_low_, *box_high_, *plane_normal_, *plane_point_, *away_low_, *away_high_;
};

} // namespace pliant_rviz
#endif
