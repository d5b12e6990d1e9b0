// The documents: the table of scene options is the printed one. Links, files, YAML examples, options of commands, tests
// and benchmarks exist. No document is longer than a reader can search.
#include "programs/options_table.h"

#include "pliant/pliant.h"
#include "tool/path.h"

#include <cctype>
#include <cstdio>
#include <cstdlib>
#include <fnmatch.h>
#include <fstream>
#include <glob.h>
#include <gtest/gtest.h>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <sys/stat.h>
#include <unistd.h>
#include <vector>

namespace {

const std::string root = PLIANT_SOURCE_DIR "/";
const char *const OPTIONS = "src/scene/README.md";

struct Document {
    const char *path;
    size_t max_lines;
};
const std::vector<Document> DOCUMENTS = {
    {"README.md", 200},
    {OPTIONS, 250},
    {"src/README.md", 250},
    {"src/contact/README.md", 250},
    {"src/cut/README.md", 250},
    {"src/examples/README.md", 250},
    {"src/programs/README.md", 250},
    {"src/python/README.md", 250},
    {"src/report/README.md", 250},
    {"src/ros/README.md", 250},
    {"launch/README.md", 250},
    {"launch/docker/README.md", 250},
    {"src/fem/NUMERICS.md", 250},
    {"src/fem/element/NUMERICS.md", 250},
    {"src/fem/coarse/NUMERICS.md", 250},
    {"src/fem/linear/NUMERICS.md", 250},
    {"src/fem/quasistatic/NUMERICS.md", 250},
    {"src/fem/dynamics/NUMERICS.md", 250},
    {"src/fem/patch/NUMERICS.md", 250},
    {"src/contact/NUMERICS.md", 250},
    {"src/cut/NUMERICS.md", 250},
};

std::string read(const std::string &path)
{
    std::ifstream file(path);
    EXPECT_TRUE(file) << path;
    std::stringstream stream;
    stream << file.rdbuf();
    return stream.str();
}

/* Return the lines outside of code blocks. */
std::vector<std::string> text_lines(const std::string &document)
{
    std::vector<std::string> out;
    std::stringstream stream(document);
    bool is_code = false;
    for (std::string line; std::getline(stream, line);) {
        if (line.compare(0, 3, "```") == 0) is_code = !is_code;
        else if (!is_code) out.push_back(line);
    }
    return out;
}

/* Return the code blocks of a language. */
std::vector<std::string> code_blocks(const std::string &document, const std::string &language)
{
    std::vector<std::string> out;
    std::stringstream stream(document);
    bool is_code = false, is_of = false;
    for (std::string line; std::getline(stream, line);) {
        if (line.compare(0, 3, "```") == 0) {
            is_code = !is_code;
            is_of = is_code && line.substr(3) == language;
            if (is_of) out.emplace_back();
        } else if (is_of)
            out.back() += line + "\n";
    }
    return out;
}

/* Return the link names of headings: lower case, hyphens for spaces, no other punctuation. */
std::set<std::string> anchors(const std::string &document)
{
    std::set<std::string> out;
    for (const std::string &line : text_lines(document)) {
        const size_t begin = line.find_first_not_of('#');
        if (begin == 0 || begin == std::string::npos || line[begin] != ' ') continue;
        std::string name;
        for (char c : line.substr(begin + 1)) {
            const int letter = static_cast<unsigned char>(c);
            if (std::isalnum(letter) || c == '-' || c == '_') name += static_cast<char>(std::tolower(letter));
            else if (c == ' ') name += '-';
        }
        out.insert(name);
    }
    return out;
}

bool is_there(const std::string &path)
{
    struct stat status;
    return stat(path.c_str(), &status) == 0;
}

/* Read an example with the reader of its kind. */
pliant_status read_example(const std::string &path, const std::string &text)
{
    const auto has = [&](const char *group) { return text.compare(0, std::string(group).size(), group) == 0; };
    pliant_status status;
    if (has("materials:")) {
        pliant_material_table table = {};
        status = pliant_material_table_read(path.c_str(), &table);
        pliant_material_table_free(&table);
    } else if (has("tools:")) {
        pliant_path tools = {};
        status = pliant_path_read(path.c_str(), &tools);
        pliant_path_free(&tools);
    } else {
        pliant_scene scene;
        pliant_scene_defaults(&scene);
        status = pliant_scene_read(path.c_str(), &scene);
    }
    return status;
}

std::string help_of(const std::string &program)
{
    std::string out;
    FILE *pipe = popen((program + " --help 2>&1").c_str(), "r");
    char text[4096];
    while (pipe && std::fgets(text, sizeof text, pipe)) out += text;
    if (pipe) pclose(pipe);
    return out;
}

std::string printed_table()
{
    char *text = nullptr;
    size_t size = 0;
    FILE *memory = open_memstream(&text, &size);
    options_table_print(memory);
    std::fclose(memory);
    std::string table(text, size);
    std::free(text);
    return table;
}

TEST(Readme, ShowsTheOptionsAsTheyAre)
{
    const std::string begin = "<!-- scene options: pliant_deform --options -->\n";
    const std::string end = "<!-- end of scene options -->\n";
    const std::string document = read(root + OPTIONS);
    size_t from = document.find(begin), to = document.find(end);
    ASSERT_NE(from, std::string::npos);
    ASSERT_NE(to, std::string::npos);
    from += begin.size();
    EXPECT_EQ(document.substr(from, to - from), printed_table())
        << "put the output of `pliant_deform --options` between the two comments of " << OPTIONS;
}

std::vector<std::string> files_of(const std::string &pattern)
{
    std::vector<std::string> out;
    glob_t files{};
    if (glob((root + pattern).c_str(), 0, nullptr, &files) == 0)
        out.assign(files.gl_pathv, files.gl_pathv + files.gl_pathc);
    globfree(&files);
    return out;
}

/* Return whether a YAML text has the option in its group, also in a comment. */
bool shows(const std::string &text, const std::string &group, const std::string &name)
{
    std::stringstream stream(text);
    bool is_group = false;
    for (std::string line; std::getline(stream, line);) {
        if (line.compare(0, 2, "# ") == 0) line.erase(0, 2);
        if (line.compare(0, group.size() + 1, group + ":") == 0) is_group = true;
        else if (!line.empty() && line[0] != ' ') is_group = false;
        if (is_group && std::regex_search(line, std::regex("[ {]" + name + ":"))) return true;
    }
    return false;
}

TEST(Readme, EachOptionIsInAScene)
{
    const std::map<std::string, std::string> exempt = {
        {"model/patch_delay", "tests set the step at which a patch of the background is used"},
        {"solver/refresh_delay", "tests set the step at which a factorization of the background is used"},
    };
    std::string paths; /* files that set options by their path */
    std::vector<std::string> scenes;
    for (const char *pattern : {"launch/*.launch", "launch/papers/*", "launch/figures", "launch/demo"})
        for (const std::string &path : files_of(pattern)) paths += read(path);
    for (const std::string &path : files_of("launch/scenes/*.yaml")) scenes.push_back(read(path));
    EXPECT_GT(scenes.size(), 20u);
    size_t count;
    const pliant_option_info *options = pliant_scene_options(&count);
    for (size_t i = 0; i < count; ++i) {
        const std::string group = options[i].group, name = options[i].name, path = group + "/" + name;
        bool is_shown = std::regex_search(paths, std::regex("\\b" + path + "\\b"));
        for (const std::string &scene : scenes) is_shown = is_shown || shows(scene, group, name);
        EXPECT_NE(is_shown, exempt.count(path) == 1) << path << ": add it to a scene of launch/scenes, or remove it";
    }
}

TEST(Readme, DocumentsAreShort)
{
    for (const Document &document : DOCUMENTS) {
        std::stringstream stream(read(root + document.path));
        size_t lines = 0;
        for (std::string line; std::getline(stream, line);) lines++;
        EXPECT_GT(lines, 0u) << document.path;
        EXPECT_LE(lines, document.max_lines) << document.path;
    }
}

TEST(Readme, LinksLeadToFilesAndHeadings)
{
    const std::regex link("\\]\\(([^)\\s]+)\\)");
    int count = 0;
    for (const Document &document : DOCUMENTS) {
        const std::string path = document.path, folder = path.substr(0, path.find_last_of('/') + 1);
        for (const std::string &line : text_lines(read(root + path)))
            for (std::sregex_iterator found(line.begin(), line.end(), link), none; found != none; ++found) {
                const std::string target = (*found)[1];
                if (target.compare(0, 4, "http") == 0) continue;
                const size_t mark = target.find('#');
                const std::string file = mark == 0 ? root + path : root + folder + target.substr(0, mark);
                EXPECT_TRUE(is_there(file)) << path << " links to " << target;
                if (mark != std::string::npos && is_there(file))
                    EXPECT_TRUE(anchors(read(file)).count(target.substr(mark + 1))) << path << " links to " << target;
                count++;
            }
    }
    EXPECT_GT(count, 20);
}

/* Return the source text of a test or benchmark program, or "" without such a program. */
std::string source_of(const std::string &program)
{
    for (const char *folder : {"test/", "test/pipeline/", "test/bench/", "test/ros/"})
        for (const char *ending : {".cpp", ".cu", ".py"})
            if (is_there(root + folder + program + ending)) return read(root + folder + program + ending);
    return "";
}

bool has_test(const std::string &source, const std::string &filter)
{
    static const std::regex name("\\bTEST(?:_[FP])?\\((\\w+), (\\w+)\\)");
    for (std::sregex_iterator found(source.begin(), source.end(), name), none; found != none; ++found) {
        const std::string whole = (*found)[1].str() + "." + (*found)[2].str();
        for (const std::string &run : {whole, "Instance/" + whole + "/0"}) /* of TEST, and of TEST_P */
            if (fnmatch(filter.c_str(), run.c_str(), 0) == 0) return true;
    }
    return false;
}

TEST(Readme, ProgramsThatFiguresNameExist)
{
    const std::regex command("\\b(bench_[a-z]+|[a-z_]+_test)\\b(?: --gtest_filter=([^\\s`]+))?");
    int filters = 0;
    for (const Document &document : DOCUMENTS) {
        const std::string path = document.path;
        for (const std::string &line : text_lines(read(root + path)))
            for (std::sregex_iterator found(line.begin(), line.end(), command), none; found != none; ++found) {
                const std::string source = source_of((*found)[1]), filter = (*found)[2];
                EXPECT_NE(source, "") << path << " names " << (*found)[0];
                if (filter.empty()) continue;
                EXPECT_TRUE(has_test(source, filter)) << path << " names " << (*found)[0];
                filters++;
            }
    }
    EXPECT_GT(filters, 20);
}

/* A path such as `sim/step/step.c` is relative to one of several folders, among them the document's folder. */
TEST(Readme, NamedFilesExist)
{
    const std::regex file("[`( ]([A-Za-z_0-9]+/[A-Za-z_0-9/.]+\\.(?:c|h|cpp|cu|py|yaml|launch|msg|srv|md|rviz))"
                          "[`) \n]");
    int count = 0;
    for (const Document &document : DOCUMENTS) {
        const std::string path = document.path, folder = path.substr(0, path.find_last_of('/') + 1);
        const std::string text = read(root + path);
        for (std::sregex_iterator found(text.begin(), text.end(), file), none; found != none; ++found) {
            const std::string name = (*found)[1];
            if (name.find("NAME") != std::string::npos || name.find("data/") == 0) continue;
            bool is_found = false;
            for (const char *where : {"", "src/", "src/fem/", "launch/", "include/"})
                is_found = is_found || is_there(root + where + name);
            is_found = is_found || is_there(root + folder + name);
            EXPECT_TRUE(is_found) << path << " names " << name;
            count++;
        }
    }
    EXPECT_GT(count, 50);
}

/* Functions, types, programs and targets. */
TEST(Readme, NamesExist)
{
    const std::regex name("\\bpliant_[a-z_]+\\b");
    std::set<std::string> known = {"pliant_msgs", "pliant_node"}; /* ros2_messages, CMakeLists.txt */
    for (const char *pattern : {"include/pliant/*.h", "src/*/*.h", "src/*/*/*.h", "src/*/*.c", "src/*/*/*.c",
                                "src/*/CMakeLists.txt", "src/cmake/*", "cuda/*/*.cu", "cuda/*/*/*.cu"})
        for (const std::string &path : files_of(pattern)) {
            const std::string text = read(path);
            for (std::sregex_iterator found(text.begin(), text.end(), name), none; found != none; ++found)
                known.insert(found->str());
        }
    const std::regex code("`[^`\n]+`");
    int count = 0;
    for (const Document &document : DOCUMENTS)
        for (const std::string &line : text_lines(read(root + document.path)))
            for (std::sregex_iterator part(line.begin(), line.end(), code), none; part != none; ++part) {
                const std::string text = part->str();
                for (std::sregex_iterator found(text.begin(), text.end(), name); found != none; ++found) {
                    const bool is_group = found->str().back() == '_'; /* pliant_data_get_* */
                    EXPECT_TRUE(is_group || known.count(found->str())) << document.path << " names " << found->str();
                    count++;
                }
            }
    EXPECT_GT(count, 50);
}

/* Every message, service, launch file, scene and program is in the document of its subject. */
TEST(Readme, EveryItemIsDocumented)
{
    const struct {
        const char *document, *files, *ending;
    } subjects[] = {
        {"src/ros/README.md", "msg/*.msg", ".msg"},
        {"src/ros/README.md", "srv/*.srv", ".srv"},
        {"src/ros/README.md", "src/ros/programs/*_main.cpp", "_main.cpp"},
        {"launch/README.md", "launch/*.launch", ".launch"},
        {"launch/README.md", "launch/materials/totalsegmentator*.yaml", ".yaml"},
        {"src/programs/README.md", "src/programs/*_main.c", "_main.c"},
        {"src/examples/README.md", "src/examples/*.py", ".py"},
        {"src/examples/README.md", "src/examples/*.c", ".c"},
    };
    for (const auto &subject : subjects) {
        const std::string text = read(root + subject.document);
        const std::vector<std::string> files = files_of(subject.files);
        EXPECT_FALSE(files.empty()) << subject.files;
        for (const std::string &path : files) {
            const size_t from = path.rfind('/') + 1;
            const std::string name = path.substr(from, path.size() - from - std::string(subject.ending).size());
            if (name == "bag" || name == "node") continue; /* pliant_bag, pliant_node */
            const std::regex word("\\b(?:pliant_)?" + name + "\\b");
            EXPECT_TRUE(std::regex_search(text, word)) << subject.document << " lacks " << path;
        }
    }
}

TEST(Readme, ExamplesCanBeRead)
{
    char folder[] = "/tmp/pliant_readme_XXXXXX";
    ASSERT_NE(mkdtemp(folder), nullptr);
    const std::string file = std::string(folder) + "/example.yaml";
    int count = 0;
    for (const Document &document : DOCUMENTS)
        for (const std::string &text : code_blocks(read(root + document.path), "yaml")) {
            std::ofstream(file) << text;
            EXPECT_EQ(read_example(file, text), PLIANT_OK) << document.path << ": " << pliant_last_error() << text;
            count++;
        }
    EXPECT_GT(count, 8);
    unlink(file.c_str());
    EXPECT_EQ(rmdir(folder), 0);
}

TEST(Readme, CommandsHaveTheirOptions)
{
    const std::map<std::string, std::string> programs = {{"pliant_deform", help_of(PLIANT_DEFORM)},
                                                         {"pliant_report", help_of(PLIANT_REPORT_PROGRAM)},
                                                         {"pliant_segment", help_of(PLIANT_SEGMENT_PROGRAM)},
                                                         {"pliant_fit", help_of(PLIANT_FIT_PROGRAM)}};
    const std::regex option("(--[a-z][a-z-]*)");
    int count = 0;
    for (const Document &document : DOCUMENTS) {
        std::stringstream stream(read(root + document.path));
        for (std::string line; std::getline(stream, line);)
            for (const auto &program : programs) {
                size_t from = line.find(program.first + " ");
                if (from == std::string::npos) continue;
                const std::string command = line.substr(from, line.find_first_of("#`", from) - from);
                for (std::sregex_iterator found(command.begin(), command.end(), option), none; found != none; ++found) {
                    EXPECT_NE(program.second.find((*found)[1]), std::string::npos) << document.path << ": " << command;
                    count++;
                }
            }
    }
    EXPECT_GT(count, 50);
}

} // namespace
