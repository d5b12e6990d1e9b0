// Find the point under the mouse, and query the node for the tissue there.
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

// Return the mouse ray in the fixed frame.
Ogre::Ray ray_of(const rviz::ViewportMouseEvent &event);

// Return rviz's volume displays, in the order of its list.
std::vector<VolumeDisplay *> volume_displays(rviz::DisplayContext *context);

class Picker {
public:
    // Call the node's service in a separate thread, so that rviz does not block. With several volumes, the nearest one
    // counts.
    // @param threshold surface threshold, used if no volume is shown
    void ask(rviz::DisplayContext *context, const Ogre::Ray &ray, const std::string &service, double threshold);
    bool is_waiting() const { return bool(pick_request_); }
    void forget() { pick_request_.reset(); }
    // Return true once the answer is available; the question then ends.
    // problem: empty if there is tissue
    bool take(pliant::Pick::Response *answer, QString *problem);

private:
    struct PickRequest;
    std::shared_ptr<PickRequest> pick_request_;
};

} // namespace pliant_rviz
#endif
