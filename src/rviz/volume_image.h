// A volume for upload to the graphics card: checked, converted to 8 or 16 bits per voxel, and updated box by box. No
// Ogre, no ROS.
#ifndef PLIANT_RVIZ_VOLUME_IMAGE_H
#define PLIANT_RVIZ_VOLUME_IMAGE_H

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace pliant_rviz {

using Size = std::array<uint32_t, 3>;

struct Box {
    Size offset{{0, 0, 0}}, size{{0, 0, 0}};
    size_t voxels() const { return size_t(size[0]) * size[1] * size[2]; }
};

enum Encoding : uint8_t { UINT8 = 1, INT16 = 2, FLOAT32 = 3 };

// View of a message; data are borrowed.
struct VolumeView {
    std::string scan_id;
    Size full_size;
    Box box;
    std::array<double, 3> position;    // centre of voxel 0, 0, 0 [m]
    std::array<double, 4> orientation; // x y z w
    bool flipped;                      // the k axis is opposite to the third axis of orientation
    std::array<double, 3> spacing;     // [m]
    uint8_t encoding;
    float slope, intercept;
    const uint8_t *data;
    size_t bytes;
};

// Return "" or an error message.
std::string check(const VolumeView &view);

// Limits of a texture: edge in texels, and total bytes.
struct TextureLimits {
    uint32_t edge = 2048;
    size_t bytes = size_t(1) << 30;
};

class VolumeImage {
public:
    enum Result {
        WHOLE, // new volume: create a new texture
        PART,  // part of the existing volume
        WAITS, // unused: a box of a volume that never arrived as a whole
    };
    // Store a view, which must have passed check().
    Result put(const VolumeView &view, const TextureLimits &limits);

    bool empty() const { return texels_.empty(); }
    size_t bytes() const { return texels_.size(); }
    Size size() const { return size_; }           // of the texture [texels]
    Size full_size() const { return full_size_; } // of the volume [voxels]
    uint32_t stride() const { return stride_; }   // voxels per texel along each axis
    int bits() const { return bits_; }            // 8 or 16 bits per texel
    uint8_t encoding() const { return encoding_; }
    // number of NaN or infinite voxels in the last message, shown as the minimum
    uint64_t not_numbers() const { return not_numbers_; }

    // value = offset + scale * texel, texel in 0..1
    double value_scale() const { return value_scale_; }
    double value_offset() const { return value_offset_; }
    // minimum and maximum value since the last new volume
    double low() const { return low_; }
    double high() const { return high_; }
    // Return the quantile of the values above the minimum, from the first whole volume.
    double quantile(double fraction) const;
    // Return the histogram of the first whole volume in equal bins from low to high: square roots, scaled to a maximum
    // of 1.
    std::vector<double> histogram(double low, double high, size_t bins) const;
    std::string precision() const; // text for the user
    // Interpolate at a position in texels as the texture does; clamped to the edge.
    double value(const std::array<double, 3> &at) const;

    // Copy the texels of a box, i fastest, without padding.
    void copy(const Box &box, std::vector<uint8_t> &out) const;
    // Return the next box to upload, at most this many bytes but at least one row; false: none.
    bool next_change(size_t max_bytes, Box &out);
    bool has_changes() const { return !changes_.empty(); }

    // Return the smallest box of texels that contains everything visible; size 0: nothing is visible.
    // visible[n]: whether values around texel n / (visible.size() - 1) are visible
    Box visible_box(const std::vector<bool> &visible) const;

private:
    enum { BRICK = 16 };
    void start(const VolumeView &view, const TextureLimits &limits);
    Box texels_of(const Box &voxels) const;
    template <class Stored> void convert(const VolumeView &view, const Box &texels);
    void range_of(const VolumeView &view, float &low, float &high);
    void widen(float low, float high);
    uint16_t texel(size_t index) const;
    void change(const Box &texels);
    void measure_bricks(const Box &texels);
    void count_values();

    std::string scan_id_;
    Size full_size_{{0, 0, 0}}, size_{{0, 0, 0}};
    uint32_t stride_ = 1;
    int bits_ = 8;
    uint8_t encoding_ = 0;
    float slope_ = 1, intercept_ = 0;
    double value_scale_ = 1, value_offset_ = 0, low_ = 0, high_ = 0;
    float stored_low_ = 0, stored_high_ = 0; // FLOAT32: values at texels 0 and 65535
    uint64_t not_numbers_ = 0;
    std::vector<uint8_t> texels_;
    std::vector<Box> changes_;
    Size bricks_{{0, 0, 0}};
    // range of each brick including the adjacent layer, which interpolation uses
    std::vector<uint16_t> brick_low_, brick_high_;
    std::vector<uint64_t> histogram_;
};

} // namespace pliant_rviz
#endif
