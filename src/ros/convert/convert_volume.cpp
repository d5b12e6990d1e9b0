/* Convert volumes to messages: boxes of voxels, and slices as images. */
#include "pliant/ros/convert.h"
#include "scan/volume.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace pliant_ros {

namespace {

enum { MAX_SLICE_PIXELS = 2048, MAX_MERGED = 128 };

size_t voxels_of(const Box &box) { return static_cast<size_t>(box.size[0]) * box.size[1] * box.size[2]; }

/* Return the voxels of the bricks [low, high]. */
Box box_of_bricks(const int32_t low[3], const int32_t high[3], const int32_t size[3])
{
    Box box;
    for (int d = 0; d < 3; ++d) {
        int32_t end = std::min((high[d] + 1) * static_cast<int32_t>(PLIANT_BRICK_SIZE), size[d]);
        box.offset[d] = static_cast<uint32_t>(low[d] * PLIANT_BRICK_SIZE);
        box.size[d] = static_cast<uint32_t>(end) - box.offset[d];
    }
    return box;
}

/* Extend [low, high] to all changed bricks connected to `seed` by a face, edge or corner, and remove them from
 * `left`. */
void flood(const int32_t count[3], std::vector<uint8_t> *left, size_t seed, int32_t low[3], int32_t high[3])
{
    std::vector<size_t> stack(1, seed);
    (*left)[seed] = 0;
    while (!stack.empty()) {
        size_t brick = stack.back();
        stack.pop_back();
        const int32_t at[3] = {static_cast<int32_t>(brick % count[0]),
                               static_cast<int32_t>(brick / count[0] % count[1]),
                               static_cast<int32_t>(brick / count[0] / count[1])};
        for (int d = 0; d < 3; ++d) {
            low[d] = std::min(low[d], at[d]);
            high[d] = std::max(high[d], at[d]);
        }
        for (int32_t k = std::max(at[2] - 1, 0); k <= std::min(at[2] + 1, count[2] - 1); ++k)
            for (int32_t j = std::max(at[1] - 1, 0); j <= std::min(at[1] + 1, count[1] - 1); ++j)
                for (int32_t i = std::max(at[0] - 1, 0); i <= std::min(at[0] + 1, count[0] - 1); ++i) {
                    size_t next = i + static_cast<size_t>(count[0]) * (j + static_cast<size_t>(count[1]) * k);
                    if (!(*left)[next]) continue;
                    (*left)[next] = 0;
                    stack.push_back(next);
                }
    }
}

/* Interpolate stored voxels trilinearly at a continuous index inside the grid. */
template <class Voxel> float trilinear(const Voxel *voxels, const int32_t size[3], const double index[3])
{
    size_t base[3], step[3];
    float f[3];
    const size_t stride[3] = {1, static_cast<size_t>(size[0]), static_cast<size_t>(size[0]) * size[1]};
    for (int d = 0; d < 3; ++d) {
        double x = std::min(std::max(index[d], 0.0), size[d] - 1.0);
        int32_t whole = std::min(static_cast<int32_t>(x), std::max(size[d] - 2, 0));
        f[d] = static_cast<float>(x - whole);
        base[d] = whole * stride[d];
        step[d] = size[d] > 1 ? stride[d] : 0;
    }
    const Voxel *v = voxels + base[0] + base[1] + base[2];
    float plane[2];
    for (int k = 0; k < 2; ++k) {
        const Voxel *w = v + k * step[2];
        float near_row = w[0] + f[0] * (static_cast<float>(w[step[0]]) - w[0]);
        float far_row = w[step[1]] + f[0] * (static_cast<float>(w[step[0] + step[1]]) - w[step[1]]);
        plane[k] = near_row + f[1] * (far_row - near_row);
    }
    return plane[0] + f[2] * (plane[1] - plane[0]);
}

/* The index of pixel (column, row) is start + column * right + row * down. */
struct Raster {
    double start[3], right[3], down[3];
    uint32_t width, height;
};

template <class Voxel> void sample(const pliant_volume &volume, const Raster &raster, float *pixels)
{
    const int32_t *size = volume.geometry.size;
    const Voxel *voxels = static_cast<const Voxel *>(volume.voxels);
    const float outside = volume.slope * volume.background + volume.intercept;
    for (uint32_t row = 0; row < raster.height; ++row)
        for (uint32_t column = 0; column < raster.width; ++column) {
            double index[3];
            bool inside = true;
            for (int d = 0; d < 3; ++d) {
                index[d] = raster.start[d] + column * raster.right[d] + row * raster.down[d];
                inside = inside && index[d] >= -0.5 && index[d] <= size[d] - 0.5;
            }
            *pixels++ = inside ? volume.slope * trilinear(voxels, size, index) + volume.intercept : outside;
        }
}

/* Return the LPS bounding box of the volume, including the outer half voxels. */
void world_box(const pliant_geometry &geometry, double low[3], double high[3])
{
    std::fill(low, low + 3, INFINITY);
    std::fill(high, high + 3, -INFINITY);
    for (int corner = 0; corner < 8; ++corner) {
        double index[3], world[3];
        for (int d = 0; d < 3; ++d) index[d] = (corner >> d & 1) ? geometry.size[d] - 0.5 : -0.5;
        pliant_geometry_to_world(&geometry, index, world);
        for (int d = 0; d < 3; ++d) {
            low[d] = std::min(low[d], world[d]);
            high[d] = std::max(high[d], world[d]);
        }
    }
}

Raster raster_of(const pliant_geometry &geometry, Plane plane, double fraction)
{
    static const int across[] = {2, 1, 0}, right[] = {0, 0, 1}, down[] = {1, 2, 2}; /* LPS axes */
    double low[3], high[3], world[3];
    world_box(geometry, low, high);
    double pixel = *std::min_element(geometry.spacing, geometry.spacing + 3);
    int u = right[plane], v = down[plane], n = across[plane];
    double sign = v == 2 ? -1 : 1; /* rows run from head to feet */
    pixel = std::max(pixel, std::max(high[u] - low[u], high[v] - low[v]) / MAX_SLICE_PIXELS);
    Raster raster;
    raster.width = static_cast<uint32_t>(std::max(1L, std::lround((high[u] - low[u]) / pixel)));
    raster.height = static_cast<uint32_t>(std::max(1L, std::lround((high[v] - low[v]) / pixel)));
    world[n] = low[n] + std::min(std::max(fraction, 0.0), 1.0) * (high[n] - low[n]);
    world[u] = low[u] + 0.5 * pixel;
    world[v] = sign > 0 ? low[v] + 0.5 * pixel : high[v] - 0.5 * pixel;
    pliant_geometry_to_index(&geometry, world, raster.start);
    double next[3];
    world[u] += pixel;
    pliant_geometry_to_index(&geometry, world, next);
    for (int d = 0; d < 3; ++d) raster.right[d] = next[d] - raster.start[d];
    world[u] -= pixel;
    world[v] += sign * pixel;
    pliant_geometry_to_index(&geometry, world, next);
    for (int d = 0; d < 3; ++d) raster.down[d] = next[d] - raster.start[d];
    return raster;
}

static_assert(int(pliant::Volume::UINT8) == PLIANT_UINT8 && int(pliant::Volume::INT16) == PLIANT_INT16 &&
                  int(pliant::Volume::FLOAT32) == PLIANT_FLOAT32,
              "Volume.msg and pliant_encoding use the same numbers");

std::vector<float> pixels_of(const pliant_volume &volume, const Raster &raster)
{
    std::vector<float> pixels(static_cast<size_t>(raster.width) * raster.height);
    switch (volume.encoding) {
    case PLIANT_UINT8: sample<uint8_t>(volume, raster, pixels.data()); break;
    case PLIANT_INT16: sample<int16_t>(volume, raster, pixels.data()); break;
    case PLIANT_FLOAT32: sample<float>(volume, raster, pixels.data()); break;
    }
    return pixels;
}

/* Fill in the grid of every step-th voxel of a region, and the grid of the whole volume. */
void describe(const pliant_volume &volume, const Box &region, uint32_t step, Volume *out)
{
    pliant_geometry grid = volume.geometry;
    const double first[3] = {double(region.offset[0]), double(region.offset[1]), double(region.offset[2])};
    pliant_geometry_to_world(&volume.geometry, first, grid.origin);
    for (int d = 0; d < 3; ++d) {
        grid.spacing[d] *= step;
        out->full_size[d] = out->size[d] = (region.size[d] - 1) / step + 1;
        out->offset[d] = 0;
    }
    bool flipped;
    geometry_to_message(grid, &out->origin, &flipped, &out->spacing);
    out->flipped = flipped;
    out->encoding = static_cast<uint8_t>(volume.encoding);
    out->slope = volume.slope;
    out->intercept = volume.intercept;
}

/* Return the smallest box that contains both boxes. */
Box box_around(const Box &a, const Box &b)
{
    Box around;
    for (int d = 0; d < 3; ++d) {
        around.offset[d] = std::min(a.offset[d], b.offset[d]);
        around.size[d] = std::max(a.offset[d] + a.size[d], b.offset[d] + b.size[d]) - around.offset[d];
    }
    return around;
}

} // namespace

std::vector<Box> changed_boxes(const int32_t count[3], const uint8_t *changed, const int32_t size[3])
{
    size_t bricks = static_cast<size_t>(count[0]) * count[1] * count[2];
    std::vector<uint8_t> left(changed, changed + bricks);
    std::vector<Box> boxes;
    int32_t all_low[3] = {INT32_MAX, INT32_MAX, INT32_MAX}, all_high[3] = {-1, -1, -1};
    size_t voxels = 0;
    for (size_t brick = 0; brick < bricks; ++brick) {
        if (!left[brick]) continue;
        int32_t low[3] = {INT32_MAX, INT32_MAX, INT32_MAX}, high[3] = {-1, -1, -1};
        flood(count, &left, brick, low, high);
        boxes.push_back(box_of_bricks(low, high, size));
        voxels += voxels_of(boxes.back());
        for (int d = 0; d < 3; ++d) {
            all_low[d] = std::min(all_low[d], low[d]);
            all_high[d] = std::max(all_high[d], high[d]);
        }
    }
    if (boxes.size() < 2) return boxes;
    Box whole = box_of_bricks(all_low, all_high, size);
    if (voxels_of(whole) <= voxels) boxes.assign(1, whole);
    return boxes;
}

Box common_box(const Box &a, const Box &b)
{
    Box common;
    for (int d = 0; d < 3; ++d) {
        const uint32_t end = std::min(a.offset[d] + a.size[d], b.offset[d] + b.size[d]);
        common.offset[d] = std::max(a.offset[d], b.offset[d]);
        common.size[d] = end > common.offset[d] ? end - common.offset[d] : 0;
    }
    return common;
}

std::vector<Box> merged_boxes(std::vector<Box> boxes, size_t maximum)
{
    if (boxes.size() > MAX_MERGED) {
        for (const Box &box : boxes) boxes[0] = box_around(boxes[0], box);
        boxes.resize(1);
    }
    while (boxes.size() > maximum) {
        size_t first = 0, second = 1, fewest = SIZE_MAX;
        for (size_t a = 0; a < boxes.size(); ++a)
            for (size_t b = a + 1; b < boxes.size(); ++b) {
                const size_t around = voxels_of(box_around(boxes[a], boxes[b])),
                             both = voxels_of(boxes[a]) + voxels_of(boxes[b]);
                const size_t added = around > both ? around - both : 0;
                if (added < fewest) first = a, second = b, fewest = added;
            }
        boxes[first] = box_around(boxes[first], boxes[second]);
        boxes.erase(boxes.begin() + static_cast<std::ptrdiff_t>(second));
    }
    return boxes;
}

Box region_box(const pliant_geometry &geometry, const double low[3], const double high[3])
{
    double world_low[3], world_high[3], from[3], to[3];
    world_box(geometry, world_low, world_high);
    for (int d = 0; d < 3; ++d) {
        world_low[d] = std::min(std::max(low[d], world_low[d]), world_high[d]);
        world_high[d] = std::max(std::min(high[d], world_high[d]), world_low[d]);
    }
    std::fill(from, from + 3, INFINITY);
    std::fill(to, to + 3, -INFINITY);
    for (int corner = 0; corner < 8; ++corner) {
        double world[3], index[3];
        for (int d = 0; d < 3; ++d) world[d] = corner >> d & 1 ? world_high[d] : world_low[d];
        pliant_geometry_to_index(&geometry, world, index);
        for (int d = 0; d < 3; ++d) from[d] = std::min(from[d], index[d]), to[d] = std::max(to[d], index[d]);
    }
    Box box;
    const double little = 1e-6; /* tolerance in voxels: a corner at a voxel centre includes that voxel */
    for (int d = 0; d < 3; ++d) {
        const int32_t last = geometry.size[d] - 1;
        const int32_t first = std::min(std::max(static_cast<int32_t>(std::ceil(from[d] - little)), 0), last);
        const int32_t end = std::min(std::max(static_cast<int32_t>(std::floor(to[d] + little)), first), last);
        box.offset[d] = static_cast<uint32_t>(first);
        box.size[d] = static_cast<uint32_t>(end - first + 1);
    }
    return box;
}

void volume_message(const pliant_volume &volume, const Box &region, const Box &box, Volume *out)
{
    const int32_t *size = volume.geometry.size;
    describe(volume, region, 1, out);
    for (int d = 0; d < 3; ++d) {
        out->offset[d] = box.offset[d] - region.offset[d];
        out->size[d] = box.size[d];
    }
    size_t bytes = pliant_encoding_size(volume.encoding), row = box.size[0] * bytes;
    out->data.resize(voxels_of(box) * bytes);
    const uint8_t *voxels = static_cast<const uint8_t *>(volume.voxels);
    uint8_t *to = out->data.data();
    for (uint32_t k = 0; k < box.size[2]; ++k)
        for (uint32_t j = 0; j < box.size[1]; ++j, to += row) {
            size_t plane = static_cast<size_t>(box.offset[2] + k) * size[1] + box.offset[1] + j;
            std::memcpy(to, voxels + (plane * size[0] + box.offset[0]) * bytes, row);
        }
}

void preview_message(const pliant_volume &volume, const Box &region, uint32_t step, Volume *out)
{
    describe(volume, region, step, out);
    const int32_t *size = volume.geometry.size;
    const size_t bytes = pliant_encoding_size(volume.encoding);
    out->data.resize(bytes * out->size[0] * out->size[1] * out->size[2]);
    const uint8_t *voxels = static_cast<const uint8_t *>(volume.voxels);
    uint8_t *to = out->data.data();
    for (uint32_t k = 0; k < out->size[2]; ++k)
        for (uint32_t j = 0; j < out->size[1]; ++j) {
            const size_t plane =
                static_cast<size_t>(region.offset[2] + k * step) * size[1] + region.offset[1] + j * step;
            const uint8_t *from = voxels + (plane * size[0] + region.offset[0]) * bytes;
            for (uint32_t i = 0; i < out->size[0]; ++i, to += bytes) std::memcpy(to, from + i * step * bytes, bytes);
        }
}

void slice_message(const pliant_volume &volume, Plane plane, double fraction, sensor_msgs::Image *out)
{
    Raster raster = raster_of(volume.geometry, plane, fraction);
    out->width = raster.width;
    out->height = raster.height;
    out->encoding = "32FC1";
    out->is_bigendian = 0;
    out->step = static_cast<uint32_t>(raster.width * sizeof(float));
    out->data.resize(static_cast<size_t>(out->step) * raster.height);
    const std::vector<float> pixels = pixels_of(volume, raster);
    std::memcpy(out->data.data(), pixels.data(), out->data.size());
}

void placed_slice_message(const pliant_volume &volume, Plane plane, double fraction, Volume *out)
{
    const Raster raster = raster_of(volume.geometry, plane, fraction);
    pliant_volume slice{};
    pliant_geometry &placed = slice.geometry;
    placed.size[0] = static_cast<int32_t>(raster.width);
    placed.size[1] = static_cast<int32_t>(raster.height);
    placed.size[2] = 1;
    pliant_geometry_to_world(&volume.geometry, raster.start, placed.origin);
    const double *steps[] = {raster.right, raster.down};
    double axes[3][3];
    for (int axis = 0; axis < 2; ++axis) {
        double index[3], world[3], length = 0;
        for (int d = 0; d < 3; ++d) index[d] = raster.start[d] + steps[axis][d];
        pliant_geometry_to_world(&volume.geometry, index, world);
        for (int d = 0; d < 3; ++d) length += (world[d] - placed.origin[d]) * (world[d] - placed.origin[d]);
        placed.spacing[axis] = std::sqrt(length);
        for (int d = 0; d < 3; ++d) axes[axis][d] = (world[d] - placed.origin[d]) / placed.spacing[axis];
    }
    placed.spacing[2] = placed.spacing[0];
    for (int d = 0; d < 3; ++d)
        axes[2][d] = axes[0][(d + 1) % 3] * axes[1][(d + 2) % 3] - axes[0][(d + 2) % 3] * axes[1][(d + 1) % 3];
    for (int d = 0; d < 3; ++d)
        for (int axis = 0; axis < 3; ++axis) placed.direction[3 * d + axis] = axes[axis][d];
    slice.encoding = PLIANT_FLOAT32;
    slice.slope = 1;
    std::vector<float> pixels = pixels_of(volume, raster);
    slice.voxels = pixels.data();
    const Box all{{0, 0, 0}, {raster.width, raster.height, 1}};
    volume_message(slice, all, all, out);
}

} // namespace pliant_ros
