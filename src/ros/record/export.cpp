#include "ros/record/export.h"

#include "ros/record/message.h"
#include "ros/record/npy.h"
#include "ros/sim/loaded_model.h"

#include <geometry_msgs/WrenchStamped.h>
#include <pliant/ContactState.h>
#include <pliant/Step.h>
#include <rosbag/view.h>
#include <sensor_msgs/Image.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <map>
#include <memory>
#include <set>

namespace pliant_ros {

namespace {

const double SLACK = 1e-9; /* tolerance [s], because times are written in decimals */

/* Column names of actions and of observations. */
const char *const motion_columns[] = {"x", "y", "z", "qx", "qy", "qz", "qw", "jaw", "closed", "cutting"};
const char *const sense_columns[] = {"present", "touching", "grasped",  "force_x", "force_y",
                                     "force_z", "torque_x", "torque_y", "torque_z"};
const size_t NUM_MOTION_COLUMNS = sizeof motion_columns / sizeof *motion_columns,
             NUM_SENSE_COLUMNS = sizeof sense_columns / sizeof *sense_columns;

using Motion = std::array<double, NUM_MOTION_COLUMNS>;
template <class Value> using Series = std::vector<std::pair<double, Value>>; /* ascending times [s] */

struct RecordedStep {
    uint64_t step;
    bool begins; /* first step after a load or a reset */
    std::map<size_t, Motion> tools; /* present tools by index */
};

struct Pictures {
    std::string name, topic, encoding;
    double first;
    uint32_t width, height;
    std::vector<int64_t> shown; /* index of the most recent picture for each row */
    bool colours() const { return encoding == "rgb8" || encoding == "bgr8"; }
    bool real() const { return encoding == "32FC1"; }
    size_t row_size() const { return size_t(width) * (colours() ? 3 : real() ? 4 : 1); } /* bytes per image row */
};

struct Row {
    double time;
    int64_t episode;
    size_t turn;
};

/* Return the last entry at or before a time; null without such an entry. */
template <class Value> const std::pair<double, Value> *newest(const Series<Value> &series, double time)
{
    auto after = std::upper_bound(series.begin(), series.end(), time + SLACK,
                                  [](double t, const std::pair<double, Value> &each) { return t < each.first; });
    return after == series.begin() ? nullptr : &*std::prev(after);
}

class Export {
public:
    Export(const rosbag::Bag &bag, const std::string &name, int fps, const std::string &folder)
        : bag_(bag), root_("/" + name + "/"), fps_(fps), folder_(folder), start_(rosbag::View(bag).getBeginTime())
    {
    }
    std::string run();

private:
    double since_start(const rosbag::MessageInstance &recorded) const { return (recorded.getTime() - start_).toSec(); }
    template <class Message, class Take> void read(const std::string &topic, Take take) const;
    void read_turns();
    void read_senses();
    void find_pictures();
    void choose_rows();
    Motion motion(const Row &row, size_t tool) const;
    void write_rows() const;
    void find_shown(Pictures *pictures) const;
    void write_index(const Pictures &pictures) const;
    void write_pictures(const Pictures &pictures) const;
    void write_columns() const;

    const rosbag::Bag &bag_;
    const std::string root_;
    const int fps_;
    const std::string folder_;
    const ros::Time start_;
    std::vector<std::string> tools_;
    Series<RecordedStep> turns_;
    std::vector<Series<std::array<double, 6>>> wrenches_; /* by tool */
    std::vector<Series<std::array<double, 2>>> contacts_; /* touching and grasped, by tool */
    std::vector<Pictures> pictures_;
    std::vector<Row> rows_;
};

template <class Message, class Take> void Export::read(const std::string &topic, Take take) const
{
    rosbag::View view(bag_, rosbag::TopicQuery(topic));
    for (const rosbag::MessageInstance &recorded : view) {
        const typename Message::ConstPtr message = read_message<Message>(recorded);
        take(since_start(recorded), *message);
    }
}

void Export::read_turns()
{
    read<pliant::Step>(root_ + "step", [this](double time, const pliant::Step &step) {
        RecordedStep turn{step.step, step.sequence == 1, {}};
        for (const pliant::ToolInput &tool : step.tools) {
            const size_t index = std::find(tools_.begin(), tools_.end(), tool.name) - tools_.begin();
            if (index == tools_.size()) tools_.push_back(tool.name);
            if (!tool.present) continue;
            Motion &motion = turn.tools[index];
            std::copy(tool.tip.begin(), tool.tip.end(), motion.begin());
            std::copy(tool.rotation.begin(), tool.rotation.end(), motion.begin() + 3);
            motion[7] = tool.jaw;
            motion[8] = tool.closed;
            motion[9] = tool.cuts;
        }
        turns_.emplace_back(time, turn);
    });
    if (turns_.empty())
        throw Failure(PLIANT_ERROR_FORMAT,
                      bag_.getFileName() + ": no " + root_ + "step in it; --ns names the namespace that was recorded");
    if (tools_.empty())
        throw Failure(PLIANT_ERROR_FORMAT,
                      bag_.getFileName() + ": the session has no tools: there is nothing to learn from");
}

void Export::read_senses()
{
    wrenches_.resize(tools_.size());
    contacts_.resize(tools_.size());
    for (size_t t = 0; t < tools_.size(); ++t) {
        const std::string topic = tools_[t][0] == '/' ? tools_[t] : root_ + tools_[t];
        read<geometry_msgs::WrenchStamped>(
            topic + "/body/measured_cf", [&](double time, const geometry_msgs::WrenchStamped &message) {
                const auto &force = message.wrench.force, &torque = message.wrench.torque;
                wrenches_[t].push_back({time, {{force.x, force.y, force.z, torque.x, torque.y, torque.z}}});
            });
        read<pliant::ContactState>(topic + "/contact", [&](double time, const pliant::ContactState &message) {
            contacts_[t].push_back({time, {{double(message.touching), double(message.grasped)}}});
        });
    }
}

/* Find all image topics whose first message has a supported encoding. */
void Export::find_pictures()
{
    const std::set<std::string> known = {"rgb8", "bgr8", "mono8", "8UC1", "32FC1"};
    rosbag::View all(bag_, rosbag::TypeQuery(ros::message_traits::DataType<sensor_msgs::Image>::value()));
    std::set<std::string> topics;
    for (const rosbag::ConnectionInfo *connection : all.getConnections()) topics.insert(connection->topic);
    for (const std::string &topic : topics) {
        rosbag::View view(bag_, rosbag::TopicQuery(topic));
        if (view.size() == 0) continue;
        sensor_msgs::Image::ConstPtr image = view.begin()->instantiate<sensor_msgs::Image>();
        if (!image || !known.count(image->encoding)) continue;
        std::string name = topic.compare(0, root_.size(), root_) == 0 ? topic.substr(root_.size()) : topic.substr(1);
        const std::string end = "/image_raw";
        if (name.size() > end.size() && name.compare(name.size() - end.size(), end.size(), end) == 0)
            name.resize(name.size() - end.size());
        std::replace(name.begin(), name.end(), '/', '_');
        pictures_.push_back(
            {name, topic, image->encoding, since_start(*view.begin()), image->width, image->height, {}});
    }
}

/* Choose the rows. An episode starts when the first step and an image of every camera are available, and ends with its
 * last step. */
void Export::choose_rows()
{
    double seen = 0;
    for (const Pictures &pictures : pictures_) seen = std::max(seen, pictures.first);
    int64_t episode = 0;
    for (size_t begin = 0, end; begin < turns_.size(); begin = end) {
        for (end = begin + 1; end < turns_.size() && !turns_[end].second.begins;) ++end;
        const double first = std::max(turns_[begin].first, seen), last = turns_[end - 1].first;
        size_t turn = begin;
        for (size_t k = 0; first + double(k) / fps_ <= last + SLACK; ++k) {
            const double time = first + double(k) / fps_;
            while (turn + 1 < end && turns_[turn + 1].first <= time + SLACK) ++turn;
            rows_.push_back({time, episode, turn});
        }
        if (!rows_.empty() && rows_.back().episode == episode) ++episode;
    }
    if (rows_.empty())
        throw Failure(PLIANT_ERROR_FORMAT,
                      bag_.getFileName() + ": every camera's first picture comes after the last step");
}

Motion Export::motion(const Row &row, size_t tool) const
{
    const std::map<size_t, Motion> &present = turns_[row.turn].second.tools;
    auto found = present.find(tool);
    return found == present.end() ? Motion{} : found->second;
}

void Export::write_rows() const
{
    const size_t rows = rows_.size(), tools = tools_.size();
    NpyFile times(folder_ + "/times.npy", "f8", {rows}), episodes(folder_ + "/episodes.npy", "i8", {rows}),
        steps(folder_ + "/steps.npy", "i8", {rows});
    NpyFile state(folder_ + "/state.npy", "f8", {rows, tools * (NUM_MOTION_COLUMNS + NUM_SENSE_COLUMNS)}),
        action(folder_ + "/action.npy", "f8", {rows, tools * NUM_MOTION_COLUMNS});
    for (size_t r = 0; r < rows; ++r) {
        const Row &row = rows_[r], &next = r + 1 < rows && rows_[r + 1].episode == row.episode ? rows_[r + 1] : row;
        const int64_t step = static_cast<int64_t>(turns_[row.turn].second.step);
        times.append(&row.time, sizeof row.time);
        episodes.append(&row.episode, sizeof row.episode);
        steps.append(&step, sizeof step);
        for (size_t t = 0; t < tools; ++t) {
            const Motion now = motion(row, t), then = motion(next, t);
            std::array<double, NUM_SENSE_COLUMNS> sense{};
            if (turns_[row.turn].second.tools.count(t)) {
                sense[0] = 1;
                if (auto contact = newest(contacts_[t], row.time))
                    std::copy(contact->second.begin(), contact->second.end(), sense.begin() + 1);
                if (auto wrench = newest(wrenches_[t], row.time))
                    std::copy(wrench->second.begin(), wrench->second.end(), sense.begin() + 3);
            }
            state.append(now.data(), sizeof now);
            state.append(sense.data(), sizeof sense);
            action.append(then.data(), sizeof then);
        }
    }
    for (NpyFile *file : {&times, &episodes, &steps, &state, &action}) file->close();
}

/* Find the shown pictures by their times, without decoding them. */
void Export::find_shown(Pictures *pictures) const
{
    rosbag::View view(bag_, rosbag::TopicQuery(pictures->topic));
    auto row = rows_.begin();
    int64_t newest = -1;
    for (const rosbag::MessageInstance &recorded : view) {
        for (; row != rows_.end() && row->time + SLACK < since_start(recorded); ++row)
            pictures->shown.push_back(newest);
        ++newest;
    }
    pictures->shown.resize(rows_.size(), newest);
}

/* Write the picture index of each row. Indices ascend with the rows, so the shown pictures are numbered in order. */
void Export::write_index(const Pictures &pictures) const
{
    NpyFile file(folder_ + "/index_" + pictures.name + ".npy", "i8", {rows_.size()});
    int64_t index = 0;
    for (size_t r = 0; r < rows_.size(); ++r) {
        if (r > 0 && pictures.shown[r] != pictures.shown[r - 1]) ++index;
        file.append(&index, sizeof index);
    }
    file.close();
}

void Export::write_pictures(const Pictures &pictures) const
{
    const std::set<int64_t> wanted(pictures.shown.begin(), pictures.shown.end());
    std::vector<size_t> shape = {wanted.size(), pictures.height, pictures.width};
    if (pictures.colours()) shape.push_back(3);
    NpyFile file(folder_ + "/image_" + pictures.name + ".npy", pictures.real() ? "f4" : "u1", shape);
    const size_t line = pictures.row_size();
    std::vector<uint8_t> picture(line * pictures.height);
    int64_t number = -1;
    read<sensor_msgs::Image>(pictures.topic, [&](double, const sensor_msgs::Image &image) {
        if (wanted.count(++number) == 0) return;
        const bool same =
            image.width == pictures.width && image.height == pictures.height && image.encoding == pictures.encoding;
        if (!same || image.step < line || image.data.size() < size_t(image.step) * image.height)
            throw Failure(PLIANT_ERROR_FORMAT, pictures.topic + ": the size or encoding of the pictures changes");
        for (size_t y = 0; y < image.height; ++y) std::copy_n(&image.data[y * image.step], line, &picture[y * line]);
        if (pictures.encoding == "bgr8")
            for (size_t i = 0; i < picture.size(); i += 3) std::swap(picture[i], picture[i + 2]);
        file.append(picture.data(), picture.size());
    });
    file.close();
}

void Export::write_columns() const
{
    auto list = [](const std::vector<std::string> &names) {
        std::string out;
        for (const std::string &name : names) out += (out.empty() ? "\"" : ", \"") + name + "\"";
        return "[" + out + "]";
    };
    std::vector<std::string> state, action, pictures;
    for (const std::string &tool : tools_) {
        for (const char *column : motion_columns) action.push_back(tool + "/" + column);
        for (const char *column : motion_columns) state.push_back(tool + "/" + column);
        for (const char *column : sense_columns) state.push_back(tool + "/" + column);
    }
    for (const Pictures &each : pictures_) pictures.push_back(each.name);
    const std::string path = folder_ + "/columns.json";
    std::ofstream file(path);
    file << "{\"fps\": " << fps_ << ",\n \"state\": " << list(state) << ",\n \"action\": " << list(action)
         << ",\n \"images\": " << list(pictures) << "}\n";
    file.close();
    if (!file) throw Failure(PLIANT_ERROR_FILE, path + ": " + std::strerror(errno));
}

std::string Export::run()
{
    read_turns();
    read_senses();
    find_pictures();
    choose_rows();
    write_rows();
    for (Pictures &pictures : pictures_) {
        find_shown(&pictures);
        write_index(pictures);
        write_pictures(pictures);
    }
    write_columns();
    return std::to_string(rows_.size()) + " rows of " + std::to_string(rows_.back().episode + 1) + " episodes, " +
           std::to_string(tools_.size()) + " tools and " + std::to_string(pictures_.size()) + " cameras in " + folder_ +
           "\n";
}

} // namespace

std::string export_numpy(const rosbag::Bag &bag, const std::string &name, int fps, const std::string &folder)
{
    return Export(bag, name, fps, folder).run();
}

} // namespace pliant_ros
