// Identification of moduli from measured displacements: the true moduli lie within the reported confidence interval.
#include "pipeline/body.h"
#include "program.h"

#include "base/memory.h"
#include "mesh/mesh.h"
#include "pliant/report.h"
#include "report/validation.h"

#include <array>
#include <fcntl.h>
#include <fstream>
#include <random>
#include <sstream>
#include <string>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

namespace {

// A clamped bar of two materials in series, with markers, under two loads: across and along.
struct Bar : Body {
    pliant_report_input input;
    pliant_path_key across[1] = {{0, {0, -3, 0}}}, along[1] = {{0, {0, 0, -9}}};
    pliant_path loads[2]{};
    std::vector<pliant_marker> markers;
    Bar(double soft, double stiff)
        : Body(std::array<int, 3>{6, 6, 18}.data(), std::array<double, 3>{0.03, 0.03, 0.09}.data(),
               {{soft, 0.45, 1000, false}, {stiff, 0.4, 1000, false}}, [](int, int, int k) { return k < 9 ? 0 : 1; })
    {
        cells(3, 3, 9, 1);
        fix_plane(0, 0, 1e-6, 0, 0, 1);
        scene.solver.threads = 1;
        input = {&scene, &scan, nullptr, &table};
        loads[0].gravity = across;
        loads[1].gravity = along;
        loads[0].num_gravity = loads[1].num_gravity = 1;
        for (int load = 0; load < 2; load++)
            for (int n = 0; n < 24; n++) {
                pliant_marker one{};
                one.load = load;
                one.rest[0] = 0.002 + 0.006 * (n % 4 + 0.5);
                one.rest[1] = n % 2 ? 0.027 : 0.004;
                one.rest[2] = 0.012 + 0.003 * n;
                one.deviation = 2e-5;
                markers.push_back(one);
            }
    }
    pliant_moduli_data measured() const { return {2, loads, static_cast<int32_t>(markers.size()), markers.data()}; }
};

// Simulate the marker displacements of a bar with these moduli.
void measure(Bar *bar, unsigned seed)
{
    std::mt19937 random(seed);
    std::normal_distribution<double> noise(0, 2e-5);
    ASSERT_EQ(bar->build(), PLIANT_OK) << pliant_last_error();
    for (int load = 0; load < 2; load++) {
        ASSERT_EQ(pliant_data_reset(bar->model, bar->data), PLIANT_OK);
        ASSERT_EQ(pliant_data_set_gravity(bar->data, bar->loads[load].gravity[0].value), PLIANT_OK);
        ASSERT_EQ(bar->settle(200), PLIANT_OK);
        for (pliant_marker &marker : bar->markers) {
            if (marker.load != load) continue;
            double weights[4];
            int32_t tet = pliant_mesh_locate(&bar->model->body->fine, marker.rest, weights);
            ASSERT_GE(tet, 0);
            for (int d = 0; d < 3; d++) {
                marker.moved[d] = noise(random) - marker.rest[d];
                for (int v = 0; v < 4; v++)
                    marker.moved[d] +=
                        weights[v] * bar->data->positions[3 * bar->model->body->fine.tets[4 * tet + v] + d];
            }
        }
    }
}

TEST(Moduli, TwoAreRecoveredFromNoisyMarkersWithinTheirConfidence)
{
    int inside = 0;
    for (unsigned seed = 1; seed <= 4; seed++) {
        Bar true_one(20e3, 7e3), bar(8e3, 15e3);
        measure(&true_one, seed);
        bar.markers = true_one.markers;
        const pliant_moduli_data data = bar.measured();
        const char *names[2] = {"m0", "m1"};
        pliant_moduli found;
        ASSERT_EQ(pliant_moduli_fit(&bar.input, &data, 2, names, {nullptr, nullptr}, &found), PLIANT_OK)
            << pliant_last_error();
        std::printf(
            "20 and 7 kPa: %.0f (%.0f to %.0f) and %.0f (%.0f to %.0f) Pa, misfit %.2f, correlation %.2f, %d passes\n",
            found.young[0], found.low[0], found.high[0], found.young[1], found.low[1], found.high[1], found.misfit,
            found.correlation[0][1], found.passes);
        EXPECT_NEAR(found.young[0], 20e3, 400);
        EXPECT_NEAR(found.young[1], 7e3, 400);
        EXPECT_NEAR(found.misfit, 1, 0.4);
        EXPECT_LT(found.high[0] / found.low[0], 1.05);
        EXPECT_NEAR(found.rms, 2e-5 * std::sqrt(3.0), 5e-6);
        inside += found.low[0] < 20e3 && found.high[0] > 20e3;
        inside += found.low[1] < 7e3 && found.high[1] > 7e3;
        EXPECT_EQ(bar.table.materials[0].young_modulus, 8e3) << "the caller's table stays";
    }
    EXPECT_GE(inside, 7); // of 8 intervals, at 95 % confidence
}

TEST(Moduli, RefusesUnidentifiableModuli)
{
    Bar bar(20e3, 7e3);
    pliant_moduli found;
    pliant_moduli_data data = bar.measured();
    const char *nobody[1] = {"bone"}, *second[1] = {"m1"};
    EXPECT_EQ(pliant_moduli_fit(&bar.input, &data, 1, nobody, {nullptr, nullptr}, &found), PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::string(pliant_last_error()).find("no material bone"), std::string::npos);
    bar.markers[3].rest[0] = 5;
    EXPECT_EQ(pliant_moduli_fit(&bar.input, &data, 1, second, {nullptr, nullptr}, &found), PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::string(pliant_last_error()).find("marker 4: there is no tissue"), std::string::npos)
        << pliant_last_error();
    bar.markers[3].deviation = 0;
    EXPECT_EQ(pliant_moduli_fit(&bar.input, &data, 1, second, {nullptr, nullptr}, &found), PLIANT_ERROR_ARGUMENT);
    data.num_markers = 0;
    EXPECT_EQ(pliant_moduli_fit(&bar.input, &data, 1, second, {nullptr, nullptr}, &found), PLIANT_ERROR_ARGUMENT);
}

// Positions instead of displacements, wrong axes, millimetres: the fit warns or refuses.
TEST(Moduli, AMisfitFarAboveTheDeviationWarns)
{
    static std::string warnings;
    pliant_set_log(
        [](pliant_log_level level, const char *text, void *) {
            if (level == PLIANT_LOG_WARNING) warnings += text;
        },
        nullptr);
    const auto fit = [](Bar &bar) {
        pliant_moduli found;
        const pliant_moduli_data data = bar.measured();
        const char *names[2] = {"m0", "m1"};
        warnings.clear();
        return pliant_moduli_fit(&bar.input, &data, 2, names, {nullptr, nullptr}, &found);
    };
    Bar good(20e3, 7e3), positions(20e3, 7e3), turned(20e3, 7e3), millimetres(20e3, 7e3), far(20e3, 7e3);
    for (Bar *bar : {&good, &positions, &turned, &millimetres, &far}) measure(bar, 1);
    EXPECT_GE(fit(good), 0) << pliant_last_error();
    EXPECT_EQ(warnings.find("do not trust"), std::string::npos) << warnings;
    for (pliant_marker &m : positions.markers)
        for (int d = 0; d < 3; d++) m.moved[d] += m.rest[d];
    EXPECT_GE(fit(positions), 0) << pliant_last_error();
    EXPECT_NE(warnings.find("do not trust these moduli; moved_x, moved_y and moved_z look like positions"),
              std::string::npos)
        << warnings;
    for (pliant_marker &m : turned.markers) std::swap(m.moved[0], m.moved[1]);
    EXPECT_GE(fit(turned), 0) << pliant_last_error();
    EXPECT_NE(warnings.find("do not trust these moduli; check the markers"), std::string::npos) << warnings;
    for (pliant_marker &m : millimetres.markers)
        for (double &x : m.moved) x *= 1000;
    millimetres.markers[0].line = 7;
    EXPECT_EQ(fit(millimetres), PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::string(pliant_last_error()).find("marker "), std::string::npos) << pliant_last_error();
    EXPECT_NE(std::string(pliant_last_error()).find("millimetres; divide them by 1000"), std::string::npos)
        << pliant_last_error();
    far.markers[2].line = 4;
    for (double &x : far.markers[2].rest) x *= 1000;
    EXPECT_EQ(fit(far), PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::string(pliant_last_error()).find("marker 3 (line 4): there is no tissue"), std::string::npos)
        << pliant_last_error();
    EXPECT_NE(std::string(pliant_last_error()).find("seems to be in millimetres"), std::string::npos)
        << pliant_last_error();
    pliant_set_log(nullptr, nullptr);
}

TEST(Moduli, MarkersAreRead)
{
    char name[] = "/tmp/pliant_markers_XXXXXX";
    close(mkstemp(name));
    std::ofstream(name)
        << "load,x,y,z,moved_x,moved_y,moved_z,deviation\n# a comment\n1,0.01,0.02,0.03,0,-0.001,0\n"
           "2,0.01,0.02,0.03,0,-0.001,0,1e-4\n";
    int32_t count;
    pliant_marker *markers;
    ASSERT_EQ(pliant_markers_read(name, 3e-4, &count, &markers), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(count, 2);
    EXPECT_EQ(markers[0].load, 0);
    EXPECT_EQ(markers[0].deviation, 3e-4);
    EXPECT_EQ(markers[1].load, 1);
    EXPECT_EQ(markers[1].deviation, 1e-4);
    EXPECT_EQ(markers[1].moved[1], -0.001);
    pliant_free(markers);
    std::ofstream(name) << "1,0.01,0.02\n";
    EXPECT_EQ(pliant_markers_read(name, 3e-4, &count, &markers), PLIANT_ERROR_FORMAT);
    EXPECT_NE(std::string(pliant_last_error()).find("line 1"), std::string::npos);
    for (const char *same :
         {"\xEF\xBB\xBFload,x,y,z,moved_x,moved_y,moved_z\n1,0.01,0.02,0.03,0,-0.001,0\n",
          "\xEF\xBB\xBF"
          "1,0.01,0.02,0.03,0,-0.001,0\r\n",
          "load;x;y;z;moved_x;moved_y;moved_z\n1;0,01;0,02;0,03;0;-0,001;0\n", "1\t0.01\t0.02\t0.03\t0\t-0.001\t0\n",
          "Load,x,y,z,mx,my,mz,deviation\n\n1, 0.01 ,0.02,0.03,0,-0.001,0,\n"}) {
        std::ofstream(name) << same;
        ASSERT_EQ(pliant_markers_read(name, 3e-4, &count, &markers), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(count, 1) << same;
        EXPECT_EQ(markers[0].load, 0) << same;
        EXPECT_EQ(markers[0].rest[2], 0.03) << same;
        EXPECT_EQ(markers[0].moved[1], -0.001) << same;
        EXPECT_EQ(markers[0].deviation, 3e-4) << same;
        pliant_free(markers);
    }
    const char *const wrong[][3] = {
        {"1,0.01,0.02,0.03,0,nan,0", "line 3: moved_y is 'nan', not a finite number", "delete the line"},
        {"1,0.01,0.02,0.03,0,,0", "line 3: moved_y is '', not a finite number", "delete the line"},
        {"1,0.01,0.02,0.03,0,-0.001 mm,0", "line 3: moved_y is '-0.001 mm'", "not a finite number"},
        {"1,10.2,-35.1,30,0,-1,0", "line 3: x is 10.2 m", "millimetres: divide"},
        {"0,0.01,0.02,0.03,0,0,0", "line 3: load is 0", "whole number from 1"},
        {"1.5,0.01,0.02,0.03,0,0,0", "line 3: load is 1.5", "whole number from 1"},
        {"1,0.01,0.02,0.03,0,0,0,0", "line 3: deviation is 0", "above 0"},
        {"1,0.01,0.02,0.03,0,0", "line 3: it has 6 cells", "write load,x,y,z,moved_x,moved_y,moved_z"},
        {"1,0.01,0.02,0.03,0,0,0,1e-3,7", "line 3: it has more than 8 cells", "write load,x,y,z"}};
    for (auto &one : wrong) {
        std::ofstream(name) << "load,x,y,z,moved_x,moved_y,moved_z,deviation\n1,0.01,0.02,0.03,0,0,0\n"
                            << one[0] << "\n";
        EXPECT_EQ(pliant_markers_read(name, 3e-4, &count, &markers), PLIANT_ERROR_FORMAT) << one[0];
        for (const char *word : {static_cast<const char *>(name), one[1], one[2]})
            EXPECT_NE(std::string(pliant_last_error()).find(word), std::string::npos) << pliant_last_error();
    }
    std::remove(name);
    EXPECT_EQ(pliant_markers_read("/nonexistent.csv", 3e-4, &count, &markers), PLIANT_ERROR_FILE);
}

// The measured beam: three markers at the tip of a clamped silicone beam under its own weight. The literature value is
// 264 kPa.
TEST(Moduli, OfTheMeasuredBeam)
{
    std::ifstream file(PLIANT_TEST_DATA "/beam/gravity_markers.csv");
    if (!file) GTEST_SKIP() << "no measured beam in " PLIANT_TEST_DATA;
    std::vector<pliant_marker> markers;
    std::vector<std::array<double, 3>> rest;
    // points of the surface below the markers' balls
    const double surface[3][3] = {{0.1, 0.015, 0.03}, {0.1, 0, 0.024}, {0.1, 0.03, 0.0065}};
    for (std::string line; std::getline(file, line);) {
        if (line.find(",Tip-") == std::string::npos) continue;
        std::stringstream cells(line);
        std::vector<std::string> cell;
        for (std::string one; std::getline(cells, one, ',');) cell.push_back(one);
        const int number = cell[2][4] - '1';
        const std::array<double, 3> at = {std::stod(cell[7]), std::stod(cell[8]), std::stod(cell[9])};
        if (cell[3] == "rest") {
            rest.resize(3);
            rest[static_cast<size_t>(number)] = at;
            continue;
        }
        pliant_marker one{};
        for (int d = 0; d < 3; d++) {
            one.rest[d] = surface[number][d];
            one.moved[d] = at[static_cast<size_t>(d)] - rest[static_cast<size_t>(number)][static_cast<size_t>(d)];
        }
        one.deviation = 1e-3; // accuracy of the measured rest state
        markers.push_back(one);
    }
    ASSERT_EQ(markers.size(), 6u);
    double young[2];
    for (pliant_element_kind kind : {PLIANT_LINEAR, PLIANT_HEXAHEDRA}) {
        Body beam(std::array<int, 3>{20, 6, 6}.data(), std::array<double, 3>{0.1, 0.03, 0.03}.data(),
                  {{150e3, 0.499, 1070, false}});
        beam.cells(10, 3, 3, 1);
        beam.fix_plane(0, 0, 0, 1, 0, 0);
        beam.scene.element.kind = kind;
        beam.scene.model.gravity[2] = -9.807;
        const pliant_report_input input = {&beam.scene, &beam.scan, nullptr, &beam.table};
        const pliant_moduli_data data = {1, nullptr, 6, markers.data()};
        const char *names[1] = {"m0"};
        pliant_moduli found;
        ASSERT_EQ(pliant_moduli_fit(&input, &data, 1, names, {nullptr, nullptr}, &found), PLIANT_OK)
            << pliant_last_error();
        std::printf("%s: %.1f kPa (%.1f to %.1f), off by %.2f mm\n", kind == PLIANT_LINEAR ? "linear" : "hexahedra",
                    1e-3 * found.young[0], 1e-3 * found.low[0], 1e-3 * found.high[0], 1e3 * found.rms);
        young[kind == PLIANT_HEXAHEDRA] = found.young[0];
    }
    EXPECT_LT(young[0], 0.8 * young[1]) << "tetrahedra that lock in bending ask for soft tissue";
    EXPECT_NEAR(young[1], 263.8e3, 0.1 * 263.8e3);
}

// Read the first body of a folder.
pliant_status read_first(const std::string &folder, measured_body *out)
{
    measured_source *sources = nullptr;
    int32_t count = 0;
    pliant_status status = measured_bodies_find(folder.c_str(), &count, &sources);
    if (status >= 0) status = measured_body_read(sources, out);
    pliant_free(sources);
    return status;
}

// A ball on a stem of 6 mm at the tip of a bending beam. The stem rotates with the tip, as two points across the tip
// show.
TEST(Validation, AMarkerThatStandsOffTurnsWithTheTissue)
{
    Body beam(std::array<int, 3>{20, 6, 6}.data(), std::array<double, 3>{0.1, 0.03, 0.03}.data(),
              {{150e3, 0.45, 1070, false}});
    beam.cells(10, 3, 3, 1);
    beam.fix_plane(0, 0, 0, 1, 0, 0);
    beam.scene.element.kind = PLIANT_HEXAHEDRA;
    beam.scene.model.gravity[2] = -9.8;
    ASSERT_EQ(beam.build(), PLIANT_OK) << pliant_last_error();
    pliant_marker markers[4]{};
    const double at[4][3] = {{0.1, 0.015, 0.03}, {0.1, 0.015, 0.03}, {0.1, 0.015, 0}, {0.1, 0, 0.015}};
    for (int m = 0; m < 4; m++) std::memcpy(markers[m].rest, at[m], sizeof at[m]);
    markers[0].offset[2] = 0.006;
    markers[3].offset[1] = -0.006; // at the side, parallel to the bending axis: the rotation does not move it
    double moved[12];
    ASSERT_EQ(report_markers_move(beam.model, nullptr, 0, 4, markers, moved), PLIANT_OK) << pliant_last_error();
    const double *top = moved + 3, *bottom = moved + 6;
    const double lean = std::atan2(top[0] - bottom[0], 0.03 + top[2] - bottom[2]);
    EXPECT_GT(lean, 0.05);
    EXPECT_NEAR(moved[0] - top[0], 0.006 * std::sin(lean), 0.05 * 0.006 * lean);
    EXPECT_NEAR(moved[2] - top[2], 0.006 * (std::cos(lean) - 1), 0.05 * 0.006 * lean);
    EXPECT_NEAR(moved[1] - top[1], 0, 1e-6);
    EXPECT_NEAR(moved[10], 0, 2e-5);
}

// A user's folder with two loads. The fit uses the first one, and predicts the second one within the noise.
TEST(Validation, PredictsTheLoadThatWasNotFittedOn)
{
    Bar bar(20e3, 7e3);
    measure(&bar, 1);
    char folder[] = "/tmp/pliant_validation_XXXXXX";
    ASSERT_NE(mkdtemp(folder), nullptr);
    const std::string in = std::string(folder) + "/";
    ASSERT_EQ(pliant_volume_write((in + "scan.nrrd").c_str(), &bar.scan), PLIANT_OK) << pliant_last_error();
    std::ofstream(in + "materials.yaml")
        << "materials:\n  - {name: m0, range: [-0.5, 0.5], young_modulus: 19000, poisson_ratio: 0.45, density: 1000}\n"
           "  - {name: m1, range: [0.5, 1.5], young_modulus: 7500, poisson_ratio: 0.4, density: 1000}\n";
    std::ofstream(in + "scene.yaml")
        << "material: {file: " << in
        << "materials.yaml}\nmesh: {coarse_cells: [3, 3, 9], ratio: 1}\nelement: {kind: linear}\n"
           "fixed: {planes: [{point: [0, 0, 1.0e-6], normal: [0, 0, 1]}]}\n";
    std::ofstream(in + "load_1.yaml") << "gravity:\n  - {time: 0, acceleration: [0, -3, 0]}\n";
    std::ofstream(in + "load_2.yaml") << "gravity:\n  - {time: 0, acceleration: [0, 0, -9]}\n";
    std::ofstream markers(in + "markers.csv");
    markers.precision(12);
    for (const pliant_marker &m : bar.markers)
        markers << m.load + 1 << "," << m.rest[0] << "," << m.rest[1] << "," << m.rest[2] << "," << m.moved[0] << ","
                << m.moved[1] << "," << m.moved[2] << ",2e-5\n";
    markers.close();
    pliant_report_tables tables{};
    ASSERT_EQ(pliant_report_open(nullptr, &tables), PLIANT_OK);
    ASSERT_EQ(pliant_validation_run(folder, 0, nullptr, &tables, {nullptr, nullptr}), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_results_rows(tables.validation), 2u);
    const auto cell = [&](size_t row, const char *name) {
        return std::string(pliant_results_cell(tables.validation, row, pliant_results_column(tables.validation, name)));
    };
    EXPECT_EQ(cell(0, "role"), "fitted");
    EXPECT_EQ(cell(1, "role"), "predicted");
    EXPECT_EQ(cell(1, "state"), "load 2");
    for (size_t row = 0; row < 2; row++)
        EXPECT_NEAR(std::stod(cell(row, "rms_mm")), 0.02 * std::sqrt(3.0), 0.01) << row;
    EXPECT_GT(std::stod(cell(1, "moved_rms_mm")), 0.3);
    EXPECT_EQ(cell(1, "fitted").find("E of m0 "), 0u) << cell(1, "fitted");
    EXPECT_NEAR(std::stod(cell(1, "fitted").substr(8)), 20, 0.2);
    for (size_t rows : {2u, 3u}) { // a second run finds the result of the same data; new measurements add a row
        ASSERT_EQ(pliant_validation_run(folder, 0, nullptr, &tables, {nullptr, nullptr}), PLIANT_OK)
            << pliant_last_error();
        EXPECT_EQ(pliant_results_rows(tables.validation), rows);
        std::ofstream again(in + "markers.csv");
        for (const pliant_marker &m : bar.markers)
            if (m.load == 0)
                again << "1," << m.rest[0] << "," << m.rest[1] << "," << m.rest[2] << "," << m.moved[0] << ","
                      << m.moved[1] << "," << m.moved[2] << "\n";
    }
    pliant_report_close(&tables);
    std::ofstream(in + "markers.csv") << "0,0.01,0.01,0.01,0,0,0\n";
    measured_body body;
    EXPECT_EQ(read_first(folder, &body), PLIANT_ERROR_FORMAT);
    std::remove((in + "scene.yaml").c_str());
    EXPECT_EQ(read_first(folder, &body), PLIANT_ERROR_FILE);
    EXPECT_NE(std::string(pliant_last_error()).find("gravity_markers.csv"), std::string::npos) << pliant_last_error();
    EXPECT_EQ(read_first("/nonexistent", &body), PLIANT_ERROR_FILE);
    std::ofstream(in + "gravity_markers.csv") << "recording,marker,state,beam_x,beam_y\n";
    EXPECT_EQ(read_first(folder, &body), PLIANT_ERROR_FORMAT);
    EXPECT_NE(std::string(pliant_last_error()).find("beam_z"), std::string::npos) << pliant_last_error();
    std::ofstream(in + "gravity_markers.csv")
        << "recording,marker,state,beam_x,beam_y,beam_z\na,Tip-1,rest,0,0.015,nan\n";
    EXPECT_EQ(read_first(folder, &body), PLIANT_ERROR_FORMAT);
    EXPECT_NE(std::string(pliant_last_error()).find("line 2"), std::string::npos) << pliant_last_error();
    EXPECT_EQ(std::system(("rm -r " + std::string(folder)).c_str()), 0);
}

// A cube with other compressions, another order, lost beads and another name: the table's header decides.
TEST(Validation, ACubeHasTheStatesThatItsTableNames)
{
    char folder[] = "/tmp/pliant-cube-XXXXXX";
    ASSERT_NE(mkdtemp(folder), nullptr);
    std::string file = std::string(folder) + "/beads.csv";
    const auto write = [&](const char *header, int beads) {
        std::ofstream out(file);
        out << "a cube\n" << header << "\ni,j,k,x0,y0,z0,x1,y1,z1,x2,y2,z2\n";
        for (int n = 0; n < beads; n++) {
            out << n << ",1,1," << n << ",2,10," << n << ",2,7," << n;
            out << (n == 3 ? ",,\n" : ",2,8\n");
        }
    };
    measured_body body;
    write("place,,,no strain,,,30% strain,,,2.5% strain,,", 12);
    ASSERT_EQ(read_first(folder, &body), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(body.num_states, 2);
    EXPECT_EQ(body.num_markers, 23);
    EXPECT_STREQ(body.state[0], "30 %");
    EXPECT_STREQ(body.state[1], "2.5 %");
    EXPECT_NEAR(body.markers[0].moved[2], -0.003, 1e-12);
    EXPECT_NEAR(body.markers[1].moved[2], -0.002, 1e-12);
    EXPECT_NEAR(body.load[0].tools[0].motion[1].value[2], -0.024, 1e-12);
    EXPECT_NEAR(body.load[1].tools[0].motion[1].value[2], -0.002, 1e-12);
    measured_body_free(&body);
    write("place,,,no strain,,,30% strain,,,2.5% strain,,", 4);
    EXPECT_EQ(read_first(folder, &body), PLIANT_ERROR_FORMAT);
    EXPECT_NE(std::string(pliant_last_error()).find("3 beads at 2.5 %"), std::string::npos) << pliant_last_error();
    write("place,,,no strain,,,30% strain,,,2.5% strain,,", 120);
    EXPECT_EQ(read_first(folder, &body), PLIANT_ERROR_FORMAT);
    EXPECT_NE(std::string(pliant_last_error()).find("up to 119 mm apart"), std::string::npos) << pliant_last_error();
    file = std::string(folder) + "/truthcube.csv"; // a cube by its file name; the table has no strain
    write("place,,,no strain,,,pressed,,,pressed more,,", 12);
    std::remove((std::string(folder) + "/beads.csv").c_str());
    EXPECT_EQ(read_first(folder, &body), PLIANT_ERROR_FORMAT);
    EXPECT_NE(std::string(pliant_last_error()).find("% strain"), std::string::npos) << pliant_last_error();
    EXPECT_EQ(std::system(("rm -r " + std::string(folder)).c_str()), 0);
}

// Tables with any names, in the folder or a subfolder, in spreadsheet formats, with fewer columns and other markers.
TEST(Validation, BeamsAreDetectedByTheirColumns)
{
    char folder[] = "/tmp/pliant-beams-XXXXXX";
    ASSERT_NE(mkdtemp(folder), nullptr);
    const std::string in = std::string(folder) + "/", first = in + "series/b.csv";
    ASSERT_EQ(mkdir((in + "series").c_str(), 0700), 0);
    std::ofstream(in + "notes.csv") << "what,where\nbeams,series\n";
    std::ofstream(first)
        << "\xEF\xBB\xBF# measured\r\n\"marker\";\"state\"; beam_z ;beam_y;beam_x\r\nBase-1;rest;0;0;-0.1\r\n"
           "left;rest;0.036;0.01;-0.02\r\nleft;half way;0.03;0.01;-0.02\r\n"
           "left;end;0.031;0.01;-0.021\r\ntip;rest;0.015;0.015;0\r\n;;;;\r\n";
    std::ofstream(in + "series/a.CSV")
        << "recording,marker,state,beam_x,beam_y,beam_z\none,m,rest,0,0.015,0.036\none,m,end,0,0.015,0.03\n"
           "two,m,end,0,0.015,0.03\ntwo,m,rest,0,0.015,0.037\n";
    measured_source *sources = nullptr;
    int32_t count = 0;
    ASSERT_EQ(measured_bodies_find(folder, &count, &sources), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(count, 2);
    measured_body a, b;
    ASSERT_EQ(measured_body_read(sources, &a), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(measured_body_read(sources + 1, &b), PLIANT_OK) << pliant_last_error();
    EXPECT_STREQ(a.name, "silicone beam, a");
    EXPECT_STREQ(b.name, "silicone beam, b");
    EXPECT_EQ(a.num_states, 2);
    ASSERT_EQ(a.num_markers, 2);
    EXPECT_NEAR(a.markers[1].moved[2], -0.007, 1e-12);
    EXPECT_EQ(b.num_states, 1);
    ASSERT_EQ(b.num_markers, 1);
    EXPECT_NEAR(b.markers[0].rest[0], 0.08, 1e-12);
    EXPECT_NEAR(b.markers[0].offset[2], 0.006, 1e-12);
    EXPECT_NE(a.bytes, b.bytes);
    measured_body_free(&a);
    measured_body_free(&b);
    pliant_free(sources);
    // a table in the folder itself comes first
    std::ofstream(in + "c.csv") << "marker,state,beam_x,beam_y,beam_z\nm,rest,-20,10,36\nm,end,-20,10,30\n";
    EXPECT_EQ(read_first(folder, &a), PLIANT_ERROR_FORMAT);
    EXPECT_NE(std::string(pliant_last_error()).find("c.csv: line 2: marker m"), std::string::npos)
        << pliant_last_error();
    std::ofstream(in + "c.csv") << "marker,beam_x,beam_y,beam_z\nm,-0.02,0.01,0.036\n";
    EXPECT_EQ(read_first(folder, &a), PLIANT_ERROR_FORMAT);
    EXPECT_NE(std::string(pliant_last_error()).find("there is no column state"), std::string::npos)
        << pliant_last_error();
    EXPECT_EQ(std::system(("rm -r " + std::string(folder)).c_str()), 0);
}

// A file has one separator. Next to semicolons or in quotes, a comma is a decimal comma. A cell with two commas is not
// a number.
TEST(Validation, DecimalCommasAndQuotedCellsAreReadAsTheyAreMeant)
{
    char folder[] = "/tmp/pliant-commas-XXXXXX";
    ASSERT_NE(mkdtemp(folder), nullptr);
    const std::string file = std::string(folder) + "/beads.csv";
    const auto write = [&](const char *at) {
        std::ofstream out(file);
        out << "bead;no strain;;;12,5% strain;;\n";
        for (int n = 0; n < 6; n++) out << "\"a;b\";" << n << "0,5;2;" << at << ";" << n << "0,5;2;7,25\n";
    };
    measured_body body;
    write("1,25e1");
    ASSERT_EQ(read_first(folder, &body), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(body.num_markers, 6);
    EXPECT_STREQ(body.state[0], "12.5 %");
    EXPECT_NEAR(body.markers[5].rest[0] - body.markers[0].rest[0], 0.05, 1e-12);
    EXPECT_NEAR(body.markers[3].moved[2], 1e-3 * (7.25 - 12.5), 1e-12);
    EXPECT_NEAR(body.markers[3].moved[0], 0, 1e-12);
    measured_body_free(&body);
    write("1,234,5");
    EXPECT_EQ(read_first(folder, &body), PLIANT_ERROR_FORMAT);
    std::remove(file.c_str());
    std::ofstream(std::string(folder) + "/beam.csv")
        << "recording,marker,\"state, of two\",state,beam_x,beam_y,beam_z\n"
           "\"one, of two\",m,\"a \"\"b\"\", c\",rest,\"-0,02\",0.015,0.036\n"
           "\"one, of two\",m,,end,\"-0,02\",0.015,\"0,03\"\n";
    ASSERT_EQ(read_first(folder, &body), PLIANT_OK) << pliant_last_error();
    EXPECT_STREQ(body.state[0], "one, of two");
    ASSERT_EQ(body.num_markers, 1);
    EXPECT_NEAR(body.markers[0].rest[0], 0.08, 1e-12);
    EXPECT_NEAR(body.markers[0].moved[2], -0.006, 1e-12);
    measured_body_free(&body);
    std::ofstream(std::string(folder) + "/beam.csv")
        << "marker;state;beam_x;beam_y;beam_z\nm;rest;-0,02;0,015;0,036\nm;end;-0,02;0,0,15;0,03\n";
    EXPECT_EQ(read_first(folder, &body), PLIANT_ERROR_FORMAT);
    EXPECT_NE(std::string(pliant_last_error()).find("line 3"), std::string::npos) << pliant_last_error();
    EXPECT_EQ(std::system(("rm -r " + std::string(folder)).c_str()), 0);
}

// Notes that mention strain are not a cube. A folder that cannot be opened does not stop the search.
TEST(Validation, OtherFilesAreIgnored)
{
    char folder[] = "/tmp/pliant-notes-XXXXXX";
    ASSERT_NE(mkdtemp(folder), nullptr);
    const std::string in = std::string(folder) + "/";
    std::ofstream(in + "materials.csv")
        << "name,law\nliver,\"constrained at 5 % of length, no strain gauge\"\n5% strain rate,x\n";
    std::ofstream(in + "z.csv")
        << "marker,state,beam_x,beam_y,beam_z\nm,rest,-0.02,0.01,0.03\nm,end,-0.02,0.01,0.025\n";
    measured_source *sources = nullptr;
    int32_t count = 0;
    ASSERT_EQ(measured_bodies_find(folder, &count, &sources), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(count, 1);
    EXPECT_NE(std::string(sources->path).find("z.csv"), std::string::npos) << sources->path;
    pliant_free(sources);
    std::remove((in + "z.csv").c_str());
    ASSERT_EQ(mkdir((in + "closed").c_str(), 0700), 0);
    const int next = open("/dev/null", O_RDONLY); // allow one more open file: the folder itself
    ASSERT_GE(next, 0);
    close(next);
    rlimit before{};
    ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
    const rlimit one_more = {static_cast<rlim_t>(next) + 1, before.rlim_max};
    std::string logged;
    pliant_set_log([](pliant_log_level, const char *text, void *out) { *static_cast<std::string *>(out) += text; },
                   &logged);
    ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &one_more), 0);
    const pliant_status status = measured_bodies_find(folder, &count, &sources);
    setrlimit(RLIMIT_NOFILE, &before);
    pliant_set_log(nullptr, nullptr);
    EXPECT_EQ(status, PLIANT_ERROR_FILE);
    EXPECT_NE(std::string(pliant_last_error()).find("no measurements found"), std::string::npos) << pliant_last_error();
    EXPECT_NE(logged.find("/closed: "), std::string::npos) << logged;
    EXPECT_EQ(std::system(("rm -r " + std::string(folder)).c_str()), 0);
}

// Read the measurements in the test data. pliant_report --validate simulates them.
TEST(Validation, MeasuredBodiesAreRead)
{
    measured_body body;
    if (read_first(PLIANT_TEST_DATA "/reference", &body) < 0) GTEST_SKIP() << "no measured cube in " PLIANT_TEST_DATA;
    EXPECT_EQ(body.num_states, 3);
    EXPECT_EQ(body.num_markers, 3 * 343);
    double lowest = 1, highest = 0;
    for (int32_t m = 0; m < body.num_markers; m++) {
        lowest = std::fmin(lowest, body.markers[m].rest[2]);
        highest = std::fmax(highest, body.markers[m].rest[2]);
    }
    EXPECT_NEAR(lowest, 0.08 - highest, 0.002); // the beads are in the middle of the cube
    measured_body_free(&body);
    ASSERT_EQ(read_first(PLIANT_TEST_DATA "/beam", &body), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(body.num_states, 2);
    ASSERT_EQ(body.num_markers, 6);
    EXPECT_LT(body.markers[0].moved[2], -0.006);
    EXPECT_NEAR(body.markers[0].offset[2], 0.006, 0.001);
    EXPECT_EQ(body.markers[0].rest[2], 0.03);
    measured_body_free(&body);
}

class Fit : public Program {
protected:
    Fit() : Program(PLIANT_FIT_PROGRAM) {}
};

// The nodes of pliant_deform serve as the measurement. The search starts at another modulus.
TEST_F(Fit, RecoversTheModuliOfAnotherProgram)
{
    const std::string scene =
        " --scan phantom:48x40x40 --set 'mesh/coarse_cells=5 4 4' --set mesh/ratio=1 --set 'model/gravity=0 9.81 0' "
        "--set solver/threads=1";
    const auto table = [](double fat, double muscle) {
        std::ostringstream text;
        text
            << "materials:\n  - {name: air, empty: true, range: [-2000, -300], young_modulus: 1, poisson_ratio: 0.3, "
               "density: 1}\n  - {name: fat, range: [-300, 0], young_modulus: "
            << fat
            << ", poisson_ratio: 0.45, density: 950}\n  - {name: muscle, range: [0, 250], young_modulus: " << muscle
            << ", poisson_ratio: 0.45, density: 1050}\n  - {name: bone, fixed: true, range: [250, 4000], "
               "young_modulus: 1e9, poisson_ratio: 0.3, density: 1800}\n";
        return text.str();
    };
    std::ofstream(in("true.yaml")) << table(3000, 9000);
    std::ofstream(in("start.yaml")) << table(5000, 5000);
    ASSERT_EQ(std::system((std::string(PLIANT_DEFORM) + scene +
                           " --quiet --no-volume --set solver/tolerance=1e-7 --set material/file=" + in("true.yaml") +
                           " --out " + in("d"))
                              .c_str()),
              0);
    std::ifstream nodes(in("d/nodes.csv"));
    std::ofstream markers(in("markers.csv"));
    markers.precision(12);
    int row = 0;
    for (std::string line; std::getline(nodes, line); row++) {
        double x[6];
        if (row % 5 == 0 ||
            std::sscanf(line.c_str(), "%lf,%lf,%lf,%lf,%lf,%lf", x, x + 1, x + 2, x + 3, x + 4, x + 5) != 6)
            continue;
        markers << "1," << x[0] << "," << x[1] << "," << x[2] << "," << x[3] - x[0] << "," << x[4] - x[1] << ","
                << x[5] - x[2] << "\n";
    }
    markers.close();
    ASSERT_EQ(run(scene + " --set material/file=" + in("start.yaml") + " --markers " + in("markers.csv") +
                  " --deviation 1e-5 --materials fat,muscle --out " + in("f")),
              0)
        << err_;
    std::ifstream result(in("f/moduli.csv"));
    std::string line;
    std::getline(result, line);
    EXPECT_EQ(line, "material,young_modulus_pa,low_pa,high_pa,misfit,rms_m,correlation_fat,correlation_muscle");
    for (double truth : {3000.0, 9000.0}) {
        ASSERT_TRUE(std::getline(result, line));
        EXPECT_NEAR(std::stod(line.substr(line.find(',') + 1)), truth, 0.01 * truth) << line;
    }
    EXPECT_NE(out_.find("95 % between"), std::string::npos) << out_;
}

TEST_F(Fit, ExitCodesDistinguishWrongUsageFromFailure)
{
    EXPECT_EQ(run("--help"), 0);
    EXPECT_EQ(run("--scan phantom --markers x"), 2);
    EXPECT_EQ(run("--scan phantom --markers /nonexistent.csv --materials fat --out " + in("x")), 1);
    EXPECT_NE(err_.find("/nonexistent.csv"), std::string::npos) << err_;
}

} // namespace
