#include "rviz/slices.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace pliant_rviz {

namespace {

Vector mix(const Vector &a, const Vector &b, double part)
{
    return {{a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]), a[2] + part * (b[2] - a[2])}};
}

// clip a convex polygon to dot(normal, x) >= offset
std::vector<Vector> cut(const std::vector<Vector> &polygon, const Plane &plane)
{
    std::vector<Vector> kept;
    for (size_t n = 0; n < polygon.size(); n++) {
        const Vector &a = polygon[n], &b = polygon[(n + 1) % polygon.size()];
        double side_a = dot(plane.normal, a) - plane.offset, side_b = dot(plane.normal, b) - plane.offset;
        if (side_a >= 0) kept.push_back(a);
        if ((side_a >= 0) != (side_b >= 0)) kept.push_back(mix(a, b, side_a / (side_a - side_b)));
    }
    return kept.size() < 3 ? std::vector<Vector>() : kept;
}

void range_along(const Bounds &box, const Vector &direction, double *low, double *high)
{
    *low = *high = 0;
    for (int d = 0; d < 3; d++) {
        double a = direction[d] * box.low[d], b = direction[d] * box.high[d];
        *low += std::min(a, b);
        *high += std::max(a, b);
    }
}

} // namespace

std::vector<Vector> slice(const Bounds &box, const std::vector<Plane> &planes, const Vector &direction, double distance)
{
    // start with a square in the plane that is larger than the box, then clip it by the six faces
    Vector middle, u{{0, 0, 0}}, v;
    double radius = 0;
    for (int d = 0; d < 3; d++) {
        middle[d] = 0.5 * (box.low[d] + box.high[d]);
        radius += std::fabs(box.high[d] - box.low[d]);
    }
    int minimum = 0;
    for (int d = 1; d < 3; d++)
        if (std::fabs(direction[d]) < std::fabs(direction[minimum])) minimum = d;
    u[minimum] = 1;
    double along = dot(u, direction);
    for (int d = 0; d < 3; d++) u[d] -= along * direction[d];
    double length = std::sqrt(dot(u, u));
    for (double &x : u) x /= length;
    for (int d = 0; d < 3; d++)
        v[d] = direction[(d + 1) % 3] * u[(d + 2) % 3] - direction[(d + 2) % 3] * u[(d + 1) % 3];

    double ahead = distance - dot(middle, direction);
    std::vector<Vector> polygon;
    for (int corner = 0; corner < 4; corner++) {
        double a = corner == 0 || corner == 3 ? -radius : radius, b = corner < 2 ? -radius : radius;
        Vector point;
        for (int d = 0; d < 3; d++) point[d] = middle[d] + ahead * direction[d] + a * u[d] + b * v[d];
        polygon.push_back(point);
    }
    for (int d = 0; d < 3 && !polygon.empty(); d++) {
        Plane face{{{0, 0, 0}}, box.low[d]};
        face.normal[d] = 1;
        polygon = cut(polygon, face);
        face.normal[d] = -1;
        face.offset = -box.high[d];
        polygon = cut(polygon, face);
    }
    for (const Plane &plane : planes) polygon = cut(polygon, plane);
    return polygon;
}

Slices make_slices(const Bounds &box, const std::vector<Plane> &planes, const Vector &direction, double spacing,
                   size_t maximum)
{
    Slices out;
    if (box.empty() || !(spacing > 0)) return out;
    double low, high;
    range_along(box, direction, &low, &high);
    double first = std::ceil(low / spacing), last = std::floor(high / spacing);
    // if the spacing gives more than `maximum` slices, draw the nearest ones
    last = std::min(last, first + double(maximum) - 1);
    for (double n = last; n >= first; n--) {
        std::vector<Vector> polygon = slice(box, planes, direction, n * spacing);
        if (polygon.empty()) continue;
        uint32_t base = uint32_t(out.vertices.size() / 3);
        for (const Vector &point : polygon)
            for (double x : point) out.vertices.push_back(float(x));
        for (uint32_t corner = 2; corner < polygon.size(); corner++)
            out.triangles.insert(out.triangles.end(), {base, base + corner - 1, base + corner});
        out.count++;
    }
    return out;
}

bool clip_ray(const Bounds &box, const std::vector<Plane> &planes, const Vector &origin, const Vector &direction,
              double *near, double *far)
{
    double enter = 0, leave = std::numeric_limits<double>::infinity();
    auto clip = [&](const Plane &plane) {
        double rate = dot(plane.normal, direction), side = dot(plane.normal, origin) - plane.offset;
        if (rate > 0) enter = std::max(enter, -side / rate);
        else if (rate < 0) leave = std::min(leave, -side / rate);
        else if (side < 0) leave = -1;
    };
    for (int d = 0; d < 3; d++) {
        Plane face{{{0, 0, 0}}, box.low[d]};
        face.normal[d] = 1;
        clip(face);
        face.normal[d] = -1;
        face.offset = -box.high[d];
        clip(face);
    }
    for (const Plane &plane : planes) clip(plane);
    if (enter > leave) return false;
    *near = enter;
    *far = leave;
    return true;
}

std::vector<Part> outside(const Bounds &box, const Vector &origin, const Vector &direction, const Part &part)
{
    double enter, leave;
    if (box.empty() || !clip_ray(box, {}, origin, direction, &enter, &leave) || leave <= part.near || enter >= part.far)
        return {part};
    std::vector<Part> left;
    if (enter > part.near) left.push_back({part.near, enter});
    if (leave < part.far) left.push_back({leave, part.far});
    return left;
}

} // namespace pliant_rviz
