#include "ros/params/params.h"

#include "model_data/data.h"
#include <gtest/gtest.h>

#include <stdlib.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <fstream>

using pliant_ros::Parameters;
using XmlRpc::XmlRpcValue;

namespace {

std::string refusal(XmlRpcValue tree)
{
    Parameters parameters;
    std::string why;
    EXPECT_FALSE(pliant_ros::read_parameters(tree, &parameters, &why));
    return why;
}

Parameters read(XmlRpcValue tree)
{
    Parameters parameters;
    std::string why;
    EXPECT_TRUE(pliant_ros::read_parameters(tree, &parameters, &why)) << why;
    return parameters;
}

TEST(Params, DefaultsWithoutAny)
{
    Parameters parameters = read(XmlRpcValue());
    pliant_scene scene;
    pliant_scene_defaults(&scene);
    EXPECT_EQ(parameters.scan, "phantom");
    EXPECT_EQ(parameters.tissue_frame, "tissue");
    EXPECT_TRUE(parameters.tools.empty());
    EXPECT_EQ(parameters.scene.solver.iterations, scene.solver.iterations);
    EXPECT_DOUBLE_EQ(parameters.tool_max_age, 0.05);
    EXPECT_DOUBLE_EQ(parameters.tool_hold, 0.1);
    EXPECT_DOUBLE_EQ(parameters.tool_max_pause, 1);
    EXPECT_EQ(parameters.background, PLIANT_BACKGROUND_LIVE) << "no step waits";
}

TEST(Params, ABladeHasANameOrAnEdge)
{
    XmlRpcValue tree;
    tree["tools"] = "knife grasper";
    tree["tool"]["knife"]["blade"] = "scalpel";
    Parameters parameters = read(tree);
    EXPECT_TRUE(parameters.tools[0].has_blade());
    EXPECT_FALSE(parameters.tools[0].grasps) << "what cuts does not grasp";
    EXPECT_FALSE(parameters.tools[1].has_blade());
    EXPECT_TRUE(parameters.tools[1].grasps);
    tree["tool"]["knife"]["mode"] = "grasp";
    EXPECT_TRUE(read(tree).tools[0].grasps) << "unless it is said to";
    XmlRpcValue edge;
    for (int d = 0; d < 3; ++d) edge["from"][d] = 0.01 * d, edge["to"][d] = 0;
    tree["tool"]["knife"]["blade"] = edge;
    EXPECT_DOUBLE_EQ(read(tree).tools[0].blade_from[2], 0.02);
    edge["from"] = edge["to"];
    tree["tool"]["knife"]["blade"] = edge;
    EXPECT_NE(refusal(tree).find("no edge"), std::string::npos);
    tree["tool"]["knife"]["blade"] = "spoon";
    EXPECT_NE(refusal(tree).find("scalpel"), std::string::npos) << "the names are listed";
    tree["tool"]["knife"]["blade"] = 3;
    EXPECT_NE(refusal(tree).find("~tool/knife/blade"), std::string::npos);
}

TEST(Params, AShapeHasANameOrAFile)
{
    XmlRpcValue tree;
    tree["tools"] = "PSM1 PSM2";
    tree["tool"]["PSM1"]["shape"] = "PROGRASP_FORCEPS_420093";
    Parameters parameters = read(tree);
    EXPECT_EQ(parameters.tools[0].shape.num_parts, 4);
    EXPECT_TRUE(parameters.tools[0].grasps);
    EXPECT_EQ(parameters.tools[1].shape.num_parts, 0);
    tree["grasp"]["kind"] = "blob";
    EXPECT_EQ(read(tree).scene.grasp.kind, PLIANT_GRASP_BLOB);
    tree["grasp"]["kind"] = "glue";
    EXPECT_NE(refusal(tree).find("auto | blob | contact"), std::string::npos) << refusal(tree);
    tree["grasp"]["kind"] = "auto";
    tree["tool"]["PSM1"]["shape"] = "spoon";
    EXPECT_NE(refusal(tree).find("~tool/PSM1/shape: there is no instrument 'spoon'"), std::string::npos)
        << refusal(tree);
    tree["tool"]["PSM1"]["shape"] = "/nowhere/shape.yaml";
    EXPECT_NE(refusal(tree).find("/nowhere/shape.yaml: cannot be opened"), std::string::npos) << refusal(tree);
    tree["tool"]["PSM1"]["shape"] = "nowhere.yml";
    EXPECT_NE(refusal(tree).find("nowhere.yml: cannot be opened"), std::string::npos) << refusal(tree);
    tree["tool"]["PSM1"]["shape"] = 3;
    EXPECT_NE(refusal(tree).find("~tool/PSM1/shape"), std::string::npos);
}

TEST(Params, RemovedOptionIsRefusedWithWhatHolds)
{
    XmlRpcValue tree;
    tree["cut"]["snap"] = 0.2;
    EXPECT_NE(refusal(tree).find("~cut/snap: was removed"), std::string::npos);
}

TEST(Params, BackgroundIsLiveOrPlanned)
{
    XmlRpcValue tree;
    tree["background"] = "planned";
    EXPECT_EQ(read(tree).background, PLIANT_BACKGROUND_PLANNED);
    tree["background"] = "live";
    EXPECT_EQ(read(tree).background, PLIANT_BACKGROUND_LIVE);
    tree["background"] = "prescribed";
    EXPECT_NE(refusal(tree).find("live or planned"), std::string::npos);
}

TEST(Params, EveryOptionOfTheSceneIsAParameter)
{
    size_t count;
    const pliant_option_info *options = pliant_scene_options(&count);
    ASSERT_GT(count, 0u);
    for (size_t i = 0; i < count; ++i) {
        std::string fallback = options[i].default_value;
        XmlRpcValue tree;
        tree[options[i].group][options[i].name] = fallback;
        Parameters parameters;
        std::string why;
        EXPECT_TRUE(pliant_ros::read_parameters(tree, &parameters, &why))
            << options[i].group << "/" << options[i].name << ": " << why;
    }
}

TEST(Params, NumbersListsAndWordsReachTheScene)
{
    XmlRpcValue tree;
    tree["solver"]["iterations"] = 4;
    tree["solver"]["step"] = 0.01;
    tree["model"]["method"] = "averaged";
    tree["mesh"]["keep_air"] = true;
    for (int d = 0; d < 3; ++d) tree["mesh"]["coarse_cells"][d] = 5 + d;
    tree["model"]["gravity"][0] = 0;
    tree["model"]["gravity"][1] = 9.81;
    tree["model"]["gravity"][2] = 0;
    Parameters parameters = read(tree);
    EXPECT_EQ(parameters.scene.solver.iterations, 4);
    EXPECT_DOUBLE_EQ(parameters.scene.solver.step, 0.01);
    EXPECT_EQ(parameters.scene.model.method, PLIANT_AVERAGED);
    EXPECT_TRUE(parameters.scene.mesh.keep_air);
    EXPECT_EQ(parameters.scene.mesh.coarse_cells[2], 7);
    EXPECT_DOUBLE_EQ(parameters.scene.model.gravity[1], 9.81);
}

TEST(Params, ParametersWinOverTheSceneFile)
{
    char path[] = "/tmp/params_testXXXXXX";
    int file = mkstemp(path);
    ASSERT_GE(file, 0);
    close(file);
    std::ofstream(path) << "solver:\n  iterations: 9\n  history: 3\n";
    XmlRpcValue tree;
    tree["scene"] = path;
    tree["solver"]["iterations"] = 4;
    Parameters parameters = read(tree);
    std::remove(path);
    EXPECT_EQ(parameters.scene.solver.iterations, 4);
    EXPECT_EQ(parameters.scene.solver.history, 3);
}

TEST(Params, ScanIsAPathOrAGroup)
{
    XmlRpcValue plain, group;
    plain["scan"] = "phantom:32x32x32";
    EXPECT_EQ(read(plain).scan, "phantom:32x32x32");
    group["scan"]["path"] = "phantom:48x48x48";
    for (int d = 0; d < 3; ++d) group["scan"]["resample"][d] = 24;
    Parameters parameters = read(group);
    EXPECT_EQ(parameters.scan, "phantom:48x48x48");
    EXPECT_EQ(parameters.scene.scan.resample[0], 24);
}

TEST(Params, UnknownOnesNameTheNearest)
{
    XmlRpcValue tree, top;
    tree["solver"]["itterations"] = 4;
    std::string why = refusal(tree);
    EXPECT_NE(why.find("solver/itterations"), std::string::npos) << why;
    EXPECT_NE(why.find("solver/iterations"), std::string::npos) << why;
    top["scanroot"] = "/data";
    EXPECT_NE(refusal(top).find("scan_root"), std::string::npos);
}

TEST(Params, ValuesOutOfRangeAreRefusedByName)
{
    XmlRpcValue iterations, slice, jaw;
    iterations["solver"]["iterations"] = 0;
    EXPECT_NE(refusal(iterations).find("iterations"), std::string::npos);
    slice["slice"]["axial"] = 1.5;
    EXPECT_NE(refusal(slice).find("slice/axial"), std::string::npos);
    jaw["jaw_close"] = 0.5;
    EXPECT_NE(refusal(jaw).find("jaw_release"), std::string::npos);
}

TEST(Params, VolumeRegionAndThreshold)
{
    XmlRpcValue tree, turned, step, empty;
    empty["jaw_close"] = 0.05;
    EXPECT_TRUE(std::isinf(read(empty).volume_low[0]) && std::isinf(read(empty).volume_high[2])) << "all";
    EXPECT_TRUE(std::isnan(read(empty).volume_threshold)) << "the noise of the scan";
    for (int d = 0; d < 3; ++d) tree["volume_region"]["low"][d] = -0.1, tree["volume_region"]["high"][d] = 0.2;
    tree["volume_threshold"] = 10;
    tree["preview_step"] = 2;
    const Parameters parameters = read(tree);
    EXPECT_DOUBLE_EQ(parameters.volume_low[1], -0.1);
    EXPECT_DOUBLE_EQ(parameters.volume_high[2], 0.2);
    EXPECT_DOUBLE_EQ(parameters.volume_threshold, 10);
    EXPECT_EQ(parameters.preview_step, 2);
    turned = tree;
    turned["volume_region"]["low"][1] = 0.3;
    EXPECT_NE(refusal(turned).find("volume_region"), std::string::npos);
    step["preview_step"] = 9;
    EXPECT_NE(refusal(step).find("preview_step"), std::string::npos);
}

TEST(Params, ToolsAndTheirModes)
{
    XmlRpcValue words, list;
    words["tools"] = "PSM1 PSM2";
    words["tool"]["PSM2"]["mode"] = "probe";
    Parameters parameters = read(words);
    ASSERT_EQ(parameters.tools.size(), 2u);
    EXPECT_TRUE(parameters.tools[0].grasps);
    EXPECT_FALSE(parameters.tools[1].grasps);
    list["tools"][0] = "left";
    EXPECT_EQ(read(list).tools[0].name, "left");
}

TEST(Params, WrongToolsAreRefused)
{
    XmlRpcValue slash, twice, mode, stranger, many;
    slash["tools"] = "a/b";
    EXPECT_NE(refusal(slash).find("a/b"), std::string::npos);
    twice["tools"] = "a a";
    EXPECT_NE(refusal(twice).find("twice"), std::string::npos);
    mode["tools"] = "a";
    mode["tool"]["a"]["mode"] = "bite";
    EXPECT_NE(refusal(mode).find("probe or grasp"), std::string::npos);
    stranger["tool"]["b"]["mode"] = "probe";
    EXPECT_NE(refusal(stranger).find("~tools"), std::string::npos);
    many["tools"] = "a b c d e f g h i";
    EXPECT_NE(refusal(many).find("at most"), std::string::npos);
}

TEST(Params, TissuePose)
{
    XmlRpcValue words, list, broken, same;
    words["tissue_pose"] = "1 2 3 0 0 0 1";
    EXPECT_DOUBLE_EQ(read(words).tissue_pose.translation[1], 2);
    for (int i = 0; i < 7; ++i) list["tissue_pose"][i] = i == 3 ? 1 : 0;
    EXPECT_DOUBLE_EQ(read(list).tissue_pose.rotation[0], 1);
    broken["tissue_pose"] = "1 2 3 0 0 0";
    EXPECT_NE(refusal(broken).find("seven"), std::string::npos);
    same["tissue_pose"] = "0 0 0 0 0 0 0";
    EXPECT_NE(refusal(same).find("quaternion"), std::string::npos);
}

TEST(Params, HandEyeNamesFramesAndFiles)
{
    XmlRpcValue good;
    good["hand_eye"] = "PSM1_base=/nowhere/PSM1.json  PSM2_base=/nowhere/PSM2.json";
    EXPECT_FALSE(read(good).hand_eye.empty()); // the existence of the files is checked when they are read
    for (const char *wrong :
         {"PSM1_base", "=/nowhere/PSM1.json", "PSM1_base=", "PSM1_base=/nowhere/PSM1.json PSM2_base"}) {
        XmlRpcValue tree;
        tree["hand_eye"] = wrong;
        EXPECT_NE(refusal(tree).find("FRAME=FILE"), std::string::npos) << wrong;
    }
}

TEST(Params, FramesMustDiffer)
{
    XmlRpcValue same, slash;
    same["parent_frame"] = "tissue";
    EXPECT_NE(refusal(same).find("same"), std::string::npos);
    slash["parent_frame"] = "/world";
    EXPECT_NE(refusal(slash).find("slash"), std::string::npos);
}

TEST(Params, Cameras)
{
    XmlRpcValue good, stranger, word, order;
    good["cameras"] = "front scope";
    good["camera"]["scope"]["convention"] = "ambf";
    good["camera"]["scope"]["baseline"] = 0.004;
    good["camera"]["scope"]["shown"] = "liver, bone";
    good["camera"]["front"]["frame"] = "endoscope_optical";
    const std::vector<pliant_ros::CameraParameters> cameras = read(good).cameras;
    ASSERT_EQ(cameras.size(), 2u);
    EXPECT_EQ(cameras[0].frame, "endoscope_optical");
    EXPECT_FALSE(cameras[0].ambf);
    EXPECT_EQ(cameras[1].frame, "scope");
    EXPECT_TRUE(cameras[1].ambf);
    EXPECT_EQ(cameras[1].shown, (std::vector<std::string>{"liver", "bone"}));
    stranger["camera"]["front"]["width"] = 10;
    EXPECT_NE(refusal(stranger).find("~cameras"), std::string::npos);
    word["cameras"] = "front";
    word["camera"]["front"]["fov"] = 60;
    EXPECT_NE(refusal(word).find("field_of_view"), std::string::npos);
    order["cameras"] = "front";
    order["camera"]["front"]["near"] = 0.2;
    order["camera"]["front"]["far"] = 0.1;
    EXPECT_NE(refusal(order).find("far"), std::string::npos);
}

} // namespace
