// Settings of contact and of the quasi-static solver: documented, few, and in one place each.
#include "contact/advance/advance.h"
#include "contact/settings.h"
#include "fem/quasistatic/settings.h"

#include <gtest/gtest.h>

#include <glob.h>

#include <cmath>
#include <fstream>
#include <regex>
#include <set>
#include <string>
#include <vector>

namespace {

struct Setting {
    const char *name, *unit, *meaning, *source, *half, *twice;
    double value;
};

const std::vector<Setting> contact = {
#define SETTING(type, name, value, unit, meaning, source, half, twice) \
    {#name, unit, meaning, source, half, twice, double(value)},
    PLIANT_CONTACT_SETTING_LIST(SETTING)};
const std::vector<Setting> quasistatic = {PLIANT_QUASISTATIC_SETTING_LIST(SETTING)};
#undef SETTING

void check(const std::vector<Setting> &settings)
{
    std::set<std::string> names;
    for (const Setting &each : settings) {
        EXPECT_TRUE(names.insert(each.name).second) << each.name;
        for (const char *text : {each.unit, each.meaning, each.source, each.half, each.twice})
            EXPECT_FALSE(std::string(text).empty()) << each.name;
        EXPECT_GT(each.value, 0) << each.name;
    }
}

TEST(Settings, OfContactAreAtMostThirtyAndDocumented)
{
    EXPECT_LE(contact.size(), 30u);
    check(contact);
}

TEST(Settings, OfTheQuasistaticSolverAreDocumented) { check(quasistatic); }

TEST(Settings, TheSceneSetsTheGuardDepth)
{
    pliant_scene scene;
    pliant_scene_defaults(&scene);
    scene.contact.guard_depth = 5e-3;
    const pliant_contact_settings settings = pliant_contact_settings_of(&scene);
    pliant_part ball{};
    ball.kind = PLIANT_PART_SPHERE;
    ball.radius = 0.1;
    EXPECT_EQ(pliant_advance_guard(&settings, &ball, 0.1), 5e-3);
    EXPECT_DOUBLE_EQ(pliant_advance_guard(&settings, &ball, 0.01), settings.guard_of_cell * 0.01);
    ball.radius = 0.005;
    EXPECT_DOUBLE_EQ(pliant_advance_guard(&settings, &ball, 0.1), settings.guard_of_part * 0.005);
}

// Constants of whole files: tolerances of exact algorithms, geometry, and lengths of the scene. A constant that tunes
// contact or the solver belongs to one of the two lists of settings.
const std::set<std::string> numerical = {
    "contact/advance/advance_rules.h PLIANT_ADVANCE_MIN_PROGRESS",
    "contact/advance/advance_rules.h PLIANT_ADVANCE_MIN_STEP",
    "contact/advance/advance_rules.h PLIANT_ADVANCE_NEAR_LIMIT",
    "contact/advance/advance_rules.h PLIANT_ADVANCE_SAFETY",
    "contact/advance/advance_rules.h PLIANT_ADVANCE_SLACK",
    "contact/advance/convex_bound.c exact",
    "contact/advance/convex_bound.c tiny",
    "contact/advance/field_bound.c close_start",
    "contact/advance/field_bound.c close_time",
    "contact/advance/field_bound.c enough",
    "contact/advance/field_bound.c smallest",
    "contact/advance/motion.c box_interval",
    "contact/detect/contact_surface.c almost_none",
    "contact/detect/contact_surface.c farthest",
    "contact/detect/contact_surface.c half",
    "contact/detect/tet_grid.c float_spacing",
    "contact/detect/tet_grid.c min_enlargement",
    "contact/detect/tissue_cut.c folded",
    "contact/detect/tissue_cut.c rounding",
    "contact/detect/tissue_rules.h PLIANT_TISSUE_BORDER",
    "contact/detect/tissue_rules.h PLIANT_TISSUE_PARALLEL",
    "contact/shapes/field.c around",
    "contact/shapes/field.c enlargement",
    "contact/shapes/field.c finest",
    "contact/shapes/field.c max_points",
    "contact/shapes/field.c no_way",
    "contact/shapes/field.c rounding",
    "contact/shapes/field.c thinnest",
    "contact/shapes/field.c usual_points",
    "contact/shapes/hull.c in_plane",
    "contact/shapes/instruments.c camera_length",
    "contact/shapes/instruments.c camera_radius",
    "contact/shapes/instruments.c hook_foot",
    "contact/shapes/instruments.c hook_radius",
    "contact/shapes/instruments.c hook_stem",
    "contact/shapes/instruments.c hook_wrist",
    "contact/shapes/instruments.c probe_length",
    "contact/shapes/instruments.c probe_radius",
    "contact/shapes/instruments.c spatula_radius",
    "contact/shapes/nearest_point.c edge_bend",
    "contact/shapes/nearest_point.c exact",
    "contact/shapes/nearest_point.c half",
    "contact/shapes/nearest_point.c shortest_normal",
    "contact/shapes/shapes.c thinnest",
    "contact/shapes/solid.c largest",
    "contact/shapes/solid.c one_point",
    "contact/shapes/solid.c smallest",
    "contact/shapes/solid.h PLIANT_FIELD_SLOPE",
    "contact/shapes/triangle_tree.c far",
    "contact/shapes/triangle_tree.c pi",
    "contact/solve/cone_problem.h PLIANT_CONE_EXACT",
    "contact/solve/cone_problem.h PLIANT_CONE_FAR",
    "contact/solve/cone_problem.h PLIANT_CONE_FIXED",
    "contact/solve/cone_problem.h PLIANT_CONE_MIN_DECREASE",
    "contact/solve/cone_problem.h PLIANT_CONE_MIN_STEP",
    "contact/solve/cone_problem.h PLIANT_CONE_STEP_FACTOR",
    "contact/solve/cone_problem.h PLIANT_CONE_STRONG_DAMPING",
    "contact/solve/cone_problem.h PLIANT_CONE_STRONG_RESISTANCE",
    "contact/solve/cone_problem.h PLIANT_CONE_TOLERANCE",
    "contact/solve/cone_problem.h PLIANT_CONE_WEAK_DAMPING",
    "contact/solve/cone_problem.h PLIANT_CONE_WEAK_RESISTANCE",
    "fem/quasistatic/active_set.c sticking",
    "fem/quasistatic/anderson.h PLIANT_ANDERSON_MIN_RATE",
    "fem/quasistatic/contact_bodies.c point_compliance",
    "fem/quasistatic/newton_rules.h PLIANT_NEWTON_DIFFERENCE",
    "fem/quasistatic/rigid_body_rules.h PLIANT_SMALL_ANGLE",
    "sim/api/contact_error.c error_of_depth",
    "sim/api/contact_error.c error_of_rest",
    "sim/build/automatic_lengths.c drag",
    "sim/build/automatic_lengths.c largest_body",
    "sim/build/automatic_lengths.c margin",
    "sim/build/automatic_lengths.c max_growth",
    "sim/build/automatic_lengths.c min_announced",
    "sim/build/automatic_lengths.c radius",
    "sim/build/automatic_lengths.c smallest_body",
    "sim/build/fixed_regions.c unnoticed_offset",
    "sim/build/linear_wrench.c min_motion",
    "sim/build/model.c max_cells",
    "sim/step/contact_reuse.c on_surface",
    "sim/step/cut.c max_chord_error",
    "sim/step/cut.c min_motion",
    "sim/step/cut.c overlap_distance",
    "sim/step/legs.c nearly_all",
    "sim/step/missing_compliance.c depth_exponent",
    "sim/step/missing_compliance.c exact_length",
    "sim/step/missing_compliance.c exact_logarithm",
    "sim/step/missing_compliance.c kappa_hertz",
    "sim/step/missing_compliance.c kappa_sneddon",
    "sim/step/missing_compliance.c lattice_distance",
    "sim/step/missing_compliance.c lattice_nu",
    "sim/step/missing_compliance.c lattice_response",
    "sim/step/missing_compliance.c lattice_smoothing",
    "sim/step/missing_compliance.c max_decrease",
    "sim/step/missing_compliance.c min_tissue",
    "sim/step/missing_compliance.c outside",
    "sim/step/proxy.c min_lever",
    "sim/step/warm_up_cut.c strip_width",
};

// Return a line of code without its comments and strings.
std::string code_of(std::string line, bool &in_comment)
{
    if (in_comment) {
        const size_t end = line.find("*/");
        if (end == std::string::npos) return "";
        line.erase(0, end + 2);
        in_comment = false;
    }
    line = std::regex_replace(line, std::regex("\"(\\\\.|[^\"\\\\])*\""), "\"\"");
    line = std::regex_replace(line, std::regex("/\\*.*?\\*/|//.*"), "");
    const size_t begin = line.find("/*");
    in_comment = begin != std::string::npos;
    return line.substr(0, begin);
}

// Return whether a number needs no name. Multiples of 1/2 need none, and a factor of 1000 between units needs none.
// Powers of ten up to 1e-6 are rounding tolerances. Powers of ten from 1e6 on are bounds of invalid input.
bool is_plain(const std::string &number)
{
    const double value = std::stod(number), exponent = std::log10(value);
    return value == 0 || std::fmod(2 * value, 1) == 0 || number == "1e-3" || number == "1e3" ||
           (number.compare(0, 2, "1e") == 0 && std::fabs(exponent) >= 6);
}

// Find the names of constants of whole files, and the lines of numbers inside functions. Tables are constants.
void add_constants(const std::string &folder, std::set<std::string> &names, std::vector<std::string> &bare)
{
    const std::regex table("^static const [a-z_0-9]+ [^(]* = "), constant("^static const (?:double|float) "),
        define("^#define (PLIANT_[A-Z_]+) [-({0-9.].*"), name("([a-z_]+)(?:\\[[^\\]]*\\])* = "),
        number("(?:^|[^\\w.])((?:\\d+\\.\\d*|\\.\\d+|\\d+(?=e))(?:e[-+]?\\d+)?)f?");
    glob_t files{};
    ASSERT_EQ(glob((PLIANT_SOURCE_DIR "/src/" + folder + "/*.[ch]").c_str(), 0, nullptr, &files), 0) << folder;
    for (size_t f = 0; f < files.gl_pathc; f++) {
        const std::string path = std::string(files.gl_pathv[f]).substr(std::string(PLIANT_SOURCE_DIR "/src/").size());
        if (path.find("settings.h") != std::string::npos) continue;
        std::ifstream in(files.gl_pathv[f]);
        std::string line;
        std::smatch match;
        bool in_comment = false, in_constant = false, is_number = false;
        for (int at = 1; std::getline(in, line); at++) {
            const std::string code = code_of(line, in_comment);
            const bool begins = std::regex_search(code, table), is_constant = in_constant || begins;
            if (std::regex_match(code, match, define)) names.insert(path + " " + match[1].str());
            if (begins) is_number = std::regex_search(code, constant);
            if (is_constant && is_number)
                for (std::sregex_iterator each(code.begin(), code.end(), name), end; each != end; ++each)
                    names.insert(path + " " + (*each)[1].str());
            in_constant = is_constant && code.find(';') == std::string::npos;
            if (is_constant || code.empty() || code[0] != ' ') continue;
            for (std::sregex_iterator each(code.begin(), code.end(), number), end; each != end; ++each)
                if (!is_plain((*each)[1].str())) bare.push_back(path + ":" + std::to_string(at) + ": " + line);
        }
    }
    globfree(&files);
}

TEST(Settings, NoOtherConstantTunesContactOrTheSolver)
{
    std::set<std::string> names;
    std::vector<std::string> bare;
    for (const char *folder :
         {"sim/api", "sim/build", "sim/export", "sim/step", "contact", "contact/advance", "contact/detect",
          "contact/shapes", "contact/solve", "contact/volume", "fem/quasistatic"})
        add_constants(folder, names, bare);
    for (const std::string &each : names) EXPECT_TRUE(numerical.count(each)) << each << " is no constant of the list";
    for (const std::string &each : numerical) EXPECT_TRUE(names.count(each)) << each << " is no constant of the code";
    EXPECT_EQ(bare, std::vector<std::string>()) << "name these numbers at the top of the file, or make them settings";
}

} // namespace
