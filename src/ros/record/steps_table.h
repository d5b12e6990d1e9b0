/* Recorded steps as a table (CSV): one line each. */
#ifndef PLIANT_ROS_RECORD_STEPS_TABLE_H
#define PLIANT_ROS_RECORD_STEPS_TABLE_H

#include <pliant/Step.h>

#include <cstdio>
#include <string>

namespace pliant_ros {

class StepsTable {
public:
    /* Throws Failure when the file cannot be written, as all of these. */
    explicit StepsTable(const std::string &path);
    ~StepsTable();
    StepsTable(const StepsTable &) = delete;
    StepsTable &operator=(const StepsTable &) = delete;

    /* time: since the start of the bag [s] */
    void append(double time, const pliant::Step &step);
    void close();

private:
    const std::string path_;
    std::FILE *file_;
};

} // namespace pliant_ros

#endif
