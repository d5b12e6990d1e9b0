// Displacement fields against the deformed volume, with an independent resampler; mesh files against the mesh.
#include "../scan_files.h"
#include "body.h"
#include "mesh/mesh.h"
#include "scan/volume.h"

#include <fstream>
#include <sstream>

namespace {

struct Field : pliant_displacement {
    Field() : pliant_displacement{} {}
    Field(const Field &) = delete;
    Field &operator=(const Field &) = delete;
    ~Field() { pliant_displacement_free(this); }
};

// A clamped beam with stripes of four materials, whose axes are rotated or mirrored.
struct Beam : Body {
    explicit Beam(pliant_cut_kind cut = PLIANT_CUT_NONE, bool mirrored = false)
        : Body(size_, box_,
               {{5000, 0.4, 1000, false}, {9000, 0.4, 1000, false}, {6000, 0.4, 1000, false}, {7000, 0.4, 1000, false}},
               [](int i, int j, int k) { return (i / 5 + j / 4 + k / 3) % 4; })
    {
        if (mirrored) {
            scan.geometry.direction[0] = -1;
            scan.geometry.origin[0] = 0.12 - scan.geometry.origin[0];
        }
        fix_plane(1e-6, 0, 0, 1, 0, 0);
        cells(12, 6, 6, 1);
        scene.cut.kind = cut;
        scene.model.gravity[2] = -4;
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
    }
    void cut_from_above()
    {
        const double points[6] = {0.051, -0.02, 0.08, 0.055, 0.1, 0.08}, depth[3] = {0.002, 0, -0.05};
        ASSERT_EQ(pliant_data_cut(model, data, 2, points, depth, nullptr), PLIANT_OK) << pliant_last_error();
    }
    const pliant_body *body() const { return pliant_data_get_body(data); }
    const double *positions() const { return pliant_data_get_positions(data, nullptr); }
    void field(pliant_displacement_sense sense, Field *out) const
    {
        ASSERT_EQ(pliant_displacement_create(model, body(), positions(), sense, nullptr, out), PLIANT_OK)
            << pliant_last_error();
    }

    static constexpr int size_[3] = {48, 24, 24};
    static constexpr double box_[3] = {0.12, 0.06, 0.06};
};
constexpr int Beam::size_[3];
constexpr double Beam::box_[3];

size_t count_of(const Field &field, int value)
{
    return static_cast<size_t>(std::count(field.mask, field.mask + pliant_geometry_voxels(&field.geometry), value));
}

void place_of(const pliant_geometry &grid, size_t voxel, double world[3])
{
    const size_t across = static_cast<size_t>(grid.size[0]), down = static_cast<size_t>(grid.size[1]);
    const double index[3] = {static_cast<double>(voxel % across), static_cast<double>(voxel / across % down),
                             static_cast<double>(voxel / across / down)};
    pliant_geometry_to_world(&grid, index, world);
}

// Interpolate trilinearly, clamped to the scan.
// change: maximum difference between the corners of the cell
double sample(const pliant_volume &scan, const double world[3], double *change)
{
    double index[3], value = 0, low = INFINITY, high = -INFINITY;
    int base[3];
    pliant_geometry_to_index(&scan.geometry, world, index);
    for (int d = 0; d < 3; d++) {
        index[d] = std::min(std::max(index[d], 0.0), scan.geometry.size[d] - 1.0);
        base[d] = std::min(static_cast<int>(index[d]), scan.geometry.size[d] - 2);
    }
    for (int corner = 0; corner < 8; corner++) {
        double weight = 1;
        size_t voxel = 0;
        for (int d = 2; d >= 0; d--) {
            const int bit = corner >> d & 1;
            weight *= bit ? index[d] - base[d] : 1 - (index[d] - base[d]);
            voxel = voxel * static_cast<size_t>(scan.geometry.size[d]) + static_cast<size_t>(base[d] + bit);
        }
        const double stored = pliant_volume_value(&scan, voxel);
        value += weight * stored;
        low = std::min(low, stored);
        high = std::max(high, stored);
    }
    *change = high - low;
    return value;
}

// Away from cuts, the scan resampled by the field equals the deformed volume, up to a tenth of a voxel and rounding to
// integers.
void expect_resampling(const Beam &beam, const Field &field)
{
    const pliant_volume &warped = *pliant_warp_volume(pliant_data_get_warp(beam.data));
    ASSERT_TRUE(pliant_geometry_equal(&field.geometry, &warped.geometry));
    size_t wrong = 0, moved = 0;
    for (size_t v = 0; v < pliant_geometry_voxels(&field.geometry); v++) {
        if (field.mask[v] != PLIANT_MASK_TISSUE) continue;
        double world[3], change;
        place_of(field.geometry, v, world);
        for (int d = 0; d < 3; d++) world[d] += field.vectors[3 * v + static_cast<size_t>(d)];
        const double found = sample(beam.scan, world, &change);
        wrong += std::fabs(found - pliant_volume_value(&warped, v)) > 0.5 + 0.1 * change;
        moved += std::fabs(field.vectors[3 * v + 2]) > 0.005;
    }
    EXPECT_EQ(wrong, 0u);
    EXPECT_GT(moved, 1000u) << "the beam sags by more than two voxels";
    EXPECT_GT(count_of(field, PLIANT_MASK_TISSUE), 20000u);
}

void draw(Beam &beam)
{
    pliant_geometry target;
    const pliant_mesh &mesh = pliant_model_get_body(beam.model)->fine;
    ASSERT_EQ(
        pliant_warp_target(&beam.scan.geometry, mesh.rest, mesh.num_nodes, beam.scene.warp.margin, SIZE_MAX, &target),
        PLIANT_OK);
    ASSERT_EQ(pliant_data_set_warp(beam.model, beam.data, &target), PLIANT_OK) << pliant_last_error();
    beam.settle();
}

TEST(Displacement, IsZeroAtRest)
{
    Beam beam;
    for (pliant_displacement_sense sense : {PLIANT_DISPLACEMENT_RESAMPLE, PLIANT_DISPLACEMENT_TISSUE}) {
        Field field;
        beam.field(sense, &field);
        double maximum = 0;
        for (size_t n = 0; n < 3 * pliant_geometry_voxels(&field.geometry); n++)
            maximum = std::max(maximum, std::fabs(static_cast<double>(field.vectors[n])));
        EXPECT_LT(maximum, 1e-8);
        EXPECT_EQ(count_of(field, PLIANT_MASK_TISSUE), 48u * 24 * 24);
        EXPECT_EQ(count_of(field, PLIANT_MASK_CUT), 0u);
    }
}

TEST(Displacement, ResamplesTheScanIntoTheDeformedVolume)
{
    for (bool mirrored : {false, true}) {
        SCOPED_TRACE(mirrored);
        Beam beam(PLIANT_CUT_NONE, mirrored);
        draw(beam);
        Field field;
        beam.field(PLIANT_DISPLACEMENT_RESAMPLE, &field);
        expect_resampling(beam, field);
    }
}

TEST(Displacement, ResamplesByTheFitToo)
{
    Beam beam;
    beam.scene.warp.kind = PLIANT_FIT;
    ASSERT_EQ(beam.build(), PLIANT_OK);
    draw(beam);
    Field field;
    beam.field(PLIANT_DISPLACEMENT_RESAMPLE, &field);
    expect_resampling(beam, field);
}

TEST(Displacement, MarksWhereACutIs)
{
    for (pliant_cut_kind kind : {PLIANT_CUT_SEVER, PLIANT_CUT_SUBDIVIDE}) {
        SCOPED_TRACE(kind);
        Beam beam(kind);
        beam.cut_from_above();
        draw(beam);
        Field field, tissue;
        beam.field(PLIANT_DISPLACEMENT_RESAMPLE, &field);
        expect_resampling(beam, field);
        beam.field(PLIANT_DISPLACEMENT_TISSUE, &tissue);
        for (const Field *of : {&field, &tissue}) {
            EXPECT_GT(count_of(*of, PLIANT_MASK_CUT), 24u * 18); // at least one sheet of the scan's voxels
            EXPECT_LT(count_of(*of, PLIANT_MASK_CUT), 24u * 24 * 12);
        }
        // outside the mask, adjacent voxels move alike; inside it, across the cut, they do not
        double outside = 0, inside = 0;
        for (size_t v = 0; v + 1 < pliant_geometry_voxels(&tissue.geometry); v++) {
            if (v % 48 == 47) continue;
            double difference = 0;
            for (size_t d = 0; d < 3; d++)
                difference = std::max(difference, std::fabs(static_cast<double>(tissue.vectors[3 * v + d]) -
                                                            tissue.vectors[3 * v + 3 + d]));
            (tissue.mask[v] == PLIANT_MASK_CUT ? inside : outside) =
                std::max(tissue.mask[v] == PLIANT_MASK_CUT ? inside : outside, difference);
        }
        EXPECT_GT(inside, 0.003);
        EXPECT_LT(outside, 0.4 * inside);
    }
}

TEST(Displacement, MovesEveryVoxelAsItsTetrahedron)
{
    Beam beam;
    beam.settle();
    Field field;
    beam.field(PLIANT_DISPLACEMENT_TISSUE, &field);
    ASSERT_TRUE(pliant_geometry_equal(&field.geometry, &beam.scan.geometry));
    const pliant_mesh &mesh = beam.body()->fine;
    for (size_t v = 0; v < pliant_geometry_voxels(&field.geometry); v += 7) {
        double world[3], weight[4];
        place_of(field.geometry, v, world);
        const int32_t tet = pliant_mesh_locate(&mesh, world, weight);
        ASSERT_GE(tet, 0);
        for (int d = 0; d < 3; d++) {
            double there = -world[d];
            for (int c = 0; c < 4; c++) there += weight[c] * beam.positions()[3 * mesh.tets[4 * tet + c] + d];
            ASSERT_NEAR(field.vectors[3 * v + static_cast<size_t>(d)], there, 1e-8);
        }
    }
}

TEST(Displacement, IsWrittenWithItsMask)
{
    Beam beam(PLIANT_CUT_SEVER, true);
    beam.cut_from_above();
    Field field;
    beam.field(PLIANT_DISPLACEMENT_RESAMPLE, &field);
    temporary_folder folder;
    for (const char *name : {"u.nii.gz", "u.NII", "u.nrrd", "u.mha"}) {
        SCOPED_TRACE(name);
        ASSERT_EQ(pliant_displacement_write((folder / name).c_str(), &field), PLIANT_OK) << pliant_last_error();
        std::string mask = name;
        mask.insert(1, "_mask");
        volume_holder back;
        ASSERT_EQ(pliant_volume_read((folder / mask.c_str()).c_str(), nullptr, 0, &back), PLIANT_OK)
            << pliant_last_error();
        EXPECT_TRUE(pliant_geometry_equal(&back->geometry, &field.geometry));
        EXPECT_EQ(std::memcmp(back->voxels, field.mask, pliant_geometry_voxels(&field.geometry)), 0);
    }
    EXPECT_EQ(pliant_displacement_write((folder / "u.vtk").c_str(), &field), PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::strstr(pliant_last_error(), ".nii.gz"), nullptr) << pliant_last_error();
    EXPECT_EQ(pliant_displacement_write((folder / "none/u.nrrd").c_str(), &field), PLIANT_ERROR_FILE);
}

TEST(Displacement, RefusesPositionsThatAreNotFinite)
{
    Beam beam;
    std::vector<double> positions(beam.positions(), beam.positions() + 3 * beam.body()->fine.num_nodes);
    positions[7] = NAN;
    Field field;
    EXPECT_EQ(pliant_displacement_create(beam.model, beam.body(), positions.data(), PLIANT_DISPLACEMENT_RESAMPLE,
                                         nullptr, &field),
              PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::strstr(pliant_last_error(), "node 2"), nullptr) << pliant_last_error();
    EXPECT_EQ(field.vectors, nullptr);
}

TEST(Displacement, LeavesNothingBehindWithoutMemory)
{
    Beam beam(PLIANT_CUT_SEVER);
    beam.cut_from_above();
    temporary_folder folder;
    const size_t before = pliant_memory_in_use();
    for (const char *what : {"field", "tissue", "mesh.vtu", "mesh.vtp", "mesh.ply"}) {
        SCOPED_TRACE(what);
        int64_t calls = 0;
        pliant_status status = PLIANT_ERROR_MEMORY;
        for (; status != PLIANT_OK && calls < 2000; calls += calls < 60 ? 1 : 97) {
            Field field;
            const bool mesh = std::strchr(what, '.') != nullptr;
            pliant_memory_fail_after(calls);
            if (mesh)
                status =
                    pliant_mesh_save((folder / what).c_str(), beam.model, beam.body(), beam.positions(), nullptr, 1);
            else
                status = pliant_displacement_create(
                    beam.model, beam.body(), beam.positions(),
                    what[0] == 'f' ? PLIANT_DISPLACEMENT_RESAMPLE : PLIANT_DISPLACEMENT_TISSUE, nullptr, &field);
            pliant_memory_fail_after(-1);
            if (status != PLIANT_OK) EXPECT_EQ(field.vectors, nullptr);
        }
        EXPECT_EQ(status, PLIANT_OK);
        EXPECT_GT(calls, 5);
        EXPECT_EQ(pliant_memory_in_use(), before);
    }
}

TEST(Save, RefusesOtherEndingsAndUnits)
{
    Beam beam;
    temporary_folder folder;
    EXPECT_EQ(pliant_mesh_save((folder / "mesh.stl").c_str(), beam.model, beam.body(), beam.positions(), nullptr, 1),
              PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::strstr(pliant_last_error(), ".vtu"), nullptr) << pliant_last_error();
    EXPECT_EQ(
        pliant_mesh_save((folder / "mesh.vtu").c_str(), beam.model, beam.body(), beam.positions(), nullptr, 25.4e-3),
        PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(
        pliant_mesh_save((folder / "none/mesh.vtu").c_str(), beam.model, beam.body(), beam.positions(), nullptr, 1),
        PLIANT_ERROR_FILE);
    EXPECT_TRUE(folder.names().empty());
}

// The header has the sizes of the mesh, and the appended arrays have the lengths in the header.
TEST(Save, WritesWhatTheHeaderSays)
{
    Beam beam(PLIANT_CUT_SEVER);
    beam.cut_from_above();
    temporary_folder folder;
    std::vector<double> force(3 * static_cast<size_t>(beam.body()->fine.num_nodes), 2);
    ASSERT_EQ(
        pliant_mesh_save((folder / "mesh.vtu").c_str(), beam.model, beam.body(), beam.positions(), force.data(), 1e-3),
        PLIANT_OK)
        << pliant_last_error();
    std::ifstream file(folder / "mesh.vtu", std::ios::binary);
    const std::string all{std::istreambuf_iterator<char>(file), {}};
    std::stringstream piece;
    piece << "NumberOfPoints=\"" << beam.body()->fine.num_nodes << "\" NumberOfCells=\"" << beam.body()->fine.num_tets
          << '"';
    EXPECT_NE(all.find(piece.str()), std::string::npos);
    const std::string begin = "<AppendedData encoding=\"raw\">\n_";
    size_t at = all.find(begin) + begin.size(), arrays = 0;
    for (const size_t end = all.rfind("\n  </AppendedData>"); at < end; arrays++) {
        uint64_t bytes;
        ASSERT_NE(all.find("offset=\"" + std::to_string(at - all.find(begin) - begin.size()) + '"'), std::string::npos);
        std::memcpy(&bytes, all.data() + at, sizeof bytes);
        if (arrays == 0) {
            double first[3];
            ASSERT_EQ(bytes, 24u * static_cast<size_t>(beam.body()->fine.num_nodes));
            std::memcpy(first, all.data() + at + 8, sizeof first);
            for (int d = 0; d < 3; d++) EXPECT_DOUBLE_EQ(first[d], beam.positions()[d] / 1e-3);
        }
        at += sizeof bytes + bytes;
    }
    EXPECT_EQ(arrays, 15u);
    EXPECT_EQ(all.substr(at), "\n  </AppendedData>\n</VTKFile>\n");
}

} // namespace
