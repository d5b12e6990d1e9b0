// Transfer functions from values to colour and opacity. No Ogre, no ROS.
#ifndef PLIANT_RVIZ_TRANSFER_H
#define PLIANT_RVIZ_TRANSFER_H

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace pliant_rviz {

struct Colour {
    double r, g, b, a;
};

// A point of a transfer function. at: position in the window; 0 is its low end, 1 its high end.
struct ControlPoint {
    double at;
    Colour colour; // a: opacity of a homogeneous path of 1/256 of the volume's diagonal
};

// Values in the file's unit (CT: Hounsfield units).
struct Preset {
    std::string name;
    std::string unit;
    bool relative;        // level and window are fractions of the 99.5 % quantile of all values above the minimum (MR)
    double level, window; // centre and width of the window
    double surface;       // value of the isosurface
    std::vector<ControlPoint> points; // ascending
};

const std::vector<Preset> &presets();
const Preset &preset(const std::string &name); // an unknown name gives the first one

// Interpolate linearly between the points; outside them the nearest point counts.
Colour colour_at(const Preset &preset, double at);

// Convert points to text and back: "position, red, green, blue, opacity; ...", all in [0, 1], ascending positions, at
// least two points. The second function returns "" or an error message.
std::string points_text(const std::vector<ControlPoint> &points);
std::string points_from_text(const std::string &text, std::vector<ControlPoint> *out);

// Edit the points. A point stays between its neighbours, no point is added if the gap is too small, and the last two
// points cannot be removed.
void move_point(std::vector<ControlPoint> *points, size_t which, double at, double opacity);
// add a point on the line; return its index, -1: the gap is too small
int add_point(std::vector<ControlPoint> *points, double at);
bool remove_point(std::vector<ControlPoint> *points, size_t which);

// Premultiplied colours over the window, 16 bits per channel. The distance of slices is in units of 1/256 of the
// diagonal (the unit of the control points' opacity). The shaders contain the same size.
enum { TABLE_SIZE = 512 };
using Table = std::array<uint16_t, TABLE_SIZE * 4>;
Table make_table(const Preset &preset, double opacity, double distance);

// Return the opacity of a path with the length of `distance` such units.
double opacity_over(double opacity, double distance);

// Return which of 4096 equal steps of [value_at_0, value_at_1] are visible with the window [low, high].
std::vector<bool> drawn_values(const Preset &preset, double low, double high, double value_at_0, double value_at_1);

// Return the highest position in the window below which everything is transparent; negative: the low end is visible.
double transparent_up_to(const Preset &preset);

} // namespace pliant_rviz
#endif
