// Source files: lines have at most 120 columns, and work on a GPU is on a given stream.
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <ftw.h>
#include <iterator>
#include <set>
#include <string>
#include <vector>

namespace {

constexpr long MAX_COLUMNS = 120;

// Return the number of UTF-8 code points: continuation bytes are 10xxxxxx.
long columns(const std::string &line)
{
    return std::count_if(line.begin(), line.end(), [](unsigned char byte) { return (byte & 0xC0) != 0x80; });
}

std::vector<std::string> files; // found by nftw(), whose callback has no argument for the caller's data

int add_source_file(const char *path, const struct stat *, int kind, FTW *)
{
    static const std::set<std::string> endings = {".c", ".h", ".cpp", ".cu", ".cuh", ".py", ".msg", ".srv"};
    const std::string name = path;
    const size_t dot = name.rfind('.');
    if (kind == FTW_F && dot != std::string::npos && endings.count(name.substr(dot))) files.push_back(name);
    return 0;
}

TEST(SourceLines, CountsCodePoints)
{
    EXPECT_EQ(columns(""), 0);
    EXPECT_EQ(columns("10 mm"), 5);
    EXPECT_EQ(columns("10 \xC2\xB5m"), 5);
    EXPECT_EQ(columns("\xE2\x89\xA4 \xF0\x9F\x98\x80"), 3);
}

TEST(SourceLines, HaveAtMost120Columns)
{
    const std::string root = PLIANT_SOURCE_DIR "/";
    files.clear();
    for (const char *folder : {"cuda", "include", "launch", "msg", "src", "srv", "test"})
        ASSERT_EQ(nftw((root + folder).c_str(), add_source_file, 16, FTW_PHYS), 0) << folder;
    EXPECT_GT(files.size(), 500u);
    for (const std::string &path : files) {
        std::ifstream file(path);
        ASSERT_TRUE(file) << path;
        long number = 0;
        for (std::string line; std::getline(file, line);) {
            number++;
            EXPECT_LE(columns(line), MAX_COLUMNS) << path.substr(root.size()) << ":" << number
                                                  << ": break the line, and move a comment at its end above it";
        }
    }
}

// Every launch, copy and fill uses a given stream. An operation on the default stream would wait for all others.
TEST(CudaSources, NothingIsOnTheDefaultStream)
{
    files.clear();
    ASSERT_EQ(nftw(PLIANT_SOURCE_DIR "/cuda", add_source_file, 16, FTW_PHYS), 0);
    EXPECT_GT(files.size(), 40u);
    int launches = 0;
    for (const std::string &path : files) {
        SCOPED_TRACE(path);
        std::ifstream in(path);
        ASSERT_TRUE(in);
        const std::string text((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
        for (const char *call : {"cudaMemcpy(", "cudaMemset(", "cudaDeviceSynchronize", "cudaMemcpyToSymbol(",
                                 "cudaStreamLegacy", "cudaStreamPerThread"})
            EXPECT_EQ(text.find(call), std::string::npos) << call;
        for (size_t at = text.find("<<<"); at != std::string::npos; at = text.find("<<<", at + 1), launches++) {
            const std::string launch = text.substr(at, text.find(">>>", at) - at);
            EXPECT_NE(launch.find("stream"), std::string::npos) << launch;
        }
        for (const char *call : {"cudaMemcpyAsync(", "cudaMemsetAsync("})
            for (size_t at = text.find(call); at != std::string::npos; at = text.find(call, at + 1)) {
                const std::string arguments = text.substr(at, text.find(';', at) - at);
                EXPECT_NE(arguments.find("stream"), std::string::npos) << arguments;
            }
    }
    EXPECT_GT(launches, 100);
}

} // namespace
