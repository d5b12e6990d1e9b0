// Segmentation on the GPU gives the CPU's labels. Skipped without a GPU.
#include "base/memory.h"
#include "cuda_warps.h"
#include "pliant/pliant.h"

#include <cstdio>
#include <random>
#include <string>

namespace {

const pliant_segment_options usual = {0, 12, 1.0, 1e-6, 2, PLIANT_CUDA};

// Expect the same labels, pieces and classes; count voxels that differ.
void compare(const pliant_volume &scan, pliant_segment_options options, const char *what)
{
    SCOPED_TRACE(what);
    pliant_segmentation cpu{}, gpu{};
    options.backend = PLIANT_CPU;
    ASSERT_EQ(pliant_segment(&scan, &options, &cpu), PLIANT_OK) << pliant_last_error();
    options.backend = PLIANT_CUDA;
    ASSERT_EQ(pliant_segment(&scan, &options, &gpu), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(cpu.num_classes, gpu.num_classes);
    for (int k = 0; k < cpu.num_classes; k++) {
        EXPECT_NEAR(cpu.classes[k].mean, gpu.classes[k].mean, 1e-9 * (1 + std::fabs(cpu.classes[k].mean)));
        EXPECT_NEAR(cpu.classes[k].deviation, gpu.classes[k].deviation, 1e-9 * cpu.classes[k].deviation);
        EXPECT_NEAR(cpu.classes[k].weight, gpu.classes[k].weight, 1e-9);
    }
    EXPECT_NEAR(cpu.criterion, gpu.criterion, 1e-9 * std::fabs(cpu.criterion));
    ASSERT_EQ(cpu.num_pieces, gpu.num_pieces);
    for (int p = 0; p < cpu.num_pieces; p++) {
        EXPECT_EQ(cpu.pieces[p].class_index, gpu.pieces[p].class_index);
        EXPECT_EQ(cpu.pieces[p].volume, gpu.pieces[p].volume);
        EXPECT_NEAR(cpu.pieces[p].mean, gpu.pieces[p].mean, 1e-6 * (1 + std::fabs(cpu.pieces[p].mean)));
        for (int d = 0; d < 3; d++) EXPECT_EQ(cpu.pieces[p].centre[d], gpu.pieces[p].centre[d]);
    }
    size_t different = 0;
    const size_t voxels = pliant_geometry_voxels(&scan.geometry);
    for (size_t v = 0; v < voxels; v++) different += cpu.labels.voxels[v] != gpu.labels.voxels[v];
    EXPECT_EQ(different, 0u) << "of " << voxels;
    std::printf("%-40s %2d classes, %5d pieces: %zu of %zu voxels differ\n", what, cpu.num_classes, cpu.num_pieces,
                different, voxels);
    pliant_segmentation_free(&cpu);
    pliant_segmentation_free(&gpu);
}

TEST(CudaSegment, MeetsTheCpu)
{
    NEEDS_GPU();
    pliant_volume phantom{};
    const int32_t size[3] = {97, 64, 50};
    ASSERT_EQ(pliant_phantom(size, 1, &phantom, nullptr), PLIANT_OK) << pliant_last_error();
    compare(phantom, usual, "phantom");
    pliant_segment_options options = usual;
    options.coherence = 0;
    options.min_volume = 0.3e-6;
    compare(phantom, options, "voxels stand alone");
    options = usual;
    options.classes = 5;
    options.min_volume = 0;
    compare(phantom, options, "five classes, no speck too small");
    options.min_volume = 2e-3; // thicker than the range of the wave front's keys
    compare(phantom, options, "organs are specks");
    options.min_volume = 1;
    compare(phantom, options, "everything is a speck");
    pliant_volume_free(&phantom);
}

TEST(CudaSegment, OtherVolumesToo)
{
    NEEDS_GPU();
    std::mt19937 random(5);
    std::normal_distribution<float> noise(0, 10);
    for (pliant_encoding encoding : {PLIANT_UINT8, PLIANT_INT16, PLIANT_FLOAT32})
        for (int flat = 0; flat < 2; flat++) {
            const pliant_geometry geometry = geometry_of(40, flat ? 33 : 30, flat ? 1 : 35);
            pliant_volume scan{};
            ASSERT_EQ(pliant_volume_create(&geometry, encoding, &scan), PLIANT_OK);
            scan.slope = encoding == PLIANT_UINT8 ? 3.5f : 1;
            scan.intercept = encoding == PLIANT_UINT8 ? -200 : 0;
            for (size_t v = 0; v < pliant_geometry_voxels(&geometry); v++) {
                const size_t i = v % 40, j = v / 40 % 33;
                const float value = (i / 10 % 2 ? 60.f : 110.f) + (j / 11 % 2 ? 70.f : 0.f) + noise(random);
                if (encoding == PLIANT_UINT8) static_cast<uint8_t *>(scan.voxels)[v] = static_cast<uint8_t>(value);
                if (encoding == PLIANT_INT16) static_cast<int16_t *>(scan.voxels)[v] = static_cast<int16_t>(value * 5);
                if (encoding == PLIANT_FLOAT32) static_cast<float *>(scan.voxels)[v] = value * 1e-3f;
            }
            pliant_segment_options options = usual;
            options.min_volume = 20 * geometry.spacing[0] * geometry.spacing[1] * geometry.spacing[2];
            compare(scan, options,
                    (std::string("tiles, encoding ") + std::to_string(encoding) + (flat ? ", one slice" : "")).c_str());
            pliant_volume_free(&scan);
        }
}

TEST(CudaSegment, SameInputSameBitsAndErrorsAreTheCpus)
{
    NEEDS_GPU();
    pliant_volume phantom{};
    const int32_t size[3] = {48, 40, 36};
    ASSERT_EQ(pliant_phantom(size, 1, &phantom, nullptr), PLIANT_OK);
    pliant_segmentation first{}, second{};
    ASSERT_EQ(pliant_segment(&phantom, &usual, &first), PLIANT_OK);
    ASSERT_EQ(pliant_segment(&phantom, &usual, &second), PLIANT_OK);
    EXPECT_EQ(std::memcmp(first.classes, second.classes, sizeof first.classes), 0);
    EXPECT_EQ(std::memcmp(first.labels.voxels, second.labels.voxels,
                          pliant_geometry_voxels(&phantom.geometry) * sizeof *first.labels.voxels),
              0);
    pliant_segmentation_free(&first);
    pliant_segmentation_free(&second);
    pliant_volume_free(&phantom);
    const pliant_geometry geometry = geometry_of(60, 60, 60);
    pliant_volume scan{};
    ASSERT_EQ(pliant_volume_create(&geometry, PLIANT_FLOAT32, &scan), PLIANT_OK);
    scan.slope = 1;
    std::mt19937 random(1);
    for (size_t v = 0; v < pliant_geometry_voxels(&geometry); v++)
        static_cast<float *>(scan.voxels)[v] = static_cast<float>(random() % 12) * 100;
    pliant_segment_options options = usual;
    options.classes = 12;
    options.coherence = 0;
    options.min_volume = 0;
    pliant_status status[2];
    for (int b = 0; b < 2; b++) {
        options.backend = b ? PLIANT_CUDA : PLIANT_CPU;
        pliant_segmentation out{};
        status[b] = pliant_segment(&scan, &options, &out);
        pliant_segmentation_free(&out);
    }
    EXPECT_EQ(status[0], status[1]);
    static_cast<float *>(scan.voxels)[77] = INFINITY;
    pliant_segmentation none{};
    EXPECT_EQ(pliant_segment(&scan, &options, &none), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(none.pieces, nullptr);
    pliant_volume_free(&scan);
}

// Every call of the CUDA runtime fails once; the CPU computes the same segmentation.
TEST(CudaSegment, TheCpuContinues)
{
    NEEDS_GPU();
    pliant_volume phantom{};
    const int32_t size[3] = {37, 30, 26};
    ASSERT_EQ(pliant_phantom(size, 1, &phantom, nullptr), PLIANT_OK);
    pliant_segment_options options = usual;
    options.classes = 3;
    options.backend = PLIANT_CPU;
    pliant_segmentation good{};
    ASSERT_EQ(pliant_segment(&phantom, &options, &good), PLIANT_OK);
    options.backend = PLIANT_AUTO;
    const size_t held = pliant_memory_in_use();
    for (int64_t calls = 0, left = -1; left < 0; calls += 1 + calls / 40) {
        ASSERT_LT(calls, 5000);
        pliant_segmentation out{};
        pliant_cuda_fail_after(calls);
        EXPECT_EQ(pliant_segment(&phantom, &options, &out), PLIANT_OK)
            << "call " << calls << ": " << pliant_last_error();
        left = pliant_cuda_fail_after(-1);
        ASSERT_NE(out.labels.voxels, nullptr);
        EXPECT_EQ(std::memcmp(out.labels.voxels, good.labels.voxels,
                              pliant_geometry_voxels(&phantom.geometry) * sizeof *out.labels.voxels),
                  0)
            << "call " << calls;
        pliant_segmentation_free(&out);
        EXPECT_EQ(pliant_memory_in_use(), held) << "call " << calls;
    }
    pliant_segmentation_free(&good);
    pliant_volume_free(&phantom);
}

// runs in a short time, for compute-sanitizer
TEST(CudaSegment, EveryKernelOnce)
{
    NEEDS_GPU();
    pliant_volume phantom{};
    const int32_t size[3] = {37, 30, 26};
    ASSERT_EQ(pliant_phantom(size, 1, &phantom, nullptr), PLIANT_OK);
    pliant_segment_options options = usual;
    options.classes = 4;
    compare(phantom, options, "small phantom");
    pliant_volume_free(&phantom);
}

} // namespace
