/* pliant_bag: read a recorded session and its scan; write deformed volumes at chosen times, recompute the steps, and
 * write tables. No ROS master is needed. */
#include "ros/record/bag_arguments.h"
#include "ros/record/export.h"
#include "ros/record/message.h"
#include "ros/record/recorded.h"
#include "ros/record/rerun.h"
#include "ros/record/tables.h"
#include "ros/sim/session.h"
#include "ros/output/deformed_volume.h"

#include "programs/command_line.h" /* exit codes */
#include "programs/console.h"
#include "programs/python_run.h"

#include <rosbag/bag.h>
#include <rosbag/view.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <sys/stat.h>
#include <unistd.h>

namespace pliant_ros {

namespace {

struct Stopped {};

void make_folder(const std::string &folder)
{
    for (size_t end = folder.find('/', 1);; end = folder.find('/', end + 1)) {
        std::string path = folder.substr(0, end);
        if (mkdir(path.c_str(), 0777) != 0 && errno != EEXIST)
            throw Failure(PLIANT_ERROR_FILE, path + ": " + std::strerror(errno));
        if (end == std::string::npos) return;
    }
}

class Extraction {
public:
    explicit Extraction(const BagArguments &arguments) : arguments_(arguments) {}
    void run();
    /* Return a text for the user about the written files. */
    std::string summary() const;

private:
    void open();
    void read_sessions();
    void load(uint32_t revision);
    void read_topologies(uint32_t end);
    std::vector<double> times_of(rosbag::View *states) const;
    void write_recorded(const std::vector<double> &times, rosbag::View *states);
    void write_simulated(const std::vector<double> &times, rosbag::View *steps);
    std::shared_ptr<const Snapshot> snapshot(double time, const rosbag::MessageInstance &recorded);
    void write(double time, const Snapshot &snapshot);
    void write_surface(double time, const Snapshot &snapshot);
    template <class Message, class Lines> void write_table(rosbag::View *view, Lines *table);
    void write_steps();
    void write_cuts();
    void write_arrays();
    void write_lerobot(const std::string &arrays) const;
    double since_start(const ros::Time &time) const { return (time - start_).toSec(); }
    std::string topic(const char *name) const { return "/" + arguments_.name + "/" + name; }
    Failure missing_topic_failure(const char *name) const
    {
        const std::string advice = " in it; --ns names the namespace that was recorded";
        return Failure(PLIANT_ERROR_FORMAT, arguments_.bag + ": no " + topic(name) + advice);
    }

    const BagArguments &arguments_;
    rosbag::Bag bag_;
    ros::Time start_, end_;
    std::map<uint32_t, Session> sessions_; /* by the revision at load; empty: the arguments define the model */
    std::unique_ptr<RecordedScanFinder> scan_finder_;
    std::shared_ptr<const LoadedModel> loaded_;
    uint32_t load_ = 0; /* revision at load of loaded_, if there are sessions */
    /* reason why the mesh of a revision cannot be reproduced; empty: it can */
    std::map<uint32_t, std::string> mesh_mismatches_;
    std::map<uint32_t, std::shared_ptr<const pliant_body>> bodies_; /* by revision */
    std::unique_ptr<DeformedVolume> warped_;
    std::shared_ptr<const LoadedModel> deformed_volume_model_;
    std::shared_ptr<const pliant_surface> surface_;
    std::unique_ptr<Rerun> rerun_;
    int written_ = 0;
    std::string exported_; /* text for the user about the export */
};

void Extraction::open()
{
    bag_.open(arguments_.bag, rosbag::bagmode::Read);
    rosbag::View all(bag_);
    if (all.size() == 0) throw Failure(PLIANT_ERROR_FORMAT, arguments_.bag + ": the bag is empty");
    start_ = all.getBeginTime();
    end_ = all.getEndTime();
}

void Extraction::read_sessions()
{
    if (!arguments_.described) return;
    rosbag::View view(bag_, rosbag::TopicQuery(topic("session")));
    for (const rosbag::MessageInstance &recorded : view) {
        const Session::ConstPtr session = read_message<Session>(recorded);
        sessions_[session->load] = *session;
    }
    scan_finder_.reset(new RecordedScanFinder(arguments_.scan, arguments_.scene.material.labels));
}

/* Load the model of a mesh revision, and discard the bodies of another model. */
void Extraction::load(uint32_t revision)
{
    auto after = sessions_.upper_bound(revision);
    if (loaded_ && (sessions_.empty() || (after != sessions_.begin() && std::prev(after)->first == load_))) return;
    bodies_.clear();
    mesh_mismatches_.clear();
    surface_.reset();
    if (sessions_.empty()) {
        Materials materials;
        std::shared_ptr<const Scan> scan = read_scan(arguments_.scene, arguments_.scan, &materials);
        loaded_ = build(arguments_.scene, scan, materials.table, console_progress());
    } else {
        if (after == sessions_.begin())
            throw Failure(PLIANT_ERROR_FORMAT, arguments_.bag + ": the topology from which revision " +
                                                   std::to_string(revision) + " was made is not in the bag");
        const Session &session = std::prev(after)->second;
        load_ = session.load;
        loaded_ = build_session(session, scan_finder_->find(session), console_progress());
    }
    console_progress_end();
    read_topologies(after == sessions_.end() ? std::numeric_limits<uint32_t>::max() : after->first);
    if (rerun_) rerun_->set_model(loaded_);
    else if (arguments_.simulate) rerun_.reset(new Rerun(loaded_));
}

/* Read the topologies of this load with lower revisions than `end`. */
void Extraction::read_topologies(uint32_t end)
{
    rosbag::View view(bag_, rosbag::TopicQuery(topic("mesh/topology")));
    bool any = false;
    std::string why;
    Bodies bodies;
    for (const rosbag::MessageInstance &recorded : view) {
        const MeshTopology::ConstPtr topology = read_message<MeshTopology>(recorded);
        if (topology->revision < load_ || topology->revision >= end) continue;
        why.clear();
        std::shared_ptr<const pliant_body> body = body_of(*loaded_, *topology, &bodies, &why);
        any |= body != nullptr;
        bodies_[topology->revision] = body;
        mesh_mismatches_[topology->revision] = why;
    }
    if (mesh_mismatches_.empty()) throw missing_topic_failure("mesh/topology");
    if (!any) throw Failure(PLIANT_ERROR_FORMAT, arguments_.bag + ": " + why);
}

std::vector<double> Extraction::times_of(rosbag::View *states) const
{
    std::vector<double> times = arguments_.times;
    double first = since_start(states->getBeginTime()), last = since_start(end_);
    const double every = arguments_.every;
    if (every > 0)
        for (double k = std::ceil(first / every); k * every <= last; ++k) times.push_back(k * every);
    if (times.empty() || times.front() < first || times.back() > last) {
        char range[160];
        std::snprintf(range, sizeof range,
                      "the states of the bag lie between %.3f and %.3f s from its start; choose times in there", first,
                      last);
        throw Failure(PLIANT_ERROR_ARGUMENT, arguments_.bag + ": " + range);
    }
    return times;
}

std::shared_ptr<const Snapshot> Extraction::snapshot(double time, const rosbag::MessageInstance &recorded)
{
    const MeshState::ConstPtr state = read_message<MeshState>(recorded);
    load(state->revision);
    auto differs = mesh_mismatches_.find(state->revision);
    char where[64];
    std::snprintf(where, sizeof where, "%.3f s: ", time);
    if (differs == mesh_mismatches_.end())
        throw Failure(PLIANT_ERROR_FORMAT,
                      where + std::string("no topology of revision ") + std::to_string(state->revision));
    if (!differs->second.empty()) throw Failure(PLIANT_ERROR_FORMAT, where + differs->second);
    return snapshot_of(loaded_, bodies_[state->revision], *state);
}

void Extraction::write(double time, const Snapshot &snapshot)
{
    if (!warped_ || deformed_volume_model_ != snapshot.loaded)
        warped_.reset(new DeformedVolume(snapshot.loaded, snapshot.body));
    deformed_volume_model_ = snapshot.loaded;
    warped_->set_body(snapshot.body);
    warped_->update(snapshot.positions);
    char name[64];
    std::snprintf(name, sizeof name, "/deformed_%08.3f.nii.gz", time);
    check(pliant_volume_write((arguments_.folder + name).c_str(), &warped_->volume()));
    if (arguments_.surfaces) write_surface(time, snapshot);
    ++written_;
}

void Extraction::write_surface(double time, const Snapshot &snapshot)
{
    surface_ = surface_of(*snapshot.body, surface_);
    char name[64];
    std::snprintf(name, sizeof name, "/surface_%08.3f.ply", time);
    check(pliant_surface_write((arguments_.folder + name).c_str(), surface_.get(), snapshot.positions.data(), 1.0, 0,
                               nullptr, nullptr));
}

void Extraction::write_recorded(const std::vector<double> &times, rosbag::View *states)
{
    rosbag::View::iterator next = states->begin(), newest = next;
    for (double time : times) {
        /* tolerance of one nanosecond, because times are written in decimals */
        for (; next != states->end() && since_start(next->getTime()) <= time + 1e-9; ++next) newest = next;
        if (console_stop_requested()) throw Stopped();
        write(time, *snapshot(time, *newest));
        console_progress().function(static_cast<double>(written_) / times.size(), "volumes", nullptr);
    }
    console_progress_end();
}

/* Write the volumes at the given times. Each volume shows the most recent step. */
void Extraction::write_simulated(const std::vector<double> &times, rosbag::View *steps)
{
    auto time = times.begin();
    std::shared_ptr<const Snapshot> newest;
    size_t done = 0;
    for (const rosbag::MessageInstance &recorded : *steps) {
        if (console_stop_requested()) throw Stopped();
        const Step::ConstPtr step = read_message<Step>(recorded);
        for (; time != times.end() && newest && since_start(recorded.getTime()) > *time + 1e-9; ++time)
            write(*time, *newest);
        load(step->load);
        if (rerun_->take(*step) && time != times.end()) newest = rerun_->snapshot();
        console_progress().function(static_cast<double>(++done) / steps->size(), "steps", nullptr);
    }
    for (; time != times.end() && newest; ++time) write(*time, *newest);
    console_progress_end();
    if (rerun_->made() == 0)
        throw Failure(PLIANT_ERROR_FORMAT,
                      arguments_.bag + ": the bag has no load and no reset, so the simulation cannot start");
    if (rerun_->differing() > 0) throw Failure(PLIANT_ERROR_NUMERIC, rerun_->summary());
}

template <class Message, class Lines> void Extraction::write_table(rosbag::View *view, Lines *table)
{
    for (const rosbag::MessageInstance &recorded : *view) {
        const typename Message::ConstPtr message = read_message<Message>(recorded);
        table->append(since_start(recorded.getTime()), *message);
    }
    table->close();
}

void Extraction::write_steps()
{
    rosbag::View view(bag_, rosbag::TopicQuery(topic("step")));
    if (view.size() == 0) throw missing_topic_failure("step");
    StepsTable table(arguments_.steps);
    write_table<Step>(&view, &table);
}

/* Write the cuts of all tools. */
void Extraction::write_cuts()
{
    rosbag::View view(bag_, rosbag::TypeQuery(ros::message_traits::DataType<Cut>::value()));
    CutsTable table(arguments_.cuts);
    write_table<Cut>(&view, &table);
}

void Extraction::write_arrays()
{
    const bool lerobot = arguments_.exported == "lerobot";
    const std::string folder = arguments_.folder + (lerobot ? "/numpy" : "");
    make_folder(folder);
    exported_ = export_numpy(bag_, arguments_.name, arguments_.rate, folder);
    if (!lerobot) return;
    write_lerobot(folder);
    exported_ += "LeRobot's layout of them in " + arguments_.folder + "\n";
}

/* Convert the arrays with the Python program pliant_lerobot in the same folder. */
void Extraction::write_lerobot(const std::string &arrays) const
{
    char own[4096];
    const ssize_t length = readlink("/proc/self/exe", own, sizeof own);
    const std::string path(own, length > 0 ? static_cast<size_t>(length) : 0);
    const std::string program = path.substr(0, path.rfind('/') + 1) + "pliant_lerobot";
    const char *python = python_find("numpy, pyarrow");
    if (!python)
        throw Failure(PLIANT_ERROR_UNAVAILABLE,
                      "python3 with numpy and pyarrow was not found (pip install numpy pyarrow). The arrays are in " +
                          arrays + "; with both installed: python3 " + program + " " + arrays + " " +
                          arguments_.folder);
    const char *words[] = {python,   program.c_str(),         arrays.c_str(), arguments_.folder.c_str(),
                           "--task", arguments_.task.c_str(), nullptr};
    if (python_run(words) != 0) throw Failure(PLIANT_ERROR_FILE, program + " failed; the arrays are in " + arrays);
}

void Extraction::run()
{
    open();
    if (!arguments_.steps.empty()) write_steps();
    if (!arguments_.cuts.empty()) write_cuts();
    if (!arguments_.exported.empty()) return write_arrays();
    const bool volumes = !arguments_.folder.empty();
    if (!volumes && !arguments_.simulate) return;
    const char *name = arguments_.simulate ? "step" : "mesh/state";
    rosbag::View wanted(bag_, rosbag::TopicQuery(topic(name)));
    if (wanted.size() == 0) throw missing_topic_failure(name);
    const std::vector<double> times = volumes ? times_of(&wanted) : std::vector<double>();
    read_sessions();
    if (volumes) make_folder(arguments_.folder);
    if (arguments_.simulate) {
        write_simulated(times, &wanted);
    } else {
        write_recorded(times, &wanted);
    }
}

std::string Extraction::summary() const
{
    std::string text = exported_ + (rerun_ ? rerun_->summary() + "\n" : "");
    if (!arguments_.folder.empty() && exported_.empty())
        text += std::to_string(written_) + " volumes in " + arguments_.folder + "\n";
    if (!arguments_.steps.empty()) text += "steps in " + arguments_.steps + "\n";
    if (!arguments_.cuts.empty()) text += "cuts in " + arguments_.cuts + "\n";
    return text;
}

} // namespace

} // namespace pliant_ros

int main(int argc, char **argv)
{
    using namespace pliant_ros;
    BagArguments arguments;
    int exit_code;
    if (!read_bag_arguments(argc, argv, &arguments, &exit_code)) return exit_code;
    console_start(arguments.quiet ? PLIANT_LOG_WARNING : PLIANT_LOG_INFO);
    Extraction extraction(arguments);
    try {
        extraction.run();
        if (!arguments.quiet) std::fputs(extraction.summary().c_str(), stdout);
        return EXIT_OK;
    } catch (const Stopped &) {
        return EXIT_STOPPED;
    } catch (const std::exception &failed) {
        console_progress_end();
        /* errors of the library are already printed */
        if (std::strcmp(failed.what(), pliant_last_error()) != 0) std::fprintf(stderr, "error: %s\n", failed.what());
        return console_stop_requested() ? EXIT_STOPPED : EXIT_FAILED;
    }
}
