// What the mouse points at: the place that is seen there, and what the node knows of the tissue in it.
#ifndef PLIANT_RVIZ_PICKER_H
#define PLIANT_RVIZ_PICKER_H

#include <OgreRay.h>
#include <QString>
#include <pliant/Pick.h>

#include <memory>
#include <string>
#include <vector>

namespace rviz {
class DisplayContext;
class DisplayGroup;
class ViewportMouseEvent;
}

namespace pliant_rviz {

class VolumeDisplay;

// In the fixed frame.
Ogre::Ray ray_of(const rviz::ViewportMouseEvent &event);

// The volume displays of rviz, in the order of its list.
std::vector<VolumeDisplay *> volume_displays(rviz::DisplayContext *context);

class Picker {
public:
    // Ask the node's service in a thread of its own: rviz must not wait for it. Of several volumes the one that is met first counts.
    // @param threshold  value of the surface that is met where no volume is shown
    void ask(rviz::DisplayContext *context, const Ogre::Ray &ray, const std::string &service, double threshold);
    bool asks() const { return bool(question_); }
    void forget() { question_.reset(); }
    // Once there is an answer, true, and from then on it asks no more. problem: empty where there is tissue.
    bool take(pliant::Pick::Response *answer, QString *problem);

private:
    struct Question;
    std::shared_ptr<Question> question_;
};

} // namespace pliant_rviz
#endif
