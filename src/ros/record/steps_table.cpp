#include "ros/record/steps_table.h"

#include "ros/sim/loaded.h"

#include <cerrno>
#include <cinttypes>
#include <cstring>

namespace pliant_ros {

StepsTable::StepsTable(const std::string &path) : path_(path), file_(std::fopen(path.c_str(), "w"))
{
    if (!file_) throw Failure(PLIANT_ERROR_FILE, path_ + ": " + std::strerror(errno));
    std::fputs("time_s,sequence,step,revision,paused,status,background", file_);
    for (int stage = 0; stage < PLIANT_NUM_STEP_STAGES; ++stage) std::fprintf(file_, ",%s_s", pliant_step_stage_name(stage));
    std::fputs(",checksum\n", file_);
}

StepsTable::~StepsTable()
{
    if (file_) std::fclose(file_);
}

void StepsTable::append(double time, const pliant::Step &step)
{
    std::fprintf(file_, "%.6f,%" PRIu64 ",%" PRIu64 ",%u,%d,%d,%u", time, step.sequence, step.step, step.revision, step.paused, step.status,
                 step.background);
    for (size_t stage = 0; stage < PLIANT_NUM_STEP_STAGES; ++stage)
        std::fprintf(file_, ",%.6g", stage < step.seconds.size() ? static_cast<double>(step.seconds[stage]) : 0.0);
    std::fprintf(file_, ",%016" PRIx64 "\n", step.checksum);
}

void StepsTable::close()
{
    const bool wrong = std::ferror(file_) != 0;
    const bool unwritten = std::fclose(file_) != 0;
    file_ = nullptr;
    if (wrong || unwritten) throw Failure(PLIANT_ERROR_FILE, path_ + ": it could not be written whole");
}

} // namespace pliant_ros
