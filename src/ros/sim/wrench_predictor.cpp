#include "ros/sim/wrench_predictor.h"

#include <algorithm>
#include <cmath>

namespace pliant_ros {

namespace {

const double shortest_blend = 0.005, longest_blend = 0.05; /* limits of the blending time after a step [s] */
const double arm = 0.02;       /* lever arm that converts rotations to lengths [m] */
const double slowest = 0.02;   /* maximum time between two poses from which a motion is estimated [s] */
const double motion_decay_time = 0.2;  /* decay time of the longest motion [s] */
const double reserved_motions = 4;     /* number of motions for which a returning force must leave energy */
const double max_reach = 0.001; /* maximum motion length in the energy credit [m] */
const double rests = 1e-4, rests_for = 0.2; /* the hand rests if it moves less than rests [m] during rests_for [s] */

double product(const double a[6], const double b[6])
{
    double sum = 0;
    for (int i = 0; i < 6; ++i) sum += a[i] * b[i];
    return sum;
}

/* Return the motion between two poses: translation and rotation vector. */
void motion_between(const pliant_tool_linear &from, const double tip[3], const double rotation[4], double out[6])
{
    pliant_tool_linear unit{}; /* with unit stiffness, the wrench equals the motion */
    std::copy(from.tip, from.tip + 3, unit.tip);
    std::copy(from.rotation, from.rotation + 4, unit.rotation);
    for (int i = 0; i < 6; ++i) unit.stiffness[7 * i] = 1;
    pliant_tool_linear_wrench(&unit, tip, rotation, INFINITY, out);
}

} // namespace

/* Return whether the tool neither grasps nor touches tissue. */
bool WrenchPredictor::is_free() const
{
    return std::all_of(linear_.wrench, linear_.wrench + 6, [](double x) { return x == 0; }) &&
           std::all_of(linear_.stiffness, linear_.stiffness + 36, [](double x) { return x == 0; });
}

void WrenchPredictor::wanted(double now, const double tip[3], const double rotation[4], double out[6]) const
{
    pliant_tool_linear_wrench(&linear_, tip, rotation, max_change_, out);
    const double left = blend_for_ > 0 ? std::max(0.0, 1 - (now - blend_from_) / blend_for_) : 0;
    double squares = 0;
    for (int i = 0; i < 6; ++i) out[i] += left * offset_[i];
    for (int d = 0; d < 3; ++d) squares += std::pow(out[d] - linear_.wrench[d], 2);
    const double part = std::sqrt(squares) > max_change_ ? max_change_ / std::sqrt(squares) : 1;
    for (int d = 0; d < 3; ++d) out[d] = linear_.wrench[d] + part * (out[d] - linear_.wrench[d]);
}

void WrenchPredictor::frame(double now, const pliant_tool_linear &linear, bool acts)
{
    double before[6], after[6];
    const bool goes_on = acts_ && has_answered_;
    if (goes_on) wanted(now, last_.tip, last_.rotation, before);
    blend_for_ = goes_on ? std::min(std::max(now - frame_at_, shortest_blend), longest_blend) : 0;
    linear_ = linear;
    frame_at_ = blend_from_ = now;
    acts_ = acts && linear.known;
    if (goes_on) pliant_tool_linear_wrench(&linear_, last_.tip, last_.rotation, max_change_, after);
    for (int i = 0; i < 6; ++i) offset_[i] = goes_on ? before[i] - after[i] : 0;
    /* At rest, the tissue stores at least the elastic energy, so the energy count is raised to it. */
    if (acts_ && now - rests_from_ > rests_for) energy_ = std::max(energy_, elastic());
    if (is_free()) energy_ = 0; /* without contact the energy count restarts */
}

/* Count the energy of the last wrench along a motion. A repeated query at the same pose is no motion. */
void WrenchPredictor::move(double now, const double motion[6])
{
    double length = 0;
    for (int i = 0; i < 6; ++i) length += std::pow(motion[i] * (i < 3 ? 1 : arm), 2);
    /* the bound stops one outlier pose from causing a permanent energy deficit */
    energy_ = std::max(energy_ + product(last_.wrench, motion), -0.5 * initial_energy_credit());
    if (!(length > 0)) return;
    reach_ = std::max(reach_ * std::exp(-(now - moved_at_) / motion_decay_time), std::sqrt(length));
    std::copy(motion, motion + 6, motion_);
    for (int i = 0; i < 6; ++i) trend_[i] += 0.1 * (motion[i] - trend_[i]);
    moved_at_ = now;
}

/* Return the elastic energy of the current force in a spring with the maximum translational stiffness, a lower bound
 * [J]. */
double WrenchPredictor::elastic() const
{
    const double stiffness = std::max({linear_.stiffness[0], linear_.stiffness[7], linear_.stiffness[14]});
    double square = 0;
    for (int d = 0; d < 3; ++d) square += linear_.wrench[d] * linear_.wrench[d];
    return stiffness > 0 ? 0.5 * square / stiffness : 0;
}

/* Return the energy that may be spent before any was put in: twice the elastic energy of the longest recent motion at
 * the maximum stiffness [J]. */
double WrenchPredictor::initial_energy_credit() const
{
    const double reach = std::min(reach_, max_reach);
    return std::max({linear_.stiffness[0], linear_.stiffness[7], linear_.stiffness[14]}) * reach * reach;
}

void WrenchPredictor::limit_for_passivity(double now, double wrench[6])
{
    double size = 0;
    for (int i = 0; i < 6; ++i) size += std::pow(wrench[i] / (i < 3 ? 1 : arm), 2);
    /* On the return motion the force is reduced earlier, so that it ends smoothly. */
    const double faded = std::exp(-(now - moved_at_) / motion_decay_time);
    const bool back = now - moved_at_ < motion_decay_time && product(wrench, trend_) < 0;
    const double taken = std::sqrt(size) * reach_ * faded * (back ? reserved_motions : 1),
                 there = std::max(energy_, -0.5 * initial_energy_credit()) + initial_energy_credit();
    if (!(taken > there)) return;
    ++num_limited_wrenches_;
    for (int i = 0; i < 6; ++i) wrench[i] *= there / taken;
}

void WrenchPredictor::answer(double now, const double tip[3], const double rotation[4], double out[6])
{
    double motion[6] = {}, ahead[3];
    if (has_answered_) {
        motion_between(last_, tip, rotation, motion);
        move(now, motion);
    }
    std::fill(out, out + 6, 0.0);
    if (acts_) {
        const bool goes_on = moved_at_ >= 0 && now - moved_at_ < slowest;
        for (int d = 0; d < 3; ++d) ahead[d] = tip[d] + (goes_on ? 0.5 * motion_[d] : 0);
        wanted(now, ahead, rotation, out);
    }
    ramp_.apply(now, acts_, out);
    if (std::any_of(out, out + 6, [](double x) { return x != 0; })) limit_for_passivity(now, out);
    else if (!acts_) energy_ = 0;
    if (acts_) ramp_.set_published(out);
    double squares_to_rest = 0;
    for (int d = 0; d < 3; ++d) squares_to_rest += std::pow(tip[d] - rests_at_[d], 2);
    if (!has_answered_ || squares_to_rest > rests * rests) {
        std::copy(tip, tip + 3, rests_at_);
        rests_from_ = now;
    }
    has_answered_ = true;
    std::copy(tip, tip + 3, last_.tip);
    std::copy(rotation, rotation + 4, last_.rotation);
    std::copy(out, out + 6, last_.wrench);
}

} // namespace pliant_ros
