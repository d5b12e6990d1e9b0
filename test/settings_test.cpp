// Settings of contact and of the quasi-static solver: documented, few, and in one place each.
#include "contact/advance/advance.h"
#include "contact/settings.h"
#include "fem/quasistatic/settings.h"

#include <gtest/gtest.h>

#include <glob.h>

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
    "contact/advance/advance_rules.h PLIANT_ADVANCE_SAFETY",
    "contact/advance/advance_rules.h PLIANT_ADVANCE_MIN_PROGRESS",
    "contact/advance/convex_bound.c exact",
    "contact/advance/convex_bound.c tiny",
    "contact/advance/field_bound.c enough",
    "contact/advance/field_bound.c smallest",
    "contact/advance/field_bound.c close_time",
    "contact/advance/field_bound.c close_start",
    "contact/detect/contact_surface.c farthest",
    "contact/detect/contact_surface.c almost_none",
    "contact/detect/contact_surface.c half",
    "contact/detect/tissue_cut.c folded",
    "contact/detect/tissue_rules.h PLIANT_TISSUE_BORDER",
    "contact/shapes/field.c around",
    "contact/shapes/field.c finest",
    "contact/shapes/field.c usual_points",
    "contact/shapes/field.c thinnest",
    "contact/shapes/field.c no_way",
    "contact/shapes/hull.c in_plane",
    "contact/shapes/instruments.c hook_wrist",
    "contact/shapes/nearest_point.c exact",
    "contact/shapes/nearest_point.c half",
    "contact/shapes/triangle_tree.c far",
    "contact/shapes/triangle_tree.c pi",
    "contact/shapes/shapes.c thinnest",
    "contact/shapes/solid.c one_point",
    "contact/shapes/solid.c largest",
    "contact/shapes/solid.h PLIANT_FIELD_SLOPE",
    "contact/solve/cone_rules.h PLIANT_CONE_FIXED",
    "contact/solve/cone_rules.h PLIANT_CONE_REGULARIZATION",
    "contact/solve/cone_rules.h PLIANT_CONE_STEP_FACTOR",
    "contact/solve/cone_rules.h PLIANT_CONE_TOLERANCE",
    "fem/quasistatic/newton_rules.h PLIANT_NEWTON_DIFFERENCE",
    "sim/build/automatic_lengths.c smallest_body",
    "sim/build/automatic_lengths.c radius",
    "sim/build/automatic_lengths.c max_growth",
    "sim/build/automatic_lengths.c min_announced",
    "sim/build/linear_wrench.c min_motion",
    "sim/step/cut.c max_return_speed",
    "sim/step/cut.c overlap_distance",
    "sim/step/cut.c min_motion",
    "sim/step/cut.c max_chord_error",
    "sim/step/cut.c long_motion",
};

void add_constants(const std::string &folder, std::set<std::string> &found)
{
    const std::regex constant("^(?:static const (?:double|float) ([a-z_]+) =|#define (PLIANT_[A-Z_]+) [-(0-9.]).*");
    glob_t files{};
    ASSERT_EQ(glob((PLIANT_SOURCE_DIR "/src/" + folder + "/*.[ch]").c_str(), 0, nullptr, &files), 0) << folder;
    for (size_t f = 0; f < files.gl_pathc; f++) {
        const std::string path = files.gl_pathv[f];
        std::ifstream in(path);
        std::string line;
        std::smatch match;
        while (std::getline(in, line))
            if (std::regex_match(line, match, constant))
                found.insert(path.substr(path.find("/src/") + 5) + " " +
                             (match[1].matched ? match[1] : match[2]).str());
    }
    globfree(&files);
}

TEST(Settings, NoOtherConstantTunesContactOrTheSolver)
{
    std::set<std::string> found;
    for (const char *folder : {"sim/build", "sim/step", "contact", "contact/advance", "contact/detect",
                               "contact/shapes", "contact/solve", "fem/quasistatic"})
        add_constants(folder, found);
    EXPECT_EQ(found, numerical);
}

} // namespace
