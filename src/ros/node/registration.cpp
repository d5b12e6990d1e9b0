#include "ros/node/registration.h"

#include "ros/params/start.h"

#include <Eigen/Dense>
#include <ros/console.h>
#include <tf2_eigen/tf2_eigen.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <sstream>
#include <stdexcept>

namespace pliant_ros {

namespace {

/* Minimum ratio of the second to the first singular value of the centred points. Below it, the rotation about the first
 * direction is undetermined. */
const double MIN_WIDTH = 0.02;

Eigen::Matrix3Xd matrix_of(const std::vector<geometry_msgs::Point> &points)
{
    Eigen::Matrix3Xd out(3, points.size());
    for (size_t p = 0; p < points.size(); ++p)
        out.col(static_cast<Eigen::Index>(p)) << points[p].x, points[p].y, points[p].z;
    return out;
}

const double DEFAULT_MAX_ERROR = 0.01; /* [m] */
/* maximum root mean square distance of points on one patient from their centre [m] */
const double MAX_RADIUS = 2;

/* Return the root mean square distance of the points from their centre. */
double radius_of(const Eigen::Matrix3Xd &points)
{
    return std::sqrt((points.colwise() - points.rowwise().mean().eval()).colwise().squaredNorm().mean());
}

double rms_of_fit(const Eigen::Matrix3Xd &from, const Eigen::Matrix3Xd &to)
{
    const Eigen::Matrix4d fitted = Eigen::umeyama(from, to, false);
    const Eigen::Matrix3Xd turned = (fitted.topLeftCorner<3, 3>() * from).colwise() + fitted.topRightCorner<3, 1>();
    return std::sqrt((turned - to).colwise().squaredNorm().mean());
}

/* Return the unit of points whose coordinates are `scale` times as large as in metres; NULL if no unit matches. */
const char *unit_of(double scale)
{
    const auto near = [scale](double known) { return scale > 0.7 * known && scale < 1.4 * known; };
    return near(1000) ? "millimetres" : near(100) ? "centimetres" : nullptr;
}

std::string millimetres(double metres)
{
    char text[40];
    std::snprintf(text, sizeof text, "%.1f mm", 1e3 * metres);
    return text;
}

bool spans_a_plane(const Eigen::Matrix3Xd &points)
{
    const Eigen::Matrix3Xd spread = points.colwise() - points.rowwise().mean().eval();
    const Eigen::Matrix3d covariance = spread * spread.transpose();
    const Eigen::Vector3d squares =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance, Eigen::EigenvaluesOnly).eigenvalues();
    return squares[2] > 0 && squares[1] > MIN_WIDTH * MIN_WIDTH * squares[2];
}

} // namespace

bool fit_rigid(const std::vector<geometry_msgs::Point> &from, const std::vector<geometry_msgs::Point> &to, Rigid *out,
               std::vector<double> *errors, std::string *why)
{
    if (from.size() != to.size() || from.size() < 3) {
        *why = std::to_string(from.size()) + " points of the tissue and " + std::to_string(to.size()) +
               " of the room; use the same number, and at least three pairs";
        return false;
    }
    const Eigen::Matrix3Xd a = matrix_of(from), b = matrix_of(to);
    if (!a.allFinite() || !b.allFinite()) {
        *why = "points must be finite";
        return false;
    }
    if (!spans_a_plane(a) || !spans_a_plane(b)) {
        *why = "the points lie on a line, so the rotation about it is unknown; add a point off the line";
        return false;
    }
    const Eigen::Matrix4d fitted = Eigen::umeyama(a, b, false);
    const Eigen::Matrix3d turn = fitted.topLeftCorner<3, 3>();
    Eigen::Map<Eigen::Quaterniond>(out->rotation) = Eigen::Quaterniond(turn).normalized();
    Eigen::Map<Eigen::Vector3d>(out->translation) = fitted.topRightCorner<3, 1>();
    errors->clear();
    for (Eigen::Index p = 0; p < a.cols(); ++p)
        errors->push_back((turn * a.col(p) + fitted.topRightCorner<3, 1>() - b.col(p)).norm());
    return true;
}

double root_mean_square(const std::vector<double> &values)
{
    return std::sqrt(
        Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size())).squaredNorm() /
        static_cast<double>(values.size()));
}

std::string refusal_of_fit(const std::vector<geometry_msgs::Point> &tissue,
                           const std::vector<geometry_msgs::Point> &room, const std::vector<double> &errors,
                           double max_error)
{
    if (!(max_error >= 0)) return "max_error is " + std::to_string(max_error) + "; use a length [m], or 0 for 0.01";
    const double limit = max_error > 0 ? max_error : DEFAULT_MAX_ERROR, rms = root_mean_square(errors);
    Eigen::Matrix3Xd a = matrix_of(tissue), b = matrix_of(room);
    const double ratio = radius_of(b) / radius_of(a), largest = std::max(radius_of(a), radius_of(b));
    if (rms <= limit && largest <= MAX_RADIUS) return "";
    std::string text = "refused, the tissue pose does not change: root mean square error " + millimetres(rms) +
                       ", limit " + millimetres(limit) + " (max_error).";
    const char *unit = unit_of(std::max(ratio, 1 / ratio));
    if (unit)
        text +=
            std::string(" Are the points of the ") + (ratio > 1 ? "room" : "tissue") + " in " + unit + "? Use metres.";
    else if (largest > MAX_RADIUS)
        text += " The points lie " + std::to_string(std::lround(largest)) +
                " m from their centre. Are they in millimetres? Use metres.";
    if (unit) (ratio > 1 ? b : a) *= std::min(ratio, 1 / ratio);
    const double direct = rms_of_fit(a, b);
    a.row(0) = -a.row(0);
    const double mirrored = rms_of_fit(a, b);
    if (direct > limit && mirrored < 0.5 * direct && mirrored <= std::max(limit, 0.2 * direct)) {
        text += " Are the points mirrored? With one axis reversed the error is " + millimetres(mirrored) + ".";
    } else if (!unit && rms > limit) {
        const auto worst = std::max_element(errors.begin(), errors.end());
        text += " Check the frame and the order of the pairs; pair " + std::to_string(worst - errors.begin() + 1) +
                " of " + std::to_string(errors.size()) + " is off by " + millimetres(*worst) + ".";
    }
    return text;
}

geometry_msgs::Pose pose_message(const Rigid &pose)
{
    return tf2::toMsg(Eigen::Isometry3d(tf2::transformToEigen(transform_message(pose))));
}

std::string registration_text(const std::string &parent_frame, const Rigid &pose)
{
    const double *t = pose.translation, *q = pose.rotation;
    char numbers[256];
    std::snprintf(numbers, sizeof numbers, "%.17g %.17g %.17g %.17g %.17g %.17g %.17g", t[0], t[1], t[2], q[0], q[1],
                  q[2], q[3]);
    return "# pose of the tissue in the parent frame: x y z [m] qx qy qz qw\nparent_frame: " + parent_frame +
           "\ntissue_pose: " + numbers + "\n";
}

bool registration_from_text(const std::string &text, const std::string &parent_frame, Rigid *out, std::string *why)
{
    const size_t frame = text.find("parent_frame: "), pose = text.find("tissue_pose: ");
    geometry_msgs::Pose read;
    geometry_msgs::Point &t = read.position;
    geometry_msgs::Quaternion &q = read.orientation;
    if (frame == std::string::npos || pose == std::string::npos ||
        std::sscanf(text.c_str() + pose, "tissue_pose: %lf %lf %lf %lf %lf %lf %lf", &t.x, &t.y, &t.z, &q.x, &q.y, &q.z,
                    &q.w) != 7) {
        *why = "it needs the lines parent_frame: NAME and tissue_pose: x y z qx qy qz qw";
        return false;
    }
    const size_t begin = frame + std::string("parent_frame: ").size();
    const std::string named = text.substr(begin, text.find('\n', begin) - begin);
    if (named != parent_frame) {
        *why = "it belongs to the parent frame " + named + ", not of " + parent_frame;
        return false;
    }
    return rigid_from_message(read, out, why);
}

bool hand_eye_from_text(const std::string &text, std::string *frame, Rigid *out, std::string *why)
{
    *why = "it needs \"reference-frame\": NAME and \"transform\": four rows of four numbers, the last one 0 0 0 1";
    const std::string named = "\"reference-frame\"", matrix = "\"transform\"";
    const size_t name = text.find(named), rows = text.find(matrix);
    if (name == std::string::npos || rows == std::string::npos) return false;
    const size_t begin = text.find('"', name + named.size()),
                 end = begin == std::string::npos ? begin : text.find('"', begin + 1);
    if (end == std::string::npos || end <= begin + 1) return false;
    Eigen::Matrix4d read;
    const char *at = text.c_str() + rows + matrix.size();
    for (int k = 0; k < 16; ++k) {
        at += std::strspn(at, " :,[]\t\r\n");
        char *after;
        read(k / 4, k % 4) = std::strtod(at, &after);
        if (after == at) return false;
        at = after;
    }
    if (!read.allFinite() || (read.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).norm() > 1e-9) return false;
    const Eigen::Matrix3d turn = read.topLeftCorner<3, 3>();
    if ((turn * turn.transpose() - Eigen::Matrix3d::Identity()).norm() > 1e-2 || turn.determinant() < 0) {
        *why = "the first three columns of its transform are not a rotation";
        return false;
    }
    Eigen::Map<Eigen::Quaterniond>(out->rotation) = Eigen::Quaterniond(turn).normalized();
    Eigen::Map<Eigen::Vector3d>(out->translation) = read.topRightCorner<3, 1>();
    *frame = text.substr(begin + 1, end - begin - 1);
    why->clear();
    return true;
}

Registration::Registration(ros::NodeHandle handle, const Parameters &parameters,
                           std::shared_ptr<tf2_ros::Buffer> frames)
    : parameters_(parameters), frames_(std::move(frames))
{
    place_arms();
    if (parameters.parent_frame.empty()) return;
    Rigid pose = parameters.tissue_pose;
    std::ifstream file(parameters.registration);
    if (!parameters.registration.empty() && file) {
        const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
        std::string why;
        if (!registration_from_text(text, parameters.parent_frame, &pose, &why))
            throw std::runtime_error("~registration: " + parameters.registration + ": " + why);
        stored_ = true;
        ROS_INFO("the tissue pose is read from %s", parameters.registration.c_str());
    }
    place(pose);
    server_ = handle.advertiseService("register", &Registration::by_points, this);
}

geometry_msgs::Pose Registration::pose_message() const
{
    std::lock_guard<std::mutex> hold(lock_);
    return pliant_ros::pose_message(pose_);
}

void Registration::restore_pose(const std::string &parent_frame, const geometry_msgs::Pose &pose)
{
    Rigid read;
    std::string why;
    if (stored_ || parent_frame.empty() || parent_frame != parameters_.parent_frame ||
        !rigid_from_message(pose, &read, &why))
        return;
    place(read);
}

void Registration::send(const geometry_msgs::TransformStamped &transform)
{
    broadcaster_.sendTransform(transform);
    /* in addition to the broadcast, so that this node sees it without network delay */
    frames_->setTransform(transform, "pliant", true);
}

void Registration::place_arms()
{
    std::istringstream all(parameters_.hand_eye);
    for (std::string word; all >> word;) {
        const size_t sign = word.find('=');
        const std::string path = word.substr(sign + 1);
        std::ifstream file(path);
        if (!file) throw std::runtime_error("~hand_eye: " + path + " cannot be read");
        const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
        geometry_msgs::TransformStamped transform;
        Rigid pose;
        std::string why;
        if (!hand_eye_from_text(text, &transform.header.frame_id, &pose, &why))
            throw std::runtime_error("~hand_eye: " + path + ": " + why);
        transform.header.stamp = ros::Time::now();
        transform.child_frame_id = word.substr(0, sign);
        transform.transform = transform_message(pose);
        send(transform);
        ROS_INFO("the pose of %s in %s is read from %s", transform.child_frame_id.c_str(),
                 transform.header.frame_id.c_str(), path.c_str());
    }
}

void Registration::place(const Rigid &pose)
{
    {
        std::lock_guard<std::mutex> hold(lock_);
        pose_ = pose;
    }
    Parameters at = parameters_;
    at.tissue_pose = pose;
    send(tissue_transform(at));
}

std::string Registration::store(const Rigid &pose) const
{
    if (parameters_.registration.empty()) return "; not stored: ~registration names no file";
    /* written next to the old file, which survives if the write fails */
    const std::string next = parameters_.registration + ".new";
    std::ofstream file(next);
    file << registration_text(parameters_.parent_frame, pose);
    file.close();
    const bool stored = file && std::rename(next.c_str(), parameters_.registration.c_str()) == 0;
    return stored ? "; stored in " + parameters_.registration
                  : "; NOT stored: " + parameters_.registration + " cannot be written";
}

bool Registration::by_points(pliant::Register::Request &request, pliant::Register::Response &response)
{
    try {
        Rigid in_parent = identity(), pose;
        std::vector<double> errors;
        std::string why;
        if (request.header.frame_id != parameters_.parent_frame &&
            !rigid_from_message(
                frames_->lookupTransform(parameters_.parent_frame, request.header.frame_id, request.header.stamp)
                    .transform,
                &in_parent, &why))
            throw std::runtime_error(why);
        if (!fit_rigid(request.tissue, request.room, &pose, &errors, &why)) throw std::runtime_error(why);
        response.largest = *std::max_element(errors.begin(), errors.end());
        response.error = root_mean_square(errors);
        response.pose = pose_message();
        why = refusal_of_fit(request.tissue, request.room, errors, request.max_error);
        if (!why.empty()) throw std::runtime_error(why);
        pose = multiply(in_parent, pose);
        place(pose);
        response.pose = pose_message();
        char summary[160];
        std::snprintf(summary, sizeof summary, "%zu pairs, root mean square error %.2f mm, maximum %.2f mm",
                      errors.size(), 1e3 * response.error, 1e3 * response.largest);
        response.message = summary + store(pose);
        response.success = true;
    } catch (const std::exception &failed) {
        response.message = failed.what();
    }
    return true;
}

} // namespace pliant_ros
