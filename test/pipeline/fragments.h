// Divide a body along a plane, for tests and benchmarks. Each tetrahedron at the plane becomes two fragments, which
// share nodes with their neighbours on their own side.
#ifndef PLIANT_TEST_FRAGMENTS_H
#define PLIANT_TEST_FRAGMENTS_H

#include "topology/body.h"

#include <algorithm>
#include <array>
#include <functional>
#include <map>
#include <numeric>
#include <vector>

struct Plane {
    double point[3], normal[3];
    double side(const double x[3]) const
    {
        double s = 0;
        for (int d = 0; d < 3; d++) s += normal[d] * (x[d] - point[d]);
        return s;
    }
};

struct Division {
    std::vector<int32_t> source, corners;
    std::vector<pliant_tet_material> material;
    int32_t cut = 0; // number of divided tetrahedra
};

// reaches: whether the cut extends to a point (the centre of a tetrahedron)
// sides: input and output, extended; side (-1 or 1) of fragments from earlier strokes in this plane, otherwise 0
inline Division divide_by_plane(const pliant_body &body, const Plane &plane,
                                const std::function<bool(const double *)> &reaches, std::vector<int8_t> &sides)
{
    const pliant_mesh &mesh = body.fine;
    const int32_t tets = mesh.num_tets;
    Division out;
    out.corners.assign(mesh.tets, mesh.tets + 4 * tets);
    out.material.assign(body.fine_material, body.fine_material + tets);
    std::vector<std::array<int32_t, 2>> part(tets); // fragment on either side; both equal: not divided; -1: none
    sides.resize(static_cast<size_t>(tets));
    for (int32_t t = 0; t < tets; t++) {
        double centre[3] = {0, 0, 0}, minimum = 1e9, maximum = -1e9, above = 0, all = 0;
        for (int v = 0; v < 4; v++) {
            const double *x = mesh.rest + 3 * mesh.tets[4 * t + v], s = plane.side(x);
            minimum = std::min(minimum, s), maximum = std::max(maximum, s);
            for (int d = 0; d < 3; d++) centre[d] += x[d] / 4;
        }
        const double edge = mesh.cell_size[0];
        part[t] = {t, t};
        if (sides[t] != 0) part[t][sides[t] > 0 ? 0 : 1] = -1;
        if (sides[t] != 0 || !reaches(centre)) continue;
        if (maximum <= 0.02 * edge || minimum >= -0.02 * edge) { // on one side
            part[t][plane.side(centre) > 0 ? 0 : 1] = -1;
            continue;
        }
        for (int i = 0; i < 8; i++) // approximate sum over the tetrahedron
            for (int j = 0; i + j < 8; j++)
                for (int k = 0; i + j + k < 8; k++) {
                    const double w[4] = {(i + 0.25) / 8, (j + 0.25) / 8, (k + 0.25) / 8, (8 - i - j - k - 0.75) / 8};
                    double s = 0;
                    for (int v = 0; v < 4; v++) s += w[v] * plane.side(mesh.rest + 3 * mesh.tets[4 * t + v]);
                    above += s > 0;
                    all += 1;
                }
        const double fraction = std::min(std::max(above / all, 0.03), 0.97);
        part[t][1] = tets + static_cast<int32_t>(out.source.size());
        out.source.push_back(t);
        out.corners.insert(out.corners.end(), mesh.tets + 4 * t, mesh.tets + 4 * t + 4);
        out.material.push_back(out.material[t]);
        for (int f = 0; f < 2; f++) {
            pliant_tet_material &m = out.material[part[t][f]];
            const double scale = f ? fraction : 1 - fraction;
            m.lambda *= scale, m.mu *= scale, m.density *= scale, m.tissue *= scale;
        }
        out.cut++;
        sides[t] = -1;
        sides.push_back(1);
    }
    // corners are joined across faces on which both fragments have a part
    const size_t total = out.corners.size();
    std::vector<int32_t> set(total);
    std::iota(set.begin(), set.end(), 0);
    std::function<int32_t(int32_t)> root = [&](int32_t i) {
        while (set[i] != i) i = set[i] = set[set[i]];
        return i;
    };
    std::map<std::array<int32_t, 3>, std::array<int32_t, 2>> faces;
    for (int32_t t = 0; t < tets; t++)
        for (int c = 0; c < 4; c++) {
            std::array<int32_t, 3> face;
            for (int v = 0, n = 0; v < 4; v++)
                if (v != c) face[n++] = mesh.tets[4 * t + v];
            std::sort(face.begin(), face.end());
            auto found = faces.find(face);
            if (found == faces.end()) {
                faces[face] = {t, -1};
                continue;
            }
            const int32_t u = found->second[0];
            for (int side = 0; side < 2; side++) {
                const int32_t a = part[t][side], b = part[u][side];
                if (a < 0 || b < 0) continue;
                bool crosses = true;
                // a fragment is joined only if it has a part of the face
                if (a != t || b != u || part[t][!side] < 0 || part[u][!side] < 0) {
                    crosses = false;
                    for (int32_t n : face)
                        crosses =
                            crosses || (side ? plane.side(mesh.rest + 3 * n) > 0 : plane.side(mesh.rest + 3 * n) < 0);
                }
                if (!crosses) continue;
                for (int32_t n : face)
                    for (int v = 0; v < 4; v++)
                        for (int w = 0; w < 4; w++)
                            if (mesh.tets[4 * t + v] == n && mesh.tets[4 * u + w] == n) {
                                const int32_t i = root(4 * a + v), j = root(4 * b + w);
                                set[std::max(i, j)] = std::min(i, j);
                            }
            }
        }
    int32_t nodes = mesh.num_nodes;
    std::vector<int32_t> node(total, -1);
    std::vector<char> taken(static_cast<size_t>(mesh.num_nodes));
    // a node whose surroundings are connected only by edges stays one node
    for (size_t c = 0; c < total; c++) {
        const int32_t r = root(static_cast<int32_t>(c)), was = out.corners[c];
        if (node[r] >= 0) continue;
        bool near = false;
        for (int side = 0; side < 2; side++)
            near = near || part[c / 4 < static_cast<size_t>(tets) ? c / 4 : out.source[c / 4 - tets]][side] !=
                               static_cast<int32_t>(c / 4);
        node[r] = taken[was] && near ? nodes++ : was;
        taken[was] = 1;
    }
    for (size_t c = 0; c < total; c++) out.corners[c] = node[root(static_cast<int32_t>(c))];
    return out;
}

// NULL: the cut divides nothing, or an error
inline const pliant_body *sever_plane(const pliant_body *body, uint64_t revision, const Plane &plane,
                                      const std::function<bool(const double *)> &reaches,
                                      std::vector<int8_t> *sides = nullptr)
{
    std::vector<int8_t> none;
    Division made = divide_by_plane(*body, plane, reaches, sides ? *sides : none);
    pliant_division division{};
    division.num_tets = static_cast<int32_t>(made.corners.size() / 4);
    division.tet_source = made.source.empty() ? nullptr : made.source.data();
    division.corners = made.corners.data();
    division.material = made.material.data();
    pliant_body *next = nullptr;
    return pliant_body_divide(body, revision, &division, &next) == PLIANT_OK ? next : nullptr;
}

#endif
