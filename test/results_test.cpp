// Tables are complete on disk after an interruption.
#include "report/report.h"

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <gtest/gtest.h>
#include <sstream>
#include <string>
#include <unistd.h>

namespace {

class Results : public testing::Test {
protected:
    void SetUp() override
    {
        ASSERT_NE(mkdtemp(folder_), nullptr);
        path_ = std::string(folder_) + "/table.csv";
    }
    void TearDown() override { EXPECT_EQ(std::system(("rm -r " + std::string(folder_)).c_str()), 0); }
    pliant_status open(pliant_results **out) { return pliant_results_open(path_.c_str(), columns_, 4, 2, out); }
    static std::string text(const std::string &path)
    {
        std::ifstream file(path);
        std::stringstream all;
        all << file.rdbuf();
        return all.str();
    }
    const char *columns_[4] = {"setup", "name", "value", "message"};
    const char *row_[4] = {"a", "with, comma", "1.5", "says \"no\""};
    const char *second_[4] = {"b", "plain", "", "7 pieces"};
    char folder_[32] = "/tmp/pliant_results_XXXXXX";
    std::string path_;
};

TEST_F(Results, AreReadAsWritten)
{
    pliant_results *table = nullptr;
    ASSERT_EQ(open(&table), PLIANT_OK) << pliant_last_error();
    EXPECT_FALSE(pliant_results_has(table, row_));
    ASSERT_EQ(pliant_results_add(table, row_), PLIANT_OK);
    EXPECT_TRUE(pliant_results_has(table, row_));
    EXPECT_FALSE(pliant_results_has(table, second_));
    // written to disk at once
    EXPECT_EQ(text(path_), "setup,name,value,message\na,\"with, comma\",1.5,\"says \"\"no\"\"\"\n");
    pliant_results_close(table);
    ASSERT_EQ(open(&table), PLIANT_OK);
    EXPECT_EQ(pliant_results_rows(table), 1u);
    EXPECT_TRUE(pliant_results_has(table, row_));
    EXPECT_STREQ(pliant_results_cell(table, 0, 1), "with, comma");
    EXPECT_STREQ(pliant_results_cell(table, 0, pliant_results_column(table, "message")), "says \"no\"");
    EXPECT_EQ(pliant_results_column(table, "nothing"), -1);
    ASSERT_EQ(pliant_results_add(table, second_), PLIANT_OK);
    pliant_results_close(table);
    ASSERT_EQ(open(&table), PLIANT_OK);
    EXPECT_EQ(pliant_results_rows(table), 2u);
    EXPECT_STREQ(pliant_results_cell(table, 1, 3), "7 pieces");
    pliant_results_close(table);
}

TEST_F(Results, AnIncompleteRowIsDropped)
{
    pliant_results *table = nullptr;
    ASSERT_EQ(open(&table), PLIANT_OK);
    ASSERT_EQ(pliant_results_add(table, row_), PLIANT_OK);
    pliant_results_close(table);
    std::string whole = text(path_);
    std::ofstream(path_, std::ios::app) << "b,\"plain, and then a very long text that was never";
    ASSERT_EQ(open(&table), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(pliant_results_rows(table), 1u);
    EXPECT_EQ(text(path_), whole);
    ASSERT_EQ(pliant_results_add(table, second_), PLIANT_OK);
    pliant_results_close(table);
    EXPECT_EQ(text(path_), whole + "b,plain,,7 pieces\n");
}

TEST_F(Results, OtherColumnsAreRefusedAndLeftAlone)
{
    std::ofstream(path_) << "setup,name,value\nx,y,1\n";
    pliant_results *table = nullptr;
    EXPECT_EQ(open(&table), PLIANT_ERROR_FORMAT);
    EXPECT_NE(std::string(pliant_last_error()).find("other columns"), std::string::npos);
    EXPECT_EQ(table, nullptr);
    EXPECT_EQ(text(path_), "setup,name,value\nx,y,1\n");
    path_ = "/proc/nowhere/table.csv";
    EXPECT_EQ(open(&table), PLIANT_ERROR_FILE);
}

TEST_F(Results, JsonHoldsNumbersTextAndNull)
{
    pliant_results *table = nullptr;
    const char *odd[4] = {"a", "0x10", "-1e-5", "tab\there"};
    ASSERT_EQ(open(&table), PLIANT_OK);
    ASSERT_EQ(pliant_results_add(table, row_), PLIANT_OK);
    ASSERT_EQ(pliant_results_add(table, second_), PLIANT_OK);
    ASSERT_EQ(pliant_results_add(table, odd), PLIANT_OK);
    std::string path = std::string(folder_) + "/table.json";
    FILE *file = fopen(path.c_str(), "w");
    ASSERT_NE(file, nullptr);
    EXPECT_EQ(pliant_results_json(table, "a", file), PLIANT_OK);
    fclose(file);
    pliant_results_close(table);
    EXPECT_EQ(text(path),
              "[\n  {\"setup\": \"a\", \"name\": \"with, comma\", \"value\": 1.5, \"message\": \"says \\\"no\\\"\"},\n"
              "  {\"setup\": \"a\", \"name\": \"0x10\", \"value\": -1e-5, \"message\": \"tab\\u0009here\"}\n]");
}

} // namespace
