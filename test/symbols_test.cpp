// The library exports exactly the functions that the public headers declare.
#include "pliant/pliant.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <dirent.h>
#include <fstream>
#include <iterator>
#include <regex>
#include <set>
#include <string>

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

// Return the functions with a prototype in include/pliant, without comments. The functions of reports belong to a
// second library.
std::set<std::string> declared_functions(bool of_reports)
{
    std::set<std::string> functions;
    const std::string folder = PLIANT_SOURCE_DIR "/include/pliant/";
    DIR *headers = opendir(folder.c_str());
    if (!headers) return functions;
    while (const dirent *entry = readdir(headers)) {
        const std::string name = entry->d_name;
        if (name.size() < 3 || name.compare(name.size() - 2, 2, ".h") != 0 || (name == "report.h") != of_reports) continue;
        const std::string text = std::regex_replace(file_text(folder + name), std::regex("/\\*[^]*?\\*/"), "");
        const std::regex prototype("\\n[a-zA-Z_][\\w ]*[ *]+(pliant_\\w+)\\(");
        for (std::sregex_iterator at(text.begin(), text.end(), prototype), end; at != end; ++at)
            if (at->str().compare(1, 7, "typedef") != 0) functions.insert((*at)[1]);
    }
    closedir(headers);
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
        const std::set<std::string> declared = declared_functions(of_reports);
        ASSERT_GT(declared.size(), of_reports ? 20u : 100u);
        EXPECT_EQ(without(exported, declared), std::set<std::string>()) << "exported, but in no public header";
        EXPECT_EQ(without(declared, exported), std::set<std::string>()) << "in a public header, but not exported: PLIANT_API is missing";
    }
}

TEST(Symbols, OneVersionEverywhere)
{
    const std::string numbers = std::to_string(PLIANT_VERSION_MAJOR) + "." + std::to_string(PLIANT_VERSION_MINOR) + "." +
                                std::to_string(PLIANT_VERSION_PATCH);
    EXPECT_EQ(numbers, PLIANT_VERSION);
    EXPECT_EQ(numbers, pliant_version());
    EXPECT_NE(file_text(PLIANT_SOURCE_DIR "/package.xml").find("<version>" + numbers + "</version>"), std::string::npos);
}
