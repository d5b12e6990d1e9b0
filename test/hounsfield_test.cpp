/* A scan whose values are not Hounsfield units does not get the built-in table of Hounsfield units. */
#include "material/material.h"
#include "scan/volume.h"
#include "scan_files.h"
#include "sim/build/model.h"

#include <cmath>

namespace {

/* Return a ball of tissue in air, with values as in an MR. */
pliant_volume ball(int16_t air, int16_t tissue, pliant_modality modality)
{
    pliant_geometry geometry = {{20, 20, 20}, {0, 0, 0}, {0.01, 0.01, 0.01}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    pliant_volume volume = {};
    EXPECT_EQ(pliant_volume_create(&geometry, PLIANT_INT16, &volume), PLIANT_OK);
    for (int n = 0; n < 8000; n++) {
        double x = n % 20 - 9.5, y = n / 20 % 20 - 9.5, z = n / 400 - 9.5;
        static_cast<int16_t *>(volume.voxels)[n] = int16_t((x * x + y * y + z * z < 64 ? tissue : air) + n % 7);
    }
    volume.modality = modality;
    std::strcpy(volume.id, "head.nii");
    return volume;
}

std::string refusal(int16_t air, int16_t tissue, pliant_modality modality)
{
    pliant_volume volume = ball(air, tissue, modality);
    EXPECT_EQ(pliant_material_default_check(&volume), PLIANT_ERROR_MATERIAL);
    pliant_volume_free(&volume);
    return pliant_last_error();
}

pliant_status status_of(int16_t air, int16_t tissue, pliant_modality modality)
{
    pliant_volume volume = ball(air, tissue, modality);
    pliant_status status = pliant_material_default_check(&volume);
    pliant_volume_free(&volume);
    return status;
}

} // namespace

TEST(Hounsfield, WhatTheHeaderSaysDecides)
{
    EXPECT_NE(refusal(10, 700, PLIANT_MODALITY_MR).find("head.nii: its header says MR"), std::string::npos)
        << pliant_last_error();
    EXPECT_NE(refusal(-1000, 40, PLIANT_MODALITY_MR).find("its header says MR"), std::string::npos);
    EXPECT_NE(refusal(0, 5, PLIANT_MODALITY_OTHER).find("another modality than CT"), std::string::npos);
    EXPECT_EQ(status_of(-1000, 40, PLIANT_MODALITY_CT), PLIANT_OK);
}

/* A CT without its intercept has no voxel below -20. */
TEST(Hounsfield, TheValuesOfACtAreLookedAtToo)
{
    std::string message = refusal(24, 1064, PLIANT_MODALITY_CT);
    for (const char *word : {"head.nii", "says CT", "below -20", "RescaleIntercept", "-1024", "abdomen_ct.yaml"})
        EXPECT_NE(message.find(word), std::string::npos) << message;
}

/* Padding that a converter stored as a value would become bone. */
TEST(Hounsfield, PaddingIsNoBone)
{
    for (pliant_modality modality : {PLIANT_MODALITY_CT, PLIANT_MODALITY_UNKNOWN}) {
        pliant_volume volume = ball(-1000, 40, modality);
        for (int n = 0; n < 7; n++)
            static_cast<int16_t *>(volume.voxels)[1000 * n] = 32767; /* an implant may be as bright as that */
        EXPECT_EQ(pliant_material_default_check(&volume), PLIANT_OK);
        for (int n = 0; n < 8; n++) static_cast<int16_t *>(volume.voxels)[1000 * n] = 31743;
        EXPECT_EQ(pliant_material_default_check(&volume), PLIANT_ERROR_MATERIAL);
        EXPECT_NE(std::strstr(pliant_last_error(), "PixelPaddingValue"), nullptr) << pliant_last_error();
        pliant_volume_free(&volume);
    }
}

TEST(Hounsfield, WithoutAWordOfTheHeaderTheValuesDecide)
{
    EXPECT_EQ(status_of(-1000, 40, PLIANT_MODALITY_UNKNOWN), PLIANT_OK);
    EXPECT_EQ(status_of(-100, 40, PLIANT_MODALITY_UNKNOWN), PLIANT_OK) << "cut out of a body: fat, no air";
    EXPECT_NE(refusal(0, 700, PLIANT_MODALITY_UNKNOWN).find("below -20"), std::string::npos);
    pliant_volume volume = ball(0, 700, PLIANT_MODALITY_UNKNOWN);
    for (int n = 0; n < 7; n++) static_cast<int16_t *>(volume.voxels)[1000 * n] = -300; /* interpolation overshoots */
    EXPECT_EQ(pliant_material_default_check(&volume), PLIANT_ERROR_MATERIAL);
    for (int n = 0; n < 8; n++) static_cast<int16_t *>(volume.voxels)[1000 * n] = -300;
    EXPECT_EQ(pliant_material_default_check(&volume), PLIANT_OK);
    pliant_volume_free(&volume);
}

/* The table in the message is valid as it is, and it separates air from tissue. */
TEST(Hounsfield, TheMessageHoldsATableToBeginWith)
{
    std::string message = refusal(10, 700, PLIANT_MODALITY_MR), first = "materials:\n", last = "or with the labels";
    size_t begin = message.find(first), end = message.find(last);
    ASSERT_NE(begin, std::string::npos) << message;
    ASSERT_NE(end, std::string::npos) << message;
    EXPECT_NE(message.find("material: {file: mine.yaml}"), std::string::npos);
    EXPECT_NE(message.find("10 to 706"), std::string::npos) << message;
    pliant_material_table table = {};
    ASSERT_EQ(pliant_material_table_parse(message.substr(begin, end - begin).c_str(), "mine.yaml", &table), PLIANT_OK)
        << pliant_last_error();
    ASSERT_EQ(table.num_materials, 2u);
    EXPECT_TRUE(table.materials[0].empty);
    EXPECT_EQ(table.materials[0].range[1], table.materials[1].range[0]);
    EXPECT_GT(table.materials[1].range[0], 16);
    EXPECT_LE(table.materials[1].range[0], 700);
    pliant_volume volume = ball(10, 700, PLIANT_MODALITY_MR);
    std::vector<uint8_t> material(8000);
    EXPECT_EQ(pliant_material_classify(&table, &volume, nullptr, material.data()), PLIANT_OK);
    EXPECT_EQ(material[0], 0);
    EXPECT_EQ(material[10 + 20 * (10 + 20 * 10)], 1);
    pliant_volume_free(&volume);
    pliant_material_table_free(&table);
}

/* Inputs from a file: refused without a table, accepted with any named table, even the built-in one. */
TEST(Hounsfield, InputsAskForATable)
{
    temporary_folder folder;
    pliant_volume made = ball(10, 700, PLIANT_MODALITY_UNKNOWN), scan = {};
    pliant_labels labels = {};
    pliant_material_table table = {};
    ASSERT_EQ(pliant_volume_write((folder / "mr.nii.gz").c_str(), &made), PLIANT_OK);
    pliant_volume_free(&made);
    pliant_scene scene;
    pliant_scene_defaults(&scene);
    size_t in_use = pliant_memory_in_use();
    EXPECT_EQ(pliant_inputs_read(&scene, (folder / "mr.nii.gz").c_str(), &scan, &labels, &table),
              PLIANT_ERROR_MATERIAL);
    EXPECT_EQ(scan.voxels, nullptr);
    EXPECT_EQ(table.materials, nullptr);
    EXPECT_EQ(pliant_memory_in_use(), in_use);
    pliant_material_table named = {};
    ASSERT_EQ(pliant_material_table_default(&named), PLIANT_OK);
    EXPECT_EQ(pliant_scan_inputs_read(&scene, &named, (folder / "mr.nii.gz").c_str(), &scan, &labels), PLIANT_OK)
        << "pliant_segment reads any scan: " << pliant_last_error();
    pliant_volume_free(&scan);
    pliant_labels_free(&labels);
    pliant_material_table_free(&named);
    std::snprintf(scene.material.file, sizeof scene.material.file, "%s",
                  PLIANT_SOURCE_DIR "/launch/materials/abdomen_ct.yaml");
    EXPECT_EQ(pliant_inputs_read(&scene, (folder / "mr.nii.gz").c_str(), &scan, &labels, &table), PLIANT_OK)
        << pliant_last_error();
    pliant_volume_free(&scan);
    pliant_labels_free(&labels);
    pliant_material_table_free(&table);
    EXPECT_EQ(pliant_memory_in_use(), in_use);
}

/* Explicit dynamics cannot move a material without density. The error names the file, the material and the remedy. Bone
 * that is fixed and air may have none, and without inertia all may. */
TEST(Hounsfield, ExplicitDynamicsNeedsDensity)
{
    temporary_folder folder;
    const std::string file = folder / "light.yaml";
    std::ofstream(file) << "materials:\n"
                           "  - {name: air, young_modulus: 10, poisson_ratio: 0, density: 0, empty: true, "
                           "range: [-1.0e+9, -300]}\n"
                           "  - {name: flesh, young_modulus: 5000, poisson_ratio: 0.4, density: 0, "
                           "range: [-300, 300]}\n"
                           "  - {name: bone, young_modulus: 1.0e+7, poisson_ratio: 0.3, density: 0, fixed: true, "
                           "range: [300, 1.0e+9]}\n";
    pliant_scene scene;
    pliant_scene_defaults(&scene);
    scene.solver.kind = PLIANT_TLED;
    std::snprintf(scene.material.file, sizeof scene.material.file, "%s", file.c_str());
    pliant_volume scan = {};
    pliant_labels labels = {};
    pliant_material_table table = {};
    EXPECT_EQ(pliant_inputs_read(&scene, "phantom:24x16x20", &scan, &labels, &table), PLIANT_ERROR_SCENE);
    for (const std::string &part : {file, std::string("'flesh'"), std::string("density is 0"), std::string("set its")})
        EXPECT_NE(std::string(pliant_last_error()).find(part), std::string::npos) << pliant_last_error();
    EXPECT_EQ(scan.voxels, nullptr);
    pliant_material_table light{};
    ASSERT_EQ(pliant_material_table_read(file.c_str(), &light), PLIANT_OK);
    light.materials[1].density = 1000;
    EXPECT_EQ(pliant_material_table_check_scene(&light, &scene, "t"), PLIANT_OK);
    for (bool *moved : {&scene.material.deformable_bone, &scene.mesh.keep_air}) {
        *moved = true;
        EXPECT_EQ(pliant_material_table_check_scene(&light, &scene, "t"), PLIANT_ERROR_SCENE);
        *moved = false;
    }
    pliant_material_table_free(&light);
    for (int quiet = 0; quiet < 2; quiet++) {
        scene.tled.quasi_static = quiet == 0;
        scene.solver.kind = quiet == 0 ? PLIANT_TLED : PLIANT_COROTATIONAL;
        EXPECT_EQ(pliant_inputs_read(&scene, "phantom:24x16x20", &scan, &labels, &table), PLIANT_OK)
            << pliant_last_error();
        pliant_volume_free(&scan);
        pliant_labels_free(&labels);
        pliant_material_table_free(&table);
    }
}

TEST(Hounsfield, CoarseMethodsHaveTheirOwnLimitOfPoissonsRatio)
{
    pliant_material_table table{};
    const char *const text = "materials: [{name: b, young_modulus: 5000, poisson_ratio: 0.4999, density: 1000, "
                             "range: [0, 1]}]";
    ASSERT_EQ(pliant_material_table_parse(text, "t", &table), PLIANT_OK) << pliant_last_error();
    pliant_scene scene;
    pliant_scene_defaults(&scene);
    EXPECT_EQ(pliant_material_table_check_scene(&table, &scene, "t"), PLIANT_OK);
    scene.model.method = PLIANT_AVERAGED;
    EXPECT_EQ(pliant_material_table_check_scene(&table, &scene, "t"), PLIANT_ERROR_SCENE);
    EXPECT_NE(std::string(pliant_last_error()).find("up to 0.499;"), std::string::npos) << pliant_last_error();
    table.materials[0].poisson_ratio = 0.499;
    EXPECT_EQ(pliant_material_table_check_scene(&table, &scene, "t"), PLIANT_OK);
    pliant_material_table_free(&table);
}

TEST(Percentiles, OfSmallAndLargeVolumes)
{
    for (int side : {20, 120}) { /* a scan of 120^3 voxels is sampled */
        pliant_geometry geometry = {{side, side, side}, {0, 0, 0}, {0.01, 0.01, 0.01}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
        pliant_volume volume = {};
        ASSERT_EQ(pliant_volume_create(&geometry, PLIANT_INT16, &volume), PLIANT_OK);
        size_t voxels = pliant_geometry_voxels(&geometry);
        for (size_t v = 0; v < voxels; v++) static_cast<int16_t *>(volume.voxels)[v] = int16_t(1000 * v / voxels);
        volume.intercept = 5;
        const double percent[] = {0, 25, 50, 100};
        double value[4];
        ASSERT_EQ(pliant_volume_percentiles(&volume, 4, percent, value), PLIANT_OK);
        EXPECT_EQ(value[0], 5);
        for (int n = 0; n < 4; n++) EXPECT_NEAR(value[n], 5 + 10 * percent[n], 1.01);
        pliant_memory_fail_after(0);
        EXPECT_EQ(pliant_volume_percentiles(&volume, 4, percent, value), PLIANT_ERROR_MEMORY);
        pliant_memory_fail_after(-1);
        pliant_volume_free(&volume);
    }
}
