// The README's table of scene options is the one that the program prints.
#include "programs/options_table.h"

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <gtest/gtest.h>
#include <sstream>
#include <string>

namespace {

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
    std::ifstream file(PLIANT_SOURCE_DIR "/README.md");
    ASSERT_TRUE(file);
    std::stringstream stream;
    stream << file.rdbuf();
    std::string readme = stream.str();
    size_t from = readme.find(begin), to = readme.find(end);
    ASSERT_NE(from, std::string::npos);
    ASSERT_NE(to, std::string::npos);
    from += begin.size();
    EXPECT_EQ(readme.substr(from, to - from), printed_table())
        << "put the output of `pliant_deform --options` between the two comments of README.md";
}

} // namespace
