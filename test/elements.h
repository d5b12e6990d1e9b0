// Stiffness matrices of elements at rest and of connected groups of elements, and the rigid modes of free bodies.
#ifndef PLIANT_TEST_ELEMENTS_H
#define PLIANT_TEST_ELEMENTS_H

#include "algebra.h"
#include "cuts.h"
#include "fem/system.h"

// Return the eigenvalues of a symmetric matrix, in ascending order.
inline std::vector<double> eigenvalues(const std::vector<double> &a)
{
    const auto n = static_cast<Eigen::Index>(std::lround(std::sqrt(static_cast<double>(a.size()))));
    const Eigen::VectorXd values = algebra::eigenvalues(Eigen::Map<const Eigen::MatrixXd>(a.data(), n, n));
    return {values.data(), values.data() + n};
}

// Elements of a system at rest.
struct Elements {
    const pliant_system &system;
    int32_t count;
    std::vector<pliant_tangent> tangents;
    explicit Elements(const pliant_system &of)
        : system(of), count(pliant_element_count(&of)), tangents(static_cast<size_t>(of.num_blocks))
    {
        pliant_system_tangents(&system, system.mesh->rest, PLIANT_TWIST_EXACT, tangents.data());
    }
    const double *rest(int32_t node) const { return system.mesh->rest + 3 * node; }
    std::vector<int32_t> nodes(int32_t e) const
    {
        const int32_t *all = pliant_element_nodes(&system);
        return {all + pliant_element_begin(&system, e), all + pliant_element_begin(&system, e + 1)};
    }
    std::vector<double> stiffness(int32_t e) const
    {
        const size_t n = 3 * nodes(e).size();
        std::vector<double> out(n * n);
        pliant_system_element(&system, tangents.data(), e, out.data());
        return out;
    }
    std::vector<int32_t> nodes(const std::vector<int32_t> &elements) const
    {
        std::set<int32_t> all;
        for (int32_t e : elements)
            for (int32_t n : nodes(e)) all.insert(n);
        return {all.begin(), all.end()};
    }
    std::vector<double> stiffness(const std::vector<int32_t> &elements) const
    {
        std::map<int32_t, size_t> number;
        for (int32_t n : nodes(elements)) number.emplace(n, number.size());
        const size_t size = 3 * number.size();
        std::vector<double> out(size * size);
        for (int32_t e : elements) {
            const std::vector<int32_t> own = nodes(e);
            const std::vector<double> of = stiffness(e);
            const size_t n = 3 * own.size();
            for (size_t i = 0; i < n; i++)
                for (size_t j = 0; j < n; j++)
                    out[size * (3 * number[own[i / 3]] + i % 3) + 3 * number[own[j / 3]] + j % 3] += of[n * i + j];
        }
        return out;
    }
    // Return the groups of elements that are connected by at least three shared nodes.
    std::vector<std::vector<int32_t>> pieces() const
    {
        Parts parts(static_cast<size_t>(count));
        std::map<int32_t, std::vector<int32_t>> around;
        for (int32_t e = 0; e < count; e++)
            for (int32_t n : nodes(e)) around[n].push_back(e);
        for (int32_t e = 0; e < count; e++) {
            std::map<int32_t, int> shared;
            for (int32_t n : nodes(e))
                for (int32_t other : around[n]) shared[other]++;
            for (const auto &each : shared)
                if (each.second >= 3) parts.join(e, each.first);
        }
        std::map<int32_t, std::vector<int32_t>> found;
        for (int32_t e = 0; e < count; e++) found[parts.find(e)].push_back(e);
        std::vector<std::vector<int32_t>> out;
        for (const auto &each : found) out.push_back(each.second);
        return out;
    }
};

// Rounding error relative to the largest eigenvalue. Square roots in single precision enter the six rigid modes
// squared.
const double rounding = 1e-12;

inline void expect_rigid_modes(const Elements &elements, const std::vector<int32_t> &nodes,
                               const std::vector<double> &stiffness, size_t rank, const std::string &what)
{
    const size_t size = 3 * nodes.size();
    const std::vector<double> values = eigenvalues(stiffness);
    const double maximum = values.back();
    ASSERT_GT(maximum, 0) << what;
    ASSERT_GT(values.front(), -rounding * maximum) << what << ": not positive semidefinite";
    ASSERT_LT(values[size - rank - 1], rounding * maximum) << what;
    ASSERT_GT(values[size - rank], 1e3 * rounding * maximum) << what << ": moves without force";
    double middle[3] = {0, 0, 0}, reach = 0;
    for (int32_t n : nodes)
        for (int d = 0; d < 3; d++) middle[d] += elements.rest(n)[d] / static_cast<double>(nodes.size());
    for (int32_t n : nodes)
        for (int d = 0; d < 3; d++) reach = std::max(reach, std::fabs(elements.rest(n)[d] - middle[d]));
    for (int mode = 0; mode < 6; mode++) {
        std::vector<double> moved(size);
        for (size_t n = 0; n < nodes.size(); n++) {
            const double *at = elements.rest(nodes[n]);
            if (mode < 3) moved[3 * n + mode] = 1;
            else {
                const int i = (mode + 1) % 3, j = (mode + 2) % 3;
                moved[3 * n + i] = -(at[j] - middle[j]) / reach;
                moved[3 * n + j] = (at[i] - middle[i]) / reach;
            }
        }
        for (size_t i = 0; i < size; i++) {
            double force = 0;
            for (size_t j = 0; j < size; j++) force += stiffness[size * i + j] * moved[j];
            ASSERT_LT(std::fabs(force), 1e-6 * maximum)
                << what << ", mode " << mode; // square roots in single precision
        }
    }
}

#endif
