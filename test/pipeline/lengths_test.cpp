// Automatic lengths follow from the size of the body; for patients they have their usual values.
#include "pipeline/body.h"
#include "pliant/report.h"
#include "scene/scene.h"
#include "sim/build/model.h"

#include <array>
#include <cmath>
#include <cstring>
#include <string>
#include <unistd.h>

namespace {

struct CapturedLog {
    std::string info, warning;
    CapturedLog()
    {
        pliant_set_log([](pliant_log_level level, const char *text, void *user) {
            auto *log = static_cast<CapturedLog *>(user);
            (level == PLIANT_LOG_WARNING ? log->warning : log->info) += std::string(text) + "\n";
        }, this);
    }
    ~CapturedLog() { pliant_set_log(nullptr, nullptr); }
};

// A block of tissue with a length of `edge` [m], which fills its scan except for an eighth of air along i.
struct Block : Body {
    explicit Block(double edge) : Block(edge, edge, edge) {}
    Block(double x, double y, double z)
        : Body(std::array<int, 3>{32, 24, 20}.data(), std::array<double, 3>{x * 8 / 7, y, z}.data(),
               {{10, 0, 1.2, true}, {5000, 0.4, 1000, false}}, [](int i, int, int) { return i >= 4; })
    {
        scene.warp.margin = scene.grasp.radius = scene.cut.drag = PLIANT_AUTO_LENGTH;
        cells(4, 3, 2, 1);
        fix_plane(0.99 * x * 8 / 7, 0, 0, -1, 0, 0);
    }
    double growth()
    {
        pliant_geometry target;
        const pliant_mesh *mesh = &model->body->fine;
        EXPECT_EQ(pliant_warp_target(&scan.geometry, mesh->rest, mesh->num_nodes, model->scene.warp.margin, SIZE_MAX,
                                     &target),
                  PLIANT_OK);
        return double(pliant_geometry_voxels(&target)) / double(pliant_geometry_voxels(&scan.geometry));
    }
};

TEST(Lengths, ArePatientsFromAKidneyToAManAndInProportionForOthers)
{
    const struct {
        double edge, scale;
    } bodies[] = {{0.0013, 0.026}, {0.029, 0.58}, {0.051, 1}, {0.12, 1}, {0.4, 1}, {0.59, 1}, {1.5, 2.5}, {3, 5}};
    for (const auto &one : bodies) {
        CapturedLog log;
        Block body(one.edge);
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        const pliant_scene &scene = body.model->scene;
        if (one.scale == 1) {
            EXPECT_EQ(scene.grasp.radius, 0.006) << one.edge;
            EXPECT_EQ(scene.cut.drag, 0.003) << one.edge;
        }
        EXPECT_NEAR(scene.grasp.radius, 0.006 * one.scale, 1e-9) << one.edge;
        EXPECT_NEAR(scene.cut.drag, 0.003 * one.scale, 1e-9) << one.edge;
        EXPECT_LE(scene.warp.margin, 0.03 * one.scale + 1e-12) << one.edge;
        if (one.edge > 0.1) EXPECT_NEAR(scene.warp.margin, 0.03 * one.scale, 1e-12) << one.edge;
        if (one.edge > 0.1 && one.scale == 1) EXPECT_EQ(scene.warp.margin, 0.03) << one.edge;
        EXPECT_GT(scene.warp.margin, 0.09 * std::fmin(one.edge, 0.3)) << one.edge;
        EXPECT_LE(body.growth(), 4) << one.edge;
        EXPECT_EQ(log.warning, "") << one.edge;
        EXPECT_EQ(log.info.find("warp/margin") == std::string::npos, one.scale == 1 && scene.warp.margin == 0.03)
            << log.info;
        EXPECT_EQ(body.scene.warp.margin, PLIANT_AUTO_LENGTH) << "the scene that was given stays";
    }
}

TEST(Lengths, AThinBodyHasNoLargerVolumeEither)
{
    for (const auto &box : {std::array<double, 3>{0.25, 0.25, 0.01}, {0.1, 0.03, 0.025}, {0.3, 0.02, 0.02}}) {
        CapturedLog log;
        Block body(box[0], box[1], box[2]);
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        EXPECT_LE(body.growth(), 4);
        EXPECT_GT(body.growth(), 2.5) << "as large as it may be";
        EXPECT_NE(log.info.find("warp/margin"), std::string::npos) << log.info;
    }
}

TEST(Lengths, ExplicitLengthsAreUsed)
{
    CapturedLog log;
    Block body(0.0013);
    body.scene.warp.margin = 0.003;
    body.scene.grasp.radius = 0.006;
    body.scene.cut.drag = 0.003;
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(body.model->scene.warp.margin, 0.003);
    EXPECT_EQ(body.model->scene.grasp.radius, 0.006);
    EXPECT_EQ(body.model->scene.cut.drag, 0.003);
    EXPECT_NE(log.warning.find("warp/margin 0.003 m makes the deformed volume"), std::string::npos) << log.warning;
    EXPECT_NE(log.warning.find("times the scan"), std::string::npos) << log.warning;
    EXPECT_GT(body.growth(), 100);
}

TEST(Lengths, AVolumeThatIsTooLargeIsRefused)
{
    Body body(std::array<int, 3>{20, 20, 20}.data(), std::array<double, 3>{6e-4, 6e-4, 6e-4}.data(),
              {{5000, 0.4, 1000, false}});
    body.cells(2, 2, 2, 1);
    body.fix_plane(0, 0, 1e-9, 0, 0, 1);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    pliant_geometry target = body.scan.geometry;
    for (int d = 0; d < 3; d++) target.size[d] = 20000;
    pliant_warp *warp = nullptr;
    EXPECT_EQ(pliant_warp_create(&body.scan, &body.model->body->fine, &target, 1, &warp), PLIANT_ERROR_MEMORY);
    EXPECT_NE(std::string(pliant_last_error()).find("the deformed volume (warp/margin)"), std::string::npos)
        << pliant_last_error();
}

// Reports and the choice of settings also pull small bodies, for which the patient's lengths (6 mm behind the front, 3
// cm) would lie outside.
TEST(Lengths, OfReportsFollowFromTheBody)
{
    Block small(0.0013), patient(0.2);
    double scale = 0;
    for (Block *body : {&small, &patient}) {
        const pliant_report_input input{&body->scene, &body->scan, nullptr, &body->table};
        pliant_pull_point points[3];
        ASSERT_EQ(pliant_length_scale(&body->scan, nullptr, &body->table, &scale), PLIANT_OK) << pliant_last_error();
        EXPECT_NEAR(scale, body == &small ? 0.026 : 1, 1e-9);
        EXPECT_EQ(pliant_pull_points(&input, nullptr, 0, 3, points), 3);
    }
}

TEST(Lengths, AreWordsOfAScene)
{
    pliant_scene scene, again;
    pliant_scene_defaults(&scene);
    for (const char *name : {"warp/margin", "grasp/radius", "cut/drag", "segment/min_volume"}) {
        EXPECT_EQ(pliant_scene_set(&scene, name, "0.001"), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_scene_set(&scene, name, "-1"), PLIANT_ERROR_SCENE) << name;
        EXPECT_NE(std::string(pliant_last_error()).find("nor auto"), std::string::npos) << pliant_last_error();
        EXPECT_EQ(pliant_scene_set(&scene, name, "auto"), PLIANT_OK) << pliant_last_error();
    }
    EXPECT_EQ(scene.warp.margin, PLIANT_AUTO_LENGTH);
    std::string text(pliant_scene_text(&scene, 0, nullptr) + 1, '\0');
    pliant_scene_text(&scene, text.size(), &text[0]);
    EXPECT_NE(text.find("margin: auto"), std::string::npos);
    ASSERT_EQ(pliant_scene_parse(text.c_str(), "text", nullptr, &again), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(std::memcmp(&scene, &again, sizeof scene), 0);
}

// The available scans are of patients.
TEST(Lengths, OfShippedScansAreUnchanged)
{
    for (const char *name : {"phantom", "phantom:120x84x102", PLIANT_TEST_DATA "/abdomen/ct.nii.gz",
                             PLIANT_TEST_DATA "/thorax/ct.mha", PLIANT_TEST_DATA "/loader/dicom_jpeg2000_abdomen"}) {
        pliant_scene scene;
        pliant_volume scan{};
        pliant_labels labels{};
        pliant_material_table table{};
        pliant_model *model = nullptr;
        pliant_scene_defaults(&scene);
        if (name[0] == '/' && access(name, R_OK) != 0) continue;
        ASSERT_EQ(pliant_inputs_read(&scene, name, &scan, &labels, &table), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(
            pliant_model_build(&scene, &scan, labels.voxels ? &labels : nullptr, &table, {nullptr, nullptr}, &model),
            PLIANT_OK)
            << pliant_last_error();
        EXPECT_EQ(model->scene.warp.margin, 0.03) << name;
        EXPECT_EQ(model->scene.grasp.radius, 0.006) << name;
        EXPECT_EQ(model->scene.cut.drag, 0.003) << name;
        pliant_model_free(model);
        pliant_material_table_free(&table);
        pliant_labels_free(&labels);
        pliant_volume_free(&scan);
    }
}

} // namespace
