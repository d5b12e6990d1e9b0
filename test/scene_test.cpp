/* Tests of scenes: defaults, YAML, option paths, checks, and the error messages of refused scenes. */
#include "model_data/data.h"
#include "base/memory.h"
#include "scene/scene.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <limits>
#include <locale.h>
#include <string>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

namespace {

pliant_scene defaults()
{
    pliant_scene scene;
    memset(&scene, 0x5a, sizeof scene);
    pliant_scene_defaults(&scene);
    return scene;
}

pliant_scene parsed(const std::string &yaml, const char *base = nullptr)
{
    pliant_scene scene = defaults();
    EXPECT_EQ(pliant_scene_parse(yaml.c_str(), "s.yaml", base, &scene), PLIANT_OK) << pliant_last_error();
    return scene;
}

void expect_words(const std::string &message, std::initializer_list<const char *> words)
{
    for (const char *word : words)
        EXPECT_NE(message.find(word), std::string::npos) << "\"" << word << "\" in: " << message;
}

/* Expect a failure with this status and these words. The output must stay unchanged. */
void refused(const std::string &yaml, pliant_status status, std::initializer_list<const char *> words)
{
    pliant_scene scene, before;
    memset(&scene, 0x5a, sizeof scene);
    memcpy(&before, &scene, sizeof scene);
    EXPECT_EQ(pliant_scene_parse(yaml.c_str(), "s.yaml", nullptr, &scene), status) << yaml;
    EXPECT_EQ(memcmp(&scene, &before, sizeof scene), 0) << "output written on failure";
    expect_words(pliant_last_error(), {"s.yaml"});
    expect_words(pliant_last_error(), words);
}

/* The reader stops at its size limit, even for endless files. */
TEST(SceneFile, ThatNeverEndsIsRefused)
{
    pliant_scene scene;
    size_t in_use = pliant_memory_in_use();
    EXPECT_EQ(pliant_scene_read("/dev/zero", &scene), PLIANT_ERROR_FORMAT);
    EXPECT_NE(std::string(pliant_last_error()).find("/dev/zero: does not end within 64 MiB"), std::string::npos)
        << pliant_last_error();
    char folder[] = "/tmp/pliant_scene_XXXXXX";
    ASSERT_NE(mkdtemp(folder), nullptr);
    const std::string huge = std::string(folder) + "/huge.yaml", pipe = std::string(folder) + "/pipe.yaml";
    std::ofstream(huge).seekp(3LL << 30).put('\n'); /* a sparse file needs no space on disk */
    EXPECT_EQ(pliant_scene_read(huge.c_str(), &scene), PLIANT_ERROR_FORMAT);
    EXPECT_NE(std::string(pliant_last_error()).find("does not end within"), std::string::npos) << pliant_last_error();
    ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
    pid_t writer = fork();
    if (writer == 0) {
        execlp("sh", "sh", "-c", ("exec yes '# nothing' > " + pipe).c_str(), static_cast<char *>(nullptr));
        _exit(127);
    }
    EXPECT_EQ(pliant_scene_read(pipe.c_str(), &scene), PLIANT_ERROR_FORMAT);
    EXPECT_NE(std::string(pliant_last_error()).find("does not end within"), std::string::npos) << pliant_last_error();
    waitpid(writer, nullptr, 0); /* the writer ends because nobody reads */
    EXPECT_LT(pliant_memory_peak() - in_use, 150u << 20);
    EXPECT_EQ(pliant_memory_in_use(), in_use);
    unlink(huge.c_str());
    unlink(pipe.c_str());
    rmdir(folder);
}

} // namespace

TEST(scene, defaults_are_in_range)
{
    pliant_scene scene = defaults();
    EXPECT_EQ(pliant_scene_check(&scene), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(scene.mesh.coarse_cells[2], 7);
    EXPECT_EQ(scene.solver.tolerance, 1e-3);
    EXPECT_EQ(scene.model.method, PLIANT_FINE);
    EXPECT_STREQ(scene.material.file, "");
    EXPECT_FALSE(scene.mesh.keep_air);
    EXPECT_EQ(scene.fixed.num_boxes, 0u);
}

TEST(scene, reads_every_kind_and_keeps_what_is_not_named)
{
    pliant_scene scene = parsed("mesh:\n"
                                "  coarse_cells: [12, 6, 5]\n"
                                "  ratio: 3\n"
                                "  keep_air: true\n"
                                "model: {method: averaged, gravity: [0, 9.81, -1e-2]}\n"
                                "solver: {backend: cpu, tolerance: 1.0e-5}\n"
                                "material: {file: \"a # b.yaml\"} # a comment\n"
                                "output: {scalar: von_mises}\n"
                                "fixed:\n"
                                "  boxes: [{low: [0, 0, 0], high: [1, 2, 3]}, {low: [-1, -1, -1], high: [0, 0, 0]}]\n"
                                "  planes:\n"
                                "    - {point: [0, 0.1, 0], normal: [0, -1, 0]}\n"
                                "obstacles:\n"
                                "  planes: [{point: [0, 0, 0.2], normal: [0, 0, 1]}]\n"
                                "  boxes: [{low: [0, 0, 0.5], high: [1, 2, 3]}]\n");
    ASSERT_EQ(scene.obstacles.num_boxes, 1u);
    ASSERT_EQ(scene.obstacles.num_planes, 1u);
    EXPECT_EQ(scene.obstacles.boxes[0].low[2], 0.5);
    EXPECT_EQ(scene.obstacles.planes[0].point[2], 0.2);
    EXPECT_EQ(scene.mesh.coarse_cells[0], 12);
    EXPECT_EQ(scene.mesh.coarse_cells[2], 5);
    EXPECT_EQ(scene.mesh.ratio, 3);
    EXPECT_TRUE(scene.mesh.keep_air);
    EXPECT_EQ(scene.model.method, PLIANT_AVERAGED);
    EXPECT_EQ(scene.model.gravity[1], 9.81);
    EXPECT_EQ(scene.model.gravity[2], -1e-2);
    EXPECT_EQ(scene.solver.backend, PLIANT_CPU);
    EXPECT_EQ(scene.solver.tolerance, 1e-5);
    EXPECT_EQ(scene.solver.iterations, 6);
    EXPECT_STREQ(scene.material.file, "a # b.yaml");
    EXPECT_EQ(scene.output.scalar, PLIANT_SCALAR_VON_MISES);
    ASSERT_EQ(scene.fixed.num_boxes, 2u);
    EXPECT_EQ(scene.fixed.boxes[0].high[2], 3);
    EXPECT_EQ(scene.fixed.boxes[1].low[0], -1);
    ASSERT_EQ(scene.fixed.num_planes, 1u);
    EXPECT_EQ(scene.fixed.planes[0].point[1], 0.1);
    EXPECT_EQ(scene.fixed.planes[0].normal[1], -1);
}

TEST(scene, an_empty_one_is_the_defaults)
{
    pliant_scene a = defaults(), b = parsed(""), c = parsed("# nothing\n");
    EXPECT_EQ(memcmp(&a, &b, sizeof a), 0);
    EXPECT_EQ(memcmp(&a, &c, sizeof a), 0);
}

TEST(scene, errors_name_file_line_field_value_and_range)
{
    refused("mesh:\n  ratoi: 2\n", PLIANT_ERROR_FORMAT,
            {"line 2", "ratoi", "mesh", "coarse_cells, ratio, depth, purity, keep_air"});
    refused("solver: {}\nmash: {}\n", PLIANT_ERROR_FORMAT, {"line 2", "mash", "mesh", "fixed"});
    refused("mesh:\n  # ratio: 1\n  ratio: 9\n", PLIANT_ERROR_SCENE, {"line 3", "mesh/ratio", "'9'", "1 .. 8"});
    refused("mesh: {ratio: 2.5}\n", PLIANT_ERROR_SCENE, {"line 1", "mesh/ratio", "2.5"});
    refused("mesh:\n  ratio: 3x\n", PLIANT_ERROR_SCENE, {"line 2", "3x"});
    refused("mesh:\n  ratio: 99999999999999999999\n", PLIANT_ERROR_SCENE, {"line 2", "mesh/ratio"});
    refused("mesh:\n  ratio: [2]\n", PLIANT_ERROR_FORMAT, {"line 2", "mesh/ratio"});
    refused("material:\n  slides: [liver, stomach]\n", PLIANT_ERROR_FORMAT,
            {"line 2", "material/slides", "is a list", "use one value, without brackets"});
    EXPECT_STREQ(parsed("material: {slides: \"liver, stomach\"}").material.slides, "liver, stomach");
    EXPECT_STREQ(parsed("material:\n  slides: liver, stomach\n").material.slides, "liver, stomach");
    refused("mesh:\n  ratio: 2\n  ratio: 3\n", PLIANT_ERROR_FORMAT, {"ratio"});
    refused("mesh:\n  coarse_cells: [7, 7]\n", PLIANT_ERROR_FORMAT,
            {"line 2", "mesh/coarse_cells has 2 values", "use a list of 3 values"});
    refused("mesh:\n  coarse_cells: [7, 7, 7, 7]\n", PLIANT_ERROR_FORMAT,
            {"line 2", "mesh/coarse_cells has more than 3 values", "use a list of 3"});
    refused("mesh: {coarse_cells: 7, ratio: 2}\n", PLIANT_ERROR_FORMAT,
            {"line 1", "mesh/coarse_cells is one value '7'", "use a list of 3 values"});
    refused("mesh:\n  coarse_cells: 7 7 7 # along i, j, k\n", PLIANT_ERROR_FORMAT,
            {"line 2", "mesh/coarse_cells is one value '7 7 7'", "use a list"});
    refused("mesh:\n  coarse_cells:\n", PLIANT_ERROR_FORMAT,
            {"line 2", "mesh/coarse_cells is empty", "use a list of 3 values"});
    refused("mesh:\n  ratio: {a: 2}\n", PLIANT_ERROR_FORMAT,
            {"line 2", "mesh/ratio is a group of keys", "use one value"});
    refused("mesh: 3\n", PLIANT_ERROR_FORMAT, {"line 1", "mesh is one value '3'", "use keys with values"});
    refused("fixed:\n  boxes: {low: [0, 0, 0], high: [1, 1, 1]}\n", PLIANT_ERROR_FORMAT,
            {"line 2", "fixed/boxes is a group of keys", "use a list"});
    refused("mesh:\n  coarse_cells: [7, 7, 0]\n", PLIANT_ERROR_SCENE,
            {"line 2", "mesh/coarse_cells", "'0'", "1 .. 256"});
    refused("mesh:\n  keep_air: perhaps\n", PLIANT_ERROR_SCENE, {"line 2", "mesh/keep_air", "perhaps", "true | false"});
    refused("model:\n  method: exact\n", PLIANT_ERROR_SCENE,
            {"line 2", "exact", "fine | coarse | schur | averaged | lod"});
    refused("model:\n  gravity: [0, 0, nan]\n", PLIANT_ERROR_SCENE, {"line 2", "model/gravity", "nan"});
    refused("model:\n  gravity: [0, 0, 1e5]\n", PLIANT_ERROR_SCENE, {"line 2", "100000", "-10000 .. 10000"});
    refused("solver:\n  tolerance: 0\n", PLIANT_ERROR_SCENE, {"line 2", "solver/tolerance", "1e-12 .. 1"});
    refused("material:\n  file: " + std::string(300, 'x') + "\n", PLIANT_ERROR_SCENE,
            {"line 2", "material/file", "255"});
    refused("fixed:\n  boxes:\n    - {low: [0, 0, 0], high: [1, 1, 1]}\n    - {low: [0, 2, 0], high: [1, 1, 1]}\n",
            PLIANT_ERROR_SCENE, {"line 4", "low", "axis 1", "less than"});
    refused("fixed: {planes: [{point: [0, 0, 0], normal: [0, 0, 0]}]}\n", PLIANT_ERROR_SCENE,
            {"line 1", "normal", "zero"});
    refused("fixed: {planes: [{point: [0, 0, 0], normal: [1e200, 0, 1e200]}]}\n", PLIANT_ERROR_SCENE,
            {"planes", "finite"});
    refused("fixed: {planes: [{point: [0, 0, 0]}]}\n", PLIANT_ERROR_FORMAT, {"line 1", "normal"});
    refused(
        "fixed:\n  boxes: [{low: [0, 0, 0], high: [1, 1, 1]}]\nobstacles:\n  boxes:\n"
        "    - {low: [0, 0, 0], high: [1, 0, 1]}\n",
        PLIANT_ERROR_SCENE, {"line 5", "obstacles/boxes/low", "axis 1"});
    refused("obstacles: {spheres: []}\n", PLIANT_ERROR_FORMAT, {"line 1", "spheres"});
    refused("cut:\n  kind: subdivide\n  snap: 0.2\n", PLIANT_ERROR_FORMAT,
            {"line 3", "cut/snap", "was removed", "0.1 of the shortest edge"});
    refused("model: {lod_seconds: 10}\n", PLIANT_ERROR_FORMAT, {"line 1", "model/lod_seconds", "300 s"});
    refused("model: {lod_memory: 10}\n", PLIANT_ERROR_FORMAT, {"line 1", "model/lod_memory", "4096 MiB"});
    refused("warp: {fit_step: 2}\n", PLIANT_ERROR_FORMAT, {"line 1", "warp/fit_step", "4 voxels"});
    refused("contact:\n  punishment: 0.2\n", PLIANT_ERROR_FORMAT,
            {"line 2", "punishment", "use contact/overlap_damping"});
    refused("model: {touch: face}\n", PLIANT_ERROR_FORMAT, {"line 1", "model/touch", "use model/submesh"});
    refused("segment: {most_classes: 3}\n", PLIANT_ERROR_FORMAT, {"segment/most_classes", "use segment/max_classes"});
    refused("segment: {smallest: auto}\n", PLIANT_ERROR_FORMAT, {"segment/smallest", "use segment/min_volume"});
    refused("mesh: [\n", PLIANT_ERROR_FORMAT, {"line 1"});
    refused("- 1\n", PLIANT_ERROR_FORMAT, {"MAPPING"});
}

TEST(scene, too_many_fixed_boxes)
{
    std::string yaml = "fixed:\n  boxes:\n";
    for (int i = 0; i < PLIANT_MAX_FIXED + 1; ++i) yaml += "    - {low: [0, 0, 0], high: [1, 1, 1]}\n";
    refused(yaml, PLIANT_ERROR_FORMAT, {"boxes", "32"});
}

TEST(scene, files_are_relative_to_the_scene)
{
    const std::string yaml = "material: {file: ../materials/m.yaml, labels: /data/l.nii.gz}\n";
    EXPECT_STREQ(parsed(yaml).material.file, "../materials/m.yaml");
    EXPECT_STREQ(parsed(yaml, "scenes").material.file, "scenes/../materials/m.yaml");
    EXPECT_STREQ(parsed(yaml, "scenes/").material.file, "scenes/../materials/m.yaml");
    EXPECT_STREQ(parsed(yaml, "scenes").material.labels, "/data/l.nii.gz");
    EXPECT_STREQ(parsed("mesh: {ratio: 2}", "scenes").material.file, "");

    std::string folder = testing::TempDir(), path = folder + "/pliant_scene_test.yaml";
    std::ofstream(path) << yaml;
    pliant_scene scene;
    ASSERT_EQ(pliant_scene_read(path.c_str(), &scene), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(std::string(scene.material.file), folder + "/../materials/m.yaml");
    std::remove(path.c_str());
    EXPECT_EQ(pliant_scene_read(path.c_str(), &scene), PLIANT_ERROR_FILE);
    expect_words(pliant_last_error(), {path.c_str()});
    refused("material: {file: m.yaml}\nmaterials: {}\n", PLIANT_ERROR_FORMAT, {"materials"});
}

TEST(scene, a_path_that_grows_too_long_is_refused)
{
    pliant_scene scene;
    std::string yaml = "material:\n  file: " + std::string(200, 'x') + "\n", base(100, 'y');
    EXPECT_EQ(pliant_scene_parse(yaml.c_str(), "s.yaml", base.c_str(), &scene), PLIANT_ERROR_SCENE);
    expect_words(pliant_last_error(), {"line 2", "material/file", "255"});
}

TEST(scene, set_by_path)
{
    pliant_scene scene = defaults();
    EXPECT_EQ(pliant_scene_set(&scene, "solver/iterations", "4"), PLIANT_OK);
    EXPECT_EQ(scene.solver.iterations, 4);
    EXPECT_EQ(pliant_scene_set(&scene, "mesh/coarse_cells", "[3, 4,5]"), PLIANT_OK);
    EXPECT_EQ(scene.mesh.coarse_cells[1], 4);
    EXPECT_EQ(pliant_scene_set(&scene, "model/gravity", " 0 9.81\t0 "), PLIANT_OK);
    EXPECT_EQ(scene.model.gravity[1], 9.81);
    EXPECT_EQ(pliant_scene_set(&scene, "model/method", "schur"), PLIANT_OK);
    EXPECT_EQ(scene.model.method, PLIANT_SCHUR);
    EXPECT_EQ(pliant_scene_set(&scene, "mesh/keep_air", "yes"), PLIANT_OK);
    EXPECT_TRUE(scene.mesh.keep_air);
    EXPECT_EQ(pliant_scene_set(&scene, "scan/series", "1.2.3 [4]"), PLIANT_OK);
    EXPECT_STREQ(scene.scan.series, "1.2.3 [4]");
    EXPECT_EQ(pliant_scene_set(&scene, "scan/series", ""), PLIANT_OK);
    EXPECT_STREQ(scene.scan.series, "");

    const pliant_scene before = scene;
    const char *const bad[][2] = {{"solver/iteration", "4"},
                                  {"solver", "4"},
                                  {"solver/iterations/", "4"},
                                  {"", ""},
                                  {"solver/iterations", ""},
                                  {"solver/iterations", "4 5"},
                                  {"solver/iterations", "0"},
                                  {"mesh/coarse_cells", "7"},
                                  {"mesh/coarse_cells", "7 7 7 7"},
                                  {"mesh/coarse_cells", "5 5 0"},
                                  {"model/gravity", "0 0 inf"},
                                  {"model/method", "Fine"},
                                  {"mesh/keep_air", "2"}};
    for (auto &option : bad) {
        EXPECT_EQ(pliant_scene_set(&scene, option[0], option[1]), PLIANT_ERROR_SCENE) << option[0] << " " << option[1];
        EXPECT_EQ(memcmp(&scene, &before, sizeof scene), 0) << option[0];
    }
    EXPECT_EQ(pliant_scene_set(&scene, "model/gravity", std::string(1000, '1').c_str()), PLIANT_ERROR_SCENE);
    EXPECT_EQ(pliant_scene_set(&scene, "solver/tolerance", "7"), PLIANT_ERROR_SCENE);
    expect_words(pliant_last_error(), {"solver/tolerance", "7", "1e-12 .. 1"});
}

TEST(scene, names_option_value_and_remedy)
{
    pliant_scene scene = defaults();
    const char *const bad[][4] = {
        {"mesh/coarse_cells", "7", "'7' is 1 value", "three whole numbers in 1 .. 256 cells, as [7, 7, 7]"},
        {"mesh/coarse_cells", "[7, 8]", "'7 8' is 2 values", "three whole numbers"},
        {"mesh/coarse_cells", "7 7 7 7", "'7 7 7 ...' is 4 values", "three whole numbers"},
        {"mesh/coarse_cells", "7x7x7", "'7x7x7' is 1 value", "three whole numbers"},
        {"mesh/coarse_cells", "", "'' is 0 values", "three whole numbers"},
        {"model/gravity", "9.81", "'9.81' is 1 value", "three numbers in -10000 .. 10000 m/s^2, as [0, 0, 1]"}};
    for (auto &one : bad) {
        EXPECT_EQ(pliant_scene_set(&scene, one[0], one[1]), PLIANT_ERROR_SCENE) << one[1];
        expect_words(pliant_last_error(), {one[0], one[2], one[3]});
    }
}

TEST(scene, a_byte_order_mark_is_no_text)
{
    const std::string path = testing::TempDir() + "/pliant_scene_mark.yaml";
    pliant_scene scene;
    std::ofstream(path) << "\xEF\xBB\xBFmesh: {ratio: 3}\n";
    ASSERT_EQ(pliant_scene_read(path.c_str(), &scene), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(scene.mesh.ratio, 3);
    std::ofstream(path) << "\xEF\xBB\xBFmesh: {ratio: 99}\n";
    EXPECT_EQ(pliant_scene_read(path.c_str(), &scene), PLIANT_ERROR_SCENE);
    expect_words(pliant_last_error(), {"line 1", "mesh/ratio"});
    std::ofstream(path) << std::string("\xFF\xFEm\0e\0s\0h\0", 10);
    EXPECT_EQ(pliant_scene_read(path.c_str(), &scene), PLIANT_ERROR_FORMAT);
    expect_words(pliant_last_error(), {"UTF-16", "save it as UTF-8"});
    std::remove(path.c_str());
}

TEST(scene, check_catches_scenes_made_by_hand)
{
    auto fails = [](void (*spoil)(pliant_scene *), const char *option) {
        pliant_scene scene = defaults();
        spoil(&scene);
        EXPECT_EQ(pliant_scene_check(&scene), PLIANT_ERROR_SCENE) << option;
        expect_words(pliant_last_error(), {option});
    };
    fails([](pliant_scene *s) { s->mesh.ratio = 0; }, "mesh/ratio");
    fails([](pliant_scene *s) { s->mesh.coarse_cells[2] = 257; }, "mesh/coarse_cells");
    fails([](pliant_scene *s) { s->model.gravity[1] = std::numeric_limits<double>::quiet_NaN(); }, "model/gravity");
    fails([](pliant_scene *s) { s->model.method = static_cast<pliant_method>(7); }, "model/method");
    fails([](pliant_scene *s) { memset(s->scan.series, 'x', sizeof s->scan.series); }, "scan/series");
    fails([](pliant_scene *s) { s->fixed.num_boxes = 1; }, "fixed/boxes");
    fails([](pliant_scene *s) { s->fixed.num_planes = 1; }, "fixed/planes");
    fails([](pliant_scene *s) { s->fixed.num_planes = 99; }, "fixed");
}

/* Every option against its own description: the default in words is the default, and values outside of the range
 * fail. */
TEST(scene, options_describe_themselves)
{
    size_t count;
    const pliant_option_info *options = pliant_scene_options(&count);
    const pliant_scene before = defaults();
    ASSERT_GT(count, 20u);
    for (size_t i = 0; i < count; ++i) {
        const pliant_option_info &o = options[i];
        std::string path = std::string(o.group) + "/" + o.name, kind = o.kind;
        pliant_scene scene = before;
        EXPECT_GT(strlen(o.text), 5u) << path;
        EXPECT_EQ(pliant_scene_set(&scene, path.c_str(), o.default_value), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(memcmp(&scene, &before, sizeof scene), 0) << path;
        if (kind == "string" || kind == "bool" || kind == "choice") continue;
        char value[128];
        auto set = [&](double number) {
            if (kind.back() == '3') snprintf(value, sizeof value, "%.17g %.17g %.17g", number, number, number);
            else snprintf(value, sizeof value, "%.17g", number);
            return pliant_scene_set(&scene, path.c_str(), value);
        };
        double step = kind.substr(0, 3) == "int" ? 1 : 1e-9 + 1e-9 * std::abs(o.high);
        EXPECT_LT(o.low, o.high) << path;
        EXPECT_EQ(set(o.low), PLIANT_OK) << path << " " << value;
        EXPECT_EQ(set(o.high), PLIANT_OK) << path << " " << value;
        EXPECT_EQ(set(o.low - step), PLIANT_ERROR_SCENE) << path << " " << value;
        EXPECT_EQ(set(o.high + step), PLIANT_ERROR_SCENE) << path << " " << value;
    }
}

TEST(scene, a_decimal_comma_in_the_locale_changes_nothing)
{
    if (!setlocale(LC_NUMERIC, "de_DE.UTF-8") && !setlocale(LC_NUMERIC, "fr_FR.UTF-8"))
        GTEST_SKIP() << "no such locale here";
    pliant_scene scene = parsed("solver: {step: 0.25}\n");
    setlocale(LC_NUMERIC, "C");
    EXPECT_EQ(scene.solver.step, 0.25);
}

// element/kind: auto selects hexahedra, unless an option needs tetrahedra.
TEST(scene, auto_elements_are_what_the_scene_can_have)
{
    struct row {
        std::vector<std::pair<const char *, const char *>> options;
        const char *why; // NULL: hexahedra
    };
    const row rows[] = {
        {{}, nullptr},
        {{{"model/method", "averaged"}}, nullptr},
        {{{"solver/kind", "tled"}, {"cut/kind", "sever"}}, nullptr},
        {{{"mesh/kind", "octree"}}, nullptr},
        {{{"model/patch", "0.05"}}, nullptr}, // the fine mesh has no patch
        {{{"contact/self", "true"}}, "contact/self"},
        {{{"tled/nodal_pressure", "true"}}, nullptr}, // the corotational solver ignores it
        {{{"model/method", "schur"}}, nullptr},
        {{{"model/method", "lod"}}, nullptr},
        {{{"model/method", "coarse"}, {"model/patch", "0.05"}}, nullptr},
        {{{"cut/kind", "subdivide"}}, "cut/kind"},
        {{{"cut/kind", "sever"}}, nullptr},
        {{{"mesh/kind", "octree"}, {"cut/kind", "sever"}}, nullptr},
        {{{"mesh/kind", "octree"}, {"solver/kind", "tled"}}, nullptr},
        {{{"solver/kind", "tled"}, {"tled/nodal_pressure", "true"}}, "tled/nodal_pressure"},
    };
    for (const row &r : rows) {
        pliant_scene scene;
        pliant_scene_defaults(&scene);
        for (const auto &option : r.options)
            ASSERT_EQ(pliant_scene_set(&scene, option.first, option.second), PLIANT_OK) << pliant_last_error();
        const char *why = "";
        EXPECT_EQ(pliant_scene_element_kind(&scene, &why), r.why ? PLIANT_LINEAR : PLIANT_HEXAHEDRA);
        EXPECT_EQ(why != nullptr, r.why != nullptr);
        if (why && r.why) EXPECT_EQ(std::string(why).compare(0, std::strlen(r.why), r.why), 0) << why;
        for (pliant_element_kind kind : {PLIANT_LINEAR, PLIANT_HEXAHEDRA}) { // an explicit kind is not changed
            scene.element.kind = kind;
            EXPECT_EQ(pliant_scene_element_kind(&scene, nullptr), kind);
        }
    }
}

TEST(scene, path_of_a_removed_option_says_what_holds)
{
    pliant_scene scene = defaults();
    EXPECT_EQ(pliant_scene_set(&scene, "warp/fit_step", "2"), PLIANT_ERROR_SCENE);
    expect_words(pliant_last_error(), {"warp/fit_step", "was removed", "4 voxels"});
    EXPECT_EQ(pliant_scene_set(&scene, "contact/punishment", "0.2"), PLIANT_ERROR_SCENE);
    expect_words(pliant_last_error(), {"contact/punishment", "was renamed; use contact/overlap_damping"});
}

TEST(scene, every_shipped_scene_is_valid)
{
    for (const char *name :
         {"abdomen_ct", "abdomen_labels", "biopsy", "breast", "breast_prone", "cut_hang", "cut_hang_ct", "demo",
          "demo_cut", "fall", "fall_soft", "fall_soft_ct", "grasp", "hang", "hang_soft", "hang_soft_ct", "organs_ct",
          "paper_256", "paper_524", "press_ct", "resect", "resect_ct"}) {
        pliant_scene scene;
        std::string path = std::string(PLIANT_SOURCE_DIR "/launch/scenes/") + name + ".yaml";
        ASSERT_EQ(pliant_scene_read(path.c_str(), &scene), PLIANT_OK) << pliant_last_error();
        pliant_material_table table;
        if (!scene.material.file[0]) continue;
        ASSERT_EQ(pliant_material_table_read(scene.material.file, &table), PLIANT_OK) << pliant_last_error();
        pliant_material_table_free(&table);
    }
}

std::string text_of(const pliant_scene &scene)
{
    std::string text(pliant_scene_text(&scene, 0, nullptr), '\0');
    EXPECT_EQ(pliant_scene_text(&scene, text.size() + 1, &text[0]), text.size());
    return text;
}

TEST(scene, text_of_a_scene_reads_back_identically)
{
    pliant_scene scene = defaults();
    scene.model.gravity[1] = 1.0 / 3;
    scene.grasp.stiffness = 123456.789012345678;
    scene.mesh.coarse_cells[2] = 17;
    scene.grasp.kind = PLIANT_GRASP_BLOB;
    scene.cut.kind = PLIANT_CUT_SEVER;
    scene.contact.self = true;
    strcpy(scene.material.labels,
           "/a folder/with \"quotes\", a \\ and: a colon # or so,\ttab, \n line, \x01 and \x7f, \xc3\xa4.nii.gz");
    scene.fixed.num_boxes = 2;
    scene.fixed.boxes[0] = {{-0.1, 0, 1e-300}, {0.1, 1.0 / 7, 5}};
    scene.fixed.boxes[1] = {{-1, -1, -1}, {1, 1, 1}};
    scene.obstacles.num_planes = 1;
    scene.obstacles.planes[0] = {{0.3, 0, 0}, {0, -1, 0.1}};
    const std::string text = text_of(scene);
    const pliant_scene again = parsed(text);
    EXPECT_EQ(memcmp(&again.fixed, &scene.fixed, sizeof scene.fixed), 0) << text;
    EXPECT_EQ(memcmp(&again.obstacles, &scene.obstacles, sizeof scene.obstacles), 0) << text;
    EXPECT_EQ(text_of(again), text);
    EXPECT_STREQ(again.material.labels, scene.material.labels);
    EXPECT_EQ(again.model.gravity[1], scene.model.gravity[1]);
    EXPECT_EQ(again.grasp.stiffness, scene.grasp.stiffness);
    EXPECT_EQ(again.grasp.kind, PLIANT_GRASP_BLOB);
    EXPECT_EQ(again.mesh.coarse_cells[2], 17);
    EXPECT_EQ(again.cut.kind, PLIANT_CUT_SEVER);
    EXPECT_TRUE(again.contact.self);
    EXPECT_STREQ(again.material.labels, scene.material.labels);
    char few[10];
    EXPECT_EQ(pliant_scene_text(&scene, sizeof few, few), text.size());
    EXPECT_EQ(std::string(few), text.substr(0, 9));
}

TEST(scene, failing_allocations_leave_nothing_behind)
{
    const char yaml[] = "mesh: {coarse_cells: [1, 2, 3], ratio: 2}\nmaterial: {file: m.yaml}\n"
                        "fixed: {boxes: [{low: [0, 0, 0], high: [1, 1, 1]}]}\n";
    std::string path = testing::TempDir() + "/pliant_scene_allocation.yaml";
    std::ofstream(path) << yaml;
    size_t before = pliant_memory_in_use();
    for (int64_t n = 0;; ++n) {
        pliant_scene scene;
        pliant_memory_fail_after(n);
        pliant_status status = pliant_scene_read(path.c_str(), &scene);
        pliant_memory_fail_after(-1);
        ASSERT_EQ(pliant_memory_in_use(), before) << n;
        if (status == PLIANT_OK) {
            EXPECT_GT(n, 10);
            break;
        }
        ASSERT_EQ(status, PLIANT_ERROR_MEMORY) << n << ": " << pliant_last_error();
    }
    std::remove(path.c_str());
}
