/* Report the progress of a recording on /diagnostics. rosbag record does not report there that the disk is full or that
 * it has exited.
 *
 * Private parameters: prefix (path prefix of the bag files), min_space (1000) [MB]: minimum free space. The recorder
 * stops writing below it, so that it can close its bag. */
#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/ros.h>

#include <dirent.h>
#include <sys/stat.h>
#include <sys/statvfs.h>

#include <algorithm>
#include <memory>
#include <string>

namespace {

using diagnostic_msgs::DiagnosticStatus;

const double megabyte = 1024 * 1024; /* the same unit as in rosbag */

/* Most recent bag of a recording. rosbag appends the date, and a number after a split; a different suffix belongs to
 * another recording. */
struct Bag {
    std::string path;
    double megabytes = 0;
    bool open = false; /* the recorder still writes it */
};

Bag newest(const std::string &prefix)
{
    const size_t slash = prefix.rfind('/');
    const std::string folder = slash == std::string::npos ? "./" : prefix.substr(0, slash + 1),
                      begins = slash == std::string::npos ? prefix : prefix.substr(slash + 1);
    Bag out;
    timespec when{};
    std::unique_ptr<DIR, int (*)(DIR *)> files(opendir(folder.c_str()), closedir);
    for (const dirent *file; files && (file = readdir(files.get()));) {
        const std::string name = file->d_name;
        struct stat file_status;
        if (name.compare(0, begins.size(), begins) != 0) continue;
        const size_t end = std::min(name.find_first_not_of("0123456789-_", begins.size()), name.size());
        if (name.compare(end, 4, ".bag") != 0 || stat((folder + name).c_str(), &file_status) != 0) continue;
        if (!out.path.empty() &&
            (file_status.st_mtim.tv_sec < when.tv_sec ||
             (file_status.st_mtim.tv_sec == when.tv_sec && file_status.st_mtim.tv_nsec <= when.tv_nsec)))
            continue;
        when = file_status.st_mtim;
        out = {folder + name, static_cast<double>(file_status.st_size) / megabyte,
               name.size() > 7 && name.compare(name.size() - 7, 7, ".active") == 0};
    }
    return out;
}

} // namespace

int main(int argc, char **argv)
{
    ros::init(argc, argv, "record_watch");
    ros::NodeHandle handle, own("~");
    const std::string prefix = own.param<std::string>("prefix", "");
    const double minimum = own.param("min_space", 1000.0);
    if (prefix.empty()) {
        ROS_FATAL("~prefix is empty: set the prefix of the bag names, such as /data/session");
        return 1;
    }
    bool was_open = false;
    diagnostic_updater::Updater diagnostics;
    diagnostics.setHardwareID("none");
    diagnostics.add("recording", [&](diagnostic_updater::DiagnosticStatusWrapper &status) {
        const Bag bag = newest(prefix);
        struct statvfs file_system;
        const size_t slash = prefix.rfind('/');
        const bool known =
            statvfs(slash == std::string::npos ? "." : prefix.substr(0, slash + 1).c_str(), &file_system) == 0;
        const double free =
            known ? static_cast<double>(file_system.f_bavail) * static_cast<double>(file_system.f_frsize) / megabyte
                  : 0;
        if (known && free < minimum)
            status.summary(
                DiagnosticStatus::ERROR,
                "the disk is full: recording has stopped; recorded messages are kept (repair a remaining .active file "
                "with "
                "rosbag reindex)");
        else if (!bag.open)
            status.summary(was_open ? DiagnosticStatus::ERROR : DiagnosticStatus::WARN,
                           was_open ? "the recorder has ended" : "nothing is recorded yet");
        else if (known && free < 5 * minimum) status.summary(DiagnosticStatus::WARN, "the disk is nearly full");
        else status.summary(DiagnosticStatus::OK, "recording");
        was_open = was_open || bag.open;
        status.add("bag", bag.path);
        status.add("size [MB]", bag.megabytes);
        status.add("free [MB]", free);
    });
    for (ros::WallRate turn(4); ros::ok(); turn.sleep()) {
        ros::spinOnce();
        diagnostics.update();
    }
    return 0;
}
