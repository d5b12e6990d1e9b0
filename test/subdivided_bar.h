// Bars whose elements cuts subdivide, and checks of their mesh.
#ifndef PLIANT_TEST_SUBDIVIDED_BAR_H
#define PLIANT_TEST_SUBDIVIDED_BAR_H

#include "cuts.h"
#include "mesh/mesh.h"
#include "topology/visible_surface.h"

#include <functional>
#include <memory>

static const int size[3] = {40, 20, 20};
static const double box[3] = {0.2, 0.1, 0.1}, surface = 2 * (0.2 * 0.1 + 0.2 * 0.1 + 0.1 * 0.1);

inline std::unique_ptr<Body> built(std::unique_ptr<Body> body, const std::function<void(pliant_scene &)> &set)
{
    body->fix_plane(1e-6, 0, 0, 1, 0, 0);
    body->cells(8, 4, 4, 1);
    body->scene.cut.kind = PLIANT_CUT_SUBDIVIDE;
    set(body->scene);
    EXPECT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
    return body;
}

inline std::unique_ptr<Body> bar(const std::function<void(pliant_scene &)> &set = [](pliant_scene &) {})
{
    std::unique_ptr<Body> body(new Body(size, box, {{4000, 0.4, 1000, false}, {20000, 0.3, 1200, false}},
                                        [](int i, int j, int k) { return (i / 5 + j / 4 + k / 3) % 2; }));
    return built(std::move(body), set);
}

inline std::unique_ptr<Body> uniform(const std::function<void(pliant_scene &)> &set = [](pliant_scene &) {})
{
    std::unique_ptr<Body> body(new Body(size, box, {{4000, 0.4, 1000, false}}));
    return built(std::move(body), set);
}

inline double area_of(const pliant_mesh &mesh, const int32_t *triangles, int32_t first, int32_t last)
{
    double sum = 0;
    for (int32_t t = first; t < last; t++) {
        double u[3], v[3], squares = 0;
        for (int d = 0; d < 3; d++) {
            u[d] = mesh.rest[3 * triangles[3 * t + 1] + d] - mesh.rest[3 * triangles[3 * t] + d];
            v[d] = mesh.rest[3 * triangles[3 * t + 2] + d] - mesh.rest[3 * triangles[3 * t] + d];
        }
        for (int d = 0; d < 3; d++)
            squares += std::pow(u[(d + 1) % 3] * v[(d + 2) % 3] - u[(d + 2) % 3] * v[(d + 1) % 3], 2);
        sum += 0.5 * std::sqrt(squares);
    }
    return sum;
}

// Check that all volumes are positive. Unshared faces must have the area of the box plus both sides of the opened area.
// If two neighbours split a face differently, the unshared area would be larger.
inline void expect_sound(const pliant_body &body, double opened)
{
    double gradients[12], volume = 0, minimum = 1;
    for (int32_t t = 0; t < body.fine.num_tets; t++) {
        const double one = pliant_mesh_gradients(&body.fine, t, gradients);
        minimum = std::fmin(minimum, one);
        volume += one;
    }
    EXPECT_GE(minimum, (1 - 1e-9) * body.subdivision->min_volume);
    EXPECT_NEAR(volume, 0.2 * 0.1 * 0.1, 1e-12 * volume);
    EXPECT_NEAR(area_of(body.fine, body.triangles, 0, body.num_triangles), surface + 2 * opened, 1e-9 * surface);
    pliant_surface *seen = nullptr;
    ASSERT_EQ(pliant_surface_create(&body, nullptr, &seen), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(seen->num_triangles, body.num_triangles);
    EXPECT_NEAR(area_of(body.fine, seen->triangle, 0, seen->first_cut), surface, 1e-9 * surface);
    EXPECT_NEAR(area_of(body.fine, seen->triangle, seen->first_cut, seen->num_triangles), 2 * opened, 1e-9 * surface);
    pliant_surface_free(seen);
}

// over all edges with an appended node
inline double shortest_edge(const pliant_body &body)
{
    double minimum = 1;
    for (int32_t t = 0; t < body.fine.num_tets; t++)
        for (int a = 0; a < 4; a++)
            for (int b = 0; b < a; b++) {
                double squares = 0;
                for (int d = 0; d < 3; d++)
                    squares += std::pow(body.fine.rest[3 * body.fine.tets[4 * t + a] + d] -
                                            body.fine.rest[3 * body.fine.tets[4 * t + b] + d],
                                        2);
                minimum = std::fmin(minimum, std::sqrt(squares));
            }
    return minimum;
}

#endif
