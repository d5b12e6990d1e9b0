// Tests of the examples: their output, their length, and that they include public headers only.
#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>
#include <glob.h>
#include <string>
#include <unistd.h>
#include <vector>

namespace {

struct ProgramResult {
    int code;
    std::string text;
};

ProgramResult run(const std::string &arguments)
{
    ProgramResult result{-1, ""};
    FILE *output = popen((PLIANT_EXAMPLES "/example_" + arguments).c_str(), "r");
    if (!output) return result;
    char line[512];
    while (fgets(line, sizeof line, output)) result.text += line;
    result.code = pclose(output);
    return result;
}

std::vector<std::string> sources()
{
    glob_t found{};
    std::vector<std::string> paths;
    for (const char *pattern : {PLIANT_SOURCE_DIR "/src/examples/*.c", PLIANT_SOURCE_DIR "/src/examples/*.h",
                                PLIANT_SOURCE_DIR "/src/examples/*.py"}) {
        if (glob(pattern, 0, nullptr, &found) == 0)
            paths.insert(paths.end(), found.gl_pathv, found.gl_pathv + found.gl_pathc);
        globfree(&found);
    }
    return paths;
}

} // namespace

TEST(Examples, PullAPoint)
{
    const ProgramResult result = run("pull_a_point");
    double moved = 0, force = 0;
    EXPECT_EQ(result.code, 0);
    ASSERT_EQ(
        std::sscanf(result.text.c_str(), "the held point moved %lf mm, and pulls back with %lf N", &moved, &force), 2)
        << result.text;
    EXPECT_GT(moved, 5) << "through a spring of 1000 N/m";
    EXPECT_LT(moved, 10);
    EXPECT_GT(force, 0);
    EXPECT_NE(run("pull_a_point nowhere.nii.gz 2>/dev/null").code, 0);
}

TEST(Examples, CutAPlane)
{
    const ProgramResult result = run("cut_a_plane");
    double plane = 0, knife = 0, force = 0;
    int pieces = 0;
    EXPECT_EQ(result.code, 0);
    ASSERT_EQ(std::sscanf(result.text.c_str(), "a plane: %lf cm^2, %d pieces\na knife: %lf cm^2, felt as up to %lf N",
                          &plane, &pieces, &knife, &force),
              4)
        << result.text;
    EXPECT_GT(plane, 300) << "the whole trunk";
    EXPECT_EQ(pieces, 2);
    EXPECT_NEAR(knife, 16, 4) << "4 cm wide, 4 cm far, in voxels of 5 mm";
    EXPECT_GT(force, 8) << "200 J/m^2 over 4 cm, and more just before it parts";
    EXPECT_LT(force, 40);
}

TEST(Examples, ReadForces)
{
    const ProgramResult result = run("read_forces");
    EXPECT_EQ(result.code, 0);
    double before = 0;
    size_t rows = 0;
    for (size_t at = result.text.find('\n'); at != std::string::npos && at + 1 < result.text.size();
         at = result.text.find('\n', at + 1), ++rows) {
        double pull, x, y, z, residual;
        ASSERT_EQ(std::sscanf(result.text.c_str() + at + 1, "%lf,%lf,%lf,%lf,%lf", &pull, &x, &y, &z, &residual), 5)
            << result.text;
        EXPECT_LT(y, before) << "the force grows with the pull, towards the front";
        before = y;
    }
    EXPECT_EQ(rows, 8u);
}

TEST(Examples, SaveVolume)
{
    const std::string path = ::testing::TempDir() + "pliant_example_" + std::to_string(getpid()) + ".nii.gz";
    EXPECT_EQ(run("save_volume " + path).code, 0);
    std::ifstream file(path, std::ios::ate | std::ios::binary);
    EXPECT_GT(file.tellg(), 10000);
    std::remove(path.c_str());
}

TEST(Examples, TwoSimulations)
{
    const ProgramResult result = run("two_simulations");
    double first = 0, second = 0;
    EXPECT_EQ(result.code, 0);
    ASSERT_EQ(
        std::sscanf(result.text.c_str(), "pulled by 10 and 20 mm: the points moved %lf and %lf mm", &first, &second), 2)
        << result.text;
    EXPECT_GT(second, 1.5 * first);
    EXPECT_GT(first, 5);
}

TEST(Examples, ChangeMaterials)
{
    const ProgramResult result = run("change_materials");
    double before = 0, after = 0;
    EXPECT_EQ(result.code, 0);
    ASSERT_EQ(
        std::sscanf(result.text.c_str(), "1 cm takes %lf N; with organs three times as stiff %lf N", &before, &after),
        2)
        << result.text;
    EXPECT_GT(after, 1.05 * before);
    EXPECT_LT(after, 3.01 * before);
}

TEST(Examples, ErrorAgainstTime)
{
    const ProgramResult result = run("error_against_time");
    double error[4] = {0}, time;
    EXPECT_EQ(result.code, 0);
    ASSERT_EQ(std::sscanf(result.text.c_str(),
                          "iterations,ms_a_step,largest_error_mm 1,%lf,%lf 2,%lf,%lf 4,%lf,%lf 8,%lf,%lf", &time,
                          &error[0], &time, &error[1], &time, &error[2], &time, &error[3]),
              8)
        << result.text;
    EXPECT_LT(error[3], 0.5 * error[0]);
    EXPECT_GT(error[0], 0);
}

TEST(Examples, AreAPageEachAndKnowPublicHeadersOnly)
{
    EXPECT_GE(sources().size(), 6u);
    for (const std::string &path : sources()) {
        std::ifstream file(path);
        int lines = 0;
        for (std::string line; std::getline(file, line); ++lines) {
            if (line.compare(0, 10, "#include \"") != 0) continue;
            EXPECT_TRUE(line.compare(10, 7, "pliant/") == 0 || line == "#include \"example.h\"")
                << path << ": " << line;
        }
        EXPECT_LE(lines, path.compare(path.size() - 3, 3, ".py") == 0 ? 100 : 60) << path;
    }
}
