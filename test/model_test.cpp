// Tests of building a model: the statistics, warnings and refusals.
#include "pipeline/body.h"

#include <string>

namespace {

const int size[3] = {8, 8, 8};
const double box[3] = {0.08, 0.08, 0.08};

std::string warnings_of(pliant_method method, double gravity, double patch)
{
    Body body(size, box, {{5e3, 0.45, 1000, false}});
    std::string logged;
    body.cells(2, 2, 2, 2);
    body.fix_plane(0.001, 0, 0, 1, 0, 0);
    body.scene.model.method = method;
    body.scene.model.gravity[1] = gravity;
    body.scene.model.patch = patch;
    pliant_set_log([](pliant_log_level level, const char *message, void *user) {
        if (level == PLIANT_LOG_WARNING) *static_cast<std::string *>(user) += std::string(message) + "\n";
    }, &logged);
    EXPECT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    pliant_set_log(nullptr, nullptr);
    return logged;
}

TEST(Model, CoarseMethodsUnderGravityWarnOfTheirError)
{
    for (pliant_method method : {PLIANT_COARSE, PLIANT_AVERAGED, PLIANT_LOD}) {
        std::string logged = warnings_of(method, 9.81, 0);
        EXPECT_NE(logged.find("model/gravity"), std::string::npos) << method;
        EXPECT_NE(logged.find("tens of percent"), std::string::npos) << logged;
        EXPECT_NE(logged.find("nothing corrects it"), std::string::npos) << logged;
        EXPECT_EQ(warnings_of(method, 0, 0), "");
    }
    EXPECT_NE(warnings_of(PLIANT_AVERAGED, 9.81, 0.05).find("near a grasp"), std::string::npos);
    EXPECT_NE(warnings_of(PLIANT_SCHUR, 9.81, 0).find("10 to 15 times"), std::string::npos);
    EXPECT_EQ(warnings_of(PLIANT_FINE, 9.81, 0), "");
}

TEST(Model, OnlyASceneThatMayCutKeepsVoxels)
{
    Body body(size, box, {{5e3, 0.45, 1000, false}});
    body.cells(2, 2, 2, 2);
    body.fix_plane(0.001, 0, 0, 1, 0, 0);
    pliant_build_statistics statistics;
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    pliant_model_get_statistics(body.model, &statistics);
    EXPECT_EQ(pliant_model_get_body(body.model)->voxels, nullptr);
    EXPECT_EQ(statistics.bytes[PLIANT_BUILD_link], 0u);
    body.scene.cut.kind = PLIANT_CUT_SEVER;
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    pliant_model_get_statistics(body.model, &statistics);
    ASSERT_NE(pliant_model_get_body(body.model)->voxels, nullptr);
    EXPECT_GE(statistics.bytes[PLIANT_BUILD_link], 8 * 8 * 8 * sizeof(int32_t)) << "the owner of every voxel";
}

TEST(Model, EmptyMaterialsAreHiddenWithHideEmpty)
{
    // One half of the body is empty, but inside elements with tissue.
    Body body(size, box, {{10, 0, 1, true}, {5e3, 0.45, 1000, false}},
              [](int i, int, int k) { return i > 2 && k < 6; });
    body.cells(2, 2, 2, 1);
    body.fix_plane(0.001, 0, 0, 1, 0, 0);
    body.scan.background = 200;
    pliant_geometry target;
    for (bool hide : {false, true}) {
        body.scene.warp.hide_empty = hide;
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_model_get_scan(body.model), &body.scan);
        ASSERT_EQ(pliant_warp_target(&body.scan.geometry, nullptr, 0, 0, 1000, &target), PLIANT_OK);
        ASSERT_EQ(pliant_data_set_warp(body.model, body.data, &target), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_step(body.model, body.data), PLIANT_OK) << pliant_last_error();
        const pliant_volume *drawn = pliant_warp_volume(pliant_data_get_warp(body.data));
        int covered = 0; // empty voxels that elements with tissue draw
        for (size_t v = 0; v < 8 * 8 * 8; v++) {
            const uint8_t seen = static_cast<uint8_t *>(drawn->voxels)[v],
                          own = static_cast<uint8_t *>(body.scan.voxels)[v];
            if (own) ASSERT_EQ(seen, own) << v;
            else if (seen != 200) covered++;
        }
        EXPECT_EQ(covered > 0, !hide) << covered;
    }
}

TEST(Model, MethodsOnWholeCubesCannotBeCut)
{
    Body body(size, box, {{5e3, 0.45, 1000, false}});
    body.cells(2, 2, 2, 2);
    body.fix_plane(0.001, 0, 0, 1, 0, 0);
    body.scene.model.method = PLIANT_LOD;
    body.scene.cut.kind = PLIANT_CUT_SEVER;
    EXPECT_EQ(body.build(), PLIANT_ERROR_SCENE);
    EXPECT_NE(std::string(pliant_last_error()).find("cut/kind: lod"), std::string::npos) << pliant_last_error();
}

// A plane between two layers of nodes fixes the layer behind it. A warning reports the distance and the exact planes.
TEST(Model, APlaneBetweenNodesIsLogged)
{
    const int voxels[3] = {8, 8, 8};
    const double box[3] = {0.08, 0.08, 0.08};
    static std::string logged;
    pliant_set_log(
        [](pliant_log_level level, const char *message, void *) {
            if (level == PLIANT_LOG_WARNING) logged += message;
        },
        nullptr);
    for (double at : {0.02, 0.0201, 0.025, -0.003}) {
        Body body(voxels, box, {{4000, 0.45, 1000, false}});
        body.cells(4, 4, 4, 1);
        body.fix_plane(0, 0, at, 0, 0, 3);
        logged.clear();
        pliant_status status = body.build();
        if (at < 0) {
            EXPECT_EQ(status, PLIANT_ERROR_SCENE);
            EXPECT_NE(logged.find("number 1 holds no node: the first lies 3 mm in front of it"), std::string::npos)
                << logged;
            EXPECT_NE(std::string(pliant_last_error()).find("fixed/planes: number 1 holds no node"), std::string::npos)
                << pliant_last_error();
            continue;
        }
        EXPECT_EQ(status, PLIANT_OK) << pliant_last_error();
        if (at < 0.024) {
            EXPECT_EQ(logged, "");
        } else {
            EXPECT_NE(logged.find("tissue is held 5 mm behind it, at (0.00000 0.00000 0.02000); "
                                  "the next nodes lie 15 mm in front of it, at (0.00000 0.00000 0.04000)"),
                      std::string::npos)
                << logged;
        }
    }
    pliant_set_log(nullptr, nullptr);
}

TEST(Model, ProgressNeverGoesBack)
{
    Body body(size, box, {{5e3, 0.45, 1000, false}});
    body.cells(4, 4, 4, 2);
    body.fix_plane(0.001, 0, 0, 1, 0, 0);
    body.scene.model.method = PLIANT_AVERAGED;
    std::vector<double> reports;
    pliant_model *model = nullptr;
    const pliant_progress progress = {[](double fraction, const char *, void *user) {
                                          static_cast<std::vector<double> *>(user)->push_back(fraction);
                                          return true;
                                      }, &reports};
    ASSERT_EQ(pliant_model_build(&body.scene, &body.scan, nullptr, &body.table, progress, &model), PLIANT_OK)
        << pliant_last_error();
    pliant_model_free(model);
    EXPECT_GT(reports.size(), PLIANT_NUM_BUILD_STAGES + 1u); // and reports within the longest stage
    for (size_t n = 1; n < reports.size(); n++) EXPECT_GE(reports[n], reports[n - 1]);
    EXPECT_EQ(reports.back(), 1);
}

TEST(Model, UnusedOptionsAreLogged)
{
    const int voxels[3] = {4, 4, 4};
    const double box[3] = {0.04, 0.04, 0.04};
    static std::string logged;
    pliant_set_log(
        [](pliant_log_level level, const char *message, void *) {
            if (level == PLIANT_LOG_WARNING) logged += message;
        },
        nullptr);
    for (pliant_solver_kind kind : {PLIANT_COROTATIONAL, PLIANT_TLED}) {
        Body body(voxels, box, {{4000, 0.45, 1000, false}});
        body.cells(2, 2, 2, 1);
        body.fix_plane(0, 0, 0, 0, 0, 1);
        body.scene.solver.kind = kind;
        logged.clear();
        EXPECT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(logged, "");
        const double damping = body.scene.tled.damping;
        body.scene.tled.damping = 2;
        body.scene.ground.friction = 0.5;
        EXPECT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(logged.find("tled/damping: used only by solver/kind: tled") == 0, kind == PLIANT_COROTATIONAL)
            << logged;
        EXPECT_EQ(
            logged.find("ground/friction: with solver/kind: corotational, only detached pieces touch the ground") !=
                std::string::npos,
            kind == PLIANT_COROTATIONAL)
            << logged;
        logged.clear();
        body.scene.tled.damping = damping;
        body.scene.cut.kind = PLIANT_CUT_SEVER; // detached pieces need the ground
        EXPECT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(logged.find("ground"), std::string::npos) << logged;
    }
    pliant_set_log(nullptr, nullptr);
}

} // namespace
