// From values to colour and opacity. No Ogre, no ROS.
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

// A point of a transfer function; at is a place in the window: 0 its low end, 1 its high end.
struct ControlPoint {
    double at;
    Colour colour; // a: opacity of a path through an even piece of 1/256 of the volume's diagonal
};

// Values in the file's unit (CT: Hounsfield).
struct Preset {
    std::string name;
    std::string unit;
    bool relative;        // level and window are fractions of the 99.5 % quantile of the values above the lowest (MR)
    double level, window; // centre and width
    double surface;       // value of the isosurface
    std::vector<ControlPoint> points; // ascending
};

const std::vector<Preset> &presets();
const Preset &preset(const std::string &name); // the first one when there is none of this name

// Linear between the points; outside of them the nearest one's.
Colour colour_at(const Preset &preset, double at);

// As text, and back: "place, red, green, blue, opacity; ...", all from 0 to 1, places ascending, two points or more. "" or what is wrong with it.
std::string points_text(const std::vector<ControlPoint> &points);
std::string points_from_text(const std::string &text, std::vector<ControlPoint> *out);

// What a hand does to them. A point stays between its neighbours, and none comes where they leave no room; of two points none is taken away.
void move_point(std::vector<ControlPoint> *points, size_t which, double at, double opacity);
int add_point(std::vector<ControlPoint> *points, double at); // on the line; its number, -1: no room
bool remove_point(std::vector<ControlPoint> *points, size_t which);

// Premultiplied colours over the window, 16 bits a channel (the shaders know the size too), for slices that are `distance` apart (in units of the
// control points' opacity: 1/256 of the diagonal).
enum { TABLE_SIZE = 512 };
using Table = std::array<uint16_t, TABLE_SIZE * 4>;
Table make_table(const Preset &preset, double opacity, double distance);

// Opacity of a path through `distance` such pieces.
double opacity_over(double opacity, double distance);

// Which of 4096 even steps of [value_at_0, value_at_1] are drawn at all, given window [low, high].
std::vector<bool> drawn_values(const Preset &preset, double low, double high, double value_at_0, double value_at_1);

// Highest place in the window below which nothing is seen; less than 0: the window's low end is seen.
double transparent_up_to(const Preset &preset);

} // namespace pliant_rviz
#endif
