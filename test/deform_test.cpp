// Tests of the program pliant_deform from a user's view: exit codes, messages and output files.
#include "program.h"
#include "scan/volume.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <gtest/gtest.h>
#include <numeric>
#include <sstream>
#include <string>
#include <unistd.h>
#include <vector>

namespace {

class Deform : public Program {
protected:
    Deform() : Program(PLIANT_DEFORM) {}
    static std::vector<std::vector<std::string>> table(const std::string &path)
    {
        std::vector<std::vector<std::string>> rows;
        std::ifstream file(path);
        for (std::string line, cell; std::getline(file, line);) {
            rows.emplace_back();
            for (std::stringstream cells(line); std::getline(cells, cell, ',');) rows.back().push_back(cell);
        }
        return rows;
    }
    const std::string small_ = "--scan phantom:48x40x40 --set 'mesh/coarse_cells=5 4 4' ";
};

TEST_F(Deform, HelpsAndListsOptions)
{
    EXPECT_EQ(run("--help"), 0);
    EXPECT_NE(out_.find("--tools FILE"), std::string::npos);
    EXPECT_EQ(run("--options"), 0);
    EXPECT_NE(out_.find("| `mesh/ratio` |"), std::string::npos);
}

TEST_F(Deform, ExitCodesDistinguishWrongUsageFromFailure)
{
    EXPECT_EQ(run(""), 2);
    EXPECT_NE(err_.find("--out DIR is missing"), std::string::npos) << err_;
    EXPECT_EQ(run("--frobnicate"), 2);
    EXPECT_EQ(run("--out x --steps many"), 2);
    EXPECT_EQ(run("--out x --set mesh/ration=2"), 2);
    EXPECT_NE(err_.find("mesh/ration"), std::string::npos) << err_;
    EXPECT_EQ(run("--out x --set mesh/ratio=99"), 2);
    EXPECT_EQ(run("--out " + in("result") + " --scan /nonexistent.nii"), 1);
    EXPECT_NE(err_.find("/nonexistent.nii"), std::string::npos) << err_;
    EXPECT_EQ(run("/nonexistent.yaml --out " + in("result")), 1);
    EXPECT_NE(err_.find("/nonexistent.yaml"), std::string::npos) << err_;
    EXPECT_EQ(run("--out /proc/nowhere " + small_), 1);
}

// Return the y coordinate [m] of the front of the muscle, in the middle of the phantom.
double front_of_the_wall()
{
    const int32_t size[3] = {48, 40, 40};
    pliant_volume scan{};
    pliant_labels labels{};
    EXPECT_EQ(pliant_phantom(size, 1, &scan, &labels), PLIANT_OK);
    double index[3], world[3] = {0, 0, 0};
    pliant_geometry_to_index(&scan.geometry, world, index);
    const int32_t middle = size[0] * size[1] * std::lround(index[2]) + std::lround(index[0]);
    index[1] = 0;
    while (index[1] < size[1] - 1 && labels.voxels[middle + size[0] * static_cast<int32_t>(index[1])] != 3) ++index[1];
    pliant_geometry_to_world(&scan.geometry, index, world);
    pliant_labels_free(&labels);
    pliant_volume_free(&scan);
    return world[1];
}

TEST_F(Deform, PullsAndWritesTheDocumentedFiles)
{
    const double front = front_of_the_wall();
    // Pull the front of the abdominal wall forward by 1 cm.
    std::ofstream(in("pull.yaml"))
        << "tools:\n  - name: grasper\n    drive: rigid\n    grasp: [0.0, " << front
        << ", 0.0]\n    motion: [{time: 0, offset: [0, 0, 0]}, {time: 0.1, offset: [0, -0.01, 0]}]\n";
    ASSERT_EQ(run(small_ + "--tools " + in("pull.yaml") +
                  " --every 2 --pictures --camera 0.1,-0.6,0.2:0,0,0 --radiograph 0,0 --out " + in("a/b")),
              0)
        << err_;
    for (const char *name : {"axial.png", "coronal.png", "sagittal.png", "camera.png", "camera_000002.png",
                             "radiograph.png", "build.csv", "nodes_000002.csv", "deformed_000004.nii.gz"})
        EXPECT_EQ(access(in(std::string("a/b/") + name).c_str(), R_OK), 0) << name;

    pliant_volume deformed{};
    ASSERT_EQ(pliant_volume_read(in("a/b/deformed.nii.gz").c_str(), nullptr, 0, &deformed), PLIANT_OK)
        << pliant_last_error();
    EXPECT_GE(deformed.geometry.size[0], 48);
    pliant_volume_free(&deformed);

    auto nodes = table(in("a/b/nodes.csv"));
    ASSERT_GT(nodes.size(), 100u);
    EXPECT_EQ(nodes[0], (std::vector<std::string>{"rest_x_m", "rest_y_m", "rest_z_m", "x_m", "y_m", "z_m"}));
    double forward = 0;
    for (size_t n = 1; n < nodes.size(); ++n) {
        ASSERT_EQ(nodes[n].size(), 6u);
        forward = std::min(forward, std::stod(nodes[n][4]) - std::stod(nodes[n][1]));
    }
    EXPECT_LT(forward, -0.005);
    EXPECT_GT(forward, -0.02);

    auto steps = table(in("a/b/steps.csv"));
    ASSERT_GT(steps.size(), 5u);
    EXPECT_EQ(steps[0].size(), steps.back().size());
    EXPECT_NE(out_.find("solve"), std::string::npos);
    EXPECT_NE(out_.find("peak memory"), std::string::npos);

    auto tools = table(in("a/b/tools.csv"));
    EXPECT_EQ(tools.size(), steps.size());
    EXPECT_EQ(tools.back()[1], "grasper");
    EXPECT_LT(std::stod(tools.back()[3]), 0.0) << "the force of the tool on the tissue points where it pulls";
    EXPECT_NEAR(std::stod(tools.back()[6]), front - 0.01, 1e-3);
}

// fields_test.py reads these files with other programs.
TEST_F(Deform, WritesDisplacementsAndMeshes)
{
    ASSERT_EQ(run(small_ +
                  "--steps 4 --every 2 --vtk --unit mm --displacement u.nii.gz --tissue-displacement v.nrrd --out " +
                  in("a")),
              0)
        << err_;
    for (const char *name : {"mesh.pvd", "surface.pvd", "mesh_000004.vtu", "surface_000002.vtp", "u_000002.nii.gz",
                             "v_000004_mask.nrrd", "u.nii.gz", "v.nrrd"})
        EXPECT_EQ(access(in(std::string("a/") + name).c_str(), R_OK), 0) << name;
    pliant_volume deformed{}, mask{}, tissue{};
    ASSERT_EQ(pliant_volume_read(in("a/deformed.nii.gz").c_str(), nullptr, 0, &deformed), PLIANT_OK)
        << pliant_last_error();
    ASSERT_EQ(pliant_volume_read(in("a/u_mask.nii.gz").c_str(), nullptr, 0, &mask), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_volume_read(in("a/v_mask.nrrd").c_str(), nullptr, 0, &tissue), PLIANT_OK) << pliant_last_error();
    EXPECT_TRUE(pliant_geometry_equal(&mask.geometry, &deformed.geometry))
        << "ITK's sense: the grid of the deformed volume";
    EXPECT_EQ(tissue.geometry.size[0], 48) << "the tissue's sense: the grid of the scan";
    EXPECT_EQ(tissue.geometry.size[2], 40);
    pliant_volume_free(&deformed);
    pliant_volume_free(&mask);
    pliant_volume_free(&tissue);
    for (const char *names : {"--displacement deformed.nii.gz", "--displacement u.nrrd --tissue-displacement u.nrrd"}) {
        EXPECT_EQ(run(std::string(names) + " --out " + in("b")), 2);
        EXPECT_NE(err_.find("use another name"), std::string::npos) << err_;
    }
    EXPECT_EQ(run("--displacement u.vtk --out " + in("b")), 2);
    EXPECT_NE(err_.find(".nii.gz"), std::string::npos) << err_;
    EXPECT_EQ(run("--unit inch --out " + in("b")), 2);
}

// Each compared method writes its own displacement field, with a relative path and with an absolute path.
TEST_F(Deform, ComparedMethodsKeepTheirFields)
{
    std::ofstream(in("pull.yaml"))
        << "tools:\n  - {name: g, drive: rigid, grasp: [0, -0.1, 0], motion: [{time: 0.06, offset: [0, -0.01, 0]}]}\n";
    ASSERT_EQ(run(small_ + "--quiet --steps 4 --compare coarse,fine --tools " + in("pull.yaml") + " --displacement " +
                  in("u.nrrd") + " --tissue-displacement v.nrrd --out " + in("c")),
              0)
        << err_;
    for (const char *name : {"u.nrrd", "c/u.nrrd", "c/v.nrrd"}) EXPECT_NE(access(in(name).c_str(), R_OK), 0) << name;
    for (const auto &pair :
         {std::array<const char *, 2>{"u_coarse.nrrd", "u_fine.nrrd"}, {"c/coarse/v.nrrd", "c/fine/v.nrrd"}}) {
        std::string bytes[2];
        for (int n = 0; n < 2; ++n) {
            std::ifstream file(in(pair[n]), std::ios::binary);
            bytes[n].assign(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
            EXPECT_GT(bytes[n].size(), 1000u) << pair[n];
        }
        EXPECT_NE(bytes[0], bytes[1]) << pair[0];
    }
    for (const char *name : {"u_coarse_mask.nrrd", "u_fine_mask.nrrd"})
        EXPECT_EQ(access(in(name).c_str(), R_OK), 0) << name;
}

// A ball presses on the wall. tools.csv has its force and torque, and nodes.csv has the force on the nodes.
TEST_F(Deform, WritesContactForces)
{
    std::ofstream(in("press.yaml"))
        << "tools:\n  - name: ball\n    shape: {parts: [{kind: sphere, from: [0, 0, 0], radius: 0.02}]}\n"
           "    poses: [{time: 0, position: [0, -0.17, 0]}, {time: 0.1, position: [0, -0.13, 0]}]\n";
    ASSERT_EQ(run(small_ + "--quiet --tools " + in("press.yaml") + " --scalars contact_force --out " + in("c")), 0)
        << err_;
    auto tools = table(in("c/tools.csv")), nodes = table(in("c/nodes.csv"));
    ASSERT_GT(tools.size(), 1u);
    EXPECT_EQ(tools[0][9], "contact_y_n");
    EXPECT_EQ(tools.back()[1], "ball");
    EXPECT_EQ(tools[0].back(), "contact_force_error_n");
    EXPECT_GT(std::stod(tools.back().back()), 0.01 * std::stod(tools.back()[9]));
    EXPECT_GT(std::stod(tools.back()[9]), 0.01) << "of the ball on the tissue, into it";
    EXPECT_EQ(std::stod(tools.back()[3]), 0) << "it holds nothing";
    ASSERT_EQ(nodes[0].back(), "contact_force_n");
    double sum = 0;
    for (size_t n = 1; n < nodes.size(); ++n) sum += std::stod(nodes[n].back());
    EXPECT_GE(sum, 0.99 * std::stod(tools.back()[9]));
}

// Properties of a surface file, at rest: the number of connected components, the area of cut faces projected along
// each axis, and the area of other faces.
struct SurfaceFile {
    size_t parts = 0;
    double cut[3] = {0, 0, 0}, others = 0;
    explicit SurfaceFile(const std::string &path)
    {
        std::ifstream file(path);
        size_t num_vertices = 0, num_faces = 0;
        for (std::string line; std::getline(file, line) && line != "end_header";) {
            std::sscanf(line.c_str(), "element vertex %zu", &num_vertices);
            std::sscanf(line.c_str(), "element face %zu", &num_faces);
        }
        std::vector<double> rest(3 * num_vertices);
        for (size_t v = 0; v < num_vertices; ++v) {
            double skipped;
            file >> skipped >> skipped >> skipped >> rest[3 * v] >> rest[3 * v + 1] >> rest[3 * v + 2] >> skipped;
        }
        std::vector<size_t> next(num_vertices);
        std::iota(next.begin(), next.end(), 0);
        const auto first = [&](size_t v) { while (next[v] != v) v = next[v] = next[next[v]]; return v; };
        size_t three, corner[3], made_by_cut;
        for (size_t f = 0; f < num_faces && file >> three >> corner[0] >> corner[1] >> corner[2] >> made_by_cut; ++f) {
            double side[2][3], area = 0;
            for (int e = 0; e < 2; ++e) {
                next[first(corner[e + 1])] = first(corner[0]);
                for (int d = 0; d < 3; ++d) side[e][d] = rest[3 * corner[e + 1] + d] - rest[3 * corner[0] + d];
            }
            for (int d = 0; d < 3; ++d) {
                const int a = (d + 1) % 3, b = (d + 2) % 3;
                const double seen = 0.5 * std::abs(side[0][a] * side[1][b] - side[0][b] * side[1][a]);
                area += seen * seen;
                if (made_by_cut) cut[d] += seen;
            }
            if (!made_by_cut) others += std::sqrt(area);
        }
        EXPECT_TRUE(file) << path;
        for (size_t v = 0; v < num_vertices; ++v) parts += next[v] == v;
    }
};

// Cut along a line across the whole body, and with a blade into its front. cuts.csv lists both cuts. tools.csv has the
// blade's force. The surface file contains the cut faces.
TEST_F(Deform, CutsAlongALineAndByABlade)
{
    const std::string line =
        "cuts: [{time: 0.1, points: [[-0.3, -0.3, 0.02], [0.3, -0.3, 0.02]], depth: [0, 0.6, 0]}]\n";
    std::ofstream(in("still.yaml")) << "gravity: [{time: 0.1, acceleration: [0, 0, 0]}]\n";
    std::ofstream(in("line.yaml")) << line;
    std::ofstream(in("both.yaml"))
        << line
        << "tools:\n  - name: knife\n    blade: {from: [0, 0, -0.3], to: [0, 0, 0.3]}\n"
           "    poses: [{time: 0, position: [0, -0.16, 0]}, "
        << "{time: 0.2, position: [0, -0.08, 0]}]\n    cut: [{from: 0.02, to: 0.18}]\n";
    const std::string common = small_ + "--quiet --no-volume --set cut/kind=";
    EXPECT_EQ(run(common + "none --tools " + in("line.yaml") + " --out " + in("refused")), 1);
    EXPECT_NE(err_.find("this scene does not cut: set cut/kind to sever"), std::string::npos) << err_;
    for (const char *path : {"still", "line", "both"})
        ASSERT_EQ(run(common + "sever --tools " + in(path) + ".yaml --out " + in(path)), 0) << err_;

    EXPECT_NE(access(in("still/cuts.csv").c_str(), F_OK), 0) << "of a path that cuts";
    const auto rows = table(in("both/cuts.csv")), tools = table(in("both/tools.csv")),
               alone = table(in("line/cuts.csv"));
    ASSERT_EQ(alone.size(), 2u);
    ASSERT_GT(rows.size(), 2u);
    EXPECT_EQ(rows[0], (std::vector<std::string>{"step", "time_s", "tool", "stroke", "area_m2", "severed_area_m2",
                                                 "pieces", "revision", "nodes", "tetrahedra", "cut_s"}));
    double by_line = 0, by_blade = 0;
    for (size_t row = 1; row < rows.size(); ++row) {
        double *sum = rows[row][2] == "knife" ? &by_blade : &by_line;
        *sum += std::stod(rows[row][4]);
        EXPECT_NEAR(std::stod(rows[row][5]), *sum, 1e-6) << "of the stroke until then";
        EXPECT_EQ(rows[row][6], row > 1 || rows[row][2] == "" ? "2" : "1") << "pieces";
        if (row > 1) { EXPECT_GT(std::stoi(rows[row][7]), std::stoi(rows[row - 1][7])) << "revision"; }
    }
    EXPECT_EQ(std::stod(alone[1][1]), 0.1);
    EXPECT_NEAR(by_line, std::stod(alone[1][4]), 0.02 * by_line);
    EXPECT_GT(by_line, 0.6 * 0.4 * 0.29) << "an ellipse has 0.79 of what is around it";
    EXPECT_LT(by_line, 0.8 * 0.4 * 0.29);
    EXPECT_GT(by_blade, 0.3 * 0.01);
    EXPECT_LT(by_blade, 0.3 * 0.06);
    double felt = 0;
    for (size_t row = 1; row < tools.size(); ++row) felt = std::max(felt, std::stod(tools[row][3]));
    EXPECT_GT(felt, 10) << "of the blade on the tissue, into it";

    const SurfaceFile still(in("still/surface.ply")), cut(in("line/surface.ply")), both(in("both/surface.ply"));
    EXPECT_EQ(still.parts, 1u);
    EXPECT_EQ(still.cut[2], 0);
    EXPECT_EQ(cut.parts, 2u);
    EXPECT_EQ(both.parts, 2u);
    for (const SurfaceFile *each : {&cut, &both}) {
        EXPECT_NEAR(each->others, still.others, 1e-6 * still.others) << "the skin is parted, and no less";
        EXPECT_GT(each->cut[2], 2 * by_line) << "both sides, and the tetrahedra's part in air";
        EXPECT_LT(each->cut[2], 2 * 1.5 * by_line);
    }
    EXPECT_LT(cut.cut[0], 0.02 * cut.cut[2]);
    EXPECT_GT(both.cut[0] - cut.cut[0], 2 * 0.7 * by_blade) << "the walls of the notch";
    EXPECT_LT(both.cut[0] - cut.cut[0], 2 * 1.5 * by_blade);
}

// The margin around the tissue is warp/margin, for any tool motion. Warnings report a far tool and tissue outside of
// the volume.
TEST_F(Deform, KeepsTheVolumeToItsMargin)
{
    std::ofstream(in("far.yaml"))
        << "tools:\n  - name: grasper\n    drive: rigid\n    grasp: [0.0, " << front_of_the_wall() + 0.006
        << ", 0.07]\n    motion: [{time: 0, offset: [0, 0, 0]}, {time: 1, offset: [0, -3, 0]}]\n";
    const std::string common = small_ + "--quiet --steps 4 --set warp/margin=0.02 --out " + in("far");
    ASSERT_EQ(run(common), 0) << err_;
    pliant_volume still{}, pulled{};
    ASSERT_EQ(pliant_volume_read(in("far/deformed.nii.gz").c_str(), nullptr, 0, &still), PLIANT_OK);
    EXPECT_EQ(err_.find("warp/margin"), std::string::npos) << err_;
    ASSERT_EQ(run(common + " --tools " + in("far.yaml")), 0) << err_;
    ASSERT_EQ(pliant_volume_read(in("far/deformed.nii.gz").c_str(), nullptr, 0, &pulled), PLIANT_OK);
    EXPECT_NE(err_.find("a tool pulls by 3 m"), std::string::npos) << err_;
    EXPECT_NE(err_.find("tissue is moved out of the deformed volume"), std::string::npos) << err_;
    for (int d = 0; d < 3; d++) EXPECT_EQ(pulled.geometry.size[d], still.geometry.size[d]);
    pliant_volume_free(&still);
    pliant_volume_free(&pulled);
}

// A micro-CT scan. With a margin of 30 mm, the deformed volume of a body of 1 mm would have 8.4e9 voxels.
TEST_F(Deform, ScalesItsLengthsToASmallBody)
{
    pliant_geometry geometry{{44, 40, 28}, {0, 0, 0}, {3e-5, 3e-5, 3e-5}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    pliant_volume scan{};
    ASSERT_EQ(pliant_volume_create(&geometry, PLIANT_INT16, &scan), PLIANT_OK);
    scan.slope = 1;
    for (int v = 0; v < 44 * 40 * 28; v++) {
        const int i = v % 44, j = v / 44 % 40, k = v / 1760;
        const bool in = i > 4 && i < 39 && j > 4 && j < 35 && k > 4 && k < 23;
        static_cast<int16_t *>(scan.voxels)[v] = int16_t(!in ? -1000 : j > 30 ? 900 : 40); // bone at its back
    }
    ASSERT_EQ(pliant_volume_write(in("micro.nii.gz").c_str(), &scan), PLIANT_OK) << pliant_last_error();
    pliant_volume_free(&scan);
    std::ofstream(in("pull.yaml"))
        << "tools:\n  - {name: g, drive: rigid, grasp: [0.00066, 0.0003, 0.0004], motion: [{time: 0, "
           "offset: [0, 0, 0]}, {time: 0.04, offset: [0, -0.0001, 0]}]}\n";
    const std::string common = "--scan " + in("micro.nii.gz") + " --tools " + in("pull.yaml") +
                               " --set 'mesh/coarse_cells=6 5 4' --steps 2 --quiet --out ";
    ASSERT_EQ(run(common + in("small")), 0) << err_;
    EXPECT_EQ(err_.find("warp/margin"), std::string::npos) << err_;
    pliant_volume out{};
    ASSERT_EQ(pliant_volume_read(in("small/deformed.nii.gz").c_str(), "", SIZE_MAX, &out), PLIANT_OK)
        << pliant_last_error();
    EXPECT_LE(pliant_geometry_voxels(&out.geometry), 4 * pliant_geometry_voxels(&geometry));
    pliant_volume_free(&out);
    ASSERT_EQ(run(common + in("large") + " --set warp/margin=0.0015"), 0) << err_;
    EXPECT_NE(err_.find("warp/margin 0.0015 m makes the deformed volume"), std::string::npos) << err_;
}

TEST_F(Deform, KeepsTheAirOfTheScanWithKeepAir)
{
    pliant_volume scan{}, drawn[2]{};
    ASSERT_EQ(pliant_phantom((const int32_t[3]){48, 40, 40}, 1, &scan, nullptr), PLIANT_OK);
    for (int keep = 0; keep < 2; keep++) {
        ASSERT_EQ(run(small_ + "--quiet --steps 1 --set warp/margin=0 --set mesh/keep_air=" +
                      (keep ? "true" : "false") + " --out " + in("air")),
                  0)
            << err_;
        ASSERT_EQ(pliant_volume_read(in("air/deformed.nii.gz").c_str(), nullptr, 0, &drawn[keep]), PLIANT_OK);
        ASSERT_EQ(pliant_geometry_voxels(&drawn[keep].geometry), pliant_geometry_voxels(&scan.geometry));
    }
    size_t other[2] = {0, 0};
    for (size_t v = 0; v < pliant_geometry_voxels(&scan.geometry); v++)
        for (int keep = 0; keep < 2; keep++) {
            float is = pliant_volume_value(&drawn[keep], v), was = pliant_volume_value(&scan, v);
            if (is == was) continue;
            other[keep]++;
            if (!keep) { EXPECT_EQ(is, scan.background) << v; }
        }
    EXPECT_EQ(other[1], 0u);
    EXPECT_GT(other[0], 1000u);
    for (pliant_volume *volume : {&scan, &drawn[0], &drawn[1]}) pliant_volume_free(volume);
}

TEST_F(Deform, StopsOnRequestAndWritesFinishedSteps)
{
    const auto steps = [&] { return table(in("stopped/steps.csv")).size() > 1; };
    EXPECT_EQ(interrupt(small_ + "--steps 1000000 --out " + in("stopped"), steps), 130) << text(in("err"));
    EXPECT_GT(table(in("stopped/nodes.csv")).size(), 100u);
    EXPECT_EQ(access(in("stopped/deformed.nii.gz").c_str(), R_OK), 0);
}

// Warn about the schur method under gravity when the model is built, and about its result at the end.
TEST_F(Deform, WarnsOfSteepLoadsAndUnconvergedSteps)
{
    const std::string hung = small_ + "--set 'model/gravity=0 9.81 0' --no-volume --out " + in("hung") + " --steps ";
    /* the solver limits the motion per step, so elements become inverted after several steps */
    ASSERT_EQ(run(hung + "14 --quiet --set solver/iterations=1 --set model/method=schur"), 0) << err_;
    for (const char *words : {"warning: model/method: schur is far too soft for model/gravity", "10 to 15 times",
                              "of 14 steps did not converge", "elements were inverted in", "use averaged"})
        EXPECT_NE(err_.find(words), std::string::npos) << words << "\n" << err_;
    const auto steps = table(in("hung/steps.csv"));
    const size_t inverted =
        static_cast<size_t>(std::find(steps[0].begin(), steps[0].end(), "inverted") - steps[0].begin());
    ASSERT_LT(inverted, steps[0].size());
    EXPECT_TRUE(std::any_of(steps.begin() + 1, steps.end(),
                            [inverted](const std::vector<std::string> &row) { return std::stoi(row[inverted]) > 0; }));
    ASSERT_EQ(run(hung + "3 --quiet --set solver/iterations=100 --set model/method=averaged"), 0) << err_;
    EXPECT_NE(err_.find("the displacement of averaged has an error of"), std::string::npos) << err_; // but it converges
    EXPECT_EQ(err_.find('\n'), err_.size() - 1) << err_;
    ASSERT_EQ(run(hung + "3 --quiet --set solver/iterations=1 --set solver/tolerance=1e-9"), 0) << err_;
    EXPECT_NE(err_.find("3 of 3 steps did not converge, nor did the last one"), std::string::npos) << err_;
    EXPECT_NE(err_.find("solver/iterations"), std::string::npos) << err_;
}

// A tool path applies gravity.
TEST_F(Deform, WarnsOfSchurWhereThePathHasGravity)
{
    std::ofstream(in("turn.yaml"))
        << "gravity: [{time: 0, acceleration: [0, 0, 0]}, {time: 0.02, acceleration: [0, 9.81, 0]}]\n";
    const std::string turned =
        small_ + "--quiet --no-volume --steps 1 --tools " + in("turn.yaml") + " --out " + in("turned");
    ASSERT_EQ(run(turned + " --set model/method=schur"), 0) << err_;
    EXPECT_NE(err_.find("schur is far too soft"), std::string::npos) << err_;
    ASSERT_EQ(run(turned + " --set model/method=averaged"), 0) << err_;
    EXPECT_EQ(err_.find("schur"), std::string::npos) << err_;
}

// The refusal of a scan that is not a CT contains a material table. With this table the program runs.
TEST_F(Deform, RequiresATableForMr)
{
    const int32_t size[3] = {40, 32, 32};
    pliant_volume scan{};
    ASSERT_EQ(pliant_phantom(size, 1, &scan, nullptr), PLIANT_OK);
    auto *voxels = static_cast<int16_t *>(scan.voxels);
    for (size_t v = 0; v < pliant_geometry_voxels(&scan.geometry); ++v)
        voxels[v] = static_cast<int16_t>(std::max(voxels[v] + 300, 3));
    ASSERT_EQ(pliant_volume_write(in("mr.nii").c_str(), &scan), PLIANT_OK);
    pliant_volume_free(&scan);
    EXPECT_EQ(run("--scan " + in("mr.nii") + " --out " + in("mr")), 1);
    EXPECT_NE(err_.find("mr.nii: its header does not say CT"), std::string::npos) << err_;
    const size_t begin = err_.find("materials:\n"), end = err_.find("or with the labels");
    ASSERT_NE(begin, std::string::npos) << err_;
    std::ofstream(in("mine.yaml")) << err_.substr(begin, end - begin);
    std::ofstream(in("mr.yaml")) << "material: {file: mine.yaml}\nmesh: {coarse_cells: [4, 4, 4], ratio: 1}\n"
                                    "fixed: {planes: [{point: [0, 0.08, 0], normal: [0, -1, 0]}]}\n";
    EXPECT_EQ(run(in("mr.yaml") + " --quiet --steps 2 --pictures --scan " + in("mr.nii") + " --out " + in("mr")), 0)
        << err_;
}

// The report has the times of the warp's two stages, and scalars for each node and element.
TEST_F(Deform, WritesTimesOfTheWarpAndScalars)
{
    ASSERT_EQ(
        run(small_ +
            "--set 'model/gravity=0 9.81 0' --steps 3 --every 2 --pictures --scalars von_mises,volume_ratio --out " +
            in("s")),
        0)
        << err_;
    auto steps = table(in("s/steps.csv"));
    const auto column = [&](const std::string &name) {
        return static_cast<size_t>(std::find(steps[0].begin(), steps[0].end(), name) - steps[0].begin());
    };
    ASSERT_LT(column("rasterize_s"), steps[0].size());
    double drawn = 0;
    for (size_t row = 1; row < steps.size(); ++row) {
        const double cull = std::stod(steps[row][column("cull_s")]),
                     rasterize = std::stod(steps[row][column("rasterize_s")]);
        EXPECT_GT(cull, 0);
        drawn += rasterize;
        EXPECT_LE(cull + rasterize, 1.001 * std::stod(steps[row][column("warp_s")]));
    }
    EXPECT_GT(drawn, 0);
    for (const char *name : {"  cull ", "  rasterize ", "share %"})
        EXPECT_NE(out_.find(name), std::string::npos) << out_;

    auto nodes = table(in("s/nodes.csv")), elements = table(in("s/elements.csv"));
    EXPECT_EQ(nodes[0].size(), 8u);
    EXPECT_EQ(nodes[0][6] + " " + nodes[0][7], "von_mises_pa volume_ratio");
    EXPECT_EQ(elements[0], (std::vector<std::string>{"node_0", "node_1", "node_2", "node_3", "material", "von_mises_pa",
                                                     "volume_ratio"}));
    std::vector<double> low(nodes.size(), INFINITY), high(nodes.size(), -INFINITY); // range of the adjacent elements
    double highest_stress = 0;
    for (size_t tet = 1; tet < elements.size(); ++tet) {
        ASSERT_EQ(elements[tet].size(), 7u);
        highest_stress = std::max(highest_stress, std::stod(elements[tet][5]));
        for (size_t v = 0; v < 4; ++v) {
            const size_t node = std::stoul(elements[tet][v]) + 1;
            ASSERT_LT(node, nodes.size());
            low[node] = std::min(low[node], std::stod(elements[tet][6]));
            high[node] = std::max(high[node], std::stod(elements[tet][6]));
        }
    }
    EXPECT_GT(highest_stress, 10);
    for (size_t node = 1; node < nodes.size(); ++node) {
        const double value = std::stod(nodes[node][7]);
        EXPECT_GE(value, low[node] - 1e-4);
        EXPECT_LE(value, high[node] + 1e-4);
    }
    for (const char *name : {"von_mises_pa_coronal.png", "volume_ratio_axial.png", "elements_000002.csv", "surface.ply",
                             "surface_000002.ply", "axial_000002.png", "von_mises_pa_000002_sagittal.png",
                             "mesh_coronal.png", "mesh_000002_axial.png"})
        EXPECT_EQ(access(in(std::string("s/") + name).c_str(), R_OK), 0) << name;
    EXPECT_EQ(run("--out x --scalars von_mises,none"), 2);
    EXPECT_EQ(run("--out x --scalars von_mises,von_mises"), 2);
    EXPECT_NE(err_.find("named twice"), std::string::npos) << err_;
}

// [H] figures 1 and 2: one command compares the methods.
TEST_F(Deform, ComparesMethodsSideBySide)
{
    const double front = front_of_the_wall();
    std::ofstream(in("pull.yaml"))
        << "tools:\n  - name: grasper\n    drive: rigid\n    grasp: [0.0, " << front
        << ", 0.0]\n    motion: [{time: 0, offset: [0, 0, 0]}, {time: 0.06, offset: [0, -0.01, 0]}]\n";
    ASSERT_EQ(run(small_ + "--quiet --pictures --steps 6 --compare coarse,averaged,fine --tools " + in("pull.yaml") +
                  " --out " + in("c")),
              0)
        << err_;
    auto rows = table(in("c/compare.csv"));
    ASSERT_EQ(rows.size(), 4u);
    EXPECT_EQ(rows[1][0] + rows[2][0] + rows[3][0], "coarseaveragedfine");
    for (size_t m = 1; m < 3; ++m) EXPECT_GT(std::stod(rows[m][2]), 0.05) << rows[m][0];
    EXPECT_LT(std::stod(rows[3][2]), 1e-9) << "the last one is the reference";
    EXPECT_GT(std::stod(rows[3][4]), 5) << "the middle of what is held was pulled by a centimetre";
    EXPECT_LT(std::stod(rows[3][4]), 20);
    for (size_t m = 1; m < 4; ++m) EXPECT_GT(std::stod(rows[m][1]), 0) << "milliseconds a step";
    for (const char *name :
         {"axial.png", "coronal.png", "sagittal.png", "coarse/axial.png", "averaged/nodes.csv", "fine/deformed.nii.gz"})
        EXPECT_EQ(access(in(std::string("c/") + name).c_str(), R_OK), 0) << name;
    const double all = std::stod(rows[1][3]);
    // --min-value limits the error to the voxels of an isosurface, so no error grows. Air that the mesh keeps is in
    // neither error.
    ASSERT_EQ(run(small_ + "--quiet --steps 6 --set mesh/keep_air=true --compare coarse,fine --tools " +
                  in("pull.yaml") + " --out " + in("k")),
              0)
        << err_;
    auto kept = table(in("k/compare.csv"));
    ASSERT_EQ(run(small_ + "--quiet --steps 6 --set mesh/keep_air=true --min-value 150 --compare coarse,fine --tools " +
                  in("pull.yaml") + " --out " + in("k")),
              0)
        << err_;
    auto limited = table(in("k/compare.csv"));
    EXPECT_LT(std::stod(limited[1][2]), std::stod(kept[1][2]));
    EXPECT_GT(std::stod(limited[1][2]), 0);
    EXPECT_LT(std::stod(kept[2][4]), 1.5 * std::stod(rows[3][4])) << "air beside the tool moves further";
    EXPECT_GT(all, 0);
    EXPECT_EQ(run("--out x --compare fine --min-value high"), 2);
    EXPECT_EQ(run("--out x --compare fine --min-value 100 --no-volume"), 2);
    EXPECT_EQ(run("--out x --compare fine,fast"), 2);
    EXPECT_NE(err_.find("'fast' is not one of fine coarse schur"), std::string::npos) << err_;
}

// The program reports its input at the start, writes probes and connectivity, and never reports more than 100 %.
// With --quiet it prints nothing.
TEST_F(Deform, LogsItsBackendAndFollowsProbes)
{
    const double front = front_of_the_wall();
    std::ofstream(in("probes.yaml"))
        << "gravity: [{time: 0, acceleration: [0, 9.81, 0]}]\nprobes:\n  - {name: wall, at: [0.0, " << front + 0.004
        << ", 0.0]}\n  - {name: side, at: [0.01, " << front + 0.01 << ", 0.01]}\n";
    const std::string probed =
        small_ + "--no-volume --tools " + in("probes.yaml") + " --set solver/iterations=1 --out " + in("p");
    ASSERT_EQ(run(probed), 0) << err_;
    EXPECT_NE(out_.find(" nodes are fixed"), std::string::npos) << out_;
    EXPECT_NE(out_.find(" kg; "), std::string::npos) << out_;
    std::stringstream lines(err_);
    for (std::string line; std::getline(lines, line);) {
        int percent = 0;
        if (std::sscanf(line.c_str(), "%d %%", &percent) == 1) { EXPECT_LE(percent, 100) << line; }
    }
    EXPECT_NE(err_.find("settling"), std::string::npos) << err_;
    auto probes = table(in("p/probes.csv")), steps = table(in("p/steps.csv"));
    ASSERT_EQ(probes.size(), 1 + 2 * steps.size()); // and one row for time 0
    EXPECT_EQ(probes[0][1], "probe");
    EXPECT_EQ(std::stod(probes[1][6]), 0);
    EXPECT_GT(std::stod(probes[probes.size() - 2][6]), 1e-5) << "the wall falls backwards";
    EXPECT_NEAR(std::stod(probes.back()[6]), std::stod(probes.back()[3]) - (front + 0.01), 1e-7);
    auto elements = table(in("p/elements.csv"));
    ASSERT_GT(elements.size(), 100u);
    EXPECT_EQ(elements[0], (std::vector<std::string>{"node_0", "node_1", "node_2", "node_3", "material"}));
    ASSERT_EQ(run(probed + " --quiet --steps 2"), 0) << err_;
    EXPECT_EQ(out_, "");
    std::ofstream(in("off.yaml")) << "probes: [{name: off, at: [0, 9, 0]}]\n";
    EXPECT_EQ(run(small_ + "--quiet --no-volume --steps 1 --tools " + in("off.yaml") + " --out " + in("off")), 1);
    EXPECT_NE(err_.find("probe off: there is no tissue at (0.0000 9.0000 0.0000) m"), std::string::npos) << err_;
}

} // namespace
