// The list of triangles near the parts (backend.h: find_near) changes no bit of a step. On the CPU, this file makes the
// list by the rule that the GPU uses. With a GPU, it tests the GPU's list.
#include "cuda_contacts.h"
#include "sim/step/legs.h"

#include <cstdio>
#include <functional>

#ifndef PLIANT_WITH_CUDA
const pliant_tissue_searcher pliant_cuda_tissue_searcher = {nullptr, nullptr, nullptr};
#endif

namespace {

using namespace cuda_contacts;

struct Triangles {
    int lists = 0, lists_in_legs = 0;
    int64_t listed = 0, all = 0;
} triangles;

// Enlarge a box so that it contains the corners of a triangle.
void add_corners(const pliant_near_surface &surface, const double *positions, int32_t t, double low[3], double high[3])
{
    for (int c = 0; c < 3; c++) {
        const int32_t node = surface.body->triangles[3 * t + c];
        double x[3] = {positions[3 * node], positions[3 * node + 1], positions[3 * node + 2]};
        if (surface.corners) pliant_contact_surface_corner(surface.corners, node, positions, x);
        for (int d = 0; d < 3; d++) {
            low[d] = std::fmin(low[d], x[d]);
            high[d] = std::fmax(high[d], x[d]);
        }
    }
}

bool list_by_rule(pliant_data *data, const pliant_near_surface *surface, bool in_leg, int32_t count,
                  const pliant_near_region *regions, pliant_triangle_list *out)
{
    static std::vector<int32_t> list;
    list.clear();
    for (int32_t t = 0; t < surface->body->num_triangles; t++) {
        double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
        bool near = false;
        add_corners(*surface, data->positions, t, low, high);
        if (in_leg) add_corners(*surface, data->legs->positions, t, low, high);
        for (int32_t r = 0; r < count && !near; r++) near = !pliant_near_is_apart(regions + r, low, high);
        if (near) list.push_back(t);
    }
    *out = {static_cast<int32_t>(list.size()), list.data()};
    return true;
}

void count_list(const pliant_near_surface *surface, bool in_leg, const pliant_triangle_list *list)
{
    triangles.lists++;
    triangles.lists_in_legs += in_leg;
    triangles.listed += list->count;
    triangles.all += surface->body->num_triangles;
}

bool find_on_cpu(pliant_data *data, const pliant_near_surface *surface, bool in_leg, int32_t count,
                 const pliant_near_region *regions, pliant_triangle_list *out)
{
    const bool found = list_by_rule(data, surface, in_leg, count, regions, out);
    count_list(surface, in_leg, out);
    return found;
}

#ifdef PLIANT_WITH_CUDA
bool find_on_gpu(pliant_data *data, const pliant_near_surface *surface, bool in_leg, int32_t count,
                 const pliant_near_region *regions, pliant_triangle_list *out)
{
    pliant_triangle_list rule;
    if (!pliant_cuda_backend.find_near(data, surface, in_leg, count, regions, out)) return false;
    count_list(surface, in_leg, out);
    list_by_rule(data, surface, in_leg, count, regions, &rule);
    EXPECT_EQ(std::vector<int32_t>(rule.triangle, rule.triangle + rule.count),
              std::vector<int32_t>(out->triangle, out->triangle + out->count));
    return true;
}
#endif

// A backend with or without the list.
pliant_backend table_of(pliant_backend_choice choice, bool lists)
{
    pliant_backend table = pliant_cpu_backend;
    table.find_near = lists ? find_on_cpu : nullptr;
#ifdef PLIANT_WITH_CUDA
    if (choice == PLIANT_CUDA) {
        table = pliant_cuda_backend;
        table.find_near = lists ? find_on_gpu : nullptr;
    }
#endif
    (void)choice;
    return table;
}

// Run steps, and return all positions and contact forces.
template <class Scene>
std::vector<double> run(Scene &body, const pliant_backend &table, int steps, const std::function<void(int)> &move,
                        int32_t *legs)
{
    std::vector<double> out;
    body.data->backend = &table;
    for (int s = 0; s < steps; s++) {
        move(s);
        EXPECT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
        out.insert(out.end(), body.data->positions, body.data->positions + 3 * body.data->body->fine.num_nodes);
        for (int32_t p = 0; p < body.data->contacts.count; p++)
            out.insert(out.end(), body.data->contacts.point[p].force, body.data->contacts.point[p].force + 3);
        *legs = std::max(*legs, body.data->statistics.legs);
    }
    EXPECT_EQ(body.data->backend, &table) << pliant_last_error();
    return out;
}

template <class Make> void compare(const char *name, pliant_backend_choice choice, int steps, const Make &make)
{
    SCOPED_TRACE(name);
    std::vector<double> results[2];
    triangles = Triangles();
    int32_t legs = 0;
    for (const bool lists : {false, true}) {
        const pliant_backend table = table_of(choice, lists);
        auto body = make();
        ASSERT_EQ(body->begin(), PLIANT_OK) << pliant_last_error();
        results[lists] = run(
            *body, table, steps, [&](int s) { body->move(s); }, &legs);
    }
    EXPECT_TRUE(results[0] == results[1]);
    std::printf("%s, %s: %d lists, %d of them in legs; %.0f %% of the triangles; up to %d legs\n",
                choice == PLIANT_CUDA ? "GPU" : "CPU", name, triangles.lists, triangles.lists_in_legs,
                100.0 * double(triangles.listed) / double(triangles.all), legs);
    EXPECT_GT(triangles.lists, triangles.lists_in_legs);
    EXPECT_GT(triangles.lists_in_legs, steps / 2);
    EXPECT_LT(triangles.listed, 0.9 * double(triangles.all));
}

// A block between planes, so that half-spaces are tested as well.
struct PlaneBlock : Block {
    PlaneBlock(const Case &of, pliant_backend_choice backend) : Block(of, backend)
    {
        scene.solver.iterations = 12;
        scene.obstacles.num_planes = 1;
        scene.obstacles.planes[0] = {{12 * h + 1e-4, 0, 0}, {-1, 0, 0}};
    }
};

struct Sweep : RodSheet {
    explicit Sweep(pliant_backend_choice backend) : RodSheet(backend, PLIANT_DIRECT, 2, 30) {}
    void move(int s)
    {
        const double tip[3] = {0.0297, 0.03, 0.012 - 0.01 * s};
        ASSERT_EQ(pliant_tool_set_pose(data, 0, tip, nullptr), PLIANT_OK);
    }
};

// Run a test on the CPU and on a GPU, if there is one.
void on_each(const std::function<void(pliant_backend_choice)> &test)
{
    test(PLIANT_CPU);
    if (there_is_a_gpu()) test(PLIANT_CUDA);
}

class NearTriangles : public testing::TestWithParam<int> {};

TEST_P(NearTriangles, OfABlockChangeNoBit)
{
    const Case &block = cases[GetParam()];
    on_each([&](pliant_backend_choice choice) {
        compare(block.name, choice, 10, [&] { return std::make_unique<PlaneBlock>(block, choice); });
    });
}

INSTANTIATE_TEST_SUITE_P(Cases, NearTriangles, testing::Values(0, 4, 5, 6));

TEST(NearTrianglesOfASweep, ChangeNoBit)
{
    on_each([&](pliant_backend_choice choice) {
        compare("a rod sweeps a sheet", choice, 8, [&] { return std::make_unique<Sweep>(choice); });
    });
}

} // namespace
