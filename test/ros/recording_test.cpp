// Sessions of every engine with cuts are recorded to a bag as the node does, and recomputed from it; each step must be
// bitwise identical. On a GPU if there is one. No master, no clock. Bodies and states are found again from messages.
#include "../pipeline/adapt_cases.h"
#include "cut/cut.h"
#include "material/material.h"
#include "ros/record/checkpoint.h"
#include "ros/record/preceding_messages.h"
#include "ros/record/recorded.h"
#include "ros/record/message.h"
#include "ros/record/rerun.h"
#include "ros/sim/resumable_state.h"

#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <topic_tools/shape_shifter.h>
#include <pliant/Session.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <sys/stat.h>
#include <unistd.h>

namespace {

using pliant_ros::CutInput;
using pliant_ros::LoadedModel;
using pliant_ros::Rerun;
using pliant_ros::Step;
using pliant_ros::ToolInput;

const Case subdivided{"subdivide", [](pliant_scene &scene) { scene.cut.kind = PLIANT_CUT_SUBDIVIDE; }};
const Case octree_dynamic{"tled_octree", [](pliant_scene &scene) {
                              dynamic.set(scene);
                              octree.set(scene);
                          }};
const Case timed{"budget", [](pliant_scene &scene) { scene.solver.budget_ms = 0.3; }};
const Case tough{"tough", [](pliant_scene &scene) { scene.cut.resistance = 1; }};

enum { HOLD = 0, FIRST = 2, LINE = 9, UNDO = 14, STEPS = 20, MAX_WAITS = 1000 };

// A block hangs from its floor and is pulled at two points. Its model is on a GPU if there is one, and uses the scan of
// the body.
struct Session {
    Body body;
    std::shared_ptr<LoadedModel> loaded = std::make_shared<LoadedModel>();
    explicit Session(const Case &each)
        : body(size, box, {{4000, 0.4, 1000, false}, {20000, 0.4, 1200, false}},
               [](int i, int, int k) { return (i < 6 || i > 9) && k > 9; })
    {
        body.fix_plane(0, 0, 1e-6, 0, 0, 1);
        body.cells(8, 8, 8, 1);
        body.scene.grasp.radius = 0.02;
        body.scene.solver.refresh_interval = 2;
        body.scene.cut.kind = PLIANT_CUT_SEVER;
        body.scene.cut.resistance = 0;
        each.set(body.scene);
        for (uint32_t m = 0; m < body.table.num_materials; m++) body.table.materials[m].toughness = 100;
        body.scene.solver.backend = PLIANT_AUTO;
        EXPECT_EQ(pliant_model_build(&body.scene, &body.scan, nullptr, &body.table, {nullptr, nullptr}, &loaded->model),
                  PLIANT_OK)
            << pliant_last_error();
        loaded->revision = 1;
    }
};

// Return the input that the node would have received at step s.
Step heard(int s)
{
    Step step;
    step.load = 1;
    step.iterations = 20;
    step.tolerance = 1e-6;
    step.stiffness = 200;
    step.gravity = {{1, 0, s > 6 ? -0.5 : 0}};
    const double points[3][3] = {{0.03, 0.08, 0.15}, {0.13, 0.08, 0.15}, {0.081, 0.08, 0.172}};
    for (int t = 0; t < 3; t++) {
        ToolInput tool;
        tool.name = t == 0 ? "left" : t == 1 ? "right" : "knife";
        tool.present = t < 2 || (s >= FIRST && s < LINE);
        std::copy(points[t], points[t] + 3, tool.tip.begin());
        tool.tip[1] += t < 2 ? (t ? 4e-4 : -4e-4) * s : 0;
        tool.tip[2] += t < 2 ? 2e-4 * s : -0.016 * std::max(0, std::min(s - FIRST, 4));
        tool.rotation[3] = 1;
        tool.closes = t < 2 && s == HOLD;
        tool.closed = t < 2;
        tool.cuts = t == 2 && s >= FIRST && s < FIRST + 5;
        if (t == 2) tool.blade_from[1] = -0.12, tool.blade_to[1] = 0.12;
        step.tools.push_back(tool);
    }
    if (s == LINE || s == UNDO || s == UNDO + 2) {
        CutInput cut;
        cut.undo = s != LINE;
        cut.points.resize(cut.undo ? 0 : 2);
        if (!cut.undo) {
            cut.points[0].x = cut.points[1].x = 0.047;
            cut.points[0].y = -0.01;
            cut.points[1].y = 0.17;
            cut.points[0].z = cut.points[1].z = 0.18;
            cut.depth.z = -0.08;
        }
        step.cuts.push_back(cut);
    }
    return step;
}

struct Recording {
    std::string path;
    uint64_t turns = 0;
    int32_t nodes = 0, maximum = 0; // initial number, and maximum with cuts
    uint32_t taken = 0;
    std::string backend;
    explicit Recording(const std::shared_ptr<const LoadedModel> &loaded)
        : path(testing::TempDir() + "recording_test_" + std::to_string(getpid()) + ".bag")
    {
        const pliant_model &model = *loaded->model;
        pliant_ros::Data data = pliant_ros::create_data(model);
        rosbag::Bag bag(path, rosbag::bagmode::Write);
        nodes = pliant_data_get_body(data.get())->fine.num_nodes;
        // also wait for the background on a busy machine
        const bool waits = pliant_model_get_scene(&model)->solver.kind == PLIANT_COROTATIONAL;
        for (int s = 0; s < STEPS; s += s != UNDO - 1 || !waits || taken != 0 || turns > MAX_WAITS) {
            Step step = heard(s);
            step.sequence = ++turns;
            if (turns == 1) pliant_ros::add_tools(model, data.get(), step.tools);
            for (const CutInput &cut : step.cuts) {
                pliant_cut_report report;
                pliant_ros::make_cut(model, data.get(), cut, &report);
            }
            pliant_ros::set_step_outcome(pliant_ros::make_step(model, data.get(), PLIANT_BACKGROUND_LIVE, step), *data,
                                         &step);
            EXPECT_GE(step.status, 0) << pliant_last_error();
            step.revision = pliant_ros::revision_of(*loaded, pliant_data_get_body(data.get())->revision);
            step.header.stamp = ros::Time(100 + 0.02 * static_cast<double>(turns));
            bag.write("/tissue/step", step.header.stamp, step);
            maximum = std::max(maximum, pliant_data_get_body(data.get())->fine.num_nodes);
            taken |= step.background;
            std::this_thread::sleep_for(std::chrono::milliseconds(s < UNDO ? 10 : 0));
        }
        backend = pliant_data_get_backend(data.get());
    }
    ~Recording() { std::remove(path.c_str()); }
    Recording(const Recording &) = delete;
    Recording &operator=(const Recording &) = delete;
    // Replay the steps in the bag one after the other, each modified by `change`.
    void replay(Rerun *rerun, const std::function<void(Step *)> &change) const
    {
        rosbag::Bag bag(path, rosbag::bagmode::Read);
        rosbag::View view(bag, rosbag::TopicQuery("/tissue/step"));
        for (const rosbag::MessageInstance &message : view) {
            Step step = *message.instantiate<Step>();
            change(&step);
            ASSERT_TRUE(rerun->take(step));
        }
    }
};

bool has_gpu()
{
    static const std::string backend =
        pliant_data_get_backend(pliant_ros::create_data(*Session(direct).loaded->model).get());
    return backend == "cuda";
}

struct EveryEngine : testing::TestWithParam<Case> {};
TEST_P(EveryEngine, IsRecomputedFromItsBag)
{
    const Session session(GetParam());
    const std::shared_ptr<const LoadedModel> loaded = session.loaded;
    ASSERT_TRUE(loaded->model);
    const Recording recording(loaded);
    EXPECT_EQ(recording.backend, has_gpu() ? "cuda" : "cpu");
    EXPECT_GT(recording.maximum, recording.nodes + 20);
    Rerun again(loaded);
    recording.replay(&again, [](Step *) {});
    EXPECT_EQ(again.made(), recording.turns);
    EXPECT_EQ(again.differing(), 0u) << again.summary();
    // both the tool motions and the times of background results matter
    Rerun shifted(loaded);
    recording.replay(&shifted, [](Step *step) { step->tools[0].tip[0] += step->sequence > LINE ? 1e-9 : 0; });
    EXPECT_GT(shifted.differing(), 0u);
    Rerun never(loaded);
    recording.replay(&never, [](Step *step) { step->background = 0; });
    EXPECT_EQ(never.differing() > 0, recording.taken != 0);
    const pliant_scene &scene = *pliant_model_get_scene(loaded->model);
    if (scene.solver.kind == PLIANT_COROTATIONAL) EXPECT_NE(recording.taken, 0u);
    std::printf("%-20s %s, %d to %d nodes, background results taken 0x%x: %s\n", GetParam().name,
                recording.backend.c_str(), recording.nodes, recording.maximum, recording.taken,
                again.summary().c_str());
}

// Compute steps as the node does; return the positions after each.
std::vector<double> turns(const pliant_model &model, pliant_data *data, int first, int end)
{
    std::vector<double> seen;
    for (int s = first; s < end; s++) {
        const Step step = heard(s);
        pliant_cut_report report;
        for (const CutInput &cut : step.cuts) pliant_ros::make_cut(model, data, cut, &report);
        EXPECT_GE(pliant_ros::make_step(model, data, PLIANT_BACKGROUND_PLANNED, step), 0) << pliant_last_error();
        const double *positions = pliant_data_get_positions(data, nullptr);
        seen.insert(seen.end(), positions,
                    positions + 3 * static_cast<size_t>(pliant_data_get_body(data)->fine.num_nodes));
    }
    return seen;
}

// A checkpoint after cuts, while tissue moves, with two grasps. Explicit dynamics continues with the same bits.
struct SomeEngines : testing::TestWithParam<Case> {};
TEST_P(SomeEngines, ContinueFromTheirCheckpoint)
{
    enum { SAVED = LINE + 2 };
    const Session session(GetParam());
    const pliant_model &model = *session.loaded->model;
    pliant_ros::Data data = pliant_ros::create_data(model);
    pliant_ros::add_tools(model, data.get(), heard(0).tools);
    turns(model, data.get(), 0, SAVED);
    pliant_ros::ResumableState moment;
    moment.snapshot.body = pliant_ros::share_body(pliant_data_get_body(data.get()));
    pliant_ros::take_state(model, data.get(), &moment);
    EXPECT_EQ(moment.holding, (std::vector<std::string>{"left", "right"}));
    const std::vector<double> straight = turns(model, data.get(), SAVED, UNDO);
    std::vector<double> continued[2];
    for (std::vector<double> &seen : continued) {
        pliant_ros::Data other = pliant_ros::create_data(model);
        pliant_ros::add_tools(model, other.get(), heard(0).tools);
        pliant_ros::restore_state(moment, model, other.get());
        seen = turns(model, other.get(), SAVED, UNDO);
    }
    EXPECT_EQ(continued[0], continued[1]);
    const pliant_scene &scene = *pliant_model_get_scene(&model);
    ASSERT_EQ(continued[0].size(), straight.size());
    double farthest = 0;
    for (size_t n = 0; n < straight.size(); n++)
        farthest = std::max(farthest, std::fabs(continued[0][n] - straight[n]));
    std::printf("%-20s continues within %.2g m\n", GetParam().name, farthest);
    if (scene.solver.kind == PLIANT_TLED && !scene.tled.quasi_static) {
        EXPECT_EQ(farthest, 0);
    }
}

INSTANTIATE_TEST_SUITE_P(Checkpoint, SomeEngines,
                         testing::Values(direct, averaged, patch, tough, dynamic, cubes, octree_dynamic, relaxed),
                         [](const testing::TestParamInfo<Case> &info) { return std::string(info.param.name); });

// In bags of Pliant 0.1.0, steps lack the last field, or the last three, and are readable.
struct OlderBags : testing::TestWithParam<std::pair<const char *, size_t>> {};
TEST_P(OlderBags, HaveStepsThatAreReadAndOtherMessagesAreRefused)
{
    const std::string md5 = GetParam().first,
                      path = testing::TempDir() + "older_bags_" + md5 + std::to_string(getpid()) + ".bag";
    Step step = heard(3);
    step.checksum = 12345;
    step.seconds = {1, 2};
    std::vector<uint8_t> bytes(ros::serialization::serializationLength(step));
    ros::serialization::OStream out(bytes.data(), static_cast<uint32_t>(bytes.size()));
    ros::serialization::serialize(out, step);
    bytes.resize(bytes.size() - GetParam().second);
    {
        rosbag::Bag bag(path, rosbag::bagmode::Write);
        for (const std::string &type : {"pliant/Step", "pliant/Session"}) {
            topic_tools::ShapeShifter message;
            message.morph(type == "pliant/Step" ? md5 : std::string(32, '0'), type, "", "false");
            ros::serialization::IStream in(bytes.data(), static_cast<uint32_t>(bytes.size()));
            message.read(in);
            bag.write(type, ros::Time(100), message);
        }
    }
    rosbag::Bag bag(path, rosbag::bagmode::Read);
    rosbag::View steps(bag, rosbag::TopicQuery("pliant/Step")), sessions(bag, rosbag::TopicQuery("pliant/Session"));
    const Step read = *pliant_ros::read_message<Step>(*steps.begin());
    EXPECT_EQ(read.checksum, 12345u);
    EXPECT_EQ(read.tools.size(), step.tools.size());
    EXPECT_EQ(read.evaluations, 0u);
    try {
        pliant_ros::read_message<pliant::Session>(*sessions.begin());
        ADD_FAILURE() << "it was read";
    } catch (const pliant_ros::Failure &failed) {
        EXPECT_NE(std::string(failed.what()).find("another version of Pliant (md5 00000"), std::string::npos)
            << failed.what();
    }
    bag.close();
    // a player would publish them unchanged
    EXPECT_THROW(pliant_ros::check_steps({path}, "pliant/Step"), pliant_ros::Failure);
    EXPECT_NO_THROW(pliant_ros::check_steps({path}, "another topic"));
    std::remove(path.c_str());
}
INSTANTIATE_TEST_SUITE_P(Recording, OlderBags,
                         testing::Values(std::make_pair("7ea001853a4b85c219a652b58dba7739", 12),
                                         std::make_pair("d1f0eb7fcc3149139caa1f19033b8b65", 4)));
INSTANTIATE_TEST_SUITE_P(Recording, EveryEngine,
                         testing::Values(direct, multigrid, hexahedra, averaged, averaged_hexahedra, plain,
                                         coarse_hexahedra, schur, schur_hexahedra, patch, patch_hexahedra,
                                         octree, octree_hexahedra, tough, timed, subdivided, dynamic, cubes,
                                         octree_dynamic, relaxed),
                         [](const testing::TestParamInfo<Case> &info) { return std::string(info.param.name); });

// a scan in a separate folder
std::shared_ptr<const pliant_ros::Scan> scan_in(const std::string &folder, const std::string &name, uint8_t first,
                                                double spacing)
{
    const std::string path = testing::TempDir() + folder + std::to_string(getpid());
    EXPECT_EQ(mkdir(path.c_str(), 0777), 0);
    Body body(size, box, {{4000, 0.4, 1000, false}, {20000, 0.4, 1200, false}});
    static_cast<uint8_t *>(body.scan.voxels)[0] = first;
    body.scan.geometry.spacing[0] = spacing;
    EXPECT_EQ(pliant_volume_write((path + "/" + name).c_str(), &body.scan), PLIANT_OK) << pliant_last_error();
    pliant_ros::Materials materials;
    EXPECT_EQ(pliant_material_table_copy(&body.table, &materials.table), PLIANT_OK);
    auto scan = pliant_ros::read_scan(body.scene, path + "/" + name, &materials);
    std::remove((path + "/" + name).c_str());
    rmdir(path.c_str());
    return scan;
}

TEST(ScanId, DistinguishesPatientsWithEqualFileNames)
{
    using pliant_ros::is_id_of;
    const auto one = scan_in("one", "SCAN.nii.gz", 0, 0.01), again = scan_in("again", "SCAN.nii.gz", 0, 0.01),
               renamed = scan_in("renamed", "other.nii.gz", 0, 0.01);
    const auto voxels = scan_in("voxels", "SCAN.nii.gz", 1, 0.01), longer = scan_in("longer", "SCAN.nii.gz", 0, 0.011);
    const std::string id = one->volume.id;
    EXPECT_EQ(id.substr(0, 12), "SCAN.nii.gz-");
    EXPECT_EQ(id.size(), 28u);
    EXPECT_EQ(id, again->volume.id);
    EXPECT_NE(id, voxels->volume.id);
    EXPECT_NE(id, longer->volume.id);
    EXPECT_TRUE(is_id_of(id, *again));
    EXPECT_TRUE(is_id_of(id, *renamed));
    EXPECT_TRUE(is_id_of("SCAN.nii.gz", *one)) << "an older recording";
    EXPECT_FALSE(is_id_of("other.nii.gz", *one));
    EXPECT_FALSE(is_id_of(voxels->volume.id, *renamed));
    const std::string longest = scan_in("long", std::string(120, 'n') + ".nii", 0, 0.01)->volume.id;
    EXPECT_EQ(longest.substr(108, 3), "nn-");
    EXPECT_EQ(longest.size(), 127u);
}

using namespace pliant_ros;

// A loaded block of 4 x 2 x 2 cubes of voxels, fixed at its floor, and its body after a cut between them.
struct RecordedBodies : ::testing::Test {
    void SetUp() override
    {
        auto scan = std::make_shared<Scan>();
        pliant_geometry geometry{};
        const int32_t cells[3] = {4, 2, 2};
        for (int d = 0; d < 3; ++d) {
            geometry.size[d] = cells[d];
            geometry.spacing[d] = 0.01;
            geometry.direction[4 * d] = 1;
        }
        ASSERT_EQ(pliant_volume_create(&geometry, PLIANT_UINT8, &scan->volume), PLIANT_OK);
        std::strcpy(scan->volume.id, "block");
        pliant_material tissue{};
        std::strcpy(tissue.name, "tissue");
        tissue.young_modulus = 4000;
        tissue.poisson_ratio = 0.4;
        tissue.density = 1000;
        tissue.num_range = 2;
        tissue.range[0] = -1;
        tissue.range[1] = 1;
        pliant_material_table table{};
        table.materials = &tissue;
        table.num_materials = 1;
        pliant_scene scene;
        pliant_scene_defaults(&scene);
        scene.model.method = PLIANT_FINE;
        scene.cut.kind = PLIANT_CUT_SEVER;
        for (int d = 0; d < 3; ++d) scene.mesh.coarse_cells[d] = cells[d];
        scene.mesh.ratio = 1;
        scene.fixed.planes[scene.fixed.num_planes++] = pliant_fixed_plane{{0, 0, -0.005}, {0, 0, 1}};
        loaded = build(scene, scan, table, pliant_progress{nullptr, nullptr});
        loaded->revision = 7;
        std::shared_ptr<const pliant_body> once = part(*loaded->model->body, 0.0152, 2);
        cut = part(*once, 0.0098, 3);
    }
    /* Cut through by a plane of constant x. */
    static std::shared_ptr<const pliant_body> part(const pliant_body &body, double x, uint64_t revision)
    {
        const double from[] = {x, -1, -1, x, 1, -1}, to[] = {x, -1, 1, x, 1, 1};
        const pliant_cut_sweep sweep{2, from, to, nullptr};
        pliant_body *made = nullptr;
        EXPECT_EQ(pliant_body_cut(&body, revision, body.fine.rest, &sweep, &made, nullptr), PLIANT_OK)
            << pliant_last_error();
        EXPECT_TRUE(made);
        return std::shared_ptr<const pliant_body>(made, pliant_body_release);
    }
    MeshTopology topology(const pliant_body &body) const
    {
        MeshTopology out;
        out.scan_id = "block";
        out.scan_checksum = loaded->scan->checksum;
        out.revision = revision_of(*loaded, body.revision);
        topology_message(*surface_of(body, nullptr), &out);
        return out;
    }
    std::shared_ptr<LoadedModel> loaded;
    std::shared_ptr<const pliant_body> cut;
};

TEST_F(RecordedBodies, OfTwoRevisionsHaveTwoTopologies)
{
    MeshTopology before = topology(*loaded->model->body), after = topology(*cut);
    EXPECT_EQ(before.revision, 7u);
    EXPECT_EQ(after.revision, 9u);
    ASSERT_GT(after.rest_parent.size(), before.rest_parent.size());
    EXPECT_TRUE(before.cut_end.empty());
    EXPECT_EQ(after.cut_end.size(), 2u);
    EXPECT_EQ(after.rest_nodes.size(), 3 * after.rest_parent.size());
    for (size_t n = 0; n < after.rest_parent.size(); ++n) {
        const uint32_t parent = static_cast<uint32_t>(cut->node_parent[n]);
        EXPECT_EQ(after.rest_parent[n], parent);
        for (int d = 0; d < 3; ++d) EXPECT_EQ(after.rest_nodes[3 * n + d], before.rest_nodes[3 * parent + d]);
    }
    EXPECT_EQ(before.first_cut, before.triangles.size() / 3);
    EXPECT_GT(after.triangles.size() / 3, after.first_cut) << "cut faces are surface";
    EXPECT_EQ(after.vertex_weight.size(), 4 * after.vertex_tetrahedron.size());
    EXPECT_EQ(after.vertex_material.size(), after.vertex_tetrahedron.size());
    for (uint32_t corner : after.triangles)
        ASSERT_LT(corner, after.rest_parent.size() + after.vertex_tetrahedron.size());
    MeshState state;
    EXPECT_EQ(mesh_state_message(*loaded->model, *cut, cut->fine.rest,
                                 pliant_model_get_scene(loaded->model)->output.scalar, {}, &state),
              PLIANT_OK);
    EXPECT_EQ(state.nodes.size(), after.rest_nodes.size());
}

// A replay finds the bodies that belong to recorded topologies.
TEST_F(RecordedBodies, AreFoundAgainFromTheirTopologies)
{
    std::string why;
    Bodies bodies;
    std::shared_ptr<const pliant_body> first = body_of(*loaded, topology(*loaded->model->body), &bodies, &why),
                                       second = body_of(*loaded, topology(*cut), &bodies, &why);
    EXPECT_EQ(first.get(), loaded->model->body);
    ASSERT_TRUE(second) << why;
    EXPECT_TRUE(pliant_body_same(second.get(), cut.get()));
    MeshState state;
    mesh_state_message(*loaded->model, *cut, cut->fine.rest, pliant_model_get_scene(loaded->model)->output.scalar, {},
                       &state);
    EXPECT_EQ(snapshot_of(loaded, second, state)->positions.size(), state.nodes.size());
    EXPECT_THROW(snapshot_of(loaded, first, state), Failure);
    MeshTopology wrong = topology(*cut);
    wrong.tetrahedra[5] = wrong.tetrahedra[4];
    EXPECT_FALSE(body_of(*loaded, wrong, &bodies, &why));
    EXPECT_NE(why.find("the scene must be the one of the recording"), std::string::npos) << why;
    wrong = topology(*cut);
    wrong.severed[0] = 0xffffffffu;
    EXPECT_FALSE(body_of(*loaded, wrong, &bodies, &why));
    EXPECT_NE(why.find("is not a link or bridge of this mesh"), std::string::npos) << why;
    wrong = topology(*cut);
    wrong.cut_end[0] = 0;
    EXPECT_FALSE(body_of(*loaded, wrong, &bodies, &why));
    /* starting from a body with the first cuts, and from one with other cuts */
    EXPECT_TRUE(body_of(*loaded, topology(*cut), &bodies, &why));
    EXPECT_EQ(body_of(*loaded, topology(*loaded->model->body), &bodies, &why).get(), loaded->model->body);
    /* found again after an undo, it is a different body, so that a warp of one is not used for the other */
    const std::shared_ptr<const pliant_body> again = body_of(*loaded, topology(*cut), &bodies, &why);
    ASSERT_TRUE(again) << why;
    EXPECT_NE(again->revision, second->revision);
    wrong = topology(*cut);
    wrong.rest_nodes.back() += 1e-3f;
    EXPECT_FALSE(body_of(*loaded, wrong, &bodies, &why));
}

TEST_F(RecordedBodies, AStateIsReadAsSaved)
{
    ResumableState moment;
    moment.snapshot.loaded = loaded;
    moment.snapshot.body = cut;
    moment.snapshot.revision = revision_of(*loaded, cut->revision);
    moment.snapshot.step = 41;
    moment.snapshot.stamp = ros::Time(12, 34);
    moment.snapshot.positions.assign(cut->fine.rest, cut->fine.rest + 3 * cut->fine.num_nodes);
    moment.snapshot.positions[4] += 0.003;
    moment.sequence = 17;
    moment.strokes = 5;
    moment.paused = true;
    moment.holding = {"left", "right"};
    moment.touching = {"probe"};
    moment.state = {1, 0, 255, 7};
    std::shared_ptr<const pliant_surface> surface;
    CheckpointContents saved;
    make_checkpoint_contents(moment, "tissue", &surface, &saved);
    EXPECT_EQ(saved.state.header.frame_id, "tissue");
    const std::string path = testing::TempDir() + "recording_test_" + std::to_string(getpid()) + ".bag";
    write_checkpoint_file(path, "/tissue/", saved);
    const ResumableState again = resumable_state_of(read_checkpoint_file(path), loaded);
    std::remove(path.c_str());
    EXPECT_TRUE(pliant_body_same(again.snapshot.body.get(), cut.get()));
    EXPECT_EQ(again.snapshot.revision, moment.snapshot.revision);
    EXPECT_EQ(again.snapshot.step, 41u);
    EXPECT_EQ(again.snapshot.stamp, moment.snapshot.stamp);
    const std::vector<double> &before = moment.snapshot.positions, &after = again.snapshot.positions;
    ASSERT_EQ(after.size(), before.size());
    for (size_t i = 0; i < before.size(); ++i) EXPECT_NEAR(after[i], before[i], 1e-8);
    EXPECT_EQ(again.sequence, 17u);
    EXPECT_EQ(again.strokes, 5u);
    EXPECT_TRUE(again.paused);
    EXPECT_EQ(again.holding, moment.holding);
    EXPECT_EQ(again.touching, moment.touching);
    EXPECT_EQ(again.state, moment.state);
}

// Same for subdivided tetrahedra: nodes on edges are bitwise identical.
TEST_F(RecordedBodies, AreFoundAgainWhereCutsSubdivide)
{
    pliant_scene scene = loaded->requested;
    scene.cut.kind = PLIANT_CUT_SUBDIVIDE;
    const std::shared_ptr<LoadedModel> other =
        build(scene, loaded->scan, *pliant_model_get_materials(loaded->model), pliant_progress{nullptr, nullptr});
    const double from[] = {0.0096, -1, -1, 0.0096, 1, -1}, to[] = {0.0144, -1, 1, 0.0144, 1, 1};
    const pliant_cut_sweep sweep{2, from, to, nullptr, 1, 1};
    pliant_body *made = nullptr;
    ASSERT_EQ(pliant_body_cut(other->model->body, 2, other->model->body->fine.rest, &sweep, &made, nullptr), PLIANT_OK)
        << pliant_last_error();
    ASSERT_TRUE(made);
    const std::shared_ptr<const pliant_body> once(made, pliant_body_release), twice = part(*once, 0.0012, 3);
    loaded = other;
    std::string why;
    Bodies bodies;
    for (const pliant_body *body :
         std::initializer_list<const pliant_body *>{other->model->body, once.get(), twice.get(), once.get()}) {
        const std::shared_ptr<const pliant_body> found = body_of(*other, topology(*body), &bodies, &why);
        ASSERT_TRUE(found) << why;
        ASSERT_EQ(found->fine.num_nodes, body->fine.num_nodes);
        ASSERT_EQ(found->fine.num_tets, body->fine.num_tets);
        EXPECT_EQ(std::memcmp(found->fine.rest, body->fine.rest,
                              3 * static_cast<size_t>(body->fine.num_nodes) * sizeof(double)),
                  0);
        EXPECT_EQ(std::memcmp(found->fine.tets, body->fine.tets,
                              4 * static_cast<size_t>(body->fine.num_tets) * sizeof(int32_t)),
                  0);
    }
    ASSERT_GT(once->fine.num_tets, other->model->body->fine.num_tets);
    ASSERT_GT(twice->fine.num_tets, once->fine.num_tets);
    MeshTopology wrong = topology(*twice);
    wrong.between.back() = static_cast<uint32_t>(twice->fine.num_nodes);
    EXPECT_FALSE(body_of(*other, wrong, &bodies, &why));
    wrong = topology(*twice);
    wrong.tetrahedron_parent.pop_back();
    EXPECT_FALSE(body_of(*other, wrong, &bodies, &why));
    EXPECT_NE(why.find("do not subdivide the mesh at load"), std::string::npos) << why;
}

} // namespace
