/* pliant_bag: a recorded session and its scan in; deformed volumes at chosen times out. No master is needed. */
#include "ros/record/bag_arguments.h"
#include "ros/record/recorded.h"
#include "ros/output/warped.h"

#include "command_line.h" /* the exit codes */
#include "console.h"

#include <rosbag/bag.h>
#include <rosbag/view.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <map>
#include <memory>
#include <sys/stat.h>

namespace pliant_ros {

namespace {

const char *const other_kind = " is of another kind, or of another version of Pliant";

struct Stopped {};

class Extraction {
public:
    explicit Extraction(const BagArguments &arguments) : arguments_(arguments) {}
    void run();
    int written() const { return written_; }

private:
    void open();
    void load();
    void read_topologies();
    std::vector<double> times_of(rosbag::View *states) const;
    void write(double time, const rosbag::MessageInstance &recorded);
    double since_start(const ros::Time &time) const { return (time - start_).toSec(); }
    std::string topic(const char *name) const { return "/" + arguments_.name + "/" + name; }
    Failure nothing_on(const char *name) const
    {
        const std::string advice = " in it; --ns names the namespace that was recorded";
        return Failure(PLIANT_ERROR_FORMAT, arguments_.bag + ": no " + topic(name) + advice);
    }

    const BagArguments &arguments_;
    rosbag::Bag bag_;
    ros::Time start_, end_;
    std::shared_ptr<const Loaded> loaded_;
    std::map<uint32_t, std::string> differs_; /* by revision; empty: it is known here */
    std::map<uint32_t, std::shared_ptr<const pliant_body>> bodies_; /* those */
    std::unique_ptr<Warped> warped_;
    int written_ = 0;
};

void Extraction::open()
{
    bag_.open(arguments_.bag, rosbag::bagmode::Read);
    rosbag::View all(bag_);
    if (all.size() == 0) throw Failure(PLIANT_ERROR_FORMAT, arguments_.bag + ": the bag is empty");
    start_ = all.getBeginTime();
    end_ = all.getEndTime();
}

void Extraction::load()
{
    Materials materials;
    std::shared_ptr<const Scan> scan = read_scan(arguments_.scene, arguments_.scan, &materials);
    loaded_ = build(arguments_.scene, scan, materials.table, console_progress());
    console_progress_end();
}

void Extraction::read_topologies()
{
    rosbag::View view(bag_, rosbag::TopicQuery(topic("mesh/topology")));
    bool any = false;
    std::string why;
    for (const rosbag::MessageInstance &recorded : view) {
        MeshTopology::ConstPtr topology = recorded.instantiate<MeshTopology>();
        if (!topology) throw Failure(PLIANT_ERROR_FORMAT, topic("mesh/topology") + other_kind);
        why.clear();
        std::shared_ptr<const pliant_body> body = body_of(*loaded_, *topology, &why);
        any |= body != nullptr;
        bodies_[topology->revision] = body;
        differs_[topology->revision] = why;
    }
    if (differs_.empty()) throw nothing_on("mesh/topology");
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

void Extraction::write(double time, const rosbag::MessageInstance &recorded)
{
    MeshState::ConstPtr state = recorded.instantiate<MeshState>();
    if (!state) throw Failure(PLIANT_ERROR_FORMAT, topic("mesh/state") + other_kind);
    auto differs = differs_.find(state->revision);
    char name[64], where[64];
    std::snprintf(where, sizeof where, "%.3f s: ", time);
    if (differs == differs_.end())
        throw Failure(PLIANT_ERROR_FORMAT,
                      where + std::string("no topology of revision ") + std::to_string(state->revision));
    if (!differs->second.empty()) throw Failure(PLIANT_ERROR_FORMAT, where + differs->second);
    std::shared_ptr<const Snapshot> snapshot = snapshot_of(loaded_, bodies_[state->revision], *state);
    if (!warped_ || !warped_->fits(*snapshot->body)) warped_.reset(new Warped(loaded_, snapshot->body));
    warped_->update(snapshot->positions);
    std::snprintf(name, sizeof name, "/deformed_%08.3f.nii.gz", time);
    check(pliant_volume_write((arguments_.folder + name).c_str(), &warped_->volume()));
    ++written_;
}

void Extraction::run()
{
    open();
    rosbag::View states(bag_, rosbag::TopicQuery(topic("mesh/state")));
    if (states.size() == 0) throw nothing_on("mesh/state");
    std::vector<double> times = times_of(&states);
    load();
    read_topologies();
    rosbag::View::iterator next = states.begin(), newest = next;
    for (double time : times) {
        /* a nanosecond of slack: times are written in decimals */
        for (; next != states.end() && since_start(next->getTime()) <= time + 1e-9; ++next) newest = next;
        if (console_stop_asked()) throw Stopped();
        write(time, *newest);
        console_progress().function(static_cast<double>(written_) / times.size(), "volumes", nullptr);
    }
    console_progress_end();
}

void make_folder(const std::string &folder)
{
    for (size_t end = folder.find('/', 1);; end = folder.find('/', end + 1)) {
        std::string path = folder.substr(0, end);
        if (mkdir(path.c_str(), 0777) != 0 && errno != EEXIST)
            throw Failure(PLIANT_ERROR_FILE, path + ": " + std::strerror(errno));
        if (end == std::string::npos) return;
    }
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
        make_folder(arguments.folder);
        extraction.run();
        if (!arguments.quiet) std::printf("%d volumes in %s\n", extraction.written(), arguments.folder.c_str());
        return EXIT_OK;
    } catch (const Stopped &) {
        return EXIT_STOPPED;
    } catch (const std::exception &failed) {
        console_progress_end();
        /* the library's own have been told */
        if (std::strcmp(failed.what(), pliant_last_error()) != 0) std::fprintf(stderr, "error: %s\n", failed.what());
        return console_stop_asked() ? EXIT_STOPPED : EXIT_FAILED;
    }
}
