#include "rviz/transfer.h"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <locale>
#include <sstream>

namespace pliant_rviz {

// The windows are common in radiology: soft tissue 40 / 400 HU, bone 400 / 1800, lung -600 / 1500. Skin is the
// transition from air to tissue; contrast-filled vessels start at 130 HU.
const std::vector<Preset> &presets()
{
    static const std::vector<Preset> all = {
        {"CT soft tissue", "HU", false, 60, 420, -350,
         {{0.05, {0.55, 0.30, 0.18, 0.0}}, {0.18, {0.80, 0.60, 0.35, 0.006}}, {0.34, {0.86, 0.62, 0.42, 0.010}},
          {0.42, {0.70, 0.22, 0.16, 0.06}}, {0.55, {0.85, 0.36, 0.26, 0.10}}, {0.70, {0.95, 0.62, 0.45, 0.18}},
          {0.85, {0.97, 0.90, 0.80, 0.45}}, {1.00, {1.00, 0.98, 0.93, 0.65}}}},
        {"CT abdomen", "HU", false, -125, 1150, -350,
         {{0.01, {0.95, 0.76, 0.62, 0.0}}, {0.17, {0.95, 0.76, 0.62, 0.10}}, {0.435, {0.95, 0.78, 0.62, 0.16}},
          {0.496, {0.95, 0.82, 0.60, 0.0}}, {0.593, {0.80, 0.50, 0.40, 0.0}}, {0.632, {0.80, 0.45, 0.40, 0.03}},
          {0.661, {0.66, 0.20, 0.15, 0.05}}, {0.679, {0.66, 0.26, 0.17, 0.10}}, {0.691, {0.58, 0.22, 0.13, 0.35}},
          {0.709, {0.56, 0.20, 0.14, 0.40}}, {0.722, {0.58, 0.16, 0.20, 0.40}}, {0.739, {0.74, 0.26, 0.20, 0.40}},
          {0.765, {0.86, 0.22, 0.16, 0.50}}, {0.809, {0.90, 0.75, 0.60, 0.50}}, {0.867, {0.96, 0.92, 0.82, 0.70}},
          {1.00, {1.00, 1.00, 0.95, 0.85}}}},
        {"CT bone", "HU", false, 500, 1100, 200,
         {{0.15, {0.55, 0.25, 0.15, 0.0}}, {0.24, {0.75, 0.50, 0.32, 0.10}}, {0.40, {0.90, 0.78, 0.60, 0.40}},
          {0.70, {0.97, 0.93, 0.84, 0.75}}, {1.00, {1.00, 1.00, 0.96, 0.90}}}},
        {"CT skin", "HU", false, -150, 500, -400,
         {{0.15, {0.65, 0.40, 0.28, 0.0}}, {0.30, {0.85, 0.62, 0.48, 0.30}}, {0.60, {0.95, 0.76, 0.62, 0.80}},
          {1.00, {1.00, 0.86, 0.74, 0.95}}}},
        {"CT lung", "HU", false, -600, 1000, -500,
         {{0.18, {0.25, 0.40, 0.65, 0.0}}, {0.28, {0.35, 0.55, 0.80, 0.02}}, {0.40, {0.75, 0.80, 0.85, 0.07}},
          {0.52, {0.95, 0.75, 0.65, 0.16}}, {0.66, {0.90, 0.50, 0.40, 0.10}}, {0.80, {0.80, 0.40, 0.30, 0.01}},
          {1.00, {0.80, 0.40, 0.30, 0.006}}}},
        {"CT vessels", "HU", false, 260, 420, 150,
         {{0.18, {0.45, 0.05, 0.04, 0.0}}, {0.30, {0.75, 0.10, 0.08, 0.15}}, {0.50, {0.92, 0.25, 0.16, 0.45}},
          {0.75, {0.98, 0.70, 0.50, 0.65}}, {1.00, {1.00, 0.96, 0.88, 0.80}}}},
        {"MR", "", true, 0.55, 0.95, 0.25,
         {{0.06, {0.10, 0.08, 0.07, 0.0}}, {0.20, {0.32, 0.28, 0.26, 0.03}}, {0.45, {0.60, 0.55, 0.50, 0.12}},
          {0.75, {0.88, 0.84, 0.78, 0.30}}, {1.00, {1.00, 1.00, 1.00, 0.55}}}},
        {"Grey", "", true, 0.5, 1.0, 0.3, {{0.0, {0, 0, 0, 0.0}}, {1.0, {1, 1, 1, 1.0}}}},
    };
    return all;
}

const Preset &preset(const std::string &name)
{
    for (const Preset &one : presets())
        if (one.name == name) return one;
    return presets().front();
}

Colour colour_at(const Preset &preset, double at)
{
    const std::vector<ControlPoint> &points = preset.points;
    if (!(at > points.front().at)) return points.front().colour;
    for (size_t n = 1; n < points.size(); n++) {
        const ControlPoint &a = points[n - 1], &b = points[n];
        if (at >= b.at) continue;
        double part = (at - a.at) / (b.at - a.at);
        return {a.colour.r + part * (b.colour.r - a.colour.r), a.colour.g + part * (b.colour.g - a.colour.g),
                a.colour.b + part * (b.colour.b - a.colour.b), a.colour.a + part * (b.colour.a - a.colour.a)};
    }
    return points.back().colour;
}

std::string points_text(const std::vector<ControlPoint> &points)
{
    std::ostringstream out;
    out.imbue(std::locale::classic()); // decimal point, independent of the desktop's language
    for (const ControlPoint &point : points) {
        const Colour &c = point.colour;
        out << (&point == &points.front() ? "" : "; ") << std::setprecision(4) << point.at << std::setprecision(3);
        out << ", " << c.r << ", " << c.g << ", " << c.b << ", " << std::setprecision(4) << c.a;
    }
    return out.str();
}

static bool read_point(const std::string &text, ControlPoint *out)
{
    std::istringstream in(text);
    in.imbue(std::locale::classic());
    Colour &c = out->colour;
    char comma = ',';
    in >> out->at;
    for (double *number : {&c.r, &c.g, &c.b, &c.a})
        if (!(in >> comma >> *number) || comma != ',') return false;
    return !(in >> comma); // nothing may follow
}

std::string points_from_text(const std::string &text, std::vector<ControlPoint> *out)
{
    std::vector<ControlPoint> read;
    std::istringstream all(text);
    for (std::string each; std::getline(all, each, ';');) {
        ControlPoint point;
        const Colour &c = point.colour;
        const std::string name = "point " + std::to_string(read.size() + 1);
        if (!read_point(each, &point)) return name + " is not place, red, green, blue, opacity: " + each;
        for (double number : {point.at, c.r, c.g, c.b, c.a})
            if (!(number >= 0 && number <= 1)) return name + " has a number outside of 0 to 1: " + each;
        if (!read.empty() && !(point.at > read.back().at)) return name + " lies before the one before it: " + each;
        read.push_back(point);
    }
    if (read.size() < 2) return "two points or more are needed";
    *out = read;
    return "";
}

// minimum distance between two points [fraction of the window]; the text has four digits
static const double MIN_SEPARATION = 0.001;

void move_point(std::vector<ControlPoint> *points, size_t which, double at, double opacity)
{
    const double low = which > 0 ? (*points)[which - 1].at + MIN_SEPARATION : 0;
    const double high = which + 1 < points->size() ? (*points)[which + 1].at - MIN_SEPARATION : 1;
    if (low <= high) (*points)[which].at = std::min(std::max(at, low), high);
    (*points)[which].colour.a = std::min(std::max(opacity, 0.0), 1.0);
}

int add_point(std::vector<ControlPoint> *points, double at)
{
    Preset line;
    line.points = *points;
    size_t which = 0;
    while (which < points->size() && (*points)[which].at < at) which++;
    const double low = which > 0 ? (*points)[which - 1].at + MIN_SEPARATION : 0,
                 high = which < points->size() ? (*points)[which].at - MIN_SEPARATION : 1;
    if (low > high) return -1;
    points->insert(points->begin() + long(which), {at, colour_at(line, at)});
    move_point(points, which, at, (*points)[which].colour.a);
    return int(which);
}

bool remove_point(std::vector<ControlPoint> *points, size_t which)
{
    if (points->size() <= 2) return false;
    points->erase(points->begin() + long(which));
    return true;
}

double opacity_over(double opacity, double distance)
{
    return 1 - std::pow(1 - std::min(std::max(opacity, 0.0), 1.0), distance);
}

Table make_table(const Preset &preset, double opacity, double distance)
{
    Table table;
    for (size_t n = 0; n < TABLE_SIZE; n++) {
        Colour colour = colour_at(preset, double(n) / (TABLE_SIZE - 1));
        double a = opacity_over(opacity * colour.a, distance);
        const double channels[4] = {colour.r * a, colour.g * a, colour.b * a, a};
        for (size_t c = 0; c < 4; c++)
            table[4 * n + c] = uint16_t(std::lround(65535 * std::min(std::max(channels[c], 0.0), 1.0)));
    }
    return table;
}

std::vector<bool> drawn_values(const Preset &preset, double low, double high, double value_at_0, double value_at_1)
{
    const size_t steps = 4096;
    std::vector<bool> drawn(steps);
    double step = (value_at_1 - value_at_0) / double(steps - 1);
    for (size_t n = 0; n < steps; n++) {
        double value = value_at_0 + step * double(n);
        // values between two steps count for both; a step wider than the window may skip all of it
        bool any = std::fabs(step) > high - low && value - std::fabs(step) < high && value + std::fabs(step) > low;
        for (double offset : {-1.0, 0.0, 1.0})
            any = any || colour_at(preset, (value + offset * step - low) / (high - low)).a > 0;
        drawn[n] = any;
    }
    return drawn;
}

double transparent_up_to(const Preset &preset)
{
    double place = -1;
    for (const ControlPoint &point : preset.points) {
        if (point.colour.a > 0) break;
        place = point.at;
    }
    return place;
}

} // namespace pliant_rviz
