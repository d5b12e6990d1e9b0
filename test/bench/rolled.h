// A block of cubes rolled up along x until its ends overlap by a fraction of an element; negative: until this distance
// remains.
#ifndef PLIANT_BENCH_ROLLED_H
#define PLIANT_BENCH_ROLLED_H

#include "mesh/mesh.h"
#include "pliant/pliant.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <vector>

struct Rolled {
    pliant_mesh mesh{};
    std::vector<double> positions;
    std::vector<int32_t> surface, all; // indices of tetrahedra

    explicit Rolled(int32_t cells, double part = 0.5)
    {
        const double length = 0.14, overlap = part * length / cells, radius = (length - overlap) / (2 * M_PI);
        pliant_geometry geometry{};
        for (int d = 0; d < 3; d++) {
            geometry.size[d] = cells;
            geometry.spacing[d] = length / cells;
            geometry.origin[d] = 0.5 * geometry.spacing[d];
            geometry.direction[4 * d] = 1;
        }
        const int32_t cube[3] = {cells, cells, cells};
        if (pliant_mesh_grid(&geometry, cube, nullptr, &mesh) != PLIANT_OK) std::exit(1);
        for (int32_t n = 0; n < mesh.num_nodes; n++) {
            const double *x = mesh.rest + 3 * n;
            const double angle = x[0] / radius, at = radius + 0.5 * (x[1] - 0.5 * length);
            positions.insert(positions.end(), {at * std::cos(angle), at * std::sin(angle), x[2]});
        }
        std::vector<int32_t> across(4 * static_cast<size_t>(mesh.num_tets));
        if (pliant_mesh_neighbours(&mesh, across.data()) != PLIANT_OK) std::exit(1);
        for (int32_t t = 0; t < mesh.num_tets; t++) {
            all.push_back(t);
            if (*std::min_element(across.begin() + 4 * t, across.begin() + 4 * t + 4) < 0) surface.push_back(t);
        }
    }
    Rolled(const Rolled &) = delete;
    Rolled &operator=(const Rolled &) = delete;
    ~Rolled() { pliant_mesh_free(&mesh); }
};

#endif
