// Geometry of what is drawn of a volume: a box, cut by planes, in slices that face the viewer. No Ogre, no ROS.
#ifndef PLIANT_RVIZ_SLICES_H
#define PLIANT_RVIZ_SLICES_H

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace pliant_rviz {

using Vector = std::array<double, 3>;

inline double dot(const Vector &a, const Vector &b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// Keeps the points with dot(normal, point) >= offset.
struct Plane {
    Vector normal;
    double offset;
};

struct Bounds {
    Vector low, high;
    bool empty() const { return !(low[0] < high[0] && low[1] < high[1] && low[2] < high[2]); }
};

struct Slices {
    std::vector<float> vertices;    // x y z
    std::vector<uint32_t> triangles;
    size_t count = 0;               // slices that are not empty
};

// Where the plane dot(direction, point) = distance meets the box and the kept sides of the planes: a convex polygon, or
// nothing. Direction is a unit vector.
std::vector<Vector> slice(const Bounds &box, const std::vector<Plane> &planes, const Vector &direction, double distance);

// Slices of the box at whole multiples of the spacing along the viewing direction, the farthest first. The multiples are
// counted from the origin of the coordinates, so that they stay where they are when the box changes.
// @param most  no more than this many; the spacing must be chosen for it
Slices make_slices(const Bounds &box, const std::vector<Plane> &planes, const Vector &direction, double spacing, size_t most);

// Part [near, far] of origin + t * direction, t >= 0, inside the box and the planes; false: none.
bool clip_ray(const Bounds &box, const std::vector<Plane> &planes, const Vector &origin, const Vector &direction, double *near,
              double *far);

// Of a part of a ray, those outside of a box: two at most, the nearer first. An empty box leaves it whole.
struct Part { double near, far; };
std::vector<Part> outside(const Bounds &box, const Vector &origin, const Vector &direction, const Part &part);

} // namespace pliant_rviz
#endif
