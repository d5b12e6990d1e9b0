// Cut bodies, built directly from the definitions: the links that a blade severs, the connected voxels, and the shared
// nodes.
#ifndef PLIANT_TEST_CUT_CASES_H
#define PLIANT_TEST_CUT_CASES_H

#include "topology/body.h"
#include "voxels_joined.h"
#include "warp_cases.h"

#include <map>
#include <numeric>

namespace cut_cases {

using warp_cases::positions;
using warp_cases::vector3;

// Return whether a blade cuts the segment between two points of the scan (index coordinates).
using Blade = std::function<bool(const vector3 &, const vector3 &)>;

// A plane through a point. `until` limits its extent; none: unbounded.
inline Blade plane(const vector3 &through, const vector3 &normal, std::function<bool(const vector3 &)> until = nullptr)
{
    return [=](const vector3 &a, const vector3 &b) {
        double p = 0, q = 0;
        vector3 at;
        for (size_t d = 0; d < 3; d++) {
            p += normal[d] * (a[d] - through[d]);
            q += normal[d] * (b[d] - through[d]);
        }
        if ((p >= 0) == (q >= 0)) return false;
        for (size_t d = 0; d < 3; d++) at[d] = a[d] + p / (p - q) * (b[d] - a[d]);
        return !until || until(at);
    };
}

// A cut body. chips: fragments of at most so many voxels move with a neighbour's fragment.
struct CutBody {
    pliant_body body{};
    pliant_cuts cuts{};
    std::vector<uint32_t> links;
    std::vector<int32_t> bridges, tet, start, fragment, voxel_start, voxel_fragment, tets, node_parent, tet_parent;
    std::vector<double> rest;
    int chips = 0;

    CutBody(const pliant_mesh &mesh, const pliant_voxels &voxels, const std::vector<Blade> &blades, int chip = 0)
    {
        body.fine = mesh; // the body shares the mesh's arrays that a cut does not change
        body.voxels = &voxels;
        body.revision = 2;
        tets.assign(mesh.tets, mesh.tets + 4 * mesh.num_tets);
        node_parent.resize(static_cast<size_t>(mesh.num_nodes));
        std::iota(node_parent.begin(), node_parent.end(), 0);
        tet_parent.resize(static_cast<size_t>(mesh.num_tets));
        std::iota(tet_parent.begin(), tet_parent.end(), 0);
        sever(blades);
        if (!links.empty()) {
            find_fragments();
            if (chip > 0) adopt(chip);
            share_nodes();
            body.cuts = &cuts;
        }
        rest.resize(3 * node_parent.size());
        for (size_t n = 0; n < node_parent.size(); n++)
            std::copy_n(mesh.rest + 3 * node_parent[n], 3, rest.begin() + 3 * static_cast<long>(n));
        body.fine.num_tets = static_cast<int32_t>(tet_parent.size());
        body.fine.num_nodes = static_cast<int32_t>(node_parent.size());
        body.fine.tets = tets.data();
        body.fine.rest = rest.data();
        body.node_parent = node_parent.data();
        body.tet_parent = tet_parent.data();
    }
    CutBody(const CutBody &) = delete;

    int32_t fragment_of(int32_t voxel) const
    {
        return pliant_voxels_fragment(body.voxels, links.empty() ? nullptr : &cuts, voxel);
    }
    vector3 place(int32_t voxel) const
    {
        const int32_t *size = body.voxels->geometry.size;
        return {double(voxel % size[0]), double(voxel / size[0] % size[1]), double(voxel / size[0] / size[1])};
    }

private:
    int32_t stride(int axis) const
    {
        const int32_t *size = body.voxels->geometry.size;
        return axis == 0 ? 1 : axis == 1 ? size[0] : size[0] * size[1];
    }
    int32_t count() const { return stride(2) * body.voxels->geometry.size[2]; }
    bool has_next(int32_t voxel, int axis) const
    {
        return int32_t(place(voxel)[size_t(axis)]) + 1 < body.voxels->geometry.size[axis];
    }

    void sever(const std::vector<Blade> &blades)
    {
        const pliant_voxels &voxels = *body.voxels;
        auto cut = [&](int32_t a, int32_t b) {
            return std::any_of(blades.begin(), blades.end(),
                               [&](const Blade &blade) { return blade(place(a), place(b)); });
        };
        for (int32_t v = 0; v < count(); v++)
            for (int d = 0; d < 3; d++)
                if (has_next(v, d) && cut(v, v + stride(d))) links.push_back(4 * uint32_t(v) + uint32_t(d));
        for (int32_t b = 0; b < voxels.num_bridges; b++)
            if (cut(voxels.bridge[2 * b], voxels.bridge[2 * b + 1])) bridges.push_back(b);
        std::vector<uint8_t> touched(static_cast<size_t>(voxels.num_tets));
        for (uint32_t link : links)
            for (int32_t v : {int32_t(link / 4), int32_t(link / 4) + stride(int(link % 4))})
                if (voxels.owner[v] >= 0) touched[size_t(voxels.owner[v])] = 1;
        for (int32_t b : bridges)
            for (int end = 0; end < 2; end++) touched[size_t(voxels.owner[voxels.bridge[2 * b + end]])] = 1;
        for (int32_t t = 0; t < voxels.num_tets; t++)
            if (touched[size_t(t)]) tet.push_back(t);
        point();
    }
    void point()
    {
        cuts.num_links = int32_t(links.size());
        cuts.link = links.data();
        cuts.num_bridges = int32_t(bridges.size());
        cuts.bridge = bridges.data();
        cuts.num_tets = int32_t(tet.size());
        cuts.tet = tet.data();
        cuts.start = start.data();
        cuts.fragment = fragment.data();
        cuts.voxel_start = voxel_start.data();
        cuts.voxel_fragment = voxel_fragment.data();
    }
    void find_fragments()
    {
        const pliant_voxels &voxels = *body.voxels;
        start = voxel_start = {0};
        for (int32_t t : tet) {
            std::vector<int32_t> part(size_t(voxels.start[t + 1] - voxels.start[t]));
            const int32_t parts = pliant_voxels_parts(&voxels, &cuts, t, part.data()),
                          first = int32_t(tet_parent.size());
            for (int32_t p = 0; p < parts; p++) {
                fragment.push_back(p == 0 ? t : first + p - 1);
                if (p == 0) continue;
                tet_parent.push_back(t);
                for (int v = 0; v < 4; v++) tets.push_back(tets[4 * size_t(t) + size_t(v)]);
            }
            for (int32_t p : part) voxel_fragment.push_back(p == 0 ? t : first + p - 1);
            start.push_back(int32_t(fragment.size()));
            voxel_start.push_back(int32_t(voxel_fragment.size()));
        }
        point();
    }
    // Let a neighbour carry fragments of up to `maximum` voxels that do not fill their tetrahedron. The empty fragment
    // remains.
    void adopt(int32_t maximum)
    {
        const pliant_voxels &voxels = *body.voxels;
        for (size_t c = 0; c < tet.size(); c++)
            for (int32_t f = start[c] + 1; f < start[c + 1]; f++) {
                std::vector<int32_t> own;
                for (int32_t n = voxel_start[c]; n < voxel_start[c + 1]; n++)
                    if (voxel_fragment[size_t(n)] == fragment[size_t(f)]) own.push_back(n);
                if (own.empty() || int32_t(own.size()) > maximum) continue;
                int32_t by = -1;
                for (int32_t n : own)
                    for (int d = 0; d < 3; d++)
                        for (int way : {-1, 1}) {
                            const int32_t voxel = voxels.voxel[voxels.start[tet[c]] + n - voxel_start[c]],
                                          other = voxel + way * stride(d);
                            if (way > 0 ? !has_next(voxel, d) : place(voxel)[size_t(d)] < 1) continue;
                            if (voxels.owner[other] >= 0 && voxels.owner[other] != tet[c] &&
                                voxels_joined(&voxels, &cuts, voxel, other))
                                by = fragment_of(other);
                        }
                for (int32_t n : own)
                    if (by >= 0) voxel_fragment[size_t(n)] = by;
                chips += by >= 0;
            }
    }
    // Merge corners of fragments that a link, a diagonal or a bridge joins, if they were one node at load.
    void share_nodes()
    {
        const pliant_voxels &voxels = *body.voxels;
        std::vector<int32_t> part(tets.size());
        std::iota(part.begin(), part.end(), 0);
        std::function<int32_t(int32_t)> first = [&](int32_t i) {
            while (part[size_t(i)] != i) i = part[size_t(i)] = part[size_t(part[size_t(i)])];
            return i;
        };
        auto unite = [&](int32_t a, int32_t b) {
            const int32_t f = fragment_of(a), g = fragment_of(b);
            for (int v = 0; v < 4 && f != g; v++)
                for (int w = 0; w < 4; w++)
                    if (tets[size_t(4 * f + v)] == tets[size_t(4 * g + w)]) {
                        const int32_t i = first(4 * f + v), j = first(4 * g + w);
                        part[size_t(std::max(i, j))] = std::min(i, j);
                    }
        };
        const int steps[9][3] = {{1, 0, 0},  {-1, 1, 0}, {0, 1, 0}, {1, 1, 0}, {0, -1, 1},
                                 {-1, 0, 1}, {0, 0, 1},  {1, 0, 1}, {0, 1, 1}};
        const int32_t *size = voxels.geometry.size;
        for (int32_t v = 0; v < count(); v++)
            for (const int *step : steps) {
                const vector3 at = place(v);
                bool in = voxels.owner[v] >= 0;
                int32_t to = v;
                for (int d = 0; d < 3; d++) {
                    in = in && at[size_t(d)] + step[d] >= 0 && at[size_t(d)] + step[d] < size[d];
                    to += step[d] * stride(d);
                }
                if (in && voxels.owner[to] >= 0 && voxels.owner[to] != voxels.owner[v] &&
                    voxels_joined(&voxels, &cuts, v, to))
                    unite(v, to);
            }
        for (int32_t b = 0; b < voxels.num_bridges; b++)
            if (!std::binary_search(bridges.begin(), bridges.end(), b))
                unite(voxels.bridge[2 * b], voxels.bridge[2 * b + 1]);
        std::map<int32_t, int32_t> node_of; // part -> node; the first part of a node keeps its number
        std::vector<uint8_t> kept(node_parent.size());
        const std::vector<int32_t> before = tets;
        for (size_t c = 0; c < tets.size(); c++) {
            auto found = node_of.find(first(int32_t(c)));
            if (found == node_of.end()) {
                const int32_t node = before[c];
                if (kept[size_t(node)]) node_parent.push_back(node);
                found = node_of.emplace(first(int32_t(c)), kept[size_t(node)] ? int32_t(node_parent.size()) - 1 : node)
                            .first;
                kept[size_t(node)] = 1;
            }
            tets[c] = found->second;
        }
    }
};

struct voxels_release { void operator()(const pliant_voxels *v) const { pliant_voxels_release(v); } };
using voxels_ptr = std::unique_ptr<const pliant_voxels, voxels_release>;

inline voxels_ptr make_voxels(const pliant_mesh &mesh, const pliant_geometry &geometry)
{
    pliant_material material{};
    material.young_modulus = 1000;
    material.poisson_ratio = 0.4;
    material.density = 1000;
    const pliant_material_table table = {&material, 1};
    const std::vector<uint8_t> of_voxel(pliant_geometry_voxels(&geometry));
    const pliant_voxels *voxels = nullptr;
    pliant_body body{};
    body.fine = mesh;
    std::vector<pliant_tet_material> of_tet(static_cast<size_t>(mesh.num_tets));
    body.fine_material = of_tet.data();
    EXPECT_EQ(pliant_voxels_create(&body, &geometry, of_voxel.data(), &table, &voxels), PLIANT_OK)
        << pliant_last_error();
    return voxels_ptr(voxels);
}

} // namespace cut_cases

#endif
