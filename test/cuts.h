// Blades for tests, and the resulting pieces, counted directly from the definitions.
#ifndef PLIANT_TEST_CUTS_H
#define PLIANT_TEST_CUTS_H

#include "cut/cut.h"
#include "pipeline/body.h"

#include <algorithm>
#include <map>
#include <memory>
#include <numeric>
#include <random>
#include <set>

// A body at load with its voxels, and its current cut body.
struct CutState {
    std::unique_ptr<Body> body;
    const pliant_body *now = nullptr;
    std::vector<double> positions;
    pliant_cut_report report{};

    explicit CutState(std::unique_ptr<Body> made) : body(std::move(made)), now(pliant_body_retain(body->model->body))
    {
        rest();
    }
    CutState(const CutState &) = delete;
    CutState &operator=(const CutState &) = delete;
    ~CutState() { pliant_body_release(now); }

    const pliant_body &load() const { return *body->model->body; }
    void rest() { positions.assign(now->fine.rest, now->fine.rest + 3 * now->fine.num_nodes); }
    // Take the next body. Copied nodes start at the positions of their sources.
    void take(const pliant_body *next)
    {
        for (int32_t n = now->fine.num_nodes; n < next->fine.num_nodes; n++) {
            const int32_t source = next->changes.node_source[n - now->fine.num_nodes];
            for (int d = 0; d < 3; d++) positions.push_back(positions[3 * source + d]);
        }
        pliant_body_release(now);
        now = next;
    }
    // Return whether the sweep severed anything.
    bool cut(const std::vector<double> &from, const std::vector<double> &to)
    {
        pliant_cut_sweep sweep{static_cast<int32_t>(from.size() / 3), from.data(), to.data(),
                               body->model->material_of_voxel};
        pliant_body *next = nullptr;
        EXPECT_EQ(pliant_body_cut(now, now->revision + 1, positions.data(), &sweep, &next, &report), PLIANT_OK)
            << pliant_last_error();
        if (next) take(next);
        return next != nullptr;
    }
    // Cut by a square that is far larger than the body.
    bool cut_plane(const double point[3], const double normal[3], double size = 10)
    {
        std::vector<double> from, to;
        plane(point, normal, size, from, to);
        return cut(from, to);
    }
    static void plane(const double point[3], const double normal[3], double size, std::vector<double> &from,
                      std::vector<double> &to)
    {
        double u[3], v[3], length = std::sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
        int minimum = 0;
        for (int d = 1; d < 3; d++)
            if (std::fabs(normal[d]) < std::fabs(normal[minimum])) minimum = d;
        double n[3], e[3] = {0, 0, 0};
        e[minimum] = 1;
        for (int d = 0; d < 3; d++) n[d] = normal[d] / length;
        for (int d = 0; d < 3; d++) u[d] = n[(d + 1) % 3] * e[(d + 2) % 3] - n[(d + 2) % 3] * e[(d + 1) % 3];
        double ul = std::sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
        for (int d = 0; d < 3; d++) u[d] /= ul;
        for (int d = 0; d < 3; d++) v[d] = n[(d + 1) % 3] * u[(d + 2) % 3] - n[(d + 2) % 3] * u[(d + 1) % 3];
        from.clear();
        to.clear();
        for (int s = -1; s <= 1; s += 2)
            for (int d = 0; d < 3; d++) {
                from.push_back(point[d] + size * (s * u[d] - v[d]));
                to.push_back(point[d] + size * (s * u[d] + v[d]));
            }
    }
};

// ---- pieces

struct Parts {
    std::vector<int32_t> parent;
    explicit Parts(size_t count) : parent(count) { std::iota(parent.begin(), parent.end(), 0); }
    int32_t find(int32_t i)
    {
        while (parent[i] != i) i = parent[i] = parent[parent[i]];
        return i;
    }
    void join(int32_t a, int32_t b) { parent[find(a)] = find(b); }
};

// Return the piece of each tetrahedron: connected by shared nodes and by joints.
inline std::vector<int32_t> mesh_pieces(const pliant_body &body)
{
    Parts parts(static_cast<size_t>(body.fine.num_nodes));
    for (int32_t t = 0; t < body.fine.num_tets; t++)
        for (int v = 1; v < 4; v++) parts.join(body.fine.tets[4 * t], body.fine.tets[4 * t + v]);
    for (int32_t j = 0; body.pieces && j < body.pieces->num_joints + body.pieces->num_inner; j++)
        parts.join(body.pieces->joint[2 * j], body.pieces->joint[2 * j + 1]);
    std::vector<int32_t> out(static_cast<size_t>(body.fine.num_tets));
    for (int32_t t = 0; t < body.fine.num_tets; t++) out[t] = parts.find(body.fine.tets[4 * t]);
    return out;
}

// Return the piece of each voxel with an owner, connected by intact links and bridges; -1: no owner. A diagonal passes
// two links through a voxel with an owner, so it joins only voxels that these links join.
inline std::vector<int32_t> voxel_pieces(const pliant_body &body)
{
    const pliant_voxels &voxels = *body.voxels;
    const int32_t *size = voxels.geometry.size;
    const int32_t count = size[0] * size[1] * size[2], strides[3] = {1, size[0], size[0] * size[1]};
    std::vector<uint8_t> severed(static_cast<size_t>(count));
    for (int32_t l = 0; body.cuts && l < body.cuts->num_links; l++)
        severed[body.cuts->link[l] / 4] |= static_cast<uint8_t>(1 << body.cuts->link[l] % 4);
    std::set<int32_t> bridges;
    for (int32_t b = 0; body.cuts && b < body.cuts->num_bridges; b++) bridges.insert(body.cuts->bridge[b]);
    Parts parts(static_cast<size_t>(count));
    for (int32_t v = 0; v < count; v++) {
        if (voxels.owner[v] < 0) continue;
        const int32_t at[3] = {v % size[0], v / size[0] % size[1], v / size[0] / size[1]};
        for (int d = 0; d < 3; d++)
            if (at[d] + 1 < size[d] && voxels.owner[v + strides[d]] >= 0 && !(severed[v] >> d & 1))
                parts.join(v, v + strides[d]);
    }
    for (int32_t b = 0; b < voxels.num_bridges; b++)
        if (!bridges.count(b)) parts.join(voxels.bridge[2 * b], voxels.bridge[2 * b + 1]);
    std::vector<int32_t> out(static_cast<size_t>(count), -1);
    for (int32_t v = 0; v < count; v++)
        if (voxels.owner[v] >= 0) out[v] = parts.find(v);
    return out;
}

// Count mesh pieces with more than one piece of voxels, and pieces of voxels with more than one mesh piece.
inline int mismatches(const pliant_body &body)
{
    const std::vector<int32_t> mesh = mesh_pieces(body), voxels = voxel_pieces(body);
    struct Other {
        int32_t first = -1;
        bool more = false; // more than one piece
        void add(int32_t piece)
        {
            if (first < 0) first = piece;
            else more = more || piece != first;
        }
    };
    std::vector<Other> of_mesh(static_cast<size_t>(body.fine.num_nodes)), of_voxels(voxels.size());
    for (size_t v = 0; v < voxels.size(); v++) {
        if (voxels[v] < 0) continue;
        const int32_t tet = pliant_voxels_fragment(body.voxels, body.cuts, static_cast<int32_t>(v));
        of_mesh[mesh[tet]].add(voxels[v]);
        of_voxels[voxels[v]].add(mesh[tet]);
    }
    int wrong = 0;
    for (const Other &piece : of_mesh) wrong += piece.more;
    for (const Other &piece : of_voxels) wrong += piece.more;
    return wrong;
}

// Return the number of mesh pieces with tissue.
inline int num_pieces(const pliant_body &body)
{
    const std::vector<int32_t> mesh = mesh_pieces(body);
    std::set<int32_t> pieces;
    for (int32_t t = 0; t < body.fine.num_tets; t++)
        if (body.fine_material[t].tissue > 0) pieces.insert(mesh[t]);
    return static_cast<int>(pieces.size());
}

inline double total_mass(const pliant_body &body)
{
    return std::accumulate(body.node_mass, body.node_mass + body.fine.num_nodes, 0.0);
}

#endif
