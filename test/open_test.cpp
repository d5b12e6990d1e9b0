// A thread's open check receives the real path of each file before the file is read.
#include "base/open.h"
#include "pliant/pliant.h"

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <gtest/gtest.h>
#include <string>
#include <thread>
#include <unistd.h>
#include <vector>

namespace {

const char table_text[] =
    "materials:\n  - {name: a, young_modulus: 1000, poisson_ratio: 0.4, density: 1000, labels: [1]}\n";

class Open : public ::testing::Test {
protected:
    void SetUp() override
    {
        char pattern[] = "/tmp/open_testXXXXXX";
        ASSERT_TRUE(mkdtemp(pattern));
        char *real = realpath(pattern, nullptr);
        folder = real;
        std::free(real);
        std::ofstream(folder + "/table.yaml") << table_text;
        ASSERT_EQ(symlink("table.yaml", (folder + "/link.yaml").c_str()), 0);
    }
    void TearDown() override
    {
        pliant_set_open_check(pliant_open_check{nullptr, nullptr});
        EXPECT_EQ(std::system(("rm -r '" + folder + "'").c_str()), 0);
    }
    void set_check()
    {
        pliant_set_open_check(pliant_open_check{[](const char *path, void *user) -> const char * {
                                                    Open *self = static_cast<Open *>(user);
                                                    self->asked.push_back(path);
                                                    return self->refuses ? "not on a Sunday" : nullptr;
                                                },
                                                this});
    }
    pliant_status read(const std::string &name)
    {
        pliant_material_table table{};
        pliant_status status = pliant_material_table_read((folder + "/" + name).c_str(), &table);
        pliant_material_table_free(&table);
        return status;
    }

    std::string folder;
    std::vector<std::string> asked;
    bool refuses = false;
};

TEST_F(Open, WithoutACheckEverythingIsRead)
{
    EXPECT_EQ(read("link.yaml"), PLIANT_OK);
    EXPECT_EQ(read("none.yaml"), PLIANT_ERROR_FILE);
}

TEST_F(Open, TheCheckGetsTheTargetOfALink)
{
    set_check();
    EXPECT_EQ(read("link.yaml"), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(asked.size(), 1u);
    EXPECT_EQ(asked[0], folder + "/table.yaml");
}

TEST_F(Open, ARefusalIsAFileErrorWithTheReason)
{
    set_check();
    refuses = true;
    EXPECT_EQ(read("table.yaml"), PLIANT_ERROR_FILE);
    EXPECT_NE(std::string(pliant_last_error()).find("not on a Sunday"), std::string::npos) << pliant_last_error();
}

TEST_F(Open, MissingFilesAreCheckedByTheirNearestFolder)
{
    set_check();
    EXPECT_EQ(read("none/none.yaml"), PLIANT_ERROR_FILE);
    EXPECT_NE(std::string(pliant_last_error()).find("No such file"), std::string::npos) << pliant_last_error();
    ASSERT_EQ(asked.size(), 1u);
    EXPECT_EQ(asked[0], folder);
    refuses = true;
    EXPECT_EQ(read("none/none.yaml"), PLIANT_ERROR_FILE);
    EXPECT_NE(std::string(pliant_last_error()).find("not on a Sunday"), std::string::npos) << pliant_last_error();
}

TEST_F(Open, TheCheckedFileIsReadEvenIfItsNameIsReplaced)
{
    set_check();
    pliant_opening opening;
    ASSERT_TRUE(pliant_opening_begin((folder + "/link.yaml").c_str(), &opening));
    ASSERT_EQ(std::rename((folder + "/table.yaml").c_str(), (folder + "/first.yaml").c_str()), 0);
    std::ofstream(folder + "/table.yaml") << "another";
    std::ifstream file(opening.name);
    std::string line;
    std::getline(file, line);
    pliant_opening_end(&opening);
    EXPECT_EQ(line, "materials:");
}

TEST_F(Open, ChecksArePerThreadAndReturnThePreviousOne)
{
    set_check();
    refuses = true;
    pliant_status elsewhere = PLIANT_ERROR_FILE;
    std::thread([&] { elsewhere = read("table.yaml"); }).join();
    EXPECT_EQ(elsewhere, PLIANT_OK);
    pliant_open_check before = pliant_set_open_check(pliant_open_check{nullptr, nullptr});
    EXPECT_EQ(before.user, this);
    EXPECT_EQ(read("table.yaml"), PLIANT_OK);
}

} // namespace
