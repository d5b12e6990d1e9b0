// The documents: the option table is the printed one, links lead to files and headings, tests and benchmarks that
// figures name exist, and no document is longer than a reader can search.
#include "programs/options_table.h"

#include <cctype>
#include <cstdio>
#include <cstdlib>
#include <fnmatch.h>
#include <fstream>
#include <gtest/gtest.h>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <sys/stat.h>
#include <vector>

namespace {

const std::string root = PLIANT_SOURCE_DIR "/";
const char *const OPTIONS = "src/scene/README.md";

struct Document {
    const char *path;
    size_t most_lines;
};
const std::vector<Document> DOCUMENTS = {
    {"README.md", 200},
    {OPTIONS, 250},
    {"src/README.md", 250},
    {"src/contact/README.md", 250},
    {"src/cut/README.md", 250},
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

/* Lines outside of code blocks. */
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

/* Names by which links reach headings: lower case, blanks become hyphens, other marks vanish. */
std::set<std::string> anchors(const std::string &document)
{
    std::set<std::string> out;
    for (const std::string &line : text_lines(document)) {
        const size_t begin = line.find_first_not_of('#');
        if (begin == 0 || begin == std::string::npos || line[begin] != ' ') continue;
        std::string name;
        for (char c : line.substr(begin + 1)) {
            if (std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_') name += static_cast<char>(std::tolower(c));
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
    const std::string begin = "<!-- scene options: pliant_deform --options -->\n", end = "<!-- end of scene options -->\n";
    const std::string document = read(root + OPTIONS);
    size_t from = document.find(begin), to = document.find(end);
    ASSERT_NE(from, std::string::npos);
    ASSERT_NE(to, std::string::npos);
    from += begin.size();
    EXPECT_EQ(document.substr(from, to - from), printed_table())
        << "put the output of `pliant_deform --options` between the two comments of " << OPTIONS;
}

TEST(Readme, DocumentsAreShort)
{
    for (const Document &document : DOCUMENTS) {
        std::stringstream stream(read(root + document.path));
        size_t lines = 0;
        for (std::string line; std::getline(stream, line);) lines++;
        EXPECT_GT(lines, 0u) << document.path;
        EXPECT_LE(lines, document.most_lines) << document.path;
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

/* Return the source of a test or benchmark program; empty: there is none. */
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
        for (const std::string &run : {whole, "Instance/" + whole + "/0"}) /* of TEST and of TEST_P */
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
        if (path.find("NUMERICS.md") == std::string::npos) continue;
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

} // namespace
