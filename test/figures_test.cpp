// Tests of launch/figures from a user's view: wrong usage, and the cheapest figures on a small built-in scan.
#include "program.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <string>
#include <unistd.h>

namespace {

class Figures : public Program {
protected:
    Figures() : Program(PLIANT_SOURCE_DIR "/launch/figures") {}
    // folder of all programs
    static std::string programs()
    {
        std::string folder;
        for (const std::string program : {PLIANT_DEFORM, PLIANT_REPORT_PROGRAM, PLIANT_SEGMENT_PROGRAM}) {
            EXPECT_TRUE(folder.empty() || folder == program.substr(0, program.rfind('/'))) << program;
            folder = program.substr(0, program.rfind('/'));
        }
        return folder;
    }
};

TEST_F(Figures, WrongUsageHasItsExitCode)
{
    for (const char *arguments : {"", "h9", "h", "all2", "'h1 h2'"}) {
        EXPECT_EQ(run(arguments), 2) << arguments;
        for (const char *name :
             {"h1 ", "h2 ", "h4.1 ", "h5 ", "h6 ", "c2 ", "c3 ", "c4 ", "c6 ", "c7 ", "c8 ", "ctable1 "})
            EXPECT_NE(out_.find(std::string("\n  ") + name), std::string::npos) << name;
    }
    EXPECT_EQ(run("h1 --frobnicate 1"), 2);
    EXPECT_NE(err_.find("--frobnicate"), std::string::npos) << err_;
    EXPECT_EQ(run("h1 --out"), 2);
    EXPECT_NE(err_.find("--out: a value is missing"), std::string::npos) << err_;
    EXPECT_NE(run("h1 --programs " + in("absent")), 0);
    EXPECT_NE(err_.find("pliant_deform is not in " + in("absent")), std::string::npos) << err_;
}

// [C] figure 3: segmentation and mesh of an organ. The caption has the size of the mesh and the differences from the
// paper.
TEST_F(Figures, OfAProxyOfTheBuiltInLiver)
{
    ASSERT_EQ(run("c3 --scan phantom:64x40x40 --programs " + programs() + " --out " + in("f")), 0) << err_;
    const std::string caption = text(in("f/c3/caption.txt"));
    EXPECT_EQ(caption.compare(0, 12, "[C] figure 3"), 0) << caption;
    EXPECT_NE(caption.find("Differences from [C]"), std::string::npos) << caption;
    for (const char *name :
         {"segmentation/axial.png", "mesh_axial.png", "mesh_coronal.png", "mesh_sagittal.png", "surface.ply"})
        EXPECT_EQ(access(in(std::string("f/c3/") + name).c_str(), R_OK), 0) << name;
    const std::string elements = text(in("f/c3/elements.csv"));
    const auto tetrahedra = std::count(elements.begin(), elements.end(), '\n') - 1;
    EXPECT_GT(tetrahedra, 300);
    int of_liver = 0; // other tetrahedra lie at its border: each holds some liver, but more of other tissue
    for (size_t at = elements.find(",liver\n"); at != std::string::npos; at = elements.find(",liver\n", at + 1))
        of_liver++;
    EXPECT_GT(of_liver, tetrahedra / 2);
    EXPECT_EQ(elements.find(",bone\n"), std::string::npos) << "the organ alone";
    EXPECT_NE(caption.find("(label "), std::string::npos) << "the piece of the mixture: " << caption;
    EXPECT_NE(caption.find(std::to_string(tetrahedra) + " tetrahedra"), std::string::npos) << caption;
}

// [H] figure 5 has no built-in scan. The caption says how to get one.
TEST_F(Figures, OfABreastNeedABreast)
{
    ASSERT_EQ(run("h5 --scan phantom --programs " + programs() + " --out " + in("f")), 0) << err_;
    EXPECT_NE(text(in("f/h5/caption.txt")).find("launch/breast_scan.py"), std::string::npos);
}

class Segment : public Program {
protected:
    Segment() : Program(PLIANT_SEGMENT_PROGRAM) {}
};

TEST_F(Segment, PrintsThePieceAtAPoint)
{
    // The corner of the scan is air. The point 1 cm below the front of the liver is not.
    ASSERT_EQ(run("--scan phantom:48x40x40 --out " + in("s") + " --at=-0.0664,-0.0528,0.0971"), 0) << err_;
    int label = 0, of_air = 0;
    const std::string told = "the piece at the point: label ";
    ASSERT_NE(out_.find(told), std::string::npos) << out_;
    ASSERT_EQ(std::sscanf(out_.c_str() + out_.find(told), "the piece at the point: label %d,", &label), 1);
    EXPECT_EQ(access(in("s/axial.png").c_str(), R_OK), 0);
    ASSERT_EQ(run("--scan phantom:48x40x40 --out " + in("s") + " --at=-0.19,-0.14,-0.14"), 0) << err_;
    ASSERT_EQ(std::sscanf(out_.c_str() + out_.find(told), "the piece at the point: label %d,", &of_air), 1);
    EXPECT_NE(label, of_air);
    EXPECT_EQ(run("--scan phantom:48x40x40 --out " + in("s") + " --at 0,0,5"), 1);
    EXPECT_NE(err_.find("--at 0,0,5 lies outside of the scan"), std::string::npos) << err_;
    EXPECT_EQ(run("--out x --at 0,0"), 2);
    EXPECT_NE(err_.find("--at 0,0: expected X,Y,Z"), std::string::npos) << err_;
}

} // namespace
