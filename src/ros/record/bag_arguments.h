/* The command line of pliant_bag. */
#ifndef PLIANT_ROS_RECORD_BAG_ARGUMENTS_H
#define PLIANT_ROS_RECORD_BAG_ARGUMENTS_H

#include "pliant/scene.h"

#include <string>
#include <vector>

namespace pliant_ros {

struct BagArguments {
    pliant_scene scene;
    /* the session in the bag, if any, defines the model; false: a scene is named */
    bool described = true;
    std::string bag, scan, folder, name = "tissue"; /* name: the recorded namespace */
    /* seconds since the start of the bag, ascending; alternative to `every` */
    std::vector<double> times;
    double every = 0;                               /* period of the written volumes [s]; 0: use `times` */
    bool surfaces = false;                          /* write surfaces in addition to volumes */
    bool simulate = false;                          /* recompute every step and write the volumes of these steps */
    std::string steps, cuts;                        /* CSV files of the recorded steps and cuts; empty: none */
    std::string exported;                           /* "numpy" or "lerobot", written to the folder; empty: no export */
    std::string task = "tissue";                    /* task description for LeRobot */
    int rate = 30;                                  /* frames per second of the export */
    bool quiet = false;
};

/* Read the command line. Return true to continue. Return false to exit with *exit_code after help or an error
 * message. */
bool read_bag_arguments(int argc, char **argv, BagArguments *out, int *exit_code);

} // namespace pliant_ros

#endif
