// A volume as it goes to the graphics card: checked, converted to 8 or 16 bits a voxel, kept up to date box by box.
// No Ogre, no ROS.
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

// What a message says; data is borrowed.
struct VolumeView {
    std::string scan_id;
    Size full_size;
    Box box;
    std::array<double, 3> position;    // centre of voxel 0, 0, 0 [m]
    std::array<double, 4> orientation; // x y z w
    bool flipped;                      // the k axis points against the third axis of orientation
    std::array<double, 3> spacing;     // [m]
    uint8_t encoding;
    float slope, intercept;
    const uint8_t *data;
    size_t bytes;
};

// "" or what is wrong with it.
std::string check(const VolumeView &view);

// Largest texture: edge in texels, and bytes in all.
struct TextureLimits {
    uint32_t edge = 2048;
    size_t bytes = size_t(1) << 30;
};

class VolumeImage {
public:
    enum Result {
        WHOLE, // starts anew: make a new texture
        PART,  // put into what was there
        WAITS, // a box of a volume that was never seen whole: not used
    };
    // The view must have passed check().
    Result put(const VolumeView &view, const TextureLimits &limits);

    bool empty() const { return texels_.empty(); }
    size_t bytes() const { return texels_.size(); }
    Size size() const { return size_; }           // of the texture [texels]
    Size full_size() const { return full_size_; } // of the volume [voxels]
    uint32_t stride() const { return stride_; }   // one texel for so many voxels along each axis
    int bits() const { return bits_; }            // 8 or 16 a texel
    uint8_t encoding() const { return encoding_; }
    uint64_t not_numbers() const { return not_numbers_; } // NaN or infinite voxels of the last message, shown as the lowest value

    // value = offset + scale * texel, texel in 0..1
    double value_scale() const { return value_scale_; }
    double value_offset() const { return value_offset_; }
    // smallest and largest value seen since it started anew
    double low() const { return low_; }
    double high() const { return high_; }
    // value below which a fraction of the voxels lies that are above the lowest value; from the first whole volume
    double quantile(double fraction) const;
    // How many of the first whole volume's voxels have which value, in even bins from low to high: roots, the largest is 1.
    std::vector<double> histogram(double low, double high, size_t bins) const;
    std::string precision() const; // a few words
    // At a place in texels, interpolated as the texture is; beyond the outermost ones theirs go on.
    double value(const std::array<double, 3> &at) const;

    // Texels of a box, i fastest, packed.
    void copy(const Box &box, std::vector<uint8_t> &out) const;
    // Next box that the texture lacks, at most this many bytes (but one row at least); false: none.
    bool next_change(size_t most_bytes, Box &out);
    bool has_changes() const { return !changes_.empty(); }

    // Smallest box of texels outside which nothing is visible. visible[n]: is anything drawn of the values around texel
    // n / (visible.size() - 1). Box of size 0: nothing is.
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
    float stored_low_ = 0, stored_high_ = 0; // FLOAT32: stored values at texels 0 and 65535
    uint64_t not_numbers_ = 0;
    std::vector<uint8_t> texels_;
    std::vector<Box> changes_;
    Size bricks_{{0, 0, 0}};
    std::vector<uint16_t> brick_low_, brick_high_; // with the layer of texels behind it: interpolation reaches there
    std::vector<uint64_t> histogram_;
};

} // namespace pliant_rviz
#endif
