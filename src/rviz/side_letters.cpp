#include "rviz/side_letters.h"

#include <algorithm>
#include <cmath>

namespace pliant_rviz {

std::string side_letters(const Vector &direction)
{
    static const char letters[3][2] = {{'R', 'L'}, {'A', 'P'}, {'I', 'S'}};
    const double minimum = std::sin(15 * std::acos(-1.0) / 180) * std::sqrt(dot(direction, direction));
    int axes[3] = {0, 1, 2};
    std::sort(axes, axes + 3, [&](int a, int b) { return std::fabs(direction[a]) > std::fabs(direction[b]); });
    std::string out;
    for (int axis : axes)
        if (std::fabs(direction[axis]) > minimum) out += letters[axis][direction[axis] > 0];
    return out;
}

} // namespace pliant_rviz
