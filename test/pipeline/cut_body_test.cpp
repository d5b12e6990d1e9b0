// Random strokes through whole scans during a deformation: pieces, masses, materials.
#include "../cuts.h"
#include "mesh/mesh.h"

#include <sys/stat.h>

namespace {

struct Scan {
    pliant_volume volume{};
    pliant_labels labels{};
    pliant_material_table table{};
    pliant_model *model = nullptr;
    ~Scan()
    {
        pliant_model_free(model);
        pliant_material_table_free(&table);
        pliant_labels_free(&labels);
        pliant_volume_free(&volume);
    }
};

// A smooth motion, different for every stroke, with noise that inverts some elements.
struct Motion {
    double phase[6], noise;
    std::mt19937 &random;
    std::vector<double> positions(const pliant_body &body)
    {
        std::uniform_real_distribution<double> unit(-1, 1);
        std::vector<double> out(3 * static_cast<size_t>(body.fine.num_nodes)), shake(out.size());
        for (double &s : shake) s = unit(random);
        for (int32_t n = 0; n < body.fine.num_nodes; n++)
            for (int d = 0; d < 3; d++) {
                const double *x = body.fine.rest + 3 * n;
                out[3 * n + d] = x[d] + 0.010 * std::sin(20 * x[(d + 1) % 3] + phase[d]) +
                                 0.006 * std::sin(35 * x[(d + 2) % 3] + phase[3 + d]) + noise * shake[3 * n + d];
            }
        return out;
    }
};

// Expect that the sums over all fragments of a tetrahedron, including chips, equal its initial values.
void expect_whole(const pliant_body &load, const pliant_body &now)
{
    const size_t tets = static_cast<size_t>(load.fine.num_tets);
    double lambda[2] = {0, 0}, mass[2] = {0, 0};
    for (int32_t t = 0; t < now.fine.num_tets; t++) {
        double gradients[12];
        const double volume = pliant_mesh_gradients(&now.fine, t, gradients);
        const pliant_tet_material &m = now.fine_material[t];
        const bool held = now.num_held_pieces > load.num_held_pieces;
        ASSERT_GE(m.lambda, 0);
        ASSERT_GE(m.mu, 0);
        ASSERT_GE(m.density, 0);
        ASSERT_GT(volume, 0);
        if (!held) lambda[1] += volume * m.lambda;
        mass[1] += volume * m.density;
        if (static_cast<size_t>(t) < tets) {
            if (!held) lambda[0] += volume * load.fine_material[t].lambda;
            mass[0] += volume * load.fine_material[t].density;
        }
    }
    EXPECT_NEAR(lambda[1], lambda[0], 1e-11 * lambda[0]);
    EXPECT_NEAR(mass[1], mass[0], 1e-12 * mass[0]);
    EXPECT_NEAR(total_mass(now), total_mass(load), 1e-12 * total_mass(load));
}

void stroke_after_stroke(const pliant_model *model, int strokes, unsigned seed, double noise)
{
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(-1, 1);
    const pliant_body &load = *model->body, *now = pliant_body_retain(&load);
    int severed = 0, chips = 0, maximum = 0;
    ASSERT_EQ(mismatches(load), 0) << "before any cut";
    for (int s = 0; s < strokes; s++) {
        Motion motion{{3 * unit(random), 3 * unit(random), 3 * unit(random), 3 * unit(random), 3 * unit(random),
                       3 * unit(random)},
                      s % 4 == 3 ? noise : 0,
                      random};
        const std::vector<double> positions = motion.positions(*now);
        int32_t tet = 0;
        do tet = static_cast<int32_t>(random() % static_cast<unsigned>(load.fine.num_tets));
        while (!(load.fine_material[tet].tissue > 0));
        const double *middle = positions.data() + 3 * load.fine.tets[4 * tet];
        // a curved blade of 2 to 12 cm that moves by up to 8 cm; every tenth cuts through everything
        double along[3], ahead[3], bent[3];
        const bool through = s % 10 == 5;
        const double size = through ? 1 : 0.02 + 0.05 * (1 + unit(random)),
                     far = through ? 2 : 0.04 * (1 + unit(random));
        for (int d = 0; d < 3; d++) {
            along[d] = unit(random);
            ahead[d] = unit(random);
            bent[d] = through ? 0 : 0.3 * unit(random);
        }
        std::vector<double> from, to;
        for (int p = -10; p <= 10; p++)
            for (int d = 0; d < 3; d++) {
                const double q = p / 10.0, at = middle[d] + size * (q * along[d] + q * q * bent[d]) -
                                                (through ? 0.5 * far * ahead[d] : 0);
                from.push_back(at);
                to.push_back(at + far * (ahead[d] + 0.3 * q * bent[d]));
            }
        const pliant_cut_sweep sweep{21, from.data(), to.data(), nullptr};
        pliant_cut_report report;
        pliant_body *next = nullptr;
        ASSERT_EQ(pliant_body_cut(now, now->revision + 1, positions.data(), &sweep, &next, &report), PLIANT_OK)
            << "stroke " << s << ": " << pliant_last_error();
        if (!next) continue;
        severed += report.num_links;
        EXPECT_EQ(report.pieces, num_pieces(*next));
        pliant_body_release(now);
        now = next;
        for (int32_t t = 0; t < now->cuts->num_tets; t++)
            maximum = std::max(maximum, now->cuts->start[t + 1] - now->cuts->start[t]);
        chips += now->cuts->num_chips;
        const int wrong = s % 10 == 9 || s == strokes - 1 ? mismatches(*now) : 0;
        EXPECT_EQ(wrong, 0) << "stroke " << s;
        if (wrong) break;
        if (s % 10 != 9) continue;
        std::vector<int32_t> across(4 * static_cast<size_t>(now->fine.num_tets));
        ASSERT_EQ(pliant_mesh_neighbours(&now->fine, across.data()), PLIANT_OK);
        ASSERT_EQ(std::memcmp(across.data(), now->across, across.size() * sizeof across[0]), 0) << "stroke " << s;
        std::vector<double> mass(static_cast<size_t>(now->fine.num_nodes));
        pliant_body_masses(now, mass.data());
        ASSERT_EQ(std::memcmp(mass.data(), now->node_mass, mass.size() * sizeof mass[0]), 0) << "stroke " << s;
    }
    expect_whole(load, *now);
    std::printf("links %d, chips %d, fragments in one %d, pieces %d, tetrahedra %d of %d, nodes %d of %d\n", severed,
                now->cuts ? now->cuts->num_chips : 0, maximum, num_pieces(*now), now->fine.num_tets, load.fine.num_tets,
                now->fine.num_nodes, load.fine.num_nodes);
    EXPECT_GT(severed, 10000);
    EXPECT_GT(num_pieces(*now), strokes < 60 ? 1 : 10);
    pliant_body_release(now);
}

struct Mesh {
    const char *name;
    std::function<void(pliant_scene &)> set;
};
const Mesh lattice{"lattice", [](pliant_scene &) {}};
const Mesh air{"air", [](pliant_scene &scene) { scene.mesh.keep_air = true; }};
const Mesh bone{"bone", [](pliant_scene &scene) { scene.mesh.bone_surface = true; }};
const Mesh octree{"octree", [](pliant_scene &scene) {
                      scene.mesh.kind = PLIANT_OCTREE;
                      scene.mesh.depth = 2;
                      for (int &n : scene.mesh.coarse_cells) n = 3;
                  }};

struct CutBody : testing::TestWithParam<Mesh> {
    void strokes(pliant_scene &scene, Scan &scan, int count)
    {
        scene.model.method = PLIANT_FINE;
        scene.cut.kind = PLIANT_CUT_SEVER;
        for (int &n : scene.mesh.coarse_cells) n = 12;
        scene.mesh.ratio = 1;
        GetParam().set(scene);
        ASSERT_EQ(pliant_model_build(&scene, &scan.volume, nullptr, &scan.table, {nullptr, nullptr}, &scan.model),
                  PLIANT_OK)
            << pliant_last_error();
        stroke_after_stroke(scan.model, count, 1, 0.006);
    }
};
std::string name_of(const testing::TestParamInfo<Mesh> &info) { return info.param.name; }

#ifdef PLIANT_SANITIZED
const int STROKES = 25; // each takes five times as long
#else
const int STROKES = 60;
#endif

TEST_P(CutBody, PiecesOfThePhantomAreThoseOfItsVoxels)
{
    Scan scan;
    pliant_scene scene;
    pliant_scene_defaults(&scene);
    const int32_t size[3] = {96, 80, 72};
    ASSERT_EQ(pliant_phantom(size, 1, &scan.volume, &scan.labels), PLIANT_OK);
    ASSERT_EQ(pliant_material_table_default(&scan.table), PLIANT_OK);
    strokes(scene, scan, STROKES);
}

TEST_P(CutBody, PiecesOfACtAreThoseOfItsVoxels)
{
    const std::string path = PLIANT_TEST_DATA "/abdomen/ct.nii.gz";
    struct stat status;
    if (stat(path.c_str(), &status) != 0) GTEST_SKIP() << "the shared test data is not at " PLIANT_TEST_DATA;
    Scan scan;
    pliant_scene scene;
    pliant_scene_defaults(&scene);
    ASSERT_EQ(pliant_scene_set(&scene, "scan/resample", "128 96 80"), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_inputs_read(&scene, path.c_str(), &scan.volume, &scan.labels, &scan.table), PLIANT_OK)
        << pliant_last_error();
    strokes(scene, scan, STROKES);
}
INSTANTIATE_TEST_SUITE_P(Meshes, CutBody, testing::Values(lattice, air, bone, octree), name_of);

} // namespace
