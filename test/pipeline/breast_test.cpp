// A breast from prone to supine ([H] 4.2) with the installed scene and path, on a generated scan and, if available, on
// the public mesh.
#include "base/matrix.h"
#include "fem/element/law.h"
#include "fem/element/rotation.h"
#include "mesh/mesh.h"
#include "model_data/data.h"
#include "pliant/pliant.h"
#include "program.h"
#include "tool/path.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace {

using Point = std::array<double, 3>;

Point operator-(const Point &a, const Point &b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Point cross(const Point &a, const Point &b)
{
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
double dot(const Point &a, const Point &b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

const double wall = 0.033;                       // y of the chest wall in the scene [m]
const double base = 0.042, depth = 0.08;         // y of the dome's flat back; depth to its front
const Point radii{0.068, depth, 0.044};          // of the dome
const double voxel = 0.002;

// Return a closed surface: half an ellipsoid with its flat side to the back. Triangles face outwards.
std::vector<std::array<Point, 3>> dome()
{
    const int rings = 12, around = 32;
    const double pi = std::acos(-1.0);
    auto at = [&](int ring, int n) -> Point {
        const double polar = 0.5 * pi * ring / rings, angle = 2 * pi * (n % around) / around;
        const double out = std::sin(polar);
        return {radii[0] * out * std::cos(angle), base - radii[1] * std::cos(polar), radii[2] * out * std::sin(angle)};
    };
    std::vector<std::array<Point, 3>> out;
    for (int n = 0; n < around; n++) {
        for (int ring = 0; ring < rings; ring++) {
            if (ring > 0) out.push_back({at(ring, n), at(ring + 1, n), at(ring, n + 1)});
            out.push_back({at(ring, n + 1), at(ring + 1, n), at(ring + 1, n + 1)});
        }
        out.push_back({Point{0, base, 0}, at(rings, n + 1), at(rings, n)});
    }
    return out;
}

// Return whether a ray to the left crosses the surface an odd number of times.
bool holds(const std::vector<std::array<Point, 3>> &surface, const Point &p)
{
    const Point ray{-0.9137, 0.2713, 0.3019}; // passes through no edge of the surface
    bool inside = false;
    for (const auto &corners : surface) {
        const Point a = corners[1] - corners[0], b = corners[2] - corners[0], from = p - corners[0];
        const Point normal = cross(ray, b), other = cross(from, a);
        const double scale = dot(a, normal), u = dot(from, normal) / scale, v = dot(ray, other) / scale;
        inside ^= u >= 0 && v >= 0 && u + v <= 1 && dot(b, other) / scale > 0;
    }
    return inside;
}

double volume_of(const std::vector<std::array<Point, 3>> &surface)
{
    double sum = 0;
    for (const auto &corners : surface) sum += dot(corners[0], cross(corners[1], corners[2])) / 6;
    return sum;
}

// Write the percentage of glandular tissue at voxel centres, -1000 outside, in the format of launch/breast_scan.py.
void write_dome(const std::string &path)
{
    const auto surface = dome();
    pliant_geometry geometry{};
    for (int d = 0; d < 3; d++) {
        geometry.size[d] = 2 * static_cast<int>(std::ceil((d == 1 ? 0.5 * depth : radii[d]) / voxel)) + 5;
        geometry.spacing[d] = voxel;
        geometry.origin[d] = -0.5 * voxel * (geometry.size[d] - 1) + (d == 1 ? base - 0.5 * depth - 0.5 * voxel : 0);
        geometry.direction[4 * d] = 1;
    }
    pliant_volume scan{};
    EXPECT_EQ(pliant_volume_create(&geometry, PLIANT_INT16, &scan), PLIANT_OK);
    scan.slope = 1;
    auto *voxels = static_cast<int16_t *>(scan.voxels);
    int count = 0;
    for (int k = 0; k < geometry.size[2]; k++)
        for (int j = 0; j < geometry.size[1]; j++)
            for (int i = 0; i < geometry.size[0]; i++) {
                Point p, index{double(i), double(j), double(k)};
                pliant_geometry_to_world(&geometry, index.data(), p.data());
                const bool inside = holds(surface, p), gland = dot(p, p) < 0.03 * 0.03;
                *voxels++ = static_cast<int16_t>(!inside ? -1000 : gland ? 80 : 15);
                count += inside;
            }
    EXPECT_EQ(pliant_volume_write(path.c_str(), &scan), PLIANT_OK) << pliant_last_error();
    pliant_volume_free(&scan);
    EXPECT_NEAR(count * voxel * voxel * voxel / volume_of(surface), 1, 0.02);
}

// Node positions of a run, read from its output file.
struct Nodes {
    std::vector<double> rest, now;
    explicit Nodes(const std::string &path)
    {
        std::ifstream file(path);
        std::string line;
        std::getline(file, line);
        double v[6];
        while (std::getline(file, line)) {
            EXPECT_EQ(std::sscanf(line.c_str(), "%lf,%lf,%lf,%lf,%lf,%lf", v, v + 1, v + 2, v + 3, v + 4, v + 5), 6)
                << line;
            rest.insert(rest.end(), v, v + 3);
            now.insert(now.end(), v + 3, v + 6);
        }
    }
    size_t count() const { return rest.size() / 3; }
    double moved(size_t n, int d) const { return now[3 * n + d] - rest[3 * n + d]; }
};

using Options = std::map<std::string, std::string>;

class Breast : public Program {
protected:
    Breast() : Program(PLIANT_DEFORM) {}
    ~Breast() override
    {
        pliant_model_free(model_);
        pliant_material_table_free(&table_);
        pliant_volume_free(&scan_);
    }
    // Build the scene's mesh again, for data that its files do not contain: tetrahedra and masses.
    void look_at(const std::string &scan)
    {
        pliant_scene scene;
        pliant_labels labels{};
        ASSERT_EQ(pliant_scene_read(scene_.c_str(), &scene), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_scene_set(&scene, "mesh/coarse_cells", cells_), PLIANT_OK);
        ASSERT_EQ(pliant_inputs_read(&scene, scan.c_str(), &scan_, &labels, &table_), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_model_build(&scene, &scan_, nullptr, &table_, {nullptr, nullptr}, &model_), PLIANT_OK)
            << pliant_last_error();
        path_ = scan;
    }
    // Run the deformation and return the final nodes. The other results are in the folder of this name.
    Nodes deform(const std::string &name, const Options &options, const std::string &more)
    {
        std::string line = scene_ + " --set solver/threads=1 --set 'mesh/coarse_cells=" + cells_ + "' --scan " + path_ +
                           " --out " + in(name) + " " + more;
        for (const auto &option : options) line += " --set '" + option.first + "=" + option.second + "'";
        EXPECT_EQ(run(line), 0) << err_;
        return nodes(name + "/nodes.csv");
    }
    Nodes nodes(const std::string &name) const
    {
        Nodes out(in(name));
        EXPECT_EQ(out.count(), static_cast<size_t>(model_->body->fine.num_nodes)) << name;
        for (size_t n = 0; n < out.rest.size(); n++) EXPECT_NEAR(out.rest[n], model_->body->fine.rest[n], 1e-8);
        return out;
    }
    // Return the installed path with a higher speed.
    std::string turn(double speed) const
    {
        pliant_path path;
        EXPECT_EQ(pliant_path_read(PLIANT_SOURCE_DIR "/launch/scenes/breast_turn.yaml", &path), PLIANT_OK)
            << pliant_last_error();
        std::ofstream file(in("turn.yaml"));
        file << "gravity:\n";
        for (uint32_t k = 0; k < path.num_gravity; k++) {
            const pliant_path_key &at = path.gravity[k];
            file << "  - {time: " << at.time / speed << ", acceleration: [" << at.value[0] << ", " << at.value[1]
                 << ", " << at.value[2] << "]}\n";
        }
        pliant_path_free(&path);
        return in("turn.yaml");
    }
    // Return the mean displacement to the back, weighted by mass [m].
    double mean_posterior_motion(const Nodes &nodes) const
    {
        double sum = 0, mass = 0;
        for (size_t n = 0; n < nodes.count(); n++) {
            mass += model_->body->node_mass[n];
            sum += model_->body->node_mass[n] * nodes.moved(n, 1);
        }
        return sum / mass;
    }
    // Compute a tetrahedron's deformation gradient, the gradients of its shape functions, and its rest volume.
    void deformation(const Nodes &nodes, int32_t tet, double f[9], double gradients[12], double *volume) const
    {
        const int32_t *corners = model_->body->fine.tets + 4 * tet;
        *volume = pliant_mesh_gradients(&model_->body->fine, tet, gradients);
        for (int m = 0; m < 9; m++) f[m] = m % 4 == 0;
        for (int v = 0; v < 4; v++)
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++) f[3 * r + c] += nodes.moved(corners[v], r) * gradients[3 * v + c];
    }
    void expect_held_by_the_wall(const Nodes &nodes) const;
    void expect_volume(const Nodes &nodes, double gravity) const;
    // Expect it to hang to the front, then to sink to the back.
    void expect_turned(const Nodes &prone, const Nodes &supine) const
    {
        for (const Nodes *each : {&prone, &supine}) {
            expect_held_by_the_wall(*each);
            expect_volume(*each, each == &prone ? -9.81 : 9.81);
        }
        EXPECT_LT(mean_posterior_motion(prone), -1e-3);
        EXPECT_GT(mean_posterior_motion(supine), 1e-3);
    }

    const char *const cells_ = "8 5 5";
    const std::string scene_ = PLIANT_SOURCE_DIR "/launch/scenes/breast.yaml";
    std::string path_;
    pliant_volume scan_{};
    pliant_material_table table_{};
    pliant_model *model_ = nullptr;
};

// Fixed nodes have not moved, and no node has passed through the wall.
void Breast::expect_held_by_the_wall(const Nodes &nodes) const
{
    int fixed = 0;
    for (size_t n = 0; n < nodes.count(); n++) {
        if (nodes.rest[3 * n + 1] >= wall) {
            fixed++;
            for (int d = 0; d < 3; d++) ASSERT_EQ(nodes.moved(n, d), 0) << n;
        } else {
            ASSERT_LT(nodes.now[3 * n + 1], wall + 0.0005 + 1e-9) << n; /* the plane of the ground */
        }
    }
    EXPECT_GT(fixed, 20);
}

// Gravity to the back reduces the volume, gravity to the front increases it. The pressure is bounded by the full height
// in elements full of tissue and away from the wall's edge. Their volume therefore changes by at most this pressure
// divided by the bulk modulus. No element is inverted.
void Breast::expect_volume(const Nodes &nodes, double gravity) const
{
    double change = 0, maximum = 0, height = 0;
    for (size_t n = 0; n < nodes.count(); n++) height = std::fmax(height, wall - nodes.rest[3 * n + 1]);
    for (int32_t t = 0; t < model_->body->fine.num_tets; t++) {
        const pliant_tet_material &material = model_->body->fine_material[t];
        const double allowed =
            material.density * std::fabs(gravity) * height / (material.lambda + 2.0 / 3 * material.mu);
        double f[9], gradients[12], volume;
        deformation(nodes, t, f, gradients, &volume);
        const double ratio = pliant_determinant(f);
        ASSERT_GT(ratio, 0.5) << t;
        if (material.tissue < 1) continue;
        change += volume * (ratio - 1);
        maximum += volume * allowed;
        if (wall - nodes.rest[3 * model_->body->fine.tets[4 * t] + 1] > 0.2 * height)
            EXPECT_LT(std::fabs(ratio - 1), allowed) << t;
    }
    EXPECT_GT(gravity > 0 ? -change : change, 0.1 * maximum);
    EXPECT_LT(std::fabs(change), maximum);
}

// Return y of the centre of a volume's tissue [m].
double centre_of(const pliant_volume &volume)
{
    double sum = 0, count = 0;
    for (size_t v = 0; v < pliant_geometry_voxels(&volume.geometry); v++) {
        if (pliant_volume_value(&volume, v) < -500) continue;
        const int32_t *size = volume.geometry.size;
        const double index[3] = {double(v % size[0]), double(v / size[0] % size[1]), double(v / size[0] / size[1])};
        double world[3];
        pliant_geometry_to_world(&volume.geometry, index, world);
        sum += world[1];
        count++;
    }
    return sum / count;
}

TEST_F(Breast, TurnsFromProneToSupine)
{
    write_dome(in("dome.nii.gz"));
    look_at(in("dome.nii.gz"));
    const Nodes supine = deform("turned", {}, "--every 100 --pictures --tools " + turn(1)),
                prone = nodes("turned/nodes_000100.csv");
    expect_turned(prone, supine);
    EXPECT_NE(out_.find("inverted now 0"), std::string::npos) << out_;
    // the rendered volume agrees within a fraction of a voxel
    const std::vector<std::pair<const char *, const Nodes *>> drawings{
        {"turned/deformed_000100.nii.gz", &prone}, {"turned/deformed.nii.gz", &supine}};
    for (const auto &drawing : drawings) {
        pliant_volume drawn{};
        ASSERT_EQ(pliant_volume_read(in(drawing.first).c_str(), nullptr, 0, &drawn), PLIANT_OK) << pliant_last_error();
        EXPECT_NEAR(centre_of(drawn) - centre_of(scan_), mean_posterior_motion(*drawing.second), 0.25 * voxel)
            << drawing.first;
        pliant_volume_free(&drawn);
    }
    for (const char *name : {"turned/axial.png", "turned/coronal.png", "turned/sagittal.png"})
        EXPECT_EQ(access(in(name).c_str(), R_OK), 0) << name;

    // The equilibrium of elastic tissue does not depend on the path: twice as fast, or with relaxation and without the
    // turn over the side.
    const Nodes faster = deform("faster", {}, "--no-volume --steps 225 --tools " + turn(2));
    const Nodes relaxed = deform("relaxed",
                                 {{"model/gravity", "0 9.81 0"},
                                  {"tled/quasi_static", "true"},
                                  {"solver/tolerance", "1e-5"},
                                  {"tled/relaxation_steps", "5000"}},
                                 "--no-volume --steps 1");
    for (const Nodes *other : {&faster, &relaxed}) {
        double difference = 0;
        for (size_t n = 0; n < supine.now.size(); n++)
            difference = std::fmax(difference, std::fabs(other->now[n] - supine.now[n]));
        EXPECT_LT(difference, 1e-3 * mean_posterior_motion(supine));
    }
}

// Equilibrium by virtual work: for every motion that the wall permits, internal forces do the work of the load; here
// the motion is the distance from the wall. Low gravity stores half its work (Clapeyron), and reversed gravity mirrors
// the displacement.
TEST_F(Breast, ForcesAreInBalance)
{
    write_dome(in("dome.nii.gz"));
    look_at(in("dome.nii.gz"));
    double way[3];
    const double gravity[3] = {-9.81, -0.2, 0.2};
    for (int g = 0; g < 3; g++) {
        const Nodes still = deform("still",
                                   {{"model/gravity", "0 " + std::to_string(gravity[g]) + " 0"},
                                    {"tled/quasi_static", "true"},
                                    {"tled/nodal_pressure", "false"},
                                    {"solver/tolerance", "1e-5"},
                                    {"tled/relaxation_steps", "5000"}},
                                   "--no-volume --steps 1");
        auto allowed = [&](int32_t n) { return std::fmin(still.rest[3 * n + 1] - wall, 0); };
        double energy = 0, work = 0, inside = 0, outside = 0;
        for (int32_t t = 0; t < model_->body->fine.num_tets; t++) {
            const pliant_tet_material &material = model_->body->fine_material[t];
            double f[9], gradients[12], stress[9], volume;
            deformation(still, t, f, gradients, &volume);
            energy += volume * pliant_law_response(PLIANT_LAW_NEO_HOOKEAN, material.lambda, material.mu, f, stress);
            for (int v = 0; v < 4; v++)
                for (int d = 0; d < 3; d++)
                    inside +=
                        volume * stress[3 + d] * allowed(model_->body->fine.tets[4 * t + v]) * gradients[3 * v + d];
        }
        for (int32_t n = 0; n < model_->body->fine.num_nodes; n++) {
            work += model_->body->node_mass[n] * gravity[g] * still.moved(n, 1);
            outside += model_->body->node_mass[n] * gravity[g] * allowed(n);
        }
        EXPECT_NEAR(inside / outside, 1, 1e-4);
        if (g > 0) EXPECT_NEAR(energy / work, 0.5, 0.002);
        way[g] = mean_posterior_motion(still);
    }
    EXPECT_LT(way[1], 0);
    EXPECT_NEAR(-way[1] / way[2], 1, 0.01);
}

// [H] figure 5: with a homogenized mesh and reversed gravity, the front hangs down and the chest wall stays.
TEST_F(Breast, AHomogenizedOneHangsToTheFront)
{
    write_dome(in("breast.nii"));
    ASSERT_EQ(run(std::string(PLIANT_SOURCE_DIR "/launch/scenes/breast_prone.yaml") +
                  " --quiet --no-volume --set 'mesh/coarse_cells=6 4 4' --scan " + in("breast.nii") + " --out " +
                  in("prone")),
              0)
        << err_;
    EXPECT_EQ(err_.find("converge"), std::string::npos) << err_;
    EXPECT_EQ(err_.find("elements were inverted"), std::string::npos) << err_;
    const Nodes prone(in("prone/nodes.csv"));
    double farthest = 0, farthest_at_the_wall = 0;
    for (size_t n = 0; n < prone.count(); n++) {
        if (prone.rest[3 * n + 1] < 0) farthest = std::min(farthest, prone.moved(n, 1));
        if (prone.rest[3 * n + 1] >= wall)
            farthest_at_the_wall = std::max(farthest_at_the_wall, std::fabs(prone.moved(n, 1)));
    }
    EXPECT_LT(farthest, -1e-3);
    EXPECT_GT(farthest, -0.03);
    EXPECT_EQ(farthest_at_the_wall, 0);
}

TEST_F(Breast, ThePublicMeshTurns)
{
    const std::string mesh = PLIANT_TEST_DATA "/breast/DigiBreast_lzma.jdat";
    if (access(mesh.c_str(), R_OK) != 0) GTEST_SKIP() << mesh << " is not there";
    if (std::system("/usr/bin/python3 -c 'import numpy' 2> /dev/null") != 0)
        GTEST_SKIP() << "python3-numpy is not there";
    ASSERT_EQ(
        std::system((PLIANT_SOURCE_DIR "/launch/breast_scan.py " + mesh + " " + in("breast.nii.gz") + " 4").c_str()),
        0);
    look_at(in("breast.nii.gz"));
    const Nodes supine = deform("turned", {}, "--no-volume --every 50 --tools " + turn(2)),
                prone = nodes("turned/nodes_000050.csv");
    expect_turned(prone, supine);
}

} // namespace
