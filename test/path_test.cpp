// Tests of tool paths: a tool follows its file, and a wrong file is refused with file, line and field.
#include "base/memory.h"
#include "contact/shapes/tool_shape.h"
#include "tool/path.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include "solids.h"

#include <gtest/gtest.h>
#include <string>
#include <unistd.h>

namespace {

class Path : public testing::Test {
protected:
    Path() { close(mkstemp(name_)); }
    ~Path() override
    {
        pliant_path_free(&path_);
        std::remove(name_);
    }
    pliant_status read(const std::string &text)
    {
        std::ofstream(name_) << text;
        return pliant_path_read(name_, &path_);
    }
    void refuses(const std::string &text, const std::string &reason)
    {
        EXPECT_EQ(read(text), PLIANT_ERROR_FORMAT) << text;
        std::string message = pliant_last_error();
        EXPECT_NE(message.find(name_), std::string::npos) << message;
        EXPECT_NE(message.find(reason), std::string::npos) << message << "\n does not say: " << reason;
        EXPECT_EQ(path_.tools, nullptr);
    }
    char name_[32] = "/tmp/pliant_path_XXXXXX";
    pliant_path path_ = {nullptr, 0};
};

const char two_tools[] = "tools:\n"
                         "  - name: grasper\n"
                         "    grasp: [0.01, -0.02, 0.03]\n"
                         "    release: 2.5\n"
                         "    mass: 0.05\n"
                         "    motion: [{time: 0.5, offset: [0, 0, 0]}, {time: 1.5, offset: [0, -0.03, 0.01]}]\n"
                         "  - name: second\n"
                         "    drive: force\n"
                         "    grasp: [0, 0, 0]\n"
                         "    motion:\n"
                         "      - {time: 0, force: [1, 2, 3]}\n";

TEST_F(Path, HoldsWhatTheFileSays)
{
    ASSERT_EQ(read(two_tools), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(path_.num_tools, 2u);
    EXPECT_STREQ(path_.tools[0].name, "grasper");
    EXPECT_EQ(path_.tools[0].drive, PLIANT_DRIVE_SPRING);
    EXPECT_EQ(path_.tools[1].drive, PLIANT_DRIVE_FORCE);
    EXPECT_DOUBLE_EQ(path_.tools[0].grasp[1], -0.02);
    EXPECT_DOUBLE_EQ(path_.tools[0].release, 2.5);
    EXPECT_DOUBLE_EQ(path_.tools[1].release, 0.0);
    EXPECT_DOUBLE_EQ(path_.tools[0].mass, 0.05);
    EXPECT_DOUBLE_EQ(path_.tools[1].mass, 0.0);
    EXPECT_DOUBLE_EQ(pliant_path_end(&path_), 2.5);
}

TEST_F(Path, IsLinearBetweenKeysAndHeldOutside)
{
    ASSERT_EQ(read(two_tools), PLIANT_OK);
    const struct { double time, y, z; bool holds; } cases[] = {
        {0.0, 0.0, 0.0, true}, {0.5, 0.0, 0.0, true}, {0.75, -0.0075, 0.0025, true}, {1.0, -0.015, 0.005, true},
        {1.5, -0.03, 0.01, true}, {2.49, -0.03, 0.01, true}, {2.5, -0.03, 0.01, false},
    };
    for (const auto &c : cases) {
        double offset[3] = {9, 9, 9};
        EXPECT_EQ(pliant_path_at(&path_.tools[0], c.time, offset), c.holds) << c.time;
        EXPECT_NEAR(offset[0], 0.0, 1e-15);
        EXPECT_NEAR(offset[1], c.y, 1e-15) << c.time;
        EXPECT_NEAR(offset[2], c.z, 1e-15) << c.time;
    }
    double force[3];
    EXPECT_TRUE(pliant_path_at(&path_.tools[1], 1e6, force));
    EXPECT_DOUBLE_EQ(force[2], 3.0);
}

TEST_F(Path, RefusesWrongFilesWithFileLineAndField)
{
    const std::string start = "tools:\n  - name: a\n    grasp: [0, 0, 0]\n";
    const std::string motion = "    motion: [{time: 0, offset: [0, 0, 0]}]\n";
    refuses("", "tools");
    refuses("tools: []\n", "tools");
    refuses(start, "motion");
    refuses(start + motion + "    speed: 3\n", "line 5: ");
    refuses("tools:\n  - name: a\n    grasp: [0, 0]\n" + motion, "grasp");
    refuses("tools:\n  - name: a\n    grasp: [0, nan, 0]\n" + motion,
            "line 2: tool 1 'a': grasp: 'nan' is not a number");
    refuses(start + "    drive: magnet\n" + motion, "drive: 'magnet' is neither spring, rigid nor force");
    refuses(start + "    release: 0\n" + motion, "release: 0 s must be more than 0");
    refuses(start + "    motion: [{time: 1, offset: [0, 0, 0]}, {time: 1, offset: [0, 0, 0]}]\n", "motion/time: 1 s");
    refuses(start + motion + "  - name: a\n    grasp: [0, 0, 0]\n" + motion, "line 5: tool 2 'a': name: another tool");
    refuses("tools:\n  - name: ''\n    grasp: [0, 0, 0]\n" + motion, "name: must have 1 to 47 characters");
}

TEST_F(Path, ForcesAreNewtonsAndOffsetsMetres)
{
    const std::string start = "tools:\n  - name: a\n    grasp: [0, 0, 0]\n", force = "    drive: force\n";
    refuses(start + force + "    motion: [{time: 0.5, offset: [0, -0.03, 0]}]\n",
            "line 2: tool 1 'a': motion: drive: force needs a force [N] at every time, as in {time: 0.5, "
            "force: [0, -5, 0]} instead of offset");
    refuses(start + force + "    motion: [{time: 0, force: [0, 0, 0]}, {time: 1}]\n", "{time: 1, force: [0, -5, 0]}");
    refuses(start + force + "    motion: [{time: 0, force: [0, 0, 0], offset: [0, 0, 0]}]\n",
            "motion/offset: a tool of drive: force has only a force");
    refuses(start + "    motion: [{time: 0, force: [0, 0, 0]}]\n", "motion/force: only a tool of drive: force has one");
    refuses(start + "    motion: [{time: 0}]\n", "motion: an offset [m] is missing");
    refuses(start + force + "    motion: [{time: 0, force: [0, x, 0]}]\n", "motion/force: 'x' is not a number");

    static std::string logged;
    pliant_set_log(
        [](pliant_log_level level, const char *message, void *) {
            if (level == PLIANT_LOG_WARNING) logged = message;
        },
        nullptr);
    const struct { std::string motion; std::vector<std::string> words;
    } cases[] = {{force + "    motion: [{time: 0, force: [0, 0, 0]}, {time: 1, force: [0, -0.03, 0]}]\n",
                  {name_, "tool a", "0.03 N", "newtons"}},
                 {"    motion: [{time: 0, offset: [0, 0, 0]}, {time: 1, offset: [0, -30, 0]}]\n",
                  {name_, "tool a", "30 m", "millimetres"}},
                 {force + "    motion: [{time: 0, force: [0, 0, 0]}, {time: 1, force: [0, -3, 0]}]\n", {}},
                 {"    motion: [{time: 0, offset: [0, 0, 0]}, {time: 1, offset: [0, -0.03, 0]}]\n", {}}};
    for (const auto &one : cases) {
        logged.clear();
        EXPECT_EQ(read(start + one.motion), PLIANT_OK) << pliant_last_error();
        pliant_path_free(&path_);
        EXPECT_EQ(logged.empty(), one.words.empty()) << logged;
        for (const std::string &word : one.words) EXPECT_NE(logged.find(word), std::string::npos) << logged;
    }
    pliant_set_log(nullptr, nullptr);
}

TEST_F(Path, TimesCountFromTheStartOfTheRun)
{
    const std::string start = "tools:\n  - name: a\n    grasp: [0, 0, 0]\n",
                      hint = "times count from the start of the run: subtract";
    refuses(start +
                "    motion: [{time: 1732736787.1, offset: [0, 0, 0]}, {time: 1732736787.3, offset: [0, -0.01, 0]}]\n",
            "motion/time is 1732736787.1 s");
    refuses(start + "    motion: [{time: 1732736787123, offset: [0, 0, 0]}]\n", hint);
    refuses(start + "    motion: [{time: 0, offset: [0, 0, 0]}, {time: 1732736787.1, offset: [0, 0, 0]}]\n", hint);
    refuses(start + "    release: 1732736787.1\n    motion: [{time: 0, offset: [0, 0, 0]}]\n",
            "release is 1732736787.1 s");
    refuses("gravity: [{time: 1732736787, acceleration: [0, 0, 0]}]\n", hint);
    refuses("cuts: [{time: 1732736787, points: [[0, 0, 0], [1, 0, 0]], depth: [0, 0, 1]}]\n", hint);
    const std::string blade = "tools:\n  - name: k\n    blade: {name: scalpel}\n";
    refuses(blade + "    poses: [{time: 1732736787.1, position: [0, 0, 0]}]\n", "poses/time is 1732736787.1 s");
    refuses(blade + "    poses: [{time: 0, position: [0, 0, 0]}]\n    cut: [{from: 1732736787, to: 1732736788}]\n",
            "cut/from is 1732736787 s");

    static std::string logged;
    pliant_set_log(
        [](pliant_log_level level, const char *message, void *) {
            if (level == PLIANT_LOG_WARNING) logged += message;
        },
        nullptr);
    ASSERT_EQ(read(start + "    motion: [{time: 12345.5, offset: [0, 0, 0]}, {time: 12346, offset: [0, -0.01, 0]}]\n"),
              PLIANT_OK);
    EXPECT_NE(logged.find("nothing moves before 12345.5 s"), std::string::npos) << logged;
    logged.clear();
    pliant_path_free(&path_);
    ASSERT_EQ(read(start + "    motion: [{time: 20, offset: [0, 0, 0]}, {time: 12346, offset: [0, -0.01, 0]}]\n"),
              PLIANT_OK);
    EXPECT_EQ(logged, "");
    pliant_set_log(nullptr, nullptr);
}

TEST_F(Path, TurnsGravity)
{
    double g[3];
    ASSERT_EQ(read("gravity: [{time: 0, acceleration: [0, 0, -9]}, {time: 2, acceleration: [0, 9, 0]}]\n"), PLIANT_OK)
        << pliant_last_error();
    EXPECT_EQ(path_.num_tools, 0u);
    EXPECT_EQ(pliant_path_end(&path_), 2);
    ASSERT_TRUE(pliant_path_gravity(&path_, 1, g));
    EXPECT_NEAR(g[1], 4.5, 1e-12);
    EXPECT_NEAR(g[2], -4.5, 1e-12);
    ASSERT_TRUE(pliant_path_gravity(&path_, 7, g));
    EXPECT_EQ(g[1], 9);
    pliant_path_free(&path_);
    ASSERT_EQ(read(two_tools), PLIANT_OK);
    EXPECT_FALSE(pliant_path_gravity(&path_, 1, g));
    pliant_path_free(&path_);
    refuses("gravity: [{time: 1, acceleration: [0, 0, 1]}, {time: 1, acceleration: [0, 0, 1]}]\n",
            "line 1: gravity/time: 1 s");
    refuses("{}\n", "is empty");
}

TEST_F(Path, NamesProbes)
{
    ASSERT_EQ(read("probes:\n  - {name: tip, at: [0.01, -0.02, 0.03]}\n  - {name: middle, at: [0, 0, 1e-3]}\n"),
              PLIANT_OK)
        << pliant_last_error();
    ASSERT_EQ(path_.num_probes, 2u);
    EXPECT_STREQ(path_.probes[0].name, "tip");
    EXPECT_DOUBLE_EQ(path_.probes[0].at[1], -0.02);
    EXPECT_DOUBLE_EQ(path_.probes[1].at[2], 1e-3);
    pliant_path_free(&path_);
    refuses("probes:\n  - {name: tip, at: [0.01, -0.02, 0.03]}\n  - {name: middle, at: [0, here, 1e-3]}\n",
            "line 3: probe 2: at: 'here' is not a number");
    refuses("probes:\n  - {name: '', at: [0, 0, 0]}\n", "probe 1: name: must have 1 to 47 characters");
}

const char knife[] = "tools:\n"
                     "  - name: knife\n"
                     "    blade: {from: [0, 0, -0.03], to: [0, 0, 0]}\n"
                     "    poses:\n"
                     "      - {time: 0, position: [0, 0, 0]}\n"
                     "      - {time: 2, position: [0.02, 0, -0.01], rotation: [0, 0, 2, 0]}\n"
                     "    cut: [{from: 0.5, to: 1}, {from: 1.5, to: 3}]\n"
                     "  - name: shears\n"
                     "    blade: {name: scissors}\n"
                     "    poses: [{time: 0, position: [1e-2, 0, 0]}]\n"
                     "cuts:\n"
                     "  - {time: 1, points: [[0, 0, 0], [0.01, 0, 0], [0.02, 0.01, 0]], depth: [0, 0, 0.05]}\n"
                     "  - {time: 4, points: [[0, 0, 0], [0.01, 0, 0]], depth: [0, 0, 0.05]}\n";

TEST_F(Path, LeadsABlade)
{
    ASSERT_EQ(read(knife), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(path_.num_tools, 2u);
    const pliant_path_tool &tool = path_.tools[0];
    double at[3], turned[4];
    EXPECT_DOUBLE_EQ(tool.blade_from[2], -0.03);
    EXPECT_NE(path_.tools[1].blade_from[2], path_.tools[1].blade_to[2]);
    ASSERT_TRUE(pliant_path_pose_at(&tool, 0.5, at, turned));
    EXPECT_NEAR(at[0], 0.005, 1e-12);
    EXPECT_NEAR(at[2], -0.0025, 1e-12);
    EXPECT_NEAR(turned[2], std::sin(M_PI / 8), 1e-12) << "a quarter of half a turn about z: an eighth of a turn";
    EXPECT_NEAR(turned[3], std::cos(M_PI / 8), 1e-12);
    ASSERT_TRUE(pliant_path_pose_at(&tool, 9, at, turned));
    EXPECT_NEAR(at[0], 0.02, 1e-12);
    EXPECT_NEAR(turned[2], 1, 1e-12) << "of length 1";
    const struct {
        double time;
        bool cuts;
    } cases[] = {{0.49, false}, {0.5, true}, {1, true}, {1.01, false}, {2.9, true}, {3.01, false}};
    for (const auto &each : cases) EXPECT_EQ(pliant_path_cuts(&tool, each.time), each.cuts) << each.time;
    EXPECT_FALSE(pliant_path_cuts(&path_.tools[1], 1));
    double value[3];
    EXPECT_FALSE(pliant_path_at(&tool, 1, value)) << "it holds nothing";
    ASSERT_EQ(path_.num_cuts, 2u);
    EXPECT_EQ(path_.cuts[0].num_points, 3u);
    EXPECT_DOUBLE_EQ(path_.cuts[0].points[7], 0.01);
    EXPECT_DOUBLE_EQ(path_.cuts[0].depth[2], 0.05);
    EXPECT_DOUBLE_EQ(pliant_path_end(&path_), 4);
}

TEST_F(Path, RefusesBladesThatCannotCut)
{
    auto with = [](const std::string &from, const std::string &to) {
        std::string text = knife;
        EXPECT_NE(text.find(from), std::string::npos) << from;
        return text.replace(text.find(from), from.size(), to);
    };
    refuses(with("name: scissors", "name: spoon"), "there is no blade 'spoon': scalpel, scissors and hook are known");
    refuses(with("{name: scissors}", "{name: hook, from: [0, 0, 0], to: [0, 0, 1e-2]}"), "blade: needs a name");
    refuses(with("{name: scissors}", "{from: [0, 0, 0]}"), "blade: needs a name");
    refuses(with("    blade: {from: [0, 0, -0.03], to: [0, 0, 0]}\n", ""), "cut: needs a blade");
    refuses(with("[0, 0, 2, 0]", "[0, 0, 0, 0]"), "poses/rotation: is not a rotation");
    refuses(with("time: 2,", "time: 0,"), "poses/time: 0 s must be at least 0 and more than the previous time");
    refuses(with("from: 1.5", "from: 0.8"), "cut: 0.8 s to 3 s must begin after 0 and after the previous cut");
    refuses(with("time: 4", "time: 0.5"), "cut 2: cuts/time: 0.5 s must be at least 0 and more than the previous time");
    refuses(with("[0.02, 0.01, 0]", "[0.02, x, 0]"), "cuts/points: 'x' is not a number");
    refuses(with("    cut: [", "    grasp: [0, 0, 0]\n    cut: ["), "a tool with poses has no grasp");
    refuses("tools: [{name: a, grasp: [0, 0, 0]}]", "a tool needs grasp and motion, or poses");
    refuses("cuts: [{time: 1, points: [[0, 0, 0]], depth: [0, 0, 1]}]", "");
}

const char shaped[] =
    "tools:\n"
    "  - name: driver\n"
    "    shape: {name: LARGE_NEEDLE_DRIVER_400006, offset: [0, 0, 0.001]}\n"
    "    poses: [{time: 0, position: [0, 0, 0]}, {time: 1, position: [0, 0, 0.01], jaw: 0.8}]\n"
    "  - name: own\n"
    "    shape:\n"
    "      parts:\n"
    "        - {kind: sphere, from: [0, 0, -0.01], radius: 0.002}\n"
    "        - {kind: box, from: [0, -0.001, -0.01], to: [0.002, 0.001, 0], moves: jaw_minus, cuts: true}\n"
    "      joint: [0, 0, -0.01]\n"
    "      axis: [0, 1, 0]\n"
    "    poses: [{time: 0, position: [0, 0, 0]}]\n";

TEST_F(Path, ToolsHaveShapesAndJaws)
{
    ASSERT_EQ(read(shaped), PLIANT_OK) << pliant_last_error();
    pliant_tool_shape driver;
    ASSERT_EQ(pliant_tool_shape_find("large_needle_driver", &driver), PLIANT_OK);
    const pliant_tool_shape &first = path_.tools[0].shape, &own = path_.tools[1].shape;
    ASSERT_EQ(first.num_parts, driver.num_parts);
    EXPECT_DOUBLE_EQ(first.part[0].to[2], driver.part[0].to[2] + 0.001);
    EXPECT_DOUBLE_EQ(first.joint[2], driver.joint[2] + 0.001);
    EXPECT_DOUBLE_EQ(pliant_path_jaw_at(&path_.tools[0], 0.25), 0.2);
    EXPECT_DOUBLE_EQ(pliant_path_jaw_at(&path_.tools[0], 5), 0.8);
    ASSERT_EQ(own.num_parts, 2);
    EXPECT_EQ(own.part[0].kind, PLIANT_PART_SPHERE);
    EXPECT_EQ(own.part[1].kind, PLIANT_PART_BOX);
    EXPECT_EQ(own.part[1].frame, PLIANT_FRAME_JAW_MINUS);
    EXPECT_TRUE(own.part[1].cuts);
    EXPECT_FALSE(own.part[0].cuts);
    EXPECT_DOUBLE_EQ(own.part[1].to[0], 0.002);
    EXPECT_DOUBLE_EQ(own.axis[1], 1);
}

TEST_F(Path, RefusesShapesThatAreNone)
{
    auto with = [](const std::string &from, const std::string &to) {
        std::string text = shaped;
        text.replace(text.find(from), from.size(), to);
        return text;
    };
    refuses(with("LARGE_NEEDLE_DRIVER_400006", "large_needle"),
            "line 2: tool 1 'driver': shape/name: there is no instrument 'large_needle': use probe, camera, or a dVRK "
            "instrument by name or code (large_needle_driver");
    refuses(with("LARGE_NEEDLE_DRIVER_400006", "large_needle_driver_x"), "there is no instrument");
    refuses(with("jaw: 0.8", "jaw: wide"), "poses/jaw: 'wide' is not a number");
    refuses(with("kind: box", "kind: cone"),
            "line 5: tool 2 'own': shape/parts/kind: 'cone' is neither sphere, capsule, box, convex nor mesh");
    refuses(with("kind: sphere", "kind: capsule"), "shape/parts: a capsule needs from and to");
    refuses(with(", radius: 0.002", ""), "shape/parts: a sphere needs a radius [m]");
    refuses(with("jaw_minus", "jaw"), "shape/parts/moves: 'jaw' is neither tip, jaw_plus nor jaw_minus");
    refuses(with("to: [0.002, 0.001, 0]", "to: [-0.002, 0.001, 0]"),
            "shape/parts: number 2: axis 0: low 0 must not be above high -0.002");
    refuses(with("      axis: [0, 1, 0]\n", ""), "shape: jaws turn about a joint and an axis");
    refuses(with("{name: LARGE_NEEDLE_DRIVER_400006, offset: [0, 0, 0.001]}", "{offset: [0, 0, 0.001]}"),
            "shape: needs a name");
}

TEST_F(Path, ReadsAShapeFromAFileOfItsOwn)
{
    pliant_tool_shape shape;
    std::ofstream(name_) << "name: probe\noffset: [0, 0, 0.02]\n";
    ASSERT_EQ(pliant_tool_shape_read(name_, &shape), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(shape.num_parts, 1);
    EXPECT_DOUBLE_EQ(shape.part[0].to[2], 0.02 - shape.part[0].radius);
    std::ofstream(name_) << "parts: [{kind: sphere, from: [0, 0, 0], radius: 0.00001}]\n";
    EXPECT_EQ(pliant_tool_shape_read(name_, &shape), PLIANT_ERROR_FORMAT);
    EXPECT_NE(std::string(pliant_last_error())
                  .find(std::string(name_) + ": shape/parts: number 1: it is thinner than 0.1 mm"),
              std::string::npos)
        << pliant_last_error();
    std::ofstream(name_) << "";
    EXPECT_EQ(pliant_tool_shape_read(name_, &shape), PLIANT_ERROR_FORMAT);
    EXPECT_EQ(shape.num_parts, 1) << "as it was";
}

// An STL file in the folder of the path, in millimetres, and a convex hull of points.
TEST_F(Path, PartsMayBeSolids)
{
    const std::string stl = std::string(name_) + ".stl";
    const size_t before = pliant_memory_in_use();
    std::ofstream(stl, std::ios::binary) << binary_stl(corner(), 0.001);
    const std::string text =
        "tools:\n"
        "  - name: own\n"
        "    shape:\n"
        "      parts:\n"
        "        - {kind: mesh, file: " +
        stl.substr(stl.rfind('/') + 1) +
        ", unit: mm, from: [0, 0, -0.02], resolution: 0.001}\n"
        "        - {kind: convex, points: [[0, 0, 0], [0.01, 0, 0], [0, 0.01, 0], [0, 0, 0.01]], "
        "rpy: [0, 0, 3.14159265358979], radius: 0.001}\n"
        "      offset: [0, 0, 0.001]\n"
        "    poses: [{time: 0, position: [0, 0, 0]}]\n";
    ASSERT_EQ(read(text), PLIANT_OK) << pliant_last_error();
    const pliant_tool_shape &shape = path_.tools[0].shape;
    ASSERT_EQ(shape.num_parts, 2);
    EXPECT_EQ(shape.part[0].kind, PLIANT_PART_SOLID);
    EXPECT_DOUBLE_EQ(shape.part[0].from[2], -0.019);
    EXPECT_DOUBLE_EQ(shape.part[1].radius, 0.001);
    pliant_solid_surface mesh, hull;
    pliant_solid_get_surface(shape.part[0].solid, &mesh);
    pliant_solid_get_surface(shape.part[1].solid, &hull);
    EXPECT_NEAR(mesh.volume, (0.02 * 0.006 + 0.014 * 0.006) * 0.008, 1e-12);
    EXPECT_DOUBLE_EQ(mesh.resolution, 0.001);
    EXPECT_TRUE(hull.convex);
    double minimum = 0;
    for (int c = 0; c < 3 * hull.num_points; c++) minimum = std::min(minimum, hull.points[c]);
    EXPECT_NEAR(minimum, -0.01, 1e-12) << "turned about z by half a turn";
    pliant_path_free(&path_);
    EXPECT_EQ(pliant_memory_in_use(), before);
    auto with = [&](const std::string &from, const std::string &to) {
        std::string other = text;
        EXPECT_NE(other.find(from), std::string::npos) << from;
        return other.replace(other.find(from), from.size(), to);
    };
    refuses(with("unit: mm", "unit: inch"), "line 2: tool 1 'own': shape/parts/unit: 'inch' is neither m nor mm");
    refuses(with("unit: mm", "unit: m"), "is 20 m large; is it in millimetres (unit: mm)?");
    refuses(with("file: ", "file: no/"), "cannot be opened");
    refuses(with("file: ", "to: [0, 0, 0], file: "),
            "shape/parts/to: a mesh has only the position of its origin, from");
    refuses(with("kind: convex", "kind: mesh"), "shape/parts: a mesh needs a file (STL)");
    refuses(with("kind: convex", "kind: sphere"),
            "shape/parts: file, unit, resolution, rpy and points belong to kinds convex and mesh, not to a sphere");
    refuses(with("[0, 0, 0.01]]", "[0.01, 0.01, 0]]"), "its points: its points lie in a plane");
    refuses(with(", [0, 0, 0.01]]", "]"), "points");
    std::ofstream(stl, std::ios::binary) << binary_stl(corner(), 0.001).substr(0, 500);
    refuses(text, "it is truncated");
    EXPECT_EQ(pliant_memory_in_use(), before);
    std::remove(stl.c_str());
}

TEST_F(Path, NamesAFileThatIsNotThere)
{
    EXPECT_EQ(pliant_path_read("/nonexistent/path.yaml", &path_), PLIANT_ERROR_FILE);
    EXPECT_NE(std::string(pliant_last_error()).find("/nonexistent/path.yaml"), std::string::npos);
}

TEST_F(Path, SurvivesEveryFailingAllocation)
{
    size_t before = pliant_memory_in_use();
    bool done = false;
    int refused = 0;
    const std::string both = std::string(two_tools) + (knife + sizeof "tools:\n" - 1);
    for (int calls = 0; !done && calls < 1000; ++calls) {
        pliant_memory_fail_after(calls);
        pliant_status status = read(both);
        pliant_memory_fail_after(-1);
        done = status == PLIANT_OK;
        if (done) break;
        ++refused;
        EXPECT_EQ(status, PLIANT_ERROR_MEMORY) << "allocation " << calls << ": " << pliant_last_error();
        EXPECT_EQ(path_.tools, nullptr);
        EXPECT_EQ(pliant_memory_in_use(), before) << "allocation " << calls;
    }
    EXPECT_TRUE(done);
    EXPECT_GT(refused, 10);
    pliant_path_free(&path_);
    EXPECT_EQ(pliant_memory_in_use(), before);
}

TEST_F(Path, DemonstrationPathsAreReadable)
{
    for (const char *name :
         {"demo_pull", "breast_turn", "breast_over", "cut_soft_path", "cut_soft_ct_path", "cut_hang_path",
          "cut_hang_ct_path", "resect_path", "resect_ct_path", "biopsy_path", "incise_path", "open_path",
          "demo_cut_path", "grasp_path", "press_ct_path", "organs_ct_path"}) {
        std::string file = std::string(PLIANT_SOURCE_DIR "/launch/scenes/") + name + ".yaml";
        EXPECT_EQ(pliant_path_read(file.c_str(), &path_), PLIANT_OK) << pliant_last_error();
        pliant_path_free(&path_);
    }
}

} // namespace
