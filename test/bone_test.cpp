// Nodes on the surface of bone: their positions, the quality of the tetrahedra, the assignment of voxels, and the
// effect on the error.
#include "base/memory.h"
#include "fem/element/scalar.h"
#include "mesh/mesh.h"
#include "pipeline/body.h"
#include "model_data/data.h"
#include "report/report.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <omp.h>
#include <random>
#include <set>
#include <string>

namespace {

// materials: 0 soft tissue, 1 bone, 2 air
struct Bone {
    pliant_geometry geometry{};
    std::vector<uint8_t> material, fixed;
    std::array<pliant_material, 3> records{};
    pliant_material_table table{records.data(), 3};
    pliant_mesh mesh{};
    std::vector<pliant_tet_material> materials;

    explicit Bone(std::array<int, 3> size, bool left_handed = false)
    {
        const double angle = 0.3;
        const double direction[9] = {
            std::cos(angle), -std::sin(angle), 0, std::sin(angle), std::cos(angle), 0, 0, 0, left_handed ? -1.0 : 1.0};
        std::copy(direction, direction + 9, geometry.direction);
        for (int d = 0; d < 3; d++) {
            geometry.size[d] = size[static_cast<size_t>(d)];
            geometry.spacing[d] = 0.001;
            geometry.origin[d] = 0.01 * d;
            records[static_cast<size_t>(d)].young_modulus = d == 1 ? 1e7 : 5e3;
            records[static_cast<size_t>(d)].poisson_ratio = 0.3;
            records[static_cast<size_t>(d)].density = d == 1 ? 1500 : 1000;
        }
        records[1].fixed = records[2].empty = true;
        material.assign(static_cast<size_t>(size[0] * size[1] * size[2]), 0);
    }
    ~Bone() { pliant_mesh_free(&mesh); }
    void ball(const double centre[3], double radius, uint8_t what = 1)
    {
        for (size_t v = 0; v < material.size(); v++) {
            double sum = 0;
            size_t rest = v;
            for (int d = 0; d < 3; d++) {
                double at = static_cast<double>(rest % static_cast<size_t>(geometry.size[d]));
                sum += (at - centre[d]) * (at - centre[d]);
                rest /= static_cast<size_t>(geometry.size[d]);
            }
            if (sum < radius * radius) material[v] = what;
        }
    }
    void scatter(unsigned seed, bool air)
    {
        std::mt19937 random(seed);
        for (int n = 0; n < 6; n++) {
            double centre[3], radius = 1.5 + random() % 7;
            for (int d = 0; d < 3; d++)
                centre[d] = static_cast<double>(random() % static_cast<unsigned>(geometry.size[d]));
            ball(centre, radius, air && n == 0 ? 2 : 1);
        }
    }
    pliant_status build(std::array<int32_t, 3> cells, int32_t octree_depth = 0, const uint8_t *keep = nullptr)
    {
        pliant_tet_material *found = nullptr;
        pliant_mesh_free(&mesh);
        fixed.resize(material.size());
        for (size_t v = 0; v < fixed.size(); v++) fixed[v] = material[v] == 1;
        pliant_status status = octree_depth > 0 ? pliant_mesh_octree(&geometry, cells.data(), octree_depth, 1, true,
                                                                     false, material.data(), &table, &mesh, &found)
                                                : pliant_mesh_grid(&geometry, cells.data(), keep, &mesh);
        EXPECT_EQ(status, PLIANT_OK);
        materials.resize(static_cast<size_t>(mesh.num_tets));
        std::vector<pliant_tet_material> all(static_cast<size_t>(5 * cells[0] * cells[1] * cells[2]));
        if (found) std::copy(found, found + mesh.num_tets, materials.begin());
        else
            EXPECT_EQ(pliant_lattice_integrate(&geometry, cells.data(), material.data(), &table, all.data()),
                      PLIANT_OK);
        for (int32_t t = 0; !found && t < mesh.num_tets; t++)
            materials[static_cast<size_t>(t)] = all[static_cast<size_t>(mesh.lattice_of_tet[t])];
        pliant_free(found);
        status = pliant_mesh_bone(&geometry, fixed.data(), &mesh);
        return status == PLIANT_OK
                   ? pliant_mesh_integrate_moved(&mesh, &geometry, material.data(), true, &table, materials.data())
                   : status;
    }
    // Classify the voxels within `reach` of a node: 1 all bone, 0 none, 2 both.
    int around(int32_t node, double reach) const
    {
        double index[3];
        pliant_geometry_to_index(&geometry, mesh.rest + 3 * node, index);
        bool any[2] = {false, false};
        for (int corner = 0; corner < 8; corner++) {
            size_t v = 0;
            for (int d = 2; d >= 0; d--) {
                double at = std::floor(index[d] + 0.5 + (corner >> d & 1 ? reach : -reach));
                v = v * static_cast<size_t>(geometry.size[d]) +
                    static_cast<size_t>(std::min(std::max(at, 0.0), geometry.size[d] - 1.0));
            }
            any[fixed[v]] = true;
        }
        return any[0] && any[1] ? 2 : any[1];
    }
};

double volume_of(const pliant_mesh &mesh, int32_t t)
{
    double g[12];
    return pliant_mesh_gradients(&mesh, t, g);
}

// Normalize by the volume of a cell. Edges are in units of cells, which are cubes here.
void shape_of(const pliant_mesh &mesh, int32_t t, double *quality, double angles[2])
{
    const int32_t *n = mesh.tets + 4 * t;
    double g[12], sum = 0;
    double volume = pliant_mesh_gradients(&mesh, t, g);
    for (int a = 0; a < 4; a++)
        for (int b = 0; b < a; b++) {
            double dot = 0, length[2] = {0, 0};
            for (int d = 0; d < 3; d++) {
                sum += std::pow(mesh.rest[3 * n[a] + d] - mesh.rest[3 * n[b] + d], 2);
                dot += g[3 * a + d] * g[3 * b + d];
                length[0] += g[3 * a + d] * g[3 * a + d];
                length[1] += g[3 * b + d] * g[3 * b + d];
            }
            double angle = std::acos(-dot / std::sqrt(length[0] * length[1])) * 180 / M_PI;
            angles[0] = std::min(angles[0], angle);
            angles[1] = std::max(angles[1], angle);
        }
    *quality = std::min(*quality, 6 * std::sqrt(2.0) * volume / std::pow(sum / 6, 1.5));
}

TEST(Bone, NodesLieOnItsSurfaceAndTetrahedraStayGood)
{
    double quality = 1, angles[2] = {180, 0};
    int moved = 0;
    for (unsigned seed = 0; seed < 24; seed++) {
        Bone bone({40, 32, 24}, seed % 2 == 1);
        bone.scatter(seed, false);
        int depth = static_cast<int>(seed % 3); // 0: a lattice
        ASSERT_EQ(bone.build(depth ? std::array<int32_t, 3>{5, 4, 3} : std::array<int32_t, 3>{10, 8, 6}, depth),
                  PLIANT_OK)
            << pliant_last_error();
        const pliant_mesh &mesh = bone.mesh;
        moved += mesh.num_moved;
        int surface = 0;
        for (int32_t n = 0; n < mesh.num_nodes; n++) {
            if (mesh.place_of_node[n] == PLIANT_BONE_SURFACE) {
                surface++;
                ASSERT_EQ(bone.around(n, 1e-6), 2) << seed; // reach of a millionth of a voxel
            } else {
                ASSERT_EQ(bone.around(n, -1e-9), mesh.place_of_node[n] == PLIANT_BONE_INSIDE) << seed;
            }
        }
        EXPECT_GE(surface, mesh.num_moved);
        double volume = 0, box = 0.04 * 0.032 * 0.024;
        for (int32_t t = 0; t < mesh.num_tets; t++) {
            ASSERT_GT(volume_of(mesh, t), 0);
            volume += volume_of(mesh, t);
            shape_of(mesh, t, &quality, angles);
        }
        EXPECT_NEAR(volume, box, 1e-12 * box); // and all volumes are positive, so no tetrahedra overlap
        // returns PLIANT_ERROR_FORMAT if three tetrahedra share a face
        std::vector<int32_t> neighbours(4 * static_cast<size_t>(mesh.num_tets));
        ASSERT_EQ(pliant_mesh_neighbours(&mesh, neighbours.data()), PLIANT_OK) << pliant_last_error();
        int32_t *triangles, count;
        ASSERT_EQ(pliant_mesh_surface(&mesh, nullptr, nullptr, &triangles, &count), PLIANT_OK);
        for (int32_t t = 0; t < count; t++) { // faces with one tetrahedron lie on the box
            bool outside = false;
            double at[3][3];
            for (int v = 0; v < 3; v++)
                pliant_geometry_to_index(&bone.geometry, mesh.rest + 3 * triangles[3 * t + v], at[v]);
            for (int d = 0; d < 3; d++)
                for (double side : {-0.5, bone.geometry.size[d] - 0.5})
                    outside =
                        outside ||
                        (std::fabs(at[0][d] - side) + std::fabs(at[1][d] - side) + std::fabs(at[2][d] - side) < 1e-9);
            ASSERT_TRUE(outside) << seed;
        }
        pliant_free(triangles);
    }
    std::printf("least quality %.3f, dihedral angles %.1f to %.1f degrees\n", quality, angles[0], angles[1]);
    EXPECT_GT(moved, 1000);
    EXPECT_GE(quality, PLIANT_BONE_QUALITY);
    EXPECT_GT(angles[0], 8);
    EXPECT_LT(angles[1], 160);
}

TEST(Bone, NearlyAllEdgesEndOnTheSurface)
{
    Bone bone({64, 64, 64});
    const double centre[3] = {31.2, 32.7, 30.9}, radius = 19;
    bone.ball(centre, radius);
    ASSERT_EQ(bone.build({12, 12, 12}), PLIANT_OK);
    const pliant_mesh &mesh = bone.mesh;
    std::set<std::array<int32_t, 2>> edges, crossing;
    for (int32_t t = 0; t < mesh.num_tets; t++)
        for (int a = 0; a < 4; a++)
            for (int b = 0; b < 4; b++) {
                int32_t in = mesh.tets[4 * t + a], out = mesh.tets[4 * t + b];
                if (mesh.place_of_node[in] == PLIANT_BONE_SURFACE) edges.insert({in, out});
                if (mesh.place_of_node[in] == PLIANT_BONE_INSIDE && mesh.place_of_node[out] == PLIANT_BONE_OUTSIDE)
                    crossing.insert({in, out});
            }
    EXPECT_LE(100 * crossing.size(), edges.size());
    // the voxelized ball differs from the ball by at most half the diagonal of a voxel
    double sum = 0, maximum = 0;
    int count = 0;
    for (int32_t n = 0; n < mesh.num_nodes; n++) {
        if (mesh.place_of_node[n] != PLIANT_BONE_SURFACE) continue;
        double index[3], apart = 0;
        pliant_geometry_to_index(&bone.geometry, mesh.rest + 3 * n, index);
        for (int d = 0; d < 3; d++) apart += (index[d] - centre[d]) * (index[d] - centre[d]);
        apart = std::fabs(std::sqrt(apart) - radius);
        maximum = std::max(maximum, apart);
        sum += apart * apart;
        count++;
    }
    std::printf("%d nodes on a ball: rms %.2f voxels from it, at most %.2f\n", count, std::sqrt(sum / count), maximum);
    EXPECT_LT(maximum, 0.87);
    EXPECT_LT(std::sqrt(sum / count), 0.5);
}

TEST(Bone, EveryVoxelAndPointHasItsTetrahedron)
{
    for (int depth : {0, 1}) {
        Bone bone({40, 32, 24});
        bone.scatter(3, false);
        ASSERT_EQ(bone.build(depth ? std::array<int32_t, 3>{5, 4, 3} : std::array<int32_t, 3>{10, 8, 6}, depth),
                  PLIANT_OK);
        const pliant_mesh &mesh = bone.mesh;
        std::mt19937 random(1);
        std::uniform_real_distribution<double> part(0, 1);
        for (int n = 0; n < 5000; n++) {
            double index[3], point[3], weights[4];
            for (int d = 0; d < 3; d++) index[d] = bone.geometry.size[d] * part(random) - 0.5;
            pliant_geometry_to_world(&bone.geometry, index, point);
            int32_t tet = pliant_mesh_locate(&mesh, point, weights);
            ASSERT_GE(tet, 0);
            for (int v = 0; v < 4; v++) EXPECT_GE(weights[v], -1e-8);
            for (int d = 0; d < 3; d++) {
                double sum = 0;
                for (int v = 0; v < 4; v++) sum += weights[v] * mesh.rest[3 * mesh.tets[4 * tet + v] + d];
                EXPECT_NEAR(sum, point[d], 1e-12);
            }
        }
        // With all voxels included, each voxel counts once. In a lattice, the tetrahedra's own materials count voxels
        // too.
        if (depth == 0) {
            std::vector<pliant_tet_material> all = bone.materials;
            ASSERT_EQ(pliant_mesh_integrate_moved(&mesh, &bone.geometry, bone.material.data(), false, &bone.table,
                                                  all.data()),
                      PLIANT_OK);
            size_t voxels = 0;
            for (const pliant_tet_material &one : all) voxels += one.num_voxels;
            EXPECT_EQ(voxels, bone.material.size());
        }
        // A tetrahedron with one corner outside of bone and one on its surface is soft, unless bone fills all of it.
        int soft = 0;
        for (int32_t t = 0; t < mesh.num_tets; t++) {
            bool outside = false, on = false;
            for (int v = 0; v < 4; v++) {
                outside = outside || mesh.place_of_node[mesh.tets[4 * t + v]] == PLIANT_BONE_OUTSIDE;
                on = on || mesh.place_of_node[mesh.tets[4 * t + v]] == PLIANT_BONE_SURFACE;
            }
            const pliant_tet_material &one = bone.materials[static_cast<size_t>(t)];
            if (!outside || !on || one.material == 1) continue;
            soft++;
            EXPECT_NEAR(one.mu, 5e3 / 2.6, 1e-6);
        }
        EXPECT_GT(soft, 100);
    }
}

TEST(Bone, NodesNextToAirStay)
{
    Bone bone({32, 32, 32});
    // a plate of bone on air
    for (size_t v = 0; v < bone.material.size(); v++) bone.material[v] = v % 32 < 14 ? 2 : v % 32 < 17 ? 1 : 0;
    std::vector<uint8_t> keep(5 * 512);
    std::vector<pliant_tet_material> all(keep.size());
    const int32_t cells[3] = {8, 8, 8};
    ASSERT_EQ(pliant_lattice_integrate(&bone.geometry, cells, bone.material.data(), &bone.table, all.data()),
              PLIANT_OK);
    for (size_t t = 0; t < keep.size(); t++) keep[t] = all[t].tissue > 0;
    pliant_mesh before{};
    ASSERT_EQ(pliant_mesh_grid(&bone.geometry, cells, keep.data(), &before), PLIANT_OK);
    double own = 0, volume = 0;
    for (int32_t t = 0; t < before.num_tets; t++) own += volume_of(before, t);
    ASSERT_EQ(bone.build({8, 8, 8}, 0, keep.data()), PLIANT_OK);
    for (int32_t t = 0; t < bone.mesh.num_tets; t++) volume += volume_of(bone.mesh, t);
    EXPECT_NEAR(volume, own, 1e-12 * own);
    EXPECT_EQ(bone.mesh.num_moved, 81); // they move from 16 to 17 voxels, to the other side of the plate
    pliant_mesh_free(&before);
}

TEST(Bone, ThreadsChangeNothingAndOutOfMemoryLeavesTheMesh)
{
    Bone one({40, 32, 24}), two({40, 32, 24});
    one.scatter(9, false);
    two.scatter(9, false);
    omp_set_num_threads(1);
    ASSERT_EQ(one.build({10, 8, 6}), PLIANT_OK);
    omp_set_num_threads(3);
    ASSERT_EQ(two.build({10, 8, 6}), PLIANT_OK);
    omp_set_num_threads(2);
    ASSERT_TRUE(std::equal(one.mesh.rest, one.mesh.rest + 3 * one.mesh.num_nodes, two.mesh.rest));
    ASSERT_EQ(std::memcmp(one.materials.data(), two.materials.data(), one.materials.size() * sizeof one.materials[0]),
              0);
    size_t held = pliant_memory_in_use();
    pliant_mesh mesh{};
    const int32_t cells[3] = {10, 8, 6};
    ASSERT_EQ(pliant_mesh_grid(&one.geometry, cells, nullptr, &mesh), PLIANT_OK);
    std::vector<double> rest(mesh.rest, mesh.rest + 3 * mesh.num_nodes);
    size_t with_mesh = pliant_memory_in_use();
    for (int calls = 0;; calls++) {
        ASSERT_LT(calls, 40);
        pliant_memory_fail_after(calls);
        pliant_status status = pliant_mesh_bone(&one.geometry, one.fixed.data(), &mesh);
        if (status == PLIANT_OK)
            status = pliant_mesh_integrate_moved(&mesh, &one.geometry, one.material.data(), true, &one.table,
                                                 one.materials.data());
        pliant_memory_fail_after(-1);
        if (status == PLIANT_OK) break;
        EXPECT_EQ(status, PLIANT_ERROR_MEMORY);
        if (!mesh.place_of_node) {
            EXPECT_EQ(pliant_memory_in_use(), with_mesh) << calls;
            ASSERT_TRUE(std::equal(rest.begin(), rest.end(), mesh.rest));
            continue;
        }
        pliant_mesh_free(&mesh); // the integration failed: restart from a new mesh
        EXPECT_EQ(pliant_memory_in_use(), held) << calls;
        ASSERT_EQ(pliant_mesh_grid(&one.geometry, cells, nullptr, &mesh), PLIANT_OK);
    }
    pliant_mesh_free(&mesh);
}

// A ball of bone in a block of tissue.
int ball(int i, int j, int k) { return (i - 15) * (i - 15) + (j - 16) * (j - 16) + (k - 17) * (k - 17) < 81; }

TEST(Bone, PatchTestAndNoHoleInTheVolume)
{
    const int size[3] = {32, 32, 32};
    const double box[3] = {0.1, 0.1, 0.1};
    // the same stiffness: a homogeneous body
    Body body(size, box, {{5e3, 0.4, 1000, false}, {5e3, 0.4, 1000, false}}, ball);
    body.table.materials[1].fixed = true;
    body.cells(4, 4, 4, 2);
    body.scene.mesh.bone_surface = true;
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const pliant_mesh &mesh = body.model->body->fine;
    ASSERT_GT(mesh.num_moved, 30);
    const double a[9] = {1.01, 0.02, 0, 0, 0.99, -0.01, 0.005, 0, 1.02}, b[3] = {0, 0, 0};
    std::vector<double> x = affine(mesh, a, b), force = body.elastic_force(x);
    double inner = 0, outer = 0;
    for (int32_t n = 0; n < mesh.num_nodes; n++) {
        bool inside = true;
        for (int d = 0; d < 3; d++) inside = inside && mesh.rest[3 * n + d] > 1e-6 && mesh.rest[3 * n + d] < 0.1 - 1e-6;
        for (int d = 0; d < 3; d++)
            (inside ? inner : outer) = std::fmax(inside ? inner : outer, std::fabs(force[3 * n + d]));
    }
    EXPECT_LT(inner, 1e-10 * outer);

    // At rest the deformed volume is the scan. After a small motion it has no hole.
    for (int v = 0; v < 32 * 32 * 32; v++)
        static_cast<uint8_t *>(body.scan.voxels)[v] = static_cast<uint8_t>(1 + v % 250);
    pliant_warp *warp = nullptr;
    ASSERT_EQ(pliant_warp_create(&body.scan, &mesh, &body.scan.geometry, 2, &warp), PLIANT_OK);
    ASSERT_EQ(pliant_warp_update(warp, mesh.rest), PLIANT_OK);
    EXPECT_EQ(std::memcmp(pliant_warp_volume(warp)->voxels, body.scan.voxels, 32 * 32 * 32), 0);
    std::mt19937 random(2);
    std::uniform_real_distribution<double> part(-0.0005, 0.0005);
    x.assign(mesh.rest, mesh.rest + 3 * mesh.num_nodes);
    for (int32_t n = 0; n < mesh.num_nodes; n++)
        for (int d = 0; d < 3; d++)
            if (mesh.rest[3 * n + d] > 1e-6 && mesh.rest[3 * n + d] < 0.1 - 1e-6) x[3 * n + d] += part(random);
    ASSERT_EQ(pliant_mesh_inverted(&mesh, x.data()), 0);
    ASSERT_EQ(pliant_warp_update(warp, x.data()), PLIANT_OK);
    const auto *drawn = static_cast<const uint8_t *>(pliant_warp_volume(warp)->voxels);
    EXPECT_EQ(std::count(drawn, drawn + 32 * 32 * 32, 0), 0);
    pliant_warp_free(warp);
}

struct Scene {
    pliant_scene scene;
    pliant_volume scan{};
    pliant_labels labels{};
    pliant_material_table table{};

    explicit Scene(const std::string &name)
    {
        EXPECT_EQ(pliant_scene_read((std::string(PLIANT_SOURCE_DIR "/launch/scenes/") + name).c_str(), &scene),
                  PLIANT_OK);
        scene.solver.threads = 2;
    }
    ~Scene()
    {
        pliant_material_table_free(&table);
        pliant_labels_free(&labels);
        pliant_volume_free(&scan);
    }
    pliant_model *build()
    {
        pliant_model *model = nullptr;
        EXPECT_EQ(pliant_model_build(&scene, &scan, &labels, &table, {nullptr, nullptr}, &model), PLIANT_OK)
            << pliant_last_error();
        return model;
    }
    // Return the positions of the given points in static equilibrium under gravity.
    std::vector<double> settle(const std::vector<double> &points, std::vector<uint8_t> &held)
    {
        pliant_model *model = build();
        pliant_data *data = nullptr;
        EXPECT_EQ(pliant_data_create(model, &data), PLIANT_OK);
        EXPECT_EQ(pliant_data_set_limits(data, 300, 1e-6), PLIANT_OK);
        pliant_status status = PLIANT_NOT_CONVERGED;
        for (int s = 0; s < 10 && status == PLIANT_NOT_CONVERGED; s++) status = pliant_step(model, data);
        EXPECT_EQ(status, PLIANT_OK);
        pliant_points found{};
        std::vector<double> out(points.size());
        EXPECT_EQ(
            pliant_points_create(&model->body->fine, static_cast<int32_t>(points.size() / 3), points.data(), &found),
            PLIANT_OK);
        pliant_points_move(&found, data->positions, out.data());
        for (size_t p = 0; p < held.size(); p++) held[p] = held[p] && found.found[p];
        pliant_points_free(&found);
        pliant_data_free(data);
        pliant_model_free(model);
        return out;
    }
};

TEST(Bone, MakesThePhantomMoreAccurateAtTheSameCount)
{
    Scene phantom("demo.yaml");
    ASSERT_EQ(pliant_inputs_read(&phantom.scene, "phantom:108x84x96", &phantom.scan, &phantom.labels, &phantom.table),
              PLIANT_OK);
    phantom.scene.model.gravity[1] = 2;
    // The reference is a lattice that is three times finer. It does not use the bone's surface.
    phantom.scene.mesh.ratio = 6;
    pliant_model *fine = phantom.build();
    std::vector<double> points;
    for (int32_t n = 0; n < fine->body->fine.num_nodes; n++)
        if (!fine->body->fine_fixed[n])
            points.insert(points.end(), fine->body->fine.rest + 3 * n, fine->body->fine.rest + 3 * n + 3);
    pliant_model_free(fine);
    std::vector<uint8_t> held(points.size() / 3, 1);
    std::vector<double> reference = phantom.settle(points, held), x[4];
    phantom.scene.mesh.ratio = 2;
    for (int n = 0; n < 4; n++) {
        phantom.scene.mesh.bone_surface = n % 2 == 1;
        phantom.scene.model.method = n < 2 ? PLIANT_FINE : PLIANT_AVERAGED;
        x[n] = phantom.settle(points, held);
    }
    double rms[4];
    for (int n = 0; n < 4; n++) {
        pliant_error error;
        ASSERT_EQ(pliant_error_between(static_cast<int32_t>(held.size()), held.data(), points.data(), reference.data(),
                                       x[n].data(), &error),
                  PLIANT_OK);
        rms[n] = error.rms;
    }
    std::printf("phantom under gravity, rms error [mm]: fine %.3f, on bone %.3f; averaged %.3f, on bone %.3f\n",
                1e3 * rms[0], 1e3 * rms[1], 1e3 * rms[2], 1e3 * rms[3]);
    EXPECT_LT(rms[1], 0.6 * rms[0]);
    EXPECT_LT(rms[3], 0.8 * rms[2]);
}

TEST(Bone, EveryMethodTakesIt)
{
    Scene phantom("demo.yaml");
    ASSERT_EQ(pliant_inputs_read(&phantom.scene, "phantom:64x48x48", &phantom.scan, &phantom.labels, &phantom.table),
              PLIANT_OK);
    phantom.scene.mesh.bone_surface = true;
    phantom.scene.model.gravity[1] = 2;
    struct { pliant_method method; pliant_mesh_kind mesh; pliant_solver_kind solver; } const cases[] = {
        {PLIANT_COARSE, PLIANT_LATTICE, PLIANT_COROTATIONAL}, {PLIANT_SCHUR, PLIANT_LATTICE, PLIANT_COROTATIONAL},
        {PLIANT_AVERAGED, PLIANT_LATTICE, PLIANT_COROTATIONAL}, {PLIANT_FINE, PLIANT_OCTREE, PLIANT_COROTATIONAL},
        {PLIANT_FINE, PLIANT_LATTICE, PLIANT_TLED}};
    for (const auto &one : cases) {
        SCOPED_TRACE(&one - cases);
        phantom.scene.model.method = one.method;
        phantom.scene.mesh.kind = one.mesh;
        phantom.scene.solver.kind = one.solver;
        phantom.scene.mesh.depth = 1;
        pliant_model *model = phantom.build();
        ASSERT_NE(model, nullptr);
        pliant_data *data = nullptr;
        ASSERT_EQ(pliant_data_create(model, &data), PLIANT_OK);
        EXPECT_GT(model->body->fine.num_moved, 0);
        for (int step = 0; step < 3; step++) ASSERT_GE(pliant_step(model, data), 0) << pliant_last_error();
        double moved = 0;
        for (int32_t n = 0; n < model->body->fine.num_nodes; n++)
            for (int d = 0; d < 3; d++) {
                double u = std::fabs(data->positions[3 * n + d] - model->body->fine.rest[3 * n + d]);
                if (model->body->fine.place_of_node[n] == PLIANT_BONE_SURFACE && one.method != PLIANT_COARSE)
                    ASSERT_EQ(u, 0);
                moved = std::max(moved, u);
            }
        EXPECT_GT(moved, 1e-6);
        EXPECT_LT(moved, 0.1); // Schur is far too soft, with nodes on bone or not
        pliant_data_free(data);
        pliant_model_free(model);
    }
}

TEST(Bone, OfACt)
{
    const std::string folder = PLIANT_TEST_DATA "/abdomen/";
    if (!std::ifstream(folder + "ct.nii.gz")) GTEST_SKIP() << folder << " is not there";
    Scene ct("abdomen_labels.yaml");
    std::snprintf(ct.scene.material.labels, sizeof ct.scene.material.labels, "%s",
                  (folder + "labels_totalseg_fast.nii.gz").c_str());
    ASSERT_EQ(pliant_inputs_read(&ct.scene, (folder + "ct.nii.gz").c_str(), &ct.scan, &ct.labels, &ct.table), PLIANT_OK)
        << pliant_last_error();
    ct.scene.mesh.ratio = 3;
    ct.scene.mesh.bone_surface = true;
    pliant_model *model = ct.build();
    ASSERT_NE(model, nullptr);
    for (int32_t t = 0; t < model->body->fine.num_tets; t++) ASSERT_GT(volume_of(model->body->fine, t), 0);
    int surface = 0, off = 0;
    for (int32_t n = 0; n < model->body->fine.num_nodes; n++) {
        if (model->body->fine.place_of_node[n] != PLIANT_BONE_SURFACE) continue;
        double index[3];
        pliant_geometry_to_index(&ct.scan.geometry, model->body->fine.rest + 3 * n, index);
        bool any[2] = {false, false};
        for (int corner = 0; corner < 8; corner++) {
            size_t v = 0;
            for (int d = 2; d >= 0; d--) {
                double at = std::floor(index[d] + 0.5 + (corner >> d & 1 ? 1e-6 : -1e-6));
                v = v * static_cast<size_t>(ct.scan.geometry.size[d]) +
                    static_cast<size_t>(std::min(std::max(at, 0.0), ct.scan.geometry.size[d] - 1.0));
            }
            any[model->materials.materials[model->material_of_voxel[v]].fixed] = true;
        }
        surface++;
        off += !any[0] || !any[1];
        ASSERT_TRUE(model->body->fine_fixed[n]);
    }
    EXPECT_GT(surface, 500);
    EXPECT_EQ(off, 0);
    pliant_model_free(model);
}

} // namespace
