// The library exports exactly the functions that the public headers declare.
#include "pliant/pliant.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <glob.h>
#include <iterator>
#include <regex>
#include <set>
#include <string>
#include <vector>

namespace {

std::string file_text(const std::string &path)
{
    std::ifstream file(path);
    return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

std::set<std::string> exported_symbols(const char *library)
{
    std::set<std::string> symbols;
    FILE *listing = popen(("nm -D --defined-only " + std::string(library)).c_str(), "r");
    if (!listing) return symbols;
    char address[64], kind[8], name[512];
    while (fscanf(listing, "%63s %7s %511s", address, kind, name) == 3) symbols.insert(name);
    pclose(listing);
    return symbols;
}

std::vector<std::string> headers_in(const std::string &pattern)
{
    std::vector<std::string> headers;
    glob_t found{};
    if (glob(pattern.c_str(), 0, nullptr, &found) == 0) headers.assign(found.gl_pathv, found.gl_pathv + found.gl_pathc);
    globfree(&found);
    return headers;
}

// Functions that a header declares, without its comments. A public header declares nothing but functions for users.
std::set<std::string> functions_of(const std::string &header, const std::string &prefix)
{
    std::set<std::string> functions;
    const std::string text = std::regex_replace(file_text(header), std::regex("/\\*[^]*?\\*/"), "");
    const std::regex prototype("\\n" + prefix + "[a-zA-Z_][\\w ]*[ *]+(pliant_\\w+)\\(");
    for (std::sregex_iterator at(text.begin(), text.end(), prototype), end; at != end; ++at)
        if (at->str().compare(1, 7, "typedef") != 0) functions.insert((*at)[1]);
    return functions;
}

// Return the public functions. Functions of reports belong to another library.
std::set<std::string> public_functions(bool of_reports)
{
    std::set<std::string> functions;
    const std::string folder = PLIANT_SOURCE_DIR "/include/pliant/";
    for (const std::string &header : headers_in(folder + "*.h"))
        if ((header == folder + "report.h") == of_reports)
            for (const std::string &name : functions_of(header, "")) functions.insert(name);
    return functions;
}

// Functions that are exported for Pliant's own libraries, nodes and programs (base/export.h).
std::set<std::string> internal_functions(bool of_reports)
{
    std::set<std::string> functions;
    const std::string folder = PLIANT_SOURCE_DIR "/src/";
    for (const char *below : {"*/*.h", "*/*/*.h"})
        for (const std::string &header : headers_in(folder + below))
            if ((header.compare(0, folder.size() + 7, folder + "report/") == 0) == of_reports)
                for (const std::string &name : functions_of(header, "PLIANT_INTERNAL ")) functions.insert(name);
    return functions;
}

std::set<std::string> without(const std::set<std::string> &all, const std::set<std::string> &known)
{
    std::set<std::string> rest;
    std::set_difference(all.begin(), all.end(), known.begin(), known.end(), std::inserter(rest, rest.begin()));
    return rest;
}

} // namespace

TEST(Symbols, EachLibraryExportsWhatItsHeadersDeclare)
{
    for (bool of_reports : {false, true}) {
        const std::set<std::string> exported = exported_symbols(of_reports ? PLIANT_REPORT_LIBRARY : PLIANT_LIBRARY);
        const std::set<std::string> declared = public_functions(of_reports), internal = internal_functions(of_reports);
        ASSERT_GT(declared.size(), of_reports ? 5u : 100u);
        EXPECT_EQ(without(without(exported, declared), internal), std::set<std::string>())
            << "exported, but declared with neither PLIANT_API nor PLIANT_INTERNAL";
        EXPECT_EQ(without(declared, exported), std::set<std::string>())
            << "in a public header, but not exported: PLIANT_API is missing";
        EXPECT_EQ(without(internal, exported), std::set<std::string>()) << "PLIANT_INTERNAL, but not exported";
        for (const std::string &name : internal)
            EXPECT_EQ(declared.count(name), 0u) << name << " is public and internal";
    }
}

TEST(Symbols, FewFunctionsArePublic)
{
    EXPECT_LE(public_functions(false).size() + public_functions(true).size(), 130u)
        << "declare what users do not need in a header below src/";
}

// The list of PLIANT_INTERNAL stays short: each of its functions is called from outside of its library.
TEST(Symbols, InternalFunctionsAreCalledFromOutside)
{
    std::string outside_core, outside_reports;
    for (const char *pattern : {"src/ros/*/*.cpp", "src/ros/*/*.h", "src/rviz/*.cpp", "src/programs/*.c",
                                "src/programs/*.h", "src/programs/*.cpp", "src/python/*.py", "test/ros/*.cpp",
                                "test/ros/*.py"})
        for (const std::string &file : headers_in(std::string(PLIANT_SOURCE_DIR "/") + pattern))
            outside_reports += file_text(file);
    outside_core = outside_reports;
    for (const std::string &file : headers_in(PLIANT_SOURCE_DIR "/src/report/*.[ch]")) outside_core += file_text(file);
    for (bool of_reports : {false, true})
        for (const std::string &name : internal_functions(of_reports)) {
            const std::string &outside = of_reports ? outside_reports : outside_core;
            const bool is_called = outside.find(name + "(") != std::string::npos ||
                                   outside.find(name + ")") != std::string::npos ||
                                   outside.find("\"" + name.substr(7) + "\"") !=
                                       std::string::npos; // python declares names without pliant_
            EXPECT_TRUE(is_called) << name << " can be hidden: remove its PLIANT_INTERNAL";
        }
}

TEST(Symbols, OneVersionEverywhere)
{
    const std::string numbers = std::to_string(PLIANT_VERSION_MAJOR) + "." + std::to_string(PLIANT_VERSION_MINOR) +
                                "." + std::to_string(PLIANT_VERSION_PATCH);
    EXPECT_EQ(numbers, PLIANT_VERSION);
    EXPECT_EQ(numbers, pliant_version());
    EXPECT_NE(file_text(PLIANT_SOURCE_DIR "/package.xml").find("<version>" + numbers + "</version>"),
              std::string::npos);
}
