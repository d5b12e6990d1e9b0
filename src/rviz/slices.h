// Geometry for drawing a volume: a clipped box in slices that face the viewer. No Ogre, no ROS.
#ifndef PLIANT_RVIZ_SLICES_H
#define PLIANT_RVIZ_SLICES_H

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace pliant_rviz {

using Vector = std::array<double, 3>;

inline double dot(const Vector &a, const Vector &b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// Half space of the kept points: dot(normal, point) >= offset.
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
    size_t count = 0;               // number of non-empty slices
};

// Return the intersection of the plane dot(direction, point) = distance with the box and the kept sides of the planes:
// a convex polygon, or nothing.
// direction: unit vector
std::vector<Vector> slice(const Bounds &box, const std::vector<Plane> &planes, const Vector &direction,
                          double distance);

// Return slices of the box at integer multiples of the spacing along the view direction, the farthest first. Multiples
// count from the coordinate origin, so that slices stay in place when the box changes.
// @param maximum maximum number of slices; choose the spacing accordingly
Slices make_slices(const Bounds &box, const std::vector<Plane> &planes, const Vector &direction, double spacing,
                   size_t maximum);

// Return the part [near, far] of origin + t * direction, t >= 0, inside the box and the planes; false: none.
bool clip_ray(const Bounds &box, const std::vector<Plane> &planes, const Vector &origin, const Vector &direction,
              double *near, double *far);

// Return the segments of a ray segment outside a box: at most two, the nearer first. An empty box removes nothing.
struct Part { double near, far; };
std::vector<Part> outside(const Bounds &box, const Vector &origin, const Vector &direction, const Part &part);

} // namespace pliant_rviz
#endif
