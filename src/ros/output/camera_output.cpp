#include "ros/output/camera_output.h"

#include "ros/output/camera_eye.h"

#ifdef __linux__
#include <sys/resource.h>
#endif

namespace pliant_ros {

namespace {

enum { NICE_INCREMENT = 5 };

} // namespace

/* Renderer of the loaded model; empty without subscribers. */
struct CameraOutput::View {
    std::shared_ptr<const LoadedModel> loaded;
    std::shared_ptr<const Snapshot> shown;
    pliant_view *view = nullptr;
    pliant_style style{};

    ~View() { drop(); }
    void drop()
    {
        pliant_view_free(view);
        view = nullptr;
        loaded.reset();
        shown.reset();
    }
    void show(const std::shared_ptr<const Snapshot> &snapshot)
    {
        if (snapshot == shown) return;
        if (loaded != snapshot->loaded) {
            drop();
            check(pliant_view_create(snapshot->loaded->model, nullptr, &view));
            check(pliant_style_defaults(&snapshot->loaded->scan->volume, &style));
            loaded = snapshot->loaded;
        }
        check(pliant_view_set(view, snapshot->body.get(), snapshot->positions.data(), nullptr));
        shown = snapshot;
    }
};

/* Both eyes of a stereo camera use one pose and one snapshot of the tissue, and their images carry one time stamp. */
struct CameraOutput::Camera {
    CameraParameters parameters;
    std::vector<std::unique_ptr<CameraEye>> eyes;
    Rate rate;

    bool is_wanted() const
    {
        return std::any_of(eyes.begin(), eyes.end(),
                           [](const std::unique_ptr<CameraEye> &eye) { return eye->is_wanted(); });
    }
};

CameraOutput::CameraOutput(ros::NodeHandle handle, const Parameters &parameters, Snapshots *snapshots,
                           std::shared_ptr<const tf2_ros::Buffer> frames)
    : tissue_frame_(parameters.tissue_frame), snapshots_(snapshots), frames_(std::move(frames))
{
    for (const CameraParameters &camera : parameters.cameras) {
        const std::vector<std::string> sides =
            camera.baseline > 0 ? std::vector<std::string>{"left", "right"} : std::vector<std::string>{""};
        cameras_.emplace_back(new Camera{camera, {}, {}});
        for (const std::string &side : sides) cameras_.back()->eyes.emplace_back(new CameraEye(handle, camera, side));
        fastest_ = std::max(fastest_, camera.rate);
    }
    if (any()) thread_ = std::thread(&CameraOutput::run, this);
}

CameraOutput::~CameraOutput()
{
    stopping_ = true;
    if (thread_.joinable()) thread_.join();
}

void CameraOutput::render_images(Camera *camera, View *view, const std::shared_ptr<const Snapshot> &newest)
{
    std::string why;
    Rigid tissue_from_frame;
    if (!rigid_from_message(frames_->lookupTransform(tissue_frame_, camera->parameters.frame, ros::Time(0)).transform,
                            &tissue_from_frame, &why))
        throw Failure(PLIANT_ERROR_ARGUMENT, "camera " + camera->parameters.name + ": " + why);
    view->show(newest);
    for (const std::unique_ptr<CameraEye> &eye : camera->eyes) {
        if (!eye->is_wanted()) continue;
        eye->render_images(view->view, *newest->loaded, tissue_from_frame, newest->stamp, view->style);
        ++drawn_;
    }
}

void CameraOutput::run()
{
#ifdef __linux__
    /* Lower the priority of this thread and its child threads, so that simulation steps run first. */
    setpriority(PRIO_PROCESS, 0, NICE_INCREMENT);
#endif
    Snapshots::Reader reader(snapshots_);
    std::shared_ptr<const Snapshot> newest;
    View view;
    const std::chrono::milliseconds frame_wait(1 + static_cast<int>(500 / std::max(fastest_, 1.0))),
        wait = std::min(poll_period, frame_wait);
    while (!stopping_) {
        const bool wanted = std::any_of(cameras_.begin(), cameras_.end(),
                                        [](const std::unique_ptr<Camera> &camera) { return camera->is_wanted(); });
        reader.want(wanted);
        if (!wanted) {
            newest.reset();
            view.drop(); /* release the memory while there are no subscribers */
            problem_.set("");
            std::this_thread::sleep_for(poll_period);
            continue;
        }
        if (std::shared_ptr<const Snapshot> next = reader.wait(wait)) newest = next;
        if (!newest) continue;
        /* A camera may move while the tissue rests, so every camera is rendered at its rate. An error of one camera
         * does not stop the others. */
        std::string problem;
        bool rendered = false;
        for (const std::unique_ptr<Camera> &camera : cameras_) {
            if (!camera->is_wanted() || !camera->rate.due(camera->parameters.rate)) continue;
            rendered = true;
            try {
                render_images(camera.get(), &view, newest);
            } catch (const std::exception &failed) {
                problem += std::string(problem.empty() ? "no picture: " : "; ") + failed.what();
                ROS_WARN_THROTTLE(5, "no picture: %s", failed.what());
            }
        }
        if (rendered) problem_.set(problem);
    }
}

} // namespace pliant_ros
