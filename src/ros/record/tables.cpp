#include "ros/record/tables.h"

#include "ros/sim/loaded_model.h"
#include "sim/api/data.h"

#include <cerrno>
#include <cinttypes>
#include <cstring>

namespace pliant_ros {

namespace {

std::string heading_of_steps()
{
    std::string out = "time_s,sequence,step,revision,paused,status,background";
    for (int stage = 0; stage < PLIANT_NUM_STEP_STAGES; ++stage)
        out += std::string(",") + pliant_step_stage_name(stage) + "_s";
    return out + ",checksum";
}

} // namespace

Table::Table(const std::string &path, const std::string &heading) : path_(path), file_(std::fopen(path.c_str(), "w"))
{
    if (!file_) throw Failure(PLIANT_ERROR_FILE, path_ + ": " + std::strerror(errno));
    std::fprintf(file_, "%s\n", heading.c_str());
}

Table::~Table()
{
    if (file_) std::fclose(file_);
}

void Table::close()
{
    const bool wrong = std::ferror(file_) != 0;
    const bool unwritten = std::fclose(file_) != 0;
    file_ = nullptr;
    if (wrong || unwritten) throw Failure(PLIANT_ERROR_FILE, path_ + ": it could not be written completely");
}

StepsTable::StepsTable(const std::string &path) : Table(path, heading_of_steps()) {}

void StepsTable::append(double time, const pliant::Step &step)
{
    std::fprintf(file(), "%.6f,%" PRIu64 ",%" PRIu64 ",%u,%d,%d,%u", time, step.sequence, step.step, step.revision,
                 step.paused, step.status, step.background);
    for (size_t stage = 0; stage < PLIANT_NUM_STEP_STAGES; ++stage)
        std::fprintf(file(), ",%.6g", stage < step.seconds.size() ? static_cast<double>(step.seconds[stage]) : 0.0);
    std::fprintf(file(), ",%016" PRIx64 "\n", step.checksum);
}

CutsTable::CutsTable(const std::string &path)
    : Table(path, "time_s,tool,stroke,cutting,engaged,severed_area_m2,revision,pieces,x_m,y_m,z_m")
{
}

void CutsTable::append(double time, const pliant::Cut &cut)
{
    std::fprintf(file(), "%.6f,%s,%" PRIu64 ",%d,%d,%.9g,%u,%d,%.6f,%.6f,%.6f\n", time, cut.tool.c_str(), cut.stroke,
                 cut.cutting, cut.engaged, cut.severed_area, cut.revision, cut.pieces, cut.point.x, cut.point.y,
                 cut.point.z);
}

} // namespace pliant_ros
