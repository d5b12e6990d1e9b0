/* The command line of pliant_bag. */
#ifndef PLIANT_ROS_RECORD_BAG_ARGUMENTS_H
#define PLIANT_ROS_RECORD_BAG_ARGUMENTS_H

#include "pliant/scene.h"

#include <string>
#include <vector>

namespace pliant_ros {

struct BagArguments {
    pliant_scene scene;
    bool described = true;                          /* by the bag, where it has a session: no scene was named */
    std::string bag, scan, folder, name = "tissue"; /* name: the namespace that was recorded */
    std::vector<double> times;                      /* since the start of the bag [s], ascending; or */
    double every = 0;                               /* [s]; 0: times */
    bool surfaces = false;                          /* beside the volumes */
    bool simulate = false;                          /* every step is made again; volumes come from there */
    std::string steps, cuts;                        /* files for tables of the recorded steps and cuts; empty: none */
    std::string exported;                           /* "numpy" or "lerobot", into the folder; empty: neither */
    std::string task = "tissue";                    /* for LeRobot, in words */
    int rate = 30;                                  /* rows of that a second */
    bool quiet = false;
};

/* True: go on. False: end now with *exit_code (help, or wrong usage told on stderr). */
bool read_bag_arguments(int argc, char **argv, BagArguments *out, int *exit_code);

} // namespace pliant_ros

#endif
