#include "ros/guard/guard_parameters.h"

#include <ros/names.h>

#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <vector>

namespace pliant_ros {

namespace {

using XmlRpc::XmlRpcValue;

struct Number {
    const char *name;
    double *value, low, high;
};

[[noreturn]] void refuse(const std::string &name, const std::string &what)
{
    throw std::invalid_argument("~" + name + " " + what);
}

std::string written(double number)
{
    char digits[32];
    std::snprintf(digits, sizeof digits, "%g", number);
    return digits;
}

double read_number(const std::string &name, XmlRpcValue &value)
{
    if (value.getType() == XmlRpcValue::TypeInt) return static_cast<int>(value);
    if (value.getType() != XmlRpcValue::TypeDouble) refuse(name, "must be a number");
    return static_cast<double>(value);
}

bool read_switch(const std::string &name, XmlRpcValue &value)
{
    if (value.getType() != XmlRpcValue::TypeBoolean) refuse(name, "must be true or false");
    return static_cast<bool>(value);
}

void check_tool(const std::string &name)
{
    std::string why;
    if (name.empty() || !ros::names::validate(name, why))
        refuse("tool", "must be the name of the tool whose force is displayed, such as PSM1");
}

void read_one(const std::string &name, XmlRpcValue &value, const std::vector<Number> &numbers, GuardParameters *out)
{
    if (name == "tool") {
        if (value.getType() != XmlRpcValue::TypeString) refuse(name, "must be text");
        out->tool = static_cast<std::string &>(value);
    }
    else if (name == "haptic") {
        out->settings.enabled = true; /* If the value is wrong, the guard sends zeros, but no force. */
        out->settings.enabled = read_switch(name, value);
    }
    else if (name == "needs_following") out->settings.needs_following = read_switch(name, value);
    else if (name == "max_error") {
        const double maximum = read_number(name, value);
        if (std::isnan(maximum)) refuse(name, "must be a number; below 0: any error is accepted");
        out->settings.largest_error = maximum < 0 ? INFINITY : maximum;
    } else if (name != "diagnostic_period") { /* diagnostic_period belongs to diagnostic_updater */
        std::string known = "tool haptic needs_following max_error";
        for (const Number &number : numbers) {
            known += std::string(" ") + number.name;
            if (name != number.name) continue;
            *number.value = read_number(name, value);
            if (*number.value >= number.low && *number.value <= number.high) return;
            refuse(name, "is " + written(*number.value) + "; it must be from " + written(number.low) + " to " +
                             written(number.high));
        }
        refuse(name, "is unknown; there are " + known);
    }
}

} // namespace

bool read_guard_parameters(XmlRpcValue tree, GuardParameters *out, std::string *why)
{
    GuardParameters read;
    GuardSettings &settings = read.settings;
    /* The force becomes zero one update after `timeout` without a pose or force: 50 ms by default, at most half a
     * second. */
    const std::vector<Number> numbers = {
        {"gain", &settings.gain, 1e-6, 100},       {"max_force", &settings.largest, 1e-6, 100},
        {"max_rate", &settings.rate, 1e-6, 1e6},   {"cutoff", &settings.cutoff, 1e-3, 1e4},
        {"ramp", &settings.ramp, 1e-3, 60},        {"tail", &settings.tail, 1e-3, 60},
        {"timeout", &settings.timeout, 1e-3, 0.5}, {"rate", &read.rate, 40, 5000}};
    try {
        if (tree.getType() == XmlRpcValue::TypeStruct) {
            /* Read `haptic` first, so that zeros are sent even if another parameter is wrong. */
            if (tree.hasMember("haptic")) read_one("haptic", tree["haptic"], numbers, &read);
            for (auto &entry : tree) read_one(entry.first, entry.second, numbers, &read);
        }
        check_tool(read.tool);
        *out = read;
        return true;
    } catch (const std::invalid_argument &refused) {
        *why = refused.what();
    }
    const bool enabled = settings.enabled;
    *out = GuardParameters();
    out->settings.enabled = enabled;
    return false;
}

} // namespace pliant_ros
