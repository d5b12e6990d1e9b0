/* replay [PLAYER [simulate] [described] [start=SECONDS] [BAG ...]]: run the node of replay.h. PLAYER is the name of a
 * paused rosbag play, which starts once the scan is loaded and plays these bags from SECONDS on. With `described` the
 * bags define the models. */
#include "ros/record/replay.h"

#include "programs/stop.h"

#include <ros/callback_queue.h>
#include <ros/ros.h>

#include <csignal>
#include <cstdlib>

namespace {

volatile std::sig_atomic_t is_over = 0;
void end(int) { is_over = 1; }

pliant_ros::ReplaySettings playing_of(int argc, char **argv)
{
    const std::string start = "start=";
    pliant_ros::ReplaySettings out;
    out.may_continue = [] { return ros::ok() && !is_over; };
    if (argc > 1) out.player = argv[1];
    for (int a = 2; a < argc; ++a) {
        const std::string word = argv[a];
        if (word == "simulate") out.simulates = true;
        else if (word == "described") out.described = true;
        else if (word.compare(0, start.size(), start) == 0)
            out.start = std::strtod(word.c_str() + start.size(), nullptr);
        else out.bags.push_back(word);
    }
    return out;
}

/* Reset /use_sim_time. The next node on this master would wait for a clock that nobody publishes. */
void reset_use_sim_time()
{
    if (ros::ok() && ros::Time::isSimTime()) ros::param::set("/use_sim_time", false);
}

} // namespace

int main(int argc, char **argv)
{
    ros::init(argc, argv, "replay", ros::init_options::NoSigintHandler);
    stop_on_signals(end);
    const pliant_ros::ReplaySettings playing = playing_of(argc, argv);
    int code = 0;
    try {
        pliant_ros::Replay replay(ros::NodeHandle(), ros::NodeHandle("~"), playing);
        while (playing.may_continue()) ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.1));
        replay.print_summary();
        reset_use_sim_time();
        ros::shutdown();
    } catch (const std::exception &wrong) {
        /* an interruption by the user is no failure */
        if (playing.may_continue()) ROS_FATAL("%s", wrong.what());
        code = playing.may_continue();
        reset_use_sim_time();
    }
    return code;
}
