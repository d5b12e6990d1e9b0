// No cycles exist among the includes of folders, or among the calls of folders and of files.
// So each folder can be read without the folders that depend on it.
#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>
#include <glob.h>
#include <iterator>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace {

// folder or file -> another one -> the include or the symbol that connects them
using Graph = std::map<std::string, std::map<std::string, std::string>>;

void add_folder(const std::string &root, const std::string &folder, Graph &graph)
{
    graph[folder]; // also if it includes no other folder
    for (const char *ending : {"/*.c", "/*.cpp", "/*.h"}) {
        glob_t files{};
        if (glob((root + folder + ending).c_str(), 0, nullptr, &files) == 0)
            for (size_t f = 0; f < files.gl_pathc; f++) {
                std::ifstream file(files.gl_pathv[f]);
                for (std::string line; std::getline(file, line);) {
                    const std::string begin = "#include \"";
                    size_t slash = line.rfind('/');
                    if (line.compare(0, begin.size(), begin) != 0 || slash == std::string::npos) continue;
                    std::string to = line.substr(begin.size(), slash - begin.size());
                    if (to != folder && to != "pliant") graph[folder][to] = files.gl_pathv[f] + (": " + line);
                }
            }
        globfree(&files);
    }
}

// Return the chain of includes from one folder to another; empty: none.
std::string way(const Graph &graph, const std::string &from, const std::string &to, std::set<std::string> &seen)
{
    if (!seen.insert(from).second || !graph.count(from)) return "";
    for (const auto &edge : graph.at(from)) {
        std::string rest = edge.first == to ? edge.second : way(graph, edge.first, to, seen);
        if (!rest.empty()) return edge.first == to ? rest : edge.second + "\n" + rest;
    }
    return "";
}

// For each file of the library, find the files that define its undefined symbols; by folders or by files.
Graph calls(bool by_folders)
{
    std::map<std::string, std::set<std::string>> uses;
    std::map<std::string, std::string> definer;
    FILE *listing = popen("xargs -d '\\n' nm -A -P -g < '" PLIANT_OBJECTS_LIST "'", "r");
    char line[4096], path[2048], symbol[1024], kind;
    while (listing && fgets(line, sizeof line, listing)) {
        if (std::sscanf(line, "%2047[^:]: %1023s %c", path, symbol, &kind) != 3) continue;
        const std::string all = path, mark = ".dir/";
        const size_t begin = all.find(mark);
        // made by the build, or a file of cuda/
        if (begin == std::string::npos || all.find("/__/") != std::string::npos) continue;
        const std::string file = all.substr(begin + mark.size()),
                          name = by_folders ? file.substr(0, file.rfind('/')) : file;
        if (kind == 'U') uses[name].insert(symbol);
        // weak inline symbols have several definitions
        else if (std::string("TDBRi").find(kind) != std::string::npos) definer.emplace(symbol, name);
    }
    if (listing) pclose(listing);
    Graph graph;
    for (const auto &each : uses)
        for (const std::string &used : each.second) {
            const auto found = definer.find(used);
            if (found != definer.end() && found->second != each.first)
                graph[each.first][found->second] = each.first + " " + used;
        }
    return graph;
}

TEST(Folders, CallEachOtherInNoCircle)
{
    for (bool by_folders : {true, false}) {
        const Graph graph = calls(by_folders);
        ASSERT_GT(graph.size(), by_folders ? 15u : 150u);
        for (const auto &each : graph) {
            std::set<std::string> seen;
            EXPECT_EQ(way(graph, each.first, each.first, seen), "") << each.first;
        }
    }
}

TEST(Folders, IncludeEachOtherInNoCircle)
{
    const std::string root = PLIANT_SOURCE_DIR "/src/";
    Graph graph;
    for (const char *pattern : {"*", "fem/*", "ros/*"}) {
        glob_t folders{};
        ASSERT_EQ(glob((root + pattern).c_str(), GLOB_ONLYDIR, nullptr, &folders), 0);
        for (size_t f = 0; f < folders.gl_pathc; f++)
            add_folder(root, std::string(folders.gl_pathv[f]).substr(root.size()), graph);
        globfree(&folders);
    }
    EXPECT_GT(graph.size(), 10u);
    for (const char *folder : {"base",        "scene",        "scan",       "material",
                               "mesh",        "topology",     "cut",        "model_data",
                               "warp",        "tool",         "contact",    "fem",
                               "fem/element", "fem/linear",   "fem/coarse", "fem/quasistatic",
                               "fem/patch",   "fem/dynamics", "fem/rigid",  "backend",
                               "sim",         "report",       "programs",   "rviz",
                               "ros/params",  "ros/convert",  "ros/sim",    "ros/output",
                               "ros/guard",   "ros/record",   "ros/node"}) {
        EXPECT_TRUE(graph.count(folder)) << folder;
        std::set<std::string> seen;
        EXPECT_EQ(way(graph, folder, folder, seen), "") << folder;
    }
}

// Nodes and displays use public headers, and internal headers whose functions are exported (base/export.h).
// Examples use public headers alone.
TEST(Folders, NodesIncludeExportedHeaders)
{
    const std::string root = PLIANT_SOURCE_DIR "/src/";
    int of_core = 0;
    for (const char *pattern : {"ros/*/*.cpp", "ros/*/*.h", "rviz/*.cpp", "rviz/*.h", "examples/*.c", "examples/*.h"}) {
        glob_t files{};
        ASSERT_EQ(glob((root + pattern).c_str(), 0, nullptr, &files), 0) << pattern;
        for (size_t f = 0; f < files.gl_pathc; f++) {
            std::ifstream file(files.gl_pathv[f]);
            for (std::string line; std::getline(file, line);) {
                const std::string begin = "#include \"";
                if (line.compare(0, begin.size(), begin) != 0) continue;
                const std::string name = line.substr(begin.size(), line.rfind('"') - begin.size()),
                                  folder = name.substr(0, name.find('/'));
                if (folder == name || folder == "pliant" || folder == "ros" || folder == "rviz" || folder == "programs")
                    continue;
                of_core++;
                EXPECT_NE(std::string(pattern).compare(0, 8, "examples"), 0) << files.gl_pathv[f] << ": " << line;
                std::ifstream header(root + name);
                const std::string text{std::istreambuf_iterator<char>(header), std::istreambuf_iterator<char>()};
                EXPECT_NE(text.find("PLIANT_INTERNAL"), std::string::npos)
                    << files.gl_pathv[f] << ": " << line << " declares nothing that is exported";
            }
        }
        globfree(&files);
    }
    EXPECT_GT(of_core, 10);
}

} // namespace
