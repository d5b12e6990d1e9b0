// Bodies for cuda_contact_test and cuda_sweep_test, on the CPU and on the GPU: a block under tools, a sheet under a
// rod, falling blocks, and detached pieces.
#ifndef PLIANT_TEST_CUDA_CONTACTS_H
#define PLIANT_TEST_CUDA_CONTACTS_H

#include "../../cuda/contact/tissue.h"
#include "body.h"
#include "cuda_warps.h"
#include "fem/rigid/rigid_pieces.h"
#include "base/memory.h"
#include "contact/advance/advance_workspace.h"
#include "tongue.h"

#include <tuple>

namespace cuda_contacts {

const double h = 0.005; // element size [m]

inline pliant_tool_shape shape_of(pliant_part_kind kind, double size)
{
    pliant_tool_shape shape{};
    shape.num_parts = 1;
    if (kind == PLIANT_PART_SPHERE) shape.part[0] = {kind, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0}, size, false};
    else if (kind == PLIANT_PART_CAPSULE)
        shape.part[0] = {kind, PLIANT_FRAME_TIP, {0, -0.01, 0}, {0, 0.01, 0}, size, false};
    else shape.part[0] = {kind, PLIANT_FRAME_TIP, {-size, -size, 0}, {size, size, 0.01}, 1e-3, false};
    return shape;
}

struct Case {
    const char *name;
    pliant_method method;
    int ratio;
    pliant_preconditioner_choice preconditioner;
    bool spring, slot; // a second tool pulls with a spring; there is a slot that closes
    double bound;      // maximum difference of a node's force relative to the maximum force
    pliant_element_kind element = PLIANT_LINEAR;
    // with friction on hexahedra a step has two solutions: from other initial forces, the CPU does not reproduce its
    // own result
    double friction = 0.3;
    double poisson = 0.4;
};

const Case cases[] = {
    {"fine, inverse", PLIANT_FINE, 1, PLIANT_DIRECT, false, false, 1e-6},
    {"fine, V-cycle", PLIANT_FINE, 1, PLIANT_MULTIGRID, false, false, 1e-6},
    {"fine, inverse, a spring beside", PLIANT_FINE, 1, PLIANT_DIRECT, true, false, 1e-6},
    {"coarse, inverse", PLIANT_COARSE, 2, PLIANT_DIRECT, false, false, 1e-6},
    {"averaged, inverse, a spring beside", PLIANT_AVERAGED, 2, PLIANT_DIRECT, true, false, 1e-6},
    {"hexahedra, inverse", PLIANT_FINE, 1, PLIANT_DIRECT, false, false, 1e-6, PLIANT_HEXAHEDRA, 0.15},
    {"tissue on tissue, inverse", PLIANT_FINE, 1, PLIANT_DIRECT, false, true, 1e-6},
    {"nu 0.499, inverse, a spring beside", PLIANT_FINE, 1, PLIANT_DIRECT, true, false, 1e-6, PLIANT_LINEAR, 0.3, 0.499},
    {"nu 0.4999, hexahedra, V-cycle", PLIANT_FINE, 1, PLIANT_MULTIGRID, false, false, 1e-6, PLIANT_HEXAHEDRA, 0.15,
     0.4999},
};

// A block of 60 x 40 x 25 mm on a fixed base, with or without a slot that is open on one side.
struct Block : Body {
    const Case &c;
    // small: elements twice as large
    Block(const Case &of, pliant_backend_choice backend, bool small = false)
        : Body(std::vector<int>{24, 16, 10}.data(), std::vector<double>{12 * h, 8 * h, 5 * h}.data(),
               {{4000, of.poisson, 1000, false}, {1, 0.3, 1, true}},
               [&of](int i, int, int k) { return of.slot && k / 2 == 2 && i >= 8; }),
          c(of)
    {
        fix_plane(0, 0, 1e-6, 0, 0, 1);
        cells(12 / c.ratio, 8 / c.ratio, c.ratio == 1 ? 5 : 2, c.ratio);
        if (small) cells(6, 4, c.slot ? 5 : 4, 1);
        scene.model.method = c.method;
        scene.element.kind = c.element;
        scene.solver.backend = backend;
        scene.solver.preconditioner = c.preconditioner;
        scene.solver.iterations = 400;
        scene.solver.tolerance = 1e-10;
        scene.contact.friction = c.friction;
        scene.contact.self = c.slot;
    }
    void add(const char *name, pliant_part_kind kind, double size, double x, double y)
    {
        int tool = -1;
        const double tip[3] = {x, y, 5 * h + (kind == PLIANT_PART_BOX ? 2e-3 : size + 1e-3)};
        const pliant_tool_shape shape = shape_of(kind, size);
        ASSERT_EQ(pliant_tool_add(model, data, name, &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_shape(data, tool, &shape), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
    }
    pliant_status begin()
    {
        const pliant_status status = build();
        if (status == PLIANT_OK) model->without_missing_compliance = true;
        return status == PLIANT_OK ? place() : status;
    }
    // Move the tools to their start above the block.
    pliant_status place()
    {
        add("ball", PLIANT_PART_SPHERE, 0.006, 0.042, 0.0212);
        if (!c.slot) {
            add("shaft", PLIANT_PART_CAPSULE, 0.003, 0.021, 0.0193);
            add("pad", PLIANT_PART_BOX, 0.004, 0.0093, 0.0103);
        }
        if (!c.spring) return PLIANT_OK;
        int tool;
        const double point[3] = {12 * h, 4 * h, 4 * h};
        pliant_tool_add(model, data, "pull", &tool);
        data->tools[tool].stiffness = 20;
        data->tools[tool].radius = 0.006;
        pliant_tool_set_pose(data, tool, point, nullptr);
        return pliant_tool_grasp(model, data, tool, nullptr);
    }
    pliant_status step(int s)
    {
        move(s);
        return pliant_step(model, data);
    }
    // Press, then slide.
    void move(int s)
    {
        const double down = c.slot ? 0.0012 : 0.0008, along = 0.0004;
        for (int t = 0; t < data->num_tools; t++) {
            double tip[3];
            std::memcpy(tip, data->tools[t].tip, sizeof tip);
            if (data->tools[t].holding) tip[0] += 3e-4;
            else if (s <= 7) tip[2] -= down;
            else tip[t % 2] += along;
            EXPECT_EQ(pliant_tool_set_pose(data, t, tip, nullptr), PLIANT_OK);
        }
    }
};

inline void forces_of(const pliant_data *data, double out[3])
{
    out[0] = out[1] = out[2] = 0;
    for (int32_t p = 0; p < data->contacts.count; p++)
        for (int d = 0; d < 3; d++) out[d] += data->contacts.point[p].force[d];
}

inline double farthest(const double *a, const double *b, int32_t nodes)
{
    double maximum = 0;
    for (int32_t n = 0; n < 3 * nodes; n++) maximum = std::fmax(maximum, std::fabs(a[n] - b[n]));
    return maximum;
}

// Copy the CPU's contact points and positions.
inline void copy_contacts(const pliant_data *from, const pliant_model *model, pliant_data *to)
{
    const size_t count = static_cast<size_t>(from->contacts.count);
    ASSERT_EQ(pliant_data_set_positions(model, to, from->positions), PLIANT_OK);
    pliant_free(to->contacts.point);
    to->contacts.point = static_cast<pliant_contact_point *>(pliant_calloc(count + 1, sizeof *to->contacts.point));
    to->contacts.count = to->contacts.capacity = from->contacts.count;
    std::copy(from->contacts.point, from->contacts.point + count, to->contacts.point);
}

// Copy them without the forces, because friction with nearly dependent points has several solutions.
inline void copy_contact_places(const pliant_data *from, const pliant_model *model, pliant_data *to)
{
    copy_contacts(from, model, to);
    for (int32_t p = 0; p < to->contacts.count; p++) std::fill_n(to->contacts.point[p].force, 3, 0.0);
}

// Return the forces on nodes instead of points, because equivalent points may share a force arbitrarily.
inline std::vector<double> forces_on_nodes(const pliant_data *data)
{
    std::vector<double> forces(3 * static_cast<size_t>(data->body->fine.num_nodes));
    pliant_data_get_contact_forces(data, forces.data());
    return forces;
}

inline double max_distance_of(const std::vector<double> &a)
{
    double maximum = 0;
    for (double v : a) maximum = std::fmax(maximum, std::fabs(v));
    return maximum;
}

inline double max_difference(const std::vector<double> &a, const std::vector<double> &b)
{
    double maximum = 0;
    for (size_t n = 0; n < a.size(); n++) maximum = std::fmax(maximum, std::fabs(a[n] - b[n]));
    return maximum;
}

// Differences between two runs.
struct Differences {
    double force = 0, forces = 0, positions = 0, moved = 0; // contact forces: maximum and difference [N]; positions [m]
    void take(const Body &a, const Body &b)
    {
        const int32_t nodes = a.data->body->fine.num_nodes;
        const std::vector<double> here = forces_on_nodes(a.data), there = forces_on_nodes(b.data);
        force = std::fmax(force, max_distance_of(here));
        forces = std::fmax(forces, max_difference(here, there));
        positions = std::fmax(positions, farthest(a.data->positions, b.data->positions, nodes));
        moved = std::fmax(moved, farthest(a.data->positions, a.data->body->fine.rest, nodes));
        for (int32_t n = 0; n < 3 * nodes; n++) EXPECT_TRUE(std::isfinite(b.data->positions[n]));
        for (double f : there) EXPECT_TRUE(std::isfinite(f));
    }
};

// relative to the maximum force: if the CPU does not reproduce its own result within this bound, there is no unique
// reference
const double one_end = 1e-7;

inline pliant_status solve(const pliant_model *model, pliant_data *data)
{
    pliant_status status = data->backend->solve(model, data);
    if (status >= 0 && data->backend->upsample(model, data) == PLIANT_OK &&
        data->backend->warp(model, data) == PLIANT_OK)
        data->statistics.step++;
    else ADD_FAILURE() << pliant_last_error();
    return status;
}

// A sheet of 60 x 60 x 4 mm, fixed at two sides, onto which a rod moves down by 20 mm per step to a depth of 24 mm.
struct RodSheet : Body {
    RodSheet(pliant_backend_choice backend, pliant_preconditioner_choice preconditioner, int finer, int iterations)
        : Body(std::vector<int>{12 * finer, 12 * finer, 2 * finer}.data(),
               std::vector<double>{0.06, 0.06, 0.004}.data(), {{4000, 0.4, 1000, false}})
    {
        fix_plane(0.001, 0, 0, 1, 0, 0);
        fix_plane(0.059, 0, 0, -1, 0, 0);
        cells(6 * finer, 6 * finer, finer, 1);
        scene.solver.backend = backend;
        scene.solver.preconditioner = preconditioner;
        scene.solver.iterations = iterations;
        scene.solver.tolerance = 1e-4;
        scene.contact.friction = 0.3;
    }
    pliant_status begin()
    {
        const pliant_status status = build();
        if (status == PLIANT_OK) model->without_missing_compliance = true;
        return status == PLIANT_OK ? place() : status;
    }
    pliant_status place()
    {
        int tool = -1;
        pliant_tool_shape rod{};
        rod.num_parts = 1;
        rod.part[0] = {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {0, -0.05, 0}, {0, 0.05, 0}, radius, false};
        const pliant_status status = pliant_tool_add(model, data, "rod", &tool);
        return status == PLIANT_OK ? pliant_tool_set_shape(data, tool, &rod) : status;
    }
    // Prepare a patch, or a detached piece.
    void expect(bool patch)
    {
        scene.cut.kind = patch ? PLIANT_CUT_NONE : PLIANT_CUT_SUBDIVIDE;
        scene.model.method = patch ? PLIANT_AVERAGED : PLIANT_FINE;
        scene.mesh.ratio = patch ? 2 : 1;
        scene.model.patch = patch ? 0.012 : 0;
        scene.warp.margin = 1;
        scene.solver.threads = 1;
    }
    // Return the maximum displacement of a node that belongs to no piece [m].
    double carried() const
    {
        double maximum = 0;
        for (int32_t n = 0; n < data->body->fine.num_nodes; n++)
            for (int d = 0; d < 3 && !pliant_rigid_pieces_contain(data->rigid_pieces, n); d++)
                maximum = std::fmax(maximum, std::fabs(data->positions[3 * n + d] - data->body->fine.rest[3 * n + d]));
        return maximum;
    }
    // Cut off a part of a free side, far from the rod.
    void cut_off()
    {
        const double way[12] = {0.0213, -0.01, 0.01, 0.0213, 0.0063, 0.01, 0.0387, 0.0063, 0.01, 0.0387, -0.01, 0.01},
                     down[3] = {0, 0, -0.02};
        ASSERT_EQ(pliant_data_cut(model, data, 4, way, down, nullptr), PLIANT_OK) << pliant_last_error();
        ASSERT_TRUE(data->body->pieces);
        std::vector<double> positions(data->positions, data->positions + 3 * data->body->fine.num_nodes);
        for (int32_t i = 0; i < data->body->pieces->start[1]; i++)
            positions[3 * data->body->pieces->node[i] + 1] -= 0.2;
        ASSERT_EQ(pliant_data_set_positions(model, data, positions.data()), PLIANT_OK) << pliant_last_error();
    }
    // Press a corner with a ball until a patch serves it.
    void press_a_corner()
    {
        const int ball = add_ball(0.004);
        for (int s = 0; s < 30 && data->statistics.patched == 0; s++) {
            const double tip[3] = {0.012, 0.008, 0.009 - 0.0005 * std::min(s, 4)};
            ASSERT_EQ(pliant_tool_set_pose(data, ball, tip, nullptr), PLIANT_OK);
            ASSERT_GE(pliant_step(model, data), 0) << pliant_last_error();
        }
        ASSERT_EQ(data->statistics.patched, 1);
    }
    pliant_status step(int s, double x)
    {
        const double tip[3] = {x, 0.03, 0.016 + radius - 0.02 * std::min(s, 2)};
        const pliant_status status = pliant_tool_set_pose(data, 0, tip, nullptr);
        return status == PLIANT_OK ? pliant_step(model, data) : status;
    }
    const double radius = 0.0005;
};

struct Fall : Body {
    // Blocks of 3 x 3 x 2 elements one above the other, separated by one empty element, over a floor that is an
    // obstacle or a wall.
    Fall(int blocks, bool self, bool still, pliant_backend_choice backend)
        : Body(std::vector<int>{6, 6, 2 * (3 * blocks - 1)}.data(),
               std::vector<double>{0.03, 0.03, 0.01 * (3 * blocks - 1)}.data(),
               {{20e3, 0.3, 1000, false}, {1, 0.3, 1, true}}, [](int, int, int k) { return k / 2 % 3 == 2; })
    {
        cells(3, 3, 3 * blocks - 1, 1);
        scene.solver.kind = PLIANT_TLED;
        scene.solver.backend = backend;
        scene.solver.step = 0.01;
        scene.contact.self = self;
        scene.contact.friction = 0.4;
        scene.tled.quasi_static = still;
        scene.tled.relaxation_steps = 2000;
        scene.tled.damping = 20;
        scene.model.gravity[0] = 1;
        scene.model.gravity[2] = -9.81;
        if (still) {
            scene.solver.tolerance = 1e-4;
            fix_plane(0, 0, 1e-6, 0, 0, 1);
        } else {
            scene.ground.normal[2] = 1;
            scene.ground.point[2] = self ? 0 : -10; // falling is permitted
        }
        if (!still && !self) {
            scene.obstacles.num_planes = 1;
            scene.obstacles.planes[0] = {{0, 0, -0.002}, {0, 0, 1}};
        }
    }
    pliant_status begin()
    {
        const pliant_status status = build();
        int tool;
        if (status != PLIANT_OK) return status;
        model->without_missing_compliance = true;
        const pliant_tool_shape shape = shape_of(PLIANT_PART_SPHERE, 0.008);
        pliant_tool_add(model, data, "ball", &tool);
        return pliant_tool_set_shape(data, tool, &shape);
    }
    bool strikes = false;
    pliant_status step(int s)
    {
        const double top = 0.01 * (data->body->fine.num_nodes > 64 ? 5 : 2),
                     slow[3] = {0.0153, 0.0147 + 2e-4 * s, top + 0.008 - 3e-4 * s};
        // 0.9 m/s
        const double fast[3] = {0.0153 + 1e-3 * s, 0.0147, top + 0.028 - 9e-3 * std::min(s, 3)},
                     *tip = strikes ? fast : slow;
        EXPECT_EQ(pliant_tool_set_pose(data, 0, tip, nullptr), PLIANT_OK);
        return pliant_step(model, data);
    }
};

// Contact detection between tissue surfaces on the CPU and on the GPU from the same positions; the points must be
// bitwise identical.
struct Searches {
    pliant_tissue of[2] = {};
    pliant_contacts found[2] = {};
    Searches() { pliant_tissue_set_searcher(of + 1, &pliant_cuda_tissue_searcher); }
    Searches(const Searches &) = delete;
    Searches &operator=(const Searches &) = delete;
    ~Searches()
    {
        for (int k = 0; k < 2; k++) {
            pliant_tissue_free(of + k);
            pliant_free(found[k].point);
        }
    }
    // Return the number of points.
    int32_t compare(const pliant_body *body, const double *positions, const pliant_tissue_rule &rule)
    {
        for (int k = 0; k < 2; k++) {
            found[k].count = 0;
            EXPECT_EQ(pliant_tissue_set_body(of + k, body, nullptr, 1), PLIANT_OK) << pliant_last_error();
            EXPECT_EQ(pliant_tissue_find(of + k, positions, &rule, found + k), PLIANT_OK) << pliant_last_error();
        }
        EXPECT_NE(of[1].searcher_state, nullptr) << "the GPU has not searched";
        EXPECT_EQ(of[0].num_overlaps, of[1].num_overlaps);
        EXPECT_EQ(found[0].count, found[1].count);
        for (int32_t p = 0; p < std::min(found[0].count, found[1].count); p++) {
            const pliant_contact_point &a = found[0].point[p], &b = found[1].point[p];
            const bool same =
                a.feature == b.feature && a.count == b.count && std::equal(a.node, a.node + a.count, b.node) &&
                std::equal(a.weight, a.weight + a.count, b.weight) && std::equal(a.normal, a.normal + 3, b.normal) &&
                std::equal(a.place, a.place + 3, b.place) && a.area == b.area;
            EXPECT_TRUE(same) << "point " << p << " of " << found[0].count;
        }
        return found[0].count;
    }
    // Compare the listed pairs that keep a distance. Their order may differ. Return their number.
    int32_t compare_pairs()
    {
        std::vector<pliant_advance_self_pair> pairs[2];
        for (int k = 0; k < 2; k++) {
            pairs[k].assign(of[k].advance->self, of[k].advance->self + of[k].advance->num_self);
            std::sort(pairs[k].begin(), pairs[k].end(),
                      [](const pliant_advance_self_pair &a, const pliant_advance_self_pair &b) {
                          return std::make_tuple(a.is_edges, a.feature[0], a.feature[1], a.node[0]) <
                                 std::make_tuple(b.is_edges, b.feature[0], b.feature[1], b.node[0]);
                      });
        }
        const bool same =
            pairs[0].size() == pairs[1].size() &&
            std::equal(pairs[0].begin(), pairs[0].end(), pairs[1].begin(),
                       [](const pliant_advance_self_pair &a, const pliant_advance_self_pair &b) {
                           return a.is_edges == b.is_edges && std::equal(a.feature, a.feature + 2, b.feature) &&
                                  std::equal(a.node, a.node + 4, b.node) && a.limit == b.limit;
                       });
        EXPECT_TRUE(same) << pairs[0].size() << " and " << pairs[1].size() << " pairs";
        EXPECT_TRUE(std::equal(of[0].exempt, of[0].exempt + of[0].body->fine.num_nodes, of[1].exempt));
        return static_cast<int32_t>(pairs[0].size());
    }
};

// A block stands on a plate, another one hangs 10 mm above it. A piece cut off the upper block falls onto the lower
// block, or on the ground, where a ball presses it.
struct Drop : Body {
    explicit Drop(bool pressed, pliant_backend_choice backend)
        : Body(std::vector<int>{6, 6, 24}.data(), std::vector<double>{0.015, 0.015, 0.06}.data(),
               {{10e3, 0.3, 1000, false}, {1, 0.3, 1, true}}, [](int, int, int k) { return k >= 8 && k < 12; }),
          presses(pressed)
    {
        cells(3, 3, 12, 1);
        fix_plane(0, 0, 1e-4, 0, 0, 1);
        fix_plane(0, 0, 0.0599, 0, 0, -1);
        scene.model.gravity[2] = -9.81;
        scene.cut.kind = PLIANT_CUT_SUBDIVIDE;
        scene.contact.self = true;
        scene.contact.friction = 0.3;
        scene.warp.margin = 1;
        scene.solver.backend = backend;
        scene.solver.preconditioner = PLIANT_DIRECT;
        scene.solver.iterations = 100;
        scene.solver.tolerance = 1e-9;
        scene.ground.normal[2] = 1;
        scene.ground.point[2] = pressed ? 0.022 : -1;
    }
    pliant_status begin()
    {
        const double corners[6] = {-0.01, -0.01, 0.0437, 0.03, -0.01, 0.0437}, across[3] = {0, 0.04, 0};
        const pliant_tool_shape ball = shape_of(PLIANT_PART_SPHERE, 0.004);
        int tool;
        pliant_status status = build();
        if (status == PLIANT_OK) status = pliant_data_cut(model, data, 2, corners, across, nullptr);
        if (status == PLIANT_OK && presses) status = pliant_tool_add(model, data, "ball", &tool);
        return status == PLIANT_OK && presses ? pliant_tool_set_shape(data, tool, &ball) : status;
    }
    // Let it land, then press it.
    void move(int s)
    {
        const double tip[3] = {0.0078, 0.0073, 0.040 - 0.00025 * std::max(0, std::min(s - 20, 20))};
        if (presses) EXPECT_EQ(pliant_tool_set_pose(data, 0, tip, nullptr), PLIANT_OK);
    }
    const bool presses;
};

// Press and cut a block on a GPU.
inline void touch_once(const Case &of)
{
    SCOPED_TRACE(of.name);
    Block body(of, PLIANT_CUDA, true);
    body.scene.cut.kind = PLIANT_CUT_SEVER;
    body.scene.solver.iterations = 3;
    ASSERT_EQ(body.begin(), PLIANT_OK) << pliant_last_error();
    for (int s = of.slot ? 4 : 2; s <= (of.slot ? 6 : 3); s++) ASSERT_GE(body.step(s), 0) << pliant_last_error();
    EXPECT_STREQ(pliant_data_get_backend(body.data), "cuda") << pliant_last_error();
    EXPECT_GT(body.data->statistics.contacts, of.slot ? 0 : 3);
    if (of.slot) return;
    // exercises the columns that are carried over
    const double points[6] = {0.031, -0.01, 0.03, 0.033, 0.05, 0.03}, depth[3] = {0.001, 0, -0.019};
    ASSERT_EQ(pliant_data_cut(body.model, body.data, 2, points, depth, nullptr), PLIANT_OK) << pliant_last_error();
    ASSERT_GE(body.step(4), 0) << pliant_last_error();
    EXPECT_STREQ(pliant_data_get_backend(body.data), "cuda") << pliant_last_error();
    EXPECT_GT(body.data->statistics.contacts, 3);
}

} // namespace cuda_contacts

#endif
