// Triangulated solids for tests, and STL files of them.
#pragma once

#include "pliant/contact.h"

#include <cmath>
#include <cstdio>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

struct Surface {
    std::vector<double> points;
    std::vector<int32_t> triangles;

    int32_t add(double x, double y, double z)
    {
        points.insert(points.end(), {x, y, z});
        return static_cast<int32_t>(points.size() / 3) - 1;
    }
    void add_quad(int32_t a, int32_t b, int32_t c, int32_t d) { triangles.insert(triangles.end(), {a, b, c, a, c, d}); }
    int32_t num_triangles() const { return static_cast<int32_t>(triangles.size() / 3); }
    pliant_status make(const pliant_solid_options &options, pliant_solid **out) const
    {
        return pliant_solid_create(static_cast<int32_t>(points.size() / 3), points.data(), num_triangles(),
                                   triangles.data(), &options, "solid", out);
    }
};

// Extrude a polygon in the x y plane from z = low to high. `outline` is counter-clockwise, and `inside` lists the
// triangles of its corners.
inline Surface prism(const std::vector<std::vector<double>> &outline, const std::vector<int32_t> &inside, double low,
                     double high)
{
    Surface out;
    const int32_t n = static_cast<int32_t>(outline.size());
    for (const double z : {low, high})
        for (const auto &p : outline) out.add(p[0], p[1], z);
    for (int32_t k = 0; k < n; k++) out.add_quad(k, (k + 1) % n, n + (k + 1) % n, n + k);
    for (size_t c = 0; c < inside.size(); c += 3) {
        out.triangles.insert(out.triangles.end(), {inside[c + 1], inside[c], inside[c + 2]});
        out.triangles.insert(out.triangles.end(), {n + inside[c], n + inside[c + 1], n + inside[c + 2]});
    }
    return out;
}

inline Surface block(const double low[3], const double high[3])
{
    return prism({{low[0], low[1]}, {high[0], low[1]}, {high[0], high[1]}, {low[0], high[1]}}, {0, 1, 2, 0, 2, 3},
                 low[2], high[2]);
}

// An L-shaped solid of 20 x 20 mm, with legs of 6 mm, 8 mm thick.
inline Surface corner()
{
    return prism({{0, 0}, {0.02, 0}, {0.02, 0.006}, {0.006, 0.006}, {0.006, 0.02}, {0, 0.02}},
                 {0, 1, 2, 0, 2, 3, 0, 3, 4, 0, 4, 5}, 0, 0.008);
}

// A torus around z.
inline Surface ring(double radius, double tube, int around = 48, int across = 24)
{
    Surface out;
    for (int a = 0; a < around; a++)
        for (int c = 0; c < across; c++) {
            const double u = 2 * M_PI * a / around, v = 2 * M_PI * c / across, far = radius + tube * std::cos(v);
            out.add(far * std::cos(u), far * std::sin(u), tube * std::sin(v));
        }
    for (int a = 0; a < around; a++)
        for (int c = 0; c < across; c++) {
            const int b = (a + 1) % around, d = (c + 1) % across;
            out.add_quad(a * across + c, b * across + c, b * across + d, a * across + d);
        }
    return out;
}

inline Surface ball_surface(double radius, int around = 32, int across = 14)
{
    Surface out;
    for (int a = 1; a < across; a++)
        for (int k = 0; k < around; k++) {
            const double u = M_PI * a / across, v = 2 * M_PI * k / around;
            out.add(radius * std::sin(u) * std::cos(v), radius * std::sin(u) * std::sin(v), radius * std::cos(u));
        }
    const int32_t top = out.add(0, 0, radius), bottom = out.add(0, 0, -radius);
    for (int k = 0; k < around; k++) {
        const int next = (k + 1) % around, last = (across - 2) * around;
        out.triangles.insert(out.triangles.end(), {top, k, next});
        out.triangles.insert(out.triangles.end(), {bottom, last + next, last + k});
        for (int a = 0; a + 2 < across; a++)
            out.add_quad(a * around + k, (a + 1) * around + k, (a + 1) * around + next, a * around + next);
    }
    return out;
}

// A rod about z from 0 to a length, with flat ends.
inline Surface rod_surface(double radius, double length, int around = 24)
{
    std::vector<std::vector<double>> outline;
    std::vector<int32_t> inside;
    for (int a = 0; a < around; a++)
        outline.push_back({radius * std::cos(2 * M_PI * a / around), radius * std::sin(2 * M_PI * a / around)});
    for (int a = 1; a + 1 < around; a++) inside.insert(inside.end(), {0, a, a + 1});
    return prism(outline, inside, 0, length);
}

inline std::string binary_stl(const Surface &of, double unit)
{
    std::string out(80, ' ');
    const uint32_t count = static_cast<uint32_t>(of.num_triangles());
    out.append(reinterpret_cast<const char *>(&count), 4);
    for (uint32_t t = 0; t < count; t++) {
        float numbers[12] = {};
        for (int c = 0; c < 9; c++)
            numbers[3 + c] = static_cast<float>(of.points[3 * of.triangles[3 * t + c / 3] + c % 3] / unit);
        out.append(reinterpret_cast<const char *>(numbers), 48);
        out.append(2, '\0');
    }
    return out;
}

inline std::string ascii_stl(const Surface &of, double unit)
{
    std::string out = "solid made here\n";
    for (int32_t t = 0; t < of.num_triangles(); t++) {
        out += " facet normal 0 0 0\n  outer loop\n";
        for (int k = 0; k < 3; k++) {
            char line[128];
            const double *p = of.points.data() + 3 * of.triangles[3 * t + k];
            std::snprintf(line, sizeof line, "   vertex %.9e %.9E %.9g\n", p[0] / unit, p[1] / unit, p[2] / unit);
            out += line;
        }
        out += "  endloop\n endfacet\n";
    }
    return out + "endsolid made here\n";
}
