#include "rviz/picker.h"

#include "rviz/service.h"
#include "rviz/volume_display.h"

#include <OgreCamera.h>
#include <OgreViewport.h>

#include <rviz/display_context.h>
#include <rviz/display_group.h>
#include <rviz/viewport_mouse_event.h>

#include <atomic>
#include <limits>
#include <thread>

namespace pliant_rviz {

// maximum distance from the seen point to the nearest tissue; a cut or pull may be one frame old [m]
static const double PICKED_DEPTH = 0.01;

struct Picker::PickRequest {
    pliant::Pick service;
    std::string name;
    bool hits_visible_part = true; // whether the ray meets anything visible
    bool reached = false;          // whether the service exists
    std::atomic<bool> answered{false};
};

Ogre::Ray ray_of(const rviz::ViewportMouseEvent &event)
{
    return event.viewport->getCamera()->getCameraToViewportRay(float(event.x) / float(event.viewport->getActualWidth()),
                                                               float(event.y) /
                                                                   float(event.viewport->getActualHeight()));
}

static void find_volumes(rviz::DisplayGroup *group, std::vector<VolumeDisplay *> *out)
{
    for (int n = 0; n < group->numDisplays(); n++) {
        rviz::Display *display = group->getDisplayAt(n);
        if (VolumeDisplay *volume = dynamic_cast<VolumeDisplay *>(display)) out->push_back(volume);
        if (rviz::DisplayGroup *inner = dynamic_cast<rviz::DisplayGroup *>(display)) find_volumes(inner, out);
    }
}

std::vector<VolumeDisplay *> volume_displays(rviz::DisplayContext *context)
{
    std::vector<VolumeDisplay *> out;
    find_volumes(context->getRootDisplayGroup(), &out);
    return out;
}

void Picker::ask(rviz::DisplayContext *context, const Ogre::Ray &ray, const std::string &service, double threshold)
{
    pick_request_ = std::make_shared<PickRequest>();
    pick_request_->name = service;
    pliant::Pick::Request &request = pick_request_->service.request;
    request.header.frame_id = context->getFixedFrame().toStdString();
    request.origin.x = ray.getOrigin().x;
    request.origin.y = ray.getOrigin().y;
    request.origin.z = ray.getOrigin().z;
    request.direction.x = ray.getDirection().x;
    request.direction.y = ray.getDirection().y;
    request.direction.z = ray.getDirection().z;
    request.threshold = float(threshold);
    bool shown = false;
    double nearest = std::numeric_limits<double>::infinity(), distance, value;
    for (VolumeDisplay *volume : volume_displays(context)) {
        shown = shown || volume->is_shown();
        if (volume->find_visible_point(ray.getOrigin(), ray.getDirection(), &distance, &value) && distance < nearest)
            nearest = distance;
    }
    if (shown && nearest == std::numeric_limits<double>::infinity()) {
        pick_request_->hits_visible_part = false;
        pick_request_->answered = true;
        return;
    }
    if (shown) {
        request.threshold = -std::numeric_limits<float>::max();
        request.near = nearest;
        request.far = nearest + PICKED_DEPTH;
    }
    std::shared_ptr<PickRequest> question = pick_request_;
    std::thread([question] {
        question->reached = call_service(question->name, &question->service);
        question->answered = true;
    }).detach();
}

bool Picker::take(pliant::Pick::Response *answer, QString *problem)
{
    if (!pick_request_ || !pick_request_->answered) return false;
    std::shared_ptr<PickRequest> question = pick_request_;
    pick_request_.reset();
    *answer = question->service.response;
    *problem = "";
    if (!question->hits_visible_part) *problem = "Nothing is seen here.";
    else if (!question->reached)
        *problem = QString::fromStdString("There is no answer from the service " + question->name + ".");
    else if (!answer->success)
        *problem =
            answer->message.empty() ? QString("There is no tissue here.") : QString::fromStdString(answer->message);
    return true;
}

} // namespace pliant_rviz
