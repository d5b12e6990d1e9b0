// Strokes of a blade through the phantom's liver: severed area, work, and what slips off the edge.
#include "cuts.h"
#include "fem/dynamics/tled.h"
#include "mesh/mesh.h"
#include "sim/build/model.h"

#include <Eigen/Dense>
#include <cmath>
#include <cstdlib>
#include <random>
#include <string>

namespace {

const double toughness = 200; // of the phantom's liver [J/m^2]

// The phantom's liver, in a scan with air, many materials and partially filled elements, with a blade across it.
struct Liver {
    pliant_scene scene;
    pliant_volume scan{};
    pliant_labels labels{};
    pliant_material_table table{};
    pliant_model *model = nullptr;
    pliant_data *data = nullptr;
    int tool = -1;
    double x = 0, section = 0; // plane between two voxel layers [m], and its area within the liver [m^2]
    explicit Liver(const std::function<void(pliant_scene &)> &set)
    {
        EXPECT_EQ(pliant_scene_read(PLIANT_SOURCE_DIR "/launch/scenes/resect.yaml", &scene), PLIANT_OK)
            << pliant_last_error();
        set(scene);
        EXPECT_EQ(pliant_inputs_read(&scene, "phantom:80x56x68", &scan, &labels, &table), PLIANT_OK)
            << pliant_last_error();
        EXPECT_EQ(pliant_model_build(&scene, &scan, &labels, &table, {nullptr, nullptr}, &model), PLIANT_OK)
            << pliant_last_error();
        EXPECT_EQ(pliant_data_create(model, &data), PLIANT_OK);
        const int32_t *count = scan.geometry.size, layer = 37;
        x = scan.geometry.origin[0] + scan.geometry.direction[0] * (layer + 0.45) * scan.geometry.spacing[0];
        const uint8_t *material = pliant_model_get_voxel_materials(model);
        for (int32_t v = layer; v < count[0] * count[1] * count[2]; v += count[0])
            if (!table.materials[material[v]].empty && !table.materials[material[v + 1]].empty)
                section += scan.geometry.spacing[1] * scan.geometry.spacing[2];
        const double from[3] = {0, -0.2, 0}, to[3] = {0, 0.2, 0};
        EXPECT_EQ(pliant_tool_add(model, data, "knife", &tool), PLIANT_OK);
        EXPECT_EQ(pliant_tool_set_blade(data, tool, from, to), PLIANT_OK);
    }
    ~Liver()
    {
        pliant_data_free(data);
        pliant_model_free(model);
        pliant_material_table_free(&table);
        pliant_labels_free(&labels);
        pliant_volume_free(&scan);
    }
    pliant_tool_state step(double z)
    {
        const double tip[3] = {x, -0.04, z};
        pliant_tool_state state{};
        EXPECT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
        EXPECT_EQ(pliant_tool_set_cutting(data, tool, true), PLIANT_OK);
        EXPECT_GE(pliant_step(model, data), 0) << pliant_last_error();
        EXPECT_EQ(pliant_tool_get(data, tool, &state), PLIANT_OK);
        return state;
    }
};

TEST(LiverKnife, SeversTheSection)
{
    Liver liver([](pliant_scene &scene) { scene.cut.resistance = 0; });
    const double x = liver.x, section = liver.section;
    ASSERT_GT(section, 2e-3);
    pliant_tool_state tool_state{};
    for (int s = 0; s < 40; s++) tool_state = liver.step(0.17 - 0.006 * s);
    EXPECT_NEAR(tool_state.severed_area, section, 0.05 * section);
    pliant_data *at_once = nullptr;
    pliant_cut_report report;
    const double line[6] = {x, -0.4, 0.3, x, 0.4, 0.3}, depth[3] = {0, 0, -0.6};
    ASSERT_EQ(pliant_data_create(liver.model, &at_once), PLIANT_OK);
    ASSERT_EQ(pliant_data_cut(liver.model, at_once, 2, line, depth, &report), PLIANT_OK) << pliant_last_error();
    EXPECT_NEAR(tool_state.severed_area, report.area, 1e-9) << "as by one cut through all of it";
    EXPECT_GE(tool_state.pieces, report.pieces);
    EXPECT_LE(tool_state.pieces, report.pieces + 2)
        << "bits at the edge of the tissue may come off where it moves between two steps";
    EXPECT_GE(report.pieces, 2);
    pliant_data_free(at_once);
}

// The edge is as wide as the liver and bends it by several centimetres. A stroke ends when the edge has left the
// tissue. With inertia the halves then swing freely, and can swing over the edge.
// With six evaluations a stroke of 8 mm/s severs 3 to 6 % more than the section; faster strokes do not.
struct Stroke {
    const char *name;
    pliant_solver_kind solver;
    double speed; // [m/s]
};

class LiverKnifeWork : public testing::TestWithParam<Stroke> {};

TEST_P(LiverKnifeWork, IsToughnessTimesItsArea)
{
    const Stroke &stroke = GetParam();
    Liver liver([&](pliant_scene &scene) {
        scene.solver.kind = stroke.solver;
        scene.solver.iterations = 30;
        scene.tled.damping = 20;
        scene.cut.drag = 0.003;
    });
    const double way = stroke.speed * liver.scene.solver.step;
    pliant_tool_state state{};
    double work = 0;
    for (double z = 0.153; z > 0.06; z -= way) { // the liver lies between z = 0.075 and 0.15 m
        const double before = -state.force[2];
        state = liver.step(z);
        work += 0.5 * (before - state.force[2]) * way;
        if (state.pieces > 1 && state.engaged_length == 0 && state.force[2] == 0) break;
    }
    const double ideal = toughness * state.severed_area;
    if (std::getenv("PLIANT_FIGURES"))
        std::printf("solver %d, %g mm/s: area %.4f of the section's, work %.4f of toughness times area\n",
                    stroke.solver, 1e3 * stroke.speed, state.severed_area / liver.section, work / ideal);
    EXPECT_NEAR(state.severed_area, liver.section, 0.05 * liver.section);
    EXPECT_NEAR(work, ideal, 0.05 * ideal);
    EXPECT_EQ(state.force[2], 0);
}

INSTANTIATE_TEST_SUITE_P(Strokes, LiverKnifeWork,
                         testing::Values(Stroke{"QuasistaticFast", PLIANT_COROTATIONAL, 0.044},
                                         Stroke{"QuasistaticSlow", PLIANT_COROTATIONAL, 0.01},
                                         Stroke{"ExplicitFast", PLIANT_TLED, 0.044},
                                         Stroke{"ExplicitSlow", PLIANT_TLED, 0.01}),
                         [](const testing::TestParamInfo<Stroke> &info) { return info.param.name; });

// With the default of six evaluations, tissue that slips off the edge stays a body: no element is inverted after any
// step.
TEST(LiverKnife, SlipsAndInvertsNoElement)
{
    for (const double start : {0.155, 0.15535}) {
        Liver liver([](pliant_scene &scene) { scene.cut.drag = 0.003; });
        const double way = 0.02 * liver.scene.solver.step;
        pliant_tool_state state{};
        for (double z = start; z > 0.06; z -= way) {
            state = liver.step(z);
            ASSERT_EQ(pliant_data_get_inverted(liver.data), 0) << start << ", " << z;
        }
        EXPECT_NEAR(state.severed_area, liver.section, 0.05 * liver.section) << start;
    }
}

// A rectangle at rest that a blade sweeps.
struct Rectangle {
    Eigen::Vector3d corner, edge, way;
    // Return the area in voxels of tissue within elements [m^2].
    double area_in_tissue(const Liver &liver) const
    {
        const uint8_t *material = pliant_model_get_voxel_materials(liver.model);
        const pliant_body &body = *liver.model->body;
        const pliant_geometry &grid = liver.scan.geometry;
        const int parts = 20;
        int inside = 0;
        for (int part = 0; part < parts * parts; part++) {
            const Eigen::Vector3d point =
                corner + (part % parts + 0.5) / parts * edge + (part / parts + 0.5) / parts * way;
            double index[3], weight[4];
            int32_t voxel = 0, tet = -1;
            bool in_scan = true;
            pliant_geometry_to_index(&grid, point.data(), index);
            for (int d = 2; d >= 0; d--) {
                const double nearest = std::floor(index[d] + 0.5);
                in_scan = in_scan && nearest >= 0 && nearest < grid.size[d];
                voxel = voxel * grid.size[d] + static_cast<int32_t>(nearest);
            }
            inside += in_scan && !liver.table.materials[material[voxel]].empty &&
                      pliant_body_locate(&body, body.fine.rest, point.data(), &tet, weight);
        }
        return edge.norm() * way.norm() * inside / (parts * parts);
    }
};

// Random blades end in the liver on up to four sides. The border of a cut is within 0.15 of an element's edge of the
// blade's path. If this distance is uniformly distributed, and independent in each element along the border, it gives
// the root mean square error of the area.
TEST(LiverKnife, SubdivisionSeversTheAreaThatABladeSweeps)
{
    Liver liver([](pliant_scene &scene) {
        scene.cut.kind = PLIANT_CUT_SUBDIVIDE;
        const int32_t cells[3] = {18, 14, 14};
        std::copy(cells, cells + 3, scene.mesh.coarse_cells);
    });
    const pliant_mesh &mesh = liver.model->body->fine;
    const double wide = 0.02, deep = 0.06, edge = pliant_tled_shortest_edge(&mesh, mesh.tets);
    std::mt19937 random(4);
    std::normal_distribution<double> normal;
    const auto direction = [&] { return Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized(); };
    double sum = 0, squares = 0, minimum = 1, maximum = 1;
    const int strokes = 40;
    for (int stroke = 0; stroke < strokes;) {
        const auto node = mesh.tets[4 * (random() % static_cast<unsigned>(mesh.num_tets))];
        const Eigen::Vector3d middle = Eigen::Map<const Eigen::Vector3d>(mesh.rest + 3 * node), along = direction(),
                              ahead = along.cross(direction()).normalized();
        const Rectangle swept{middle - 0.5 * wide * along - 0.5 * deep * ahead, wide * along, deep * ahead};
        const double area = swept.area_in_tissue(liver);
        if (area < 0.5 * wide * deep) continue;
        const Eigen::Vector3d other = swept.corner + swept.edge;
        const double points[6] = {swept.corner[0], swept.corner[1], swept.corner[2], other[0], other[1], other[2]};
        pliant_cut_report report{};
        ASSERT_EQ(pliant_data_cut(liver.model, liver.data, 2, points, swept.way.data(), &report), PLIANT_OK)
            << pliant_last_error();
        ASSERT_EQ(pliant_data_undo_cut(liver.model, liver.data), PLIANT_OK);
        const double ratio = report.area / area;
        sum += ratio;
        squares += (ratio - 1) * (ratio - 1);
        minimum = std::fmin(minimum, ratio);
        maximum = std::fmax(maximum, ratio);
        stroke++;
    }
    const double error = std::sqrt(squares / strokes), mean = sum / strokes,
                 bound = 0.15 / std::sqrt(3) * edge * std::sqrt(2 * (wide + deep) * edge) / (wide * deep);
    if (std::getenv("PLIANT_FIGURES"))
        std::printf("%.1f mm edges: severed over swept area: mean %.3f, %.2f to %.2f, root mean square error %.1f %% "
                    "(bound %.1f %%)\n",
                    1e3 * edge, mean, minimum, maximum, 100 * error, 100 * bound);
    EXPECT_LT(error, bound);
    EXPECT_NEAR(mean, 1, 3 * bound / std::sqrt(strokes)) << "three standard deviations of the mean";
}

} // namespace
