// Tests of the program pliant_report from a user's view.
#include "program.h"

#include <cstdlib>
#include <fstream>
#include <gtest/gtest.h>
#include <sstream>
#include <string>
#include <unistd.h>

namespace {

class Report : public Program {
protected:
    Report() : Program(PLIANT_REPORT_PROGRAM) {}
    int python(const std::string &program)
    {
        return std::system(("cd " + in("result") + " && python3 -c '" + program + "'").c_str());
    }
    const std::string small_ =
        "--scan phantom:48x40x40 --set 'mesh/coarse_cells=5 4 4' --set solver/threads=1 --refined 0 "
        "--methods fine,averaged --budgets 2,0 --frames 3 ";
};

TEST_F(Report, ExitCodesDistinguishWrongUsageFromFailure)
{
    EXPECT_EQ(run("--help"), 0);
    EXPECT_NE(out_.find("--stability"), std::string::npos);
    EXPECT_EQ(run("--cases"), 0);
    EXPECT_NE(out_.find("scrambled\n"), std::string::npos);
    EXPECT_EQ(run("--scan phantom"), 2);
    EXPECT_NE(err_.find("--out"), std::string::npos) << err_;
    EXPECT_EQ(run("--out " + in("result")), 2);
    EXPECT_NE(err_.find("--scan"), std::string::npos) << err_;
    EXPECT_EQ(run("--out x --scan phantom --methods fine,magic"), 2);
    EXPECT_EQ(run("--out x --scan phantom --ratios 2,9"), 2);
    EXPECT_EQ(run("--out x --scan phantom --at 1,2"), 2);
    EXPECT_EQ(run("--out " + in("result") + " --scan /nonexistent.nii"), 1);
    EXPECT_NE(err_.find("/nonexistent.nii"), std::string::npos) << err_;
    EXPECT_EQ(run(small_ + "--at 5,5,5 --sweep --no-pictures --out " + in("far")), 1);
    EXPECT_NE(err_.find("there is no tissue at"), std::string::npos) << err_;
}

TEST_F(Report, WritesTablesThatAreReadBack)
{
    ASSERT_EQ(
        run(small_ + "__name:=report --stability --case single_tetrahedron --sweep --ablation --out " + in("result")),
        0)
        << err_;
    EXPECT_EQ(
        python("import csv, json; r = json.load(open(\"report.json\")); s = list(csv.DictReader(open(\"sweep.csv\"))); "
               "assert len(s) == 16 == len(r[\"sweep\"]), len(s); "
               "assert all(float(a[\"max_mm\"]) == b[\"max_mm\"] for a, b in zip(s, r[\"sweep\"])); "
               "assert r[\"machine\"][\"cores\"] >= 1 and r[\"threads\"] >= 1 and r[\"version\"]; "
               "assert {a[\"backend\"] for a in s} == {\"cpu\"} or \"cuda\" in str(s); "
               "assert len(r[\"stages\"]) == 8 and len(r[\"stability\"]) == 4 and len(r[\"builds\"]) == 2"),
        0);
    if (err_.find("python3-matplotlib") == std::string::npos) {
        for (const char *name : {"tradeoff.png", "histogram.png", "stages.png", "stability.png", "error_gravity_2.png"})
            EXPECT_EQ(access(in(std::string("result/") + name).c_str(), F_OK), 0) << name;
    }
    // a second run adds nothing
    std::string table = text(in("result/sweep.csv"));
    ASSERT_EQ(run(small_ + "--sweep --no-pictures --out " + in("result")), 0) << err_;
    EXPECT_EQ(text(in("result/sweep.csv")), table);
    // The shards of a sweep, merged, give the same results.
    for (const char *part : {"1", "2"})
        ASSERT_EQ(run(small_ + "--budgets 2 --sweep --no-pictures --no-warp --shard " + part + "/2 --out " + in(part)),
                  0)
            << err_;
    ASSERT_EQ(run("--merge " + in("1") + " --merge " + in("2") + " --no-pictures --out " + in("result/merged")), 0)
        << err_;
    EXPECT_EQ(
        python(
            "import csv; t = [{tuple(r[c] for c in (\"method\", \"budget\", \"case\", \"point\")): "
            "(r[\"max_mm\"], r[\"force_n\"], r[\"iterations_mean\"]) "
            "for r in csv.DictReader(open(f))} for f in (\"sweep.csv\", \"merged/sweep.csv\", \"../1/sweep.csv\")]; "
            "assert all(t[0][k] == v for k, v in t[1].items()) and len(t[1]) == 8 and len(t[2]) == 4, t"),
        0);
    EXPECT_EQ(run("--merge /nonexistent --out " + in("result")), 1);
    EXPECT_EQ(run(small_ + "--sweep --shard 3/2 --out " + in("result")), 2);
}

// The report compares the error of the mesh with the error of the solver.
TEST_F(Report, ReportsWhetherMeshOrSolverHasTheLargerError)
{
    const std::string asked =
        "--scan phantom:48x40x40 --set 'mesh/coarse_cells=5 4 4' --set solver/threads=1 --frames 3 --truth --out " +
        in("result");
    ASSERT_EQ(run(asked + " --refined 40000"), 0) << err_;
    EXPECT_NE(out_.find("mesh off by %"), std::string::npos) << out_;
    EXPECT_EQ(
        python(
            "import csv; t = list(csv.DictReader(open(\"truth.csv\"))); "
            "assert [(r[\"case\"], r[\"law\"]) for r in t] == [(c, l) for l in (\"corotational\", \"neo_hookean\") "
            "for c in (\"displacement\", \"force\")], t; "
            "assert all((r[\"law_distance_p95_percent\"] == \"\") == (r[\"law\"] == \"corotational\") for r in t), t; "
            "assert all(0 < float(r[\"mesh_p95_mm\"]) < float(r[\"mesh_max_mm\"]) < float(r[\"largest_mm\"]) "
            "for r in t); "
            "assert all(r[\"larger\"] == (\"mesh\" if float(r[\"mesh_p95_mm\"]) >= float(r[\"solver_p95_mm\"]) "
            "else \"solver\") for r in t); "
            "assert all(float(r[\"mesh_p95_percent_refined\"]) < float(r[\"mesh_p95_percent\"]) for r in t)"),
        0);
    EXPECT_NE(out_.find("laws apart %"), std::string::npos) << out_;
    EXPECT_EQ(run(asked + "2 --refined 0"), 1);
    EXPECT_NE(err_.find("three resolutions"), std::string::npos) << err_;
}

TEST_F(Report, CtrlCKeepsFinishedRows)
{
    const auto works = [&] { return text(in("err")).find("long_run") != std::string::npos; };
    EXPECT_EQ(interrupt("--stability --case long_run --steps 1e9 --no-pictures --out " + in("result"), works), 130)
        << text(in("err"));
    EXPECT_EQ(access(in("result/report.json").c_str(), F_OK), 0);
}

} // namespace
