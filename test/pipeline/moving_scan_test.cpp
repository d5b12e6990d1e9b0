// Random strokes of a blade through a CT that the solver moves during the strokes: connectivity, mass and stiffness of
// the result.
#include "../elements.h"
#include "sim/build/discretization.h"

#include <cstdlib>
#include <fstream>
#include <string>

namespace {

const int fewest_strokes = 18;

int number_from(const char *name, int otherwise)
{
    const char *const asked = std::getenv(name);
    return asked ? std::atoi(asked) : otherwise;
}

struct Engine {
    const char *name;
    pliant_solver_kind solver;
    pliant_element_kind element;
};
void PrintTo(const Engine &engine, std::ostream *out) { *out << engine.name; }

const double step_size = 0.02, max_speed = 0.2;

// The CT with a coarse mesh, fixed at its bones. Gravity rotates, and forceps move the grasped tissue in circles at up
// to 0.2 m/s.
struct Scan {
    pliant_scene scene;
    pliant_volume volume{};
    pliant_labels labels{};
    pliant_material_table table{};
    pliant_model *model = nullptr;
    pliant_data *data = nullptr;
    int knife = -1, forceps = -1;
    double time = 0, held[3], phase = 0;
    std::vector<double> last;
    std::mt19937 random;

    Scan(const std::string &path, const Engine &engine, unsigned seed) : random(seed)
    {
        pliant_scene_defaults(&scene);
        EXPECT_EQ(pliant_scene_set(&scene, "scan/resample", "56 46 52"), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_inputs_read(&scene, path.c_str(), &volume, &labels, &table), PLIANT_OK) << pliant_last_error();
        for (uint32_t m = 0; m < table.num_materials; m++)
            // soft bone, so that explicit dynamics does not need a thousand sub-steps
            if (table.materials[m].fixed) table.materials[m].young_modulus = 1e5;
        scene.model.method = PLIANT_FINE;
        scene.element.kind = engine.element;
        scene.solver.kind = engine.solver;
        scene.solver.step = step_size;
        scene.solver.iterations = 8;
        scene.solver.threads = 1;
        scene.tled.damping = 2;
        scene.cut.kind = PLIANT_CUT_SEVER;
        scene.cut.undo = 1;
        const int cells[3] = {10, 8, 9};
        std::copy(cells, cells + 3, scene.mesh.coarse_cells);
        scene.mesh.ratio = 1;
        scene.grasp.radius = 0.03;
        scene.grasp.stiffness = 600;
        for (int d = 0; d < 3; d++) { // detached pieces stay near
            const double end = volume.geometry.origin[d] + (volume.geometry.size[d] - 1) * volume.geometry.spacing[d] *
                                                               volume.geometry.direction[4 * d];
            scene.ground.box_low[d] = std::min(volume.geometry.origin[d], end) - 0.03;
            scene.ground.box_high[d] = std::max(volume.geometry.origin[d], end) + 0.03;
        }
        EXPECT_EQ(pliant_model_build(&scene, &volume, nullptr, &table, {nullptr, nullptr}, &model), PLIANT_OK)
            << pliant_last_error();
        EXPECT_EQ(pliant_data_create(model, &data), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_tool_add(model, data, "knife", &knife), PLIANT_OK);
        EXPECT_EQ(pliant_tool_add(model, data, "forceps", &forceps), PLIANT_OK);
    }
    Scan(const Scan &) = delete;
    ~Scan()
    {
        pliant_data_free(data);
        pliant_model_free(model);
        pliant_material_table_free(&table);
        pliant_labels_free(&labels);
        pliant_volume_free(&volume);
    }
    double unit() { return std::uniform_real_distribution<double>(-1, 1)(random); }
    int32_t some_tet()
    {
        const pliant_body &body = *model->body;
        for (;;) {
            const auto tet = static_cast<int32_t>(random() % static_cast<unsigned>(body.fine.num_tets));
            const int32_t *node = body.fine.tets + 4 * tet;
            if (body.fine_material[tet].tissue > 0 &&
                !(body.fine_fixed[node[0]] && body.fine_fixed[node[1]] && body.fine_fixed[node[2]]))
                return tet;
        }
    }
    void grasp(int32_t tet)
    {
        const int32_t *node = model->body->fine.tets + 4 * tet;
        for (int d = 0; d < 3; d++) held[d] = data->positions[3 * node[0] + d];
        pliant_tool_release(data, forceps);
        ASSERT_EQ(pliant_tool_set_pose(data, forceps, held, nullptr), PLIANT_OK);
        // rejected if nothing there moves
        const pliant_status status = pliant_tool_grasp(model, data, forceps, model->body->fine.rest + 3 * node[0]);
        ASSERT_TRUE(status == PLIANT_OK || status == PLIANT_ERROR_ARGUMENT) << pliant_last_error();
        phase = time;
    }
    // Compute a step. Return the median speed of tissue nodes within 5 cm of the blade [m/s].
    double step(const double tip[3])
    {
        const double gravity[3] = {0.4 * std::sin(11 * time), 0.4 * std::cos(13 * time), 0.3 * std::sin(7 * time)},
                     reach = 0.015, angle = max_speed / reach * (time - phase);
        const double around[3] = {held[0] + reach * std::sin(angle), held[1] + reach * (std::cos(angle) - 1),
                                  held[2] + 0.3 * reach * std::sin(0.7 * angle)};
        EXPECT_EQ(pliant_data_set_gravity(data, gravity), PLIANT_OK);
        EXPECT_EQ(pliant_tool_set_pose(data, forceps, around, nullptr), PLIANT_OK);
        last.assign(data->positions, data->positions + 3 * data->body->fine.num_nodes);
        const auto before = static_cast<size_t>(data->body->fine.num_nodes);
        EXPECT_GE(pliant_step(model, data), 0) << pliant_last_error();
        time += step_size;
        std::vector<double> speeds;
        for (size_t n = 0; n < before; n++) {
            double apart = 0, way = 0;
            for (int d = 0; d < 3; d++) {
                EXPECT_TRUE(std::isfinite(data->positions[3 * n + d]));
                apart += std::pow(last[3 * n + d] - tip[d], 2);
                way += std::pow(data->positions[3 * n + d] - last[3 * n + d], 2);
            }
            if (apart < 0.05 * 0.05 && !data->body->fine_fixed[n]) speeds.push_back(std::sqrt(way) / step_size);
        }
        if (speeds.empty()) return 0;
        std::nth_element(speeds.begin(), speeds.begin() + static_cast<long>(speeds.size() / 2), speeds.end());
        return speeds[speeds.size() / 2];
    }
    // Move a blade of 2 to 12 cm by 1 to 6 cm at up to 0.4 m/s, with rotation. Return the maximum tissue speed of a
    // step [m/s].
    double stroke(bool resists)
    {
        const int32_t tet = some_tet(), *node = data->body->fine.tets + 4 * tet;
        double from[3], to[3], ahead[3], turn[3], middle[3], fastest = 0;
        const double size = 0.01 + 0.025 * (1 + unit()), speed = 0.2 + 0.15 * unit();
        const int steps = 6;
        for (int d = 0; d < 3; d++) {
            middle[d] = data->positions[3 * node[0] + d];
            to[d] = size * unit();
            from[d] = -to[d];
            ahead[d] = unit();
            turn[d] = 0.05 * unit();
        }
        const double length = std::sqrt(ahead[0] * ahead[0] + ahead[1] * ahead[1] + ahead[2] * ahead[2]);
        grasp(some_tet_near(middle));
        EXPECT_EQ(pliant_tool_set_blade(data, knife, from, to), PLIANT_OK);
        model->scene.cut.resistance = resists;
        for (int s = 0; s <= steps; s++) {
            const double rotation[4] = {s * turn[0], s * turn[1], s * turn[2], 1},
                         sizes = std::sqrt(1 + s * s * (turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]));
            double unit_rotation[4], tip[3];
            for (int d = 0; d < 4; d++) unit_rotation[d] = rotation[d] / sizes;
            for (int d = 0; d < 3; d++) tip[d] = middle[d] + (s - 0.5 * steps) * speed * step_size * ahead[d] / length;
            EXPECT_EQ(pliant_tool_set_pose(data, knife, tip, unit_rotation), PLIANT_OK);
            EXPECT_EQ(pliant_tool_set_cutting(data, knife, true), PLIANT_OK) << pliant_last_error();
            const double now = step(tip);
            fastest = s > 0 ? std::max(fastest, now) : 0; // in the first steps the tissue springs back from the forceps
        }
        EXPECT_EQ(pliant_tool_set_cutting(data, knife, false), PLIANT_OK);
        return fastest;
    }
    // Return a tissue tetrahedron with a node 2 to 5 cm from a position.
    int32_t some_tet_near(const double place[3])
    {
        int32_t tet = 0;
        for (int tries = 0; tries < 1000; tries++) {
            tet = some_tet();
            double apart = 0;
            for (int d = 0; d < 3; d++)
                apart += std::pow(data->positions[3 * model->body->fine.tets[4 * tet] + d] - place[d], 2);
            if (apart > 0.02 * 0.02 && apart < 0.05 * 0.05) break;
        }
        return tet;
    }
    // Cut through everything in one step.
    void plane()
    {
        const int32_t *node = data->body->fine.tets + 4 * some_tet();
        const double normal[3] = {unit(), unit(), unit()};
        std::vector<double> from, to;
        CutState::plane(data->positions + 3 * node[0], normal, 1, from, to);
        const double depth[3] = {to[0] - from[0], to[1] - from[1], to[2] - from[2]};
        const int before = num_pieces(*data->body);
        ASSERT_EQ(pliant_data_cut(model, data, 2, from.data(), depth, nullptr), PLIANT_OK) << pliant_last_error();
        EXPECT_GT(num_pieces(*data->body), before);
    }
};

// Check the stiffness of every fragment and detached piece for a solver with a matrix.
void expect_stiff(const Scan &scan)
{
    const pliant_body &body = *scan.data->body;
    pliant_scene scene = scan.model->scene;
    scene.solver.kind = PLIANT_COROTATIONAL;
    pliant_discretizing work; // without a factor, because pieces held only by inertia have none
    ASSERT_EQ(pliant_discretizing_begin(&scene, &body, {nullptr, nullptr}, &work), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_discretizing_homogenize(&work), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_discretizing_analyze(&work), PLIANT_OK) << pliant_last_error();
    const Elements elements(*(scan.data->tled ? work.made : scan.data->discretization)->system);
    std::set<std::set<int32_t>> fragments;
    for (int32_t c = 0; c < body.cuts->num_tets; c++)
        for (int32_t f = body.cuts->start[c];
             f < body.cuts->start[c + 1] && body.cuts->start[c + 1] - body.cuts->start[c] > 1; f++) {
            const int32_t *node = body.fine.tets + 4 * body.cuts->fragment[f];
            fragments.emplace(node, node + 4);
        }
    std::map<int32_t, std::vector<int32_t>> around;
    size_t found = 0, pieces = 0;
    for (int32_t e = 0; e < elements.count && !testing::Test::HasFatalFailure(); e++) {
        const std::vector<int32_t> nodes = elements.nodes(e);
        for (int32_t n : nodes) around[n].push_back(e);
        expect_rigid_modes(elements, nodes, elements.stiffness(e), 3 * nodes.size() - 6,
                           "element " + std::to_string(e));
    }
    for (const std::set<int32_t> &fragment : fragments) // separate, or in a part of a hexahedron
        found += std::any_of(around[*fragment.begin()].begin(), around[*fragment.begin()].end(), [&](int32_t e) {
            const std::vector<int32_t> nodes = elements.nodes(e);
            const std::set<int32_t> own(nodes.begin(), nodes.end());
            return std::includes(own.begin(), own.end(), fragment.begin(), fragment.end());
        });
    for (const std::vector<int32_t> &piece : elements.pieces()) {
        const std::vector<int32_t> nodes = elements.nodes(piece);
        if (nodes.size() > 60 || pieces == 40 || testing::Test::HasFatalFailure()) continue;
        expect_rigid_modes(elements, nodes, elements.stiffness(piece), 3 * nodes.size() - 6,
                           "a piece of " + std::to_string(piece.size()) + " elements");
        pieces++;
    }
    if (std::getenv("PLIANT_FIGURES"))
        std::printf("%d elements, %zu fragments of %zu, %zu pieces\n", elements.count, found, fragments.size(), pieces);
    EXPECT_EQ(found, fragments.size());
    pliant_discretizing_end(&work);
}

struct EveryEngine : testing::TestWithParam<Engine> {};

TEST_P(EveryEngine, PiecesAreThoseOfTheVoxels)
{
    const std::string path = PLIANT_TEST_DATA "/abdomen/ct.nii.gz";
    if (!std::ifstream(path)) GTEST_SKIP() << "the shared test data is not at " PLIANT_TEST_DATA;
    const int strokes = number_from("PLIANT_STROKES", fewest_strokes);
    Scan scan(path, GetParam(), static_cast<unsigned>(number_from("PLIANT_SEED", 1)));
    const double mass = total_mass(*scan.model->body);
    ASSERT_EQ(mismatches(*scan.data->body), 0) << "before any cut";
    std::vector<double> speeds;
    int cutting = 0;
    for (int s = 0; s < strokes && !HasFailure(); s++) {
        const uint64_t revision = scan.data->body->revision;
        if (s % 25 == 8) scan.plane();
        speeds.push_back(scan.stroke(s % 2 == 1));
        const pliant_body &body = *scan.data->body;
        cutting += body.revision != revision;
        EXPECT_EQ(mismatches(body), 0) << "stroke " << s;
        EXPECT_NEAR(total_mass(body), mass, 1e-12 * mass) << "stroke " << s;
        if (body.revision != revision) EXPECT_EQ(body.cuts->num_pieces, num_pieces(body)) << "stroke " << s;
    }
    expect_stiff(scan);
    const long whole = std::min(strokes, fewest_strokes); // later, most fragments near a blade lie on the ground
    std::nth_element(speeds.begin(), speeds.begin() + whole / 2, speeds.begin() + whole);
    const double usual = speeds[static_cast<size_t>(whole / 2)];
    std::sort(speeds.begin(), speeds.end());
    const pliant_body &body = *scan.data->body;
    if (std::getenv("PLIANT_FIGURES"))
        std::printf(
            "%d of %d strokes cut, %d links, %d pieces, tetrahedra %d of %d; tissue near the blade at %.3f, %.3f, "
            "%.3f m/s, at first %.3f\n",
            cutting, strokes, body.cuts->num_links, num_pieces(body), body.fine.num_tets,
            scan.model->body->fine.num_tets, speeds[0], speeds[speeds.size() / 2], speeds.back(), usual);
    EXPECT_GT(cutting, strokes / 2);
    EXPECT_GT(usual, 0.1);
    EXPECT_GT(num_pieces(body), 1);
}

const Engine engines[] = {{"quasistatic_tetrahedra", PLIANT_COROTATIONAL, PLIANT_LINEAR},
                          {"quasistatic_hexahedra", PLIANT_COROTATIONAL, PLIANT_HEXAHEDRA},
                          {"tled_tetrahedra", PLIANT_TLED, PLIANT_LINEAR},
                          {"tled_hexahedra", PLIANT_TLED, PLIANT_HEXAHEDRA}};
INSTANTIATE_TEST_SUITE_P(Engines, EveryEngine, testing::ValuesIn(engines),
                         [](const auto &info) { return std::string(info.param.name); });

} // namespace
