// Bars of explicit dynamics, of tetrahedra and of hexahedra.
#ifndef PLIANT_TEST_TLED_BARS_H
#define PLIANT_TEST_TLED_BARS_H

#include "algebra.h"
#include "fem/dynamics/tled.h"
#include "pipeline/beam.h"

#include <array>
#include <string>

using Matrix = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

constexpr std::array<pliant_law, 3> laws{PLIANT_LAW_NEO_HOOKEAN, PLIANT_LAW_COMPRESSIBLE,
                                         PLIANT_LAW_SAINT_VENANT_KIRCHHOFF};

struct Moduli {
    double lambda, mu;
};
inline Moduli moduli(double young, double poisson)
{
    return {young * poisson / (1 + poisson) / (1 - 2 * poisson), young / 2 / (1 + poisson)};
}

// A bar along z. Its lower end is fixed, unless the bar may fall.
static pliant_element_kind kind_of_bars = PLIANT_LINEAR;
class EveryKind : public ::testing::TestWithParam<pliant_element_kind> {
protected:
    void SetUp() override { kind_of_bars = GetParam(); }
    void TearDown() override { kind_of_bars = PLIANT_LINEAR; }
};

struct Bar : Body {
    Bar(int across, int along, double length, Material material, bool fixed = true)
        : Body(std::array<int, 3>{2 * across, 2 * across, 2 * along}.data(),
               std::array<double, 3>{length * across / along, length * across / along, length}.data(), {material})
    {
        cells(across, across, along, 1);
        if (fixed) fix_plane(0, 0, 1e-6, 0, 0, 1);
        scene.solver.kind = PLIANT_TLED;
        scene.element.kind = kind_of_bars;
        scene.tled.damping = 0;
    }
};

inline std::vector<double> nodal_forces(const Body &body)
{
    const pliant_tled_system *system = body.model->tled;
    std::vector<double> out(3 * static_cast<size_t>(system->mesh->num_nodes));
    if (system->nodal_pressure) pliant_tled_pressures(body.data->tled);
    pliant_tled_element_forces(body.data->tled, body.data->tled->time_step);
    for (int32_t n = 0; n < system->mesh->num_nodes; n++)
        for (int32_t c = system->corner_start[n]; c < system->corner_start[n + 1]; c++)
            for (int d = 0; d < 3; d++) out[3 * n + d] += body.data->tled->forces[system->corner[c] + d * LANES];
    return out;
}

inline void put(const Body &body, const Matrix &f)
{
    const pliant_mesh &mesh = body.model->body->fine;
    for (int32_t n = 0; n < mesh.num_nodes; n++) {
        Eigen::Map<Eigen::Vector3d> u(body.data->tled->u + 3 * n);
        u = (f - Matrix::Identity()) * Eigen::Map<const Eigen::Vector3d>(mesh.rest + 3 * n);
    }
}

#endif
