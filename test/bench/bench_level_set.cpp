// [C] figure 2: segmentation of an organ by the Gaussian mixture (pliant_segment) and by ITK's level set, each compared
// with a label map by Dice.
// Usage:
//   bench_level_set OUT.png [SCAN LABELS LABEL]      without SCAN: the phantom's liver
// The user input is the same for both: a point in the organ, here the voxel of the label farthest from its border. The
// mixture gives the piece that contains the point. The level set (ThresholdSegmentationLevelSetImageFilter; Lefohn,
// Cates and Whitaker 2003) starts as a ball there. It grows over intensities within 2.5 standard deviations of the mean
// in the ball, with a curvature weight of 1. Panels: scan, label map, mixture, level set.
#include "programs/picture.h"
#include "base/clock.h"
#include "pliant/pliant.h"

#include <itkFastMarchingImageFilter.h>
#include <itkImage.h>
#include <itkThresholdSegmentationLevelSetImageFilter.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <vector>

using Image = itk::Image<float, 3>;

static Image::Pointer image_of(const pliant_volume &scan)
{
    auto image = Image::New();
    Image::SizeType size;
    Image::SpacingType spacing;
    for (unsigned d = 0; d < 3; d++) {
        size[d] = static_cast<itk::SizeValueType>(scan.geometry.size[d]);
        spacing[d] = 1e3 * scan.geometry.spacing[d];
    }
    image->SetRegions(Image::RegionType(size));
    image->SetSpacing(spacing);
    image->Allocate();
    for (size_t v = 0; v < pliant_geometry_voxels(&scan.geometry); v++)
        image->GetBufferPointer()[v] = static_cast<float>(pliant_volume_value(&scan, v));
    return image;
}

// Return the voxel of the label farthest from its border, by erosion.
static size_t deepest(const pliant_geometry &g, const std::vector<uint8_t> &inside)
{
    const long stride[3] = {1, g.size[0], static_cast<long>(g.size[0]) * g.size[1]};
    std::vector<uint8_t> now = inside, next;
    size_t last = 0;
    for (bool any = true; any;) {
        any = false;
        next.assign(now.size(), 0);
        for (int k = 1; k + 1 < g.size[2]; k++)
            for (int j = 1; j + 1 < g.size[1]; j++)
                for (int i = 1; i + 1 < g.size[0]; i++) {
                    const long v = i + stride[1] * j + stride[2] * k;
                    bool all = now[static_cast<size_t>(v)];
                    if (all) last = static_cast<size_t>(v), any = true;
                    for (int d = 0; all && d < 3; d++)
                        all = now[static_cast<size_t>(v - stride[d])] && now[static_cast<size_t>(v + stride[d])];
                    next[static_cast<size_t>(v)] = all;
                }
        now.swap(next);
    }
    return last;
}

static double dice(const std::vector<uint8_t> &a, const std::vector<uint8_t> &b)
{
    size_t both = 0, sum = 0;
    for (size_t v = 0; v < a.size(); v++) both += a[v] && b[v], sum += static_cast<size_t>(a[v]) + b[v];
    return sum ? 2.0 * static_cast<double>(both) / static_cast<double>(sum) : 0;
}

static std::vector<uint8_t> level_set(const pliant_volume &scan, size_t seed, double radius)
{
    const pliant_geometry &g = scan.geometry;
    Image::Pointer image = image_of(scan);
    Image::IndexType at;
    at[0] = static_cast<long>(seed % static_cast<size_t>(g.size[0]));
    at[1] = static_cast<long>(seed / static_cast<size_t>(g.size[0]) % static_cast<size_t>(g.size[1]));
    at[2] = static_cast<long>(seed / (static_cast<size_t>(g.size[0]) * static_cast<size_t>(g.size[1])));
    double sum = 0, squares = 0;
    int count = 0;
    const int reach[3] = {static_cast<int>(radius / g.spacing[0]), static_cast<int>(radius / g.spacing[1]),
                          static_cast<int>(radius / g.spacing[2])};
    for (int k = -reach[2]; k <= reach[2]; k++)
        for (int j = -reach[1]; j <= reach[1]; j++)
            for (int i = -reach[0]; i <= reach[0]; i++) {
                Image::IndexType other = {{at[0] + i, at[1] + j, at[2] + k}};
                const double far = std::hypot(i * g.spacing[0], std::hypot(j * g.spacing[1], k * g.spacing[2]));
                if (far > radius || !image->GetLargestPossibleRegion().IsInside(other)) continue;
                const double value = image->GetPixel(other);
                sum += value, squares += value * value, count++;
            }
    const double mean = sum / count, deviation = std::sqrt(std::max(squares / count - mean * mean, 1.0));
    using March = itk::FastMarchingImageFilter<Image, Image>;
    auto march = March::New();
    auto seeds = March::NodeContainer::New();
    March::NodeType node;
    node.SetIndex(at);
    node.SetValue(-1e3 * radius);
    seeds->InsertElement(0, node);
    march->SetTrialPoints(seeds);
    march->SetSpeedConstant(1);
    march->SetOutputRegion(image->GetBufferedRegion());
    march->SetOutputSpacing(image->GetSpacing());
    using Level = itk::ThresholdSegmentationLevelSetImageFilter<Image, Image>;
    auto level = Level::New();
    level->SetPropagationScaling(1);
    level->SetCurvatureScaling(1);
    level->SetMaximumRMSError(0.02);
    level->SetNumberOfIterations(1200);
    level->SetLowerThreshold(mean - 2.5 * deviation);
    level->SetUpperThreshold(mean + 2.5 * deviation);
    level->SetIsoSurfaceValue(0);
    level->SetInput(march->GetOutput());
    level->SetFeatureImage(image);
    level->Update();
    std::vector<uint8_t> out(pliant_geometry_voxels(&g));
    for (size_t v = 0; v < out.size(); v++) out[v] = level->GetOutput()->GetBufferPointer()[v] < 0;
    return out;
}

int main(int argc, char **argv)
{
    const bool file = argc > 4;
    pliant_volume scan{};
    pliant_labels truth{};
    pliant_segmentation found{};
    if (argc < 2) return std::fprintf(stderr, "bench_level_set OUT.png [SCAN LABELS LABEL]\n"), 2;
    const int32_t size[3] = {128, 80, 61};
    const int label = file ? std::atoi(argv[4]) : 4;
    pliant_status status =
        file ? pliant_volume_read(argv[2], nullptr, 0, &scan) : pliant_phantom(size, 1, &scan, &truth);
    if (status == PLIANT_OK && file) status = pliant_labels_read(argv[3], 0, &truth);
    pliant_segment_options options{0, 12, 1.0, 1e-6, 2, PLIANT_CPU};
    const double start = pliant_seconds();
    if (status == PLIANT_OK) status = pliant_segment(&scan, &options, &found);
    const double mixed = pliant_seconds();
    const size_t voxels = pliant_geometry_voxels(&scan.geometry);
    if (status != PLIANT_OK) return std::fprintf(stderr, "%s\n", pliant_last_error()), 1;
    std::vector<uint8_t> organ(voxels), mixture(voxels);
    for (size_t v = 0; v < voxels; v++) organ[v] = truth.voxels[v] == label;
    const size_t seed = deepest(scan.geometry, organ);
    if (!organ[seed]) return std::fprintf(stderr, "label %d: there is no such label\n", label), 1;
    for (size_t v = 0; v < voxels; v++) mixture[v] = found.labels.voxels[v] == found.labels.voxels[seed];
    const double before = pliant_seconds();
    std::vector<uint8_t> level = level_set(scan, seed, 0.012);
    std::printf("method,dice,seconds\nmixture,%.4f,%.3g\nlevel set,%.4f,%.3g\n", dice(organ, mixture), mixed - start,
                dice(organ, level), pliant_seconds() - before);
    const pliant_geometry &g = scan.geometry;
    const size_t wide = static_cast<size_t>(g.size[0]), tall = static_cast<size_t>(g.size[1]), scale = 3,
                 layer = seed / (wide * tall);
    double low, high;
    if (picture_window(&scan, &low, &high) < 0) return 1;
    std::vector<uint8_t> rgb(4 * wide * scale * tall * scale * 3);
    const std::vector<uint8_t> *masks[4] = {nullptr, &organ, &mixture, &level};
    /* radiological orientation: the patient's left on the right, the front above */
    const bool turned[2] = {g.direction[0] < 0, g.direction[4] < 0};
    for (size_t y = 0; y < tall * scale; y++)
        for (size_t x = 0; x < 4 * wide * scale; x++) {
            const size_t panel = x / (wide * scale), i = x % (wide * scale) / scale, j = y / scale;
            const size_t v = (turned[0] ? wide - 1 - i : i) + wide * ((turned[1] ? tall - 1 - j : j) + tall * layer);
            const auto grey = static_cast<uint8_t>(
                255 * std::min(std::max((pliant_volume_value(&scan, v) - low) / (high - low), 0.0), 1.0));
            uint8_t *pixel = &rgb[3 * (y * 4 * wide * scale + x)];
            pixel[0] = pixel[1] = pixel[2] = grey;
            if (masks[panel] && (*masks[panel])[v])
                pixel[0] = static_cast<uint8_t>(128 + grey / 2), pixel[2] = static_cast<uint8_t>(grey / 2),
                pixel[1] = static_cast<uint8_t>(grey / 2);
        }
    return picture_png(argv[1], rgb.data(), static_cast<int32_t>(4 * wide * scale),
                       static_cast<int32_t>(tall * scale)) == PLIANT_OK
               ? 0
               : 1;
}
