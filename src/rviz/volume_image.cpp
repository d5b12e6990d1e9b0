#include "rviz/volume_image.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <sstream>

namespace pliant_rviz {

namespace {

const size_t HISTOGRAM = 4096;

size_t bytes_of(uint8_t encoding)
{
    return encoding == UINT8 ? 1 : encoding == INT16 ? 2 : encoding == FLOAT32 ? 4 : 0;
}

std::string text(const Size &size)
{
    std::ostringstream out;
    out << size[0] << " x " << size[1] << " x " << size[2];
    return out.str();
}

template <class T> bool all_finite(const T &numbers)
{
    return std::all_of(numbers.begin(), numbers.end(), [](double x) { return std::isfinite(x); });
}

// a * b * c if below 2^62, otherwise 0
uint64_t product(const Size &size)
{
    double estimate = double(size[0]) * size[1] * size[2];
    return estimate < 4.6e18 ? uint64_t(size[0]) * size[1] * size[2] : 0;
}

std::string check_sizes(const VolumeView &view)
{
    std::ostringstream out;
    for (int d = 0; d < 3; d++) {
        if (view.full_size[d] == 0 || view.box.size[d] == 0) {
            out << "empty: full_size " << text(view.full_size) << ", size " << text(view.box.size);
            return out.str();
        }
        if (uint64_t(view.box.offset[d]) + view.box.size[d] > view.full_size[d]) {
            out << "the box at " << text(view.box.offset) << " of size " << text(view.box.size)
                << " leaves the volume of " << text(view.full_size);
            return out.str();
        }
    }
    uint64_t wanted = product(view.box.size);
    if (wanted == 0 || product(view.full_size) == 0 || wanted * bytes_of(view.encoding) != view.bytes) {
        out << "size does not match the data: " << text(view.box.size) << " voxels of " << bytes_of(view.encoding)
            << " bytes, but " << view.bytes << " bytes of data";
        return out.str();
    }
    return "";
}

} // namespace

std::string check(const VolumeView &view)
{
    std::ostringstream out;
    if (bytes_of(view.encoding) == 0) {
        out << "unknown encoding " << int(view.encoding) << " (1: UINT8, 2: INT16, 3: FLOAT32)";
        return out.str();
    }
    std::string sizes = check_sizes(view);
    if (!sizes.empty()) return sizes;
    for (double spacing : view.spacing)
        if (!(spacing > 0) || !std::isfinite(spacing)) {
            out << "spacing must be above 0 and finite, it is " << view.spacing[0] << ", " << view.spacing[1] << ", "
                << view.spacing[2];
            return out.str();
        }
    if (!all_finite(view.position) || !all_finite(view.orientation))
        return "the pose of the origin holds NaN or infinite numbers";
    double norm = 0;
    for (double x : view.orientation) norm += x * x;
    if (std::fabs(norm - 1) > 0.01) {
        out << "the orientation of the origin is not a unit quaternion (its squared length is " << norm << ")";
        return out.str();
    }
    if (!std::isfinite(view.slope) || !std::isfinite(view.intercept) || view.slope == 0)
        return "slope and intercept must be finite, and slope not 0";
    return "";
}

VolumeImage::Result VolumeImage::put(const VolumeView &view, const TextureLimits &limits)
{
    bool whole = view.box.size == view.full_size;
    bool same = !texels_.empty() && view.scan_id == scan_id_ && view.full_size == full_size_ &&
                view.encoding == encoding_ && view.slope == slope_ && view.intercept == intercept_;
    if (!same && !whole) return WAITS;
    if (!same) start(view, limits);

    Box texels = texels_of(view.box);
    float low = 0, high = 0;
    range_of(view, low, high);
    if (encoding_ == FLOAT32) {
        if (!same) {
            stored_low_ = low;
            stored_high_ = high > low ? high : low + 1;
        } else {
            widen(low, high);
        }
        convert<float>(view, texels);
        value_scale_ = double(slope_) * (double(stored_high_) - stored_low_);
        value_offset_ = double(slope_) * stored_low_ + intercept_;
    } else if (encoding_ == INT16) {
        convert<int16_t>(view, texels);
    } else {
        convert<uint8_t>(view, texels);
    }
    double a = double(slope_) * low + intercept_, b = double(slope_) * high + intercept_;
    low_ = same ? std::min(low_, std::min(a, b)) : std::min(a, b);
    high_ = same ? std::max(high_, std::max(a, b)) : std::max(a, b);
    measure_bricks(texels);
    if (!same) count_values();
    change(texels);
    return same ? PART : WHOLE;
}

void VolumeImage::start(const VolumeView &view, const TextureLimits &limits)
{
    scan_id_ = view.scan_id;
    full_size_ = view.full_size;
    encoding_ = view.encoding;
    slope_ = view.slope;
    intercept_ = view.intercept;
    bits_ = encoding_ == UINT8 ? 8 : 16;
    for (stride_ = 1;; stride_++) {
        for (int d = 0; d < 3; d++) size_[d] = (full_size_[d] + stride_ - 1) / stride_;
        bool fits = size_[0] <= limits.edge && size_[1] <= limits.edge && size_[2] <= limits.edge;
        if (fits && product(size_) * uint64_t(bits_ / 8) <= limits.bytes) break;
        if (size_ == Size{{1, 1, 1}}) break;
    }
    value_scale_ = encoding_ == UINT8 ? 255.0 * slope_ : 65535.0 * slope_;
    value_offset_ = encoding_ == UINT8 ? intercept_ : -32768.0 * slope_ + intercept_;
    size_t count = size_t(size_[0]) * size_[1] * size_[2];
    texels_.assign(count * size_t(bits_ / 8), 0);
    changes_.clear();
    for (int d = 0; d < 3; d++) bricks_[d] = (size_[d] + BRICK - 1) / BRICK;
    size_t bricks = size_t(bricks_[0]) * bricks_[1] * bricks_[2];
    brick_low_.assign(bricks, 0);
    brick_high_.assign(bricks, 0);
}

// Return the texels whose voxels (stride * texel) lie in the box.
Box VolumeImage::texels_of(const Box &voxels) const
{
    Box out;
    for (int d = 0; d < 3; d++) {
        uint32_t first = (voxels.offset[d] + stride_ - 1) / stride_;
        uint32_t end = (voxels.offset[d] + voxels.size[d] + stride_ - 1) / stride_;
        out.offset[d] = first;
        out.size[d] = end - first;
    }
    return out;
}

void VolumeImage::range_of(const VolumeView &view, float &low, float &high)
{
    size_t count = view.box.voxels();
    not_numbers_ = 0;
    if (encoding_ == UINT8) {
        auto range = std::minmax_element(view.data, view.data + count);
        low = *range.first;
        high = *range.second;
        return;
    }
    if (encoding_ == INT16) {
        int16_t minimum = std::numeric_limits<int16_t>::max(), maximum = std::numeric_limits<int16_t>::min();
        for (size_t n = 0; n < count; n++) {
            int16_t stored;
            std::memcpy(&stored, view.data + 2 * n, 2);
            minimum = std::min(minimum, stored);
            maximum = std::max(maximum, stored);
        }
        low = minimum;
        high = maximum;
        return;
    }
    low = std::numeric_limits<float>::max();
    high = std::numeric_limits<float>::lowest();
    for (size_t n = 0; n < count; n++) {
        float stored;
        std::memcpy(&stored, view.data + 4 * n, 4);
        if (!std::isfinite(stored)) {
            not_numbers_++;
            continue;
        }
        low = std::min(low, stored);
        high = std::max(high, stored);
    }
    if (low > high) low = high = 0;
}

// Widen the range of FLOAT32 values: convert all texels to the new range.
void VolumeImage::widen(float low, float high)
{
    if (low >= stored_low_ && high <= stored_high_) return;
    // widen by an additional quarter, so that a slowly growing range does not rewrite the texture for every box
    float quarter = 0.25f * (std::max(high, stored_high_) - std::min(low, stored_low_));
    float new_low = low < stored_low_ ? low - quarter : stored_low_,
          new_high = high > stored_high_ ? high + quarter : stored_high_;
    if (!std::isfinite(new_low)) new_low = low;
    if (!std::isfinite(new_high)) new_high = high;
    double old_step = (double(stored_high_) - stored_low_) / 65535, new_range = double(new_high) - new_low;
    uint16_t *texels = reinterpret_cast<uint16_t *>(texels_.data());
    for (size_t n = 0; n < texels_.size() / 2; n++)
        texels[n] = uint16_t(std::lround((stored_low_ + old_step * texels[n] - new_low) / new_range * 65535));
    stored_low_ = new_low;
    stored_high_ = new_high;
    measure_bricks({{{0, 0, 0}}, size_});
    change({{{0, 0, 0}}, size_});
}

template <class Stored> void VolumeImage::convert(const VolumeView &view, const Box &texels)
{
    const Size &count = view.box.size, &first = view.box.offset;
    double low = stored_low_, factor = 65535 / (double(stored_high_) - stored_low_);
    for (uint32_t k = 0; k < texels.size[2]; k++)
        for (uint32_t j = 0; j < texels.size[1]; j++) {
            size_t z = size_t(texels.offset[2] + k) * stride_ - first[2],
                   y = size_t(texels.offset[1] + j) * stride_ - first[1];
            const uint8_t *from = view.data + sizeof(Stored) * (count[0] * (y + count[1] * z));
            size_t row =
                texels.offset[0] + size_[0] * (texels.offset[1] + j + size_t(size_[1]) * (texels.offset[2] + k));
            for (uint32_t i = 0; i < texels.size[0]; i++) {
                Stored stored;
                std::memcpy(&stored, from + sizeof(Stored) * (size_t(texels.offset[0] + i) * stride_ - first[0]),
                            sizeof(Stored));
                if (sizeof(Stored) == 1) {
                    texels_[row + i] = uint8_t(stored);
                    continue;
                }
                uint16_t texel;
                if (sizeof(Stored) == 2)
                    texel = uint16_t(int(stored) + 32768);
                else
                    texel = std::isfinite(double(stored)) ? uint16_t((stored - low) * factor + 0.5) : 0;
                std::memcpy(&texels_[2 * (row + i)], &texel, 2);
            }
        }
}

uint16_t VolumeImage::texel(size_t index) const
{
    if (bits_ == 8) return uint16_t(texels_[index] * 257);
    uint16_t value;
    std::memcpy(&value, &texels_[2 * index], 2);
    return value;
}

double VolumeImage::value(const std::array<double, 3> &at) const
{
    size_t first[3], second[3];
    double part[3], sum = 0;
    for (size_t d = 0; d < 3; d++) {
        const double inside = std::min(std::max(at[d], 0.0), size_[d] - 1.0);
        first[d] = size_t(inside);
        second[d] = std::min<size_t>(first[d] + 1, size_[d] - 1);
        part[d] = inside - double(first[d]);
    }
    for (int corner = 0; corner < 8; corner++) {
        double weight = 1;
        size_t index[3];
        for (int d = 0; d < 3; d++) {
            const bool is_second = corner >> d & 1;
            index[d] = is_second ? second[d] : first[d];
            weight *= is_second ? part[d] : 1 - part[d];
        }
        sum += weight * texel(index[0] + size_[0] * (index[1] + size_[1] * index[2]));
    }
    return value_offset_ + value_scale_ * sum / 65535;
}

void VolumeImage::measure_bricks(const Box &texels)
{
    Size first, last;
    for (int d = 0; d < 3; d++) {
        if (texels.size[d] == 0) return;
        // a brick includes the adjacent layer behind it
        first[d] = (texels.offset[d] > 0 ? texels.offset[d] - 1 : 0) / BRICK;
        last[d] = (texels.offset[d] + texels.size[d] - 1) / BRICK;
    }
    for (uint32_t c = first[2]; c <= last[2]; c++)
        for (uint32_t b = first[1]; b <= last[1]; b++)
            for (uint32_t a = first[0]; a <= last[0]; a++) {
                uint16_t low = 65535, high = 0;
                for (uint32_t k = c * BRICK; k < std::min(c * BRICK + BRICK + 1, size_[2]); k++)
                    for (uint32_t j = b * BRICK; j < std::min(b * BRICK + BRICK + 1, size_[1]); j++) {
                        size_t row = size_[0] * (j + size_t(size_[1]) * k);
                        for (uint32_t i = a * BRICK; i < std::min(a * BRICK + BRICK + 1, size_[0]); i++) {
                            uint16_t value = texel(row + i);
                            low = std::min(low, value);
                            high = std::max(high, value);
                        }
                    }
                size_t brick = a + size_t(bricks_[0]) * (b + size_t(bricks_[1]) * c);
                brick_low_[brick] = low;
                brick_high_[brick] = high;
            }
}

void VolumeImage::count_values()
{
    histogram_.assign(HISTOGRAM, 0);
    size_t count = size_t(size_[0]) * size_[1] * size_[2];
    for (size_t n = 0; n < count; n++) histogram_[texel(n) * HISTOGRAM / 65536]++;
}

double VolumeImage::quantile(double fraction) const
{
    if (histogram_.empty()) return low_;
    uint64_t all = 0, sum = 0;
    size_t lowest = 0;
    while (lowest + 1 < HISTOGRAM && histogram_[lowest] == 0) lowest++;
    for (size_t n = lowest + 1; n < HISTOGRAM; n++) all += histogram_[n];
    if (all == 0) return low_;
    size_t n = lowest;
    while (n + 1 < HISTOGRAM && double(sum) < fraction * double(all)) sum += histogram_[++n];
    return value_offset_ + value_scale_ * (double(n) + 0.5) / double(HISTOGRAM);
}

std::vector<double> VolumeImage::histogram(double low, double high, size_t bins) const
{
    std::vector<double> out(bins, 0), below(1, 0); /* number of texels below each limit of the stored histogram */
    for (uint64_t count : histogram_) below.push_back(below.back() + double(count));
    auto below_value = [&](double value) {
        const double place =
            std::min(std::max((value - value_offset_) / value_scale_, 0.0), 1.0) * double(below.size() - 1);
        const size_t first = std::min(size_t(place), below.size() - 1), second = std::min(first + 1, below.size() - 1);
        return below[first] + (place - double(first)) * (below[second] - below[first]);
    };
    double maximum = 0;
    for (size_t n = 0; n < bins; n++) {
        const double step = (high - low) / double(bins), from = low + step * double(n);
        maximum = std::max(maximum, out[n] = std::fabs(below_value(from + step) - below_value(from)));
    }
    for (double &each : out) each = maximum > 0 ? std::sqrt(each / maximum) : 0;
    return out;
}

std::string VolumeImage::precision() const
{
    std::ostringstream out;
    if (encoding_ == UINT8) out << "8-bit texture, exact";
    else if (encoding_ == INT16) out << "16-bit texture, exact";
    else out << "16-bit texture, steps of " << std::fabs(value_scale_) / 65535;
    if (stride_ > 1) out << ", every " << stride_ << ". voxel along each axis (" << text(size_) << ")";
    return out.str();
}

void VolumeImage::change(const Box &texels)
{
    if (texels.voxels() == 0) return;
    // older boxes inside the new box are uploaded with it
    auto inside = [&](const Box &old) {
        for (int d = 0; d < 3; d++)
            if (old.offset[d] < texels.offset[d] || old.offset[d] + old.size[d] > texels.offset[d] + texels.size[d])
                return false;
        return true;
    };
    changes_.erase(std::remove_if(changes_.begin(), changes_.end(), inside), changes_.end());
    changes_.push_back(texels);
}

bool VolumeImage::next_change(size_t max_bytes, Box &out)
{
    if (changes_.empty()) return false;
    Box &box = changes_.front();
    size_t texel_bytes = size_t(bits_ / 8), layer = texel_bytes * box.size[0] * box.size[1];
    out = box;
    if (layer * box.size[2] > max_bytes) {
        // whole layers, or whole rows of one layer
        uint32_t rows = uint32_t(std::max<size_t>(1, max_bytes / (texel_bytes * box.size[0])));
        if (layer <= max_bytes) {
            out.size[2] = uint32_t(max_bytes / layer);
        } else if (rows < box.size[1]) {
            Box rest = box;
            out.size[2] = 1;
            out.size[1] = rows;
            rest.size[2] = 1;
            rest.offset[1] += rows;
            rest.size[1] -= rows;
            box.offset[2]++;
            box.size[2]--;
            if (box.size[2] == 0) box = rest;
            else changes_.insert(changes_.begin(), rest);
            return true;
        }
    }
    box.offset[2] += out.size[2];
    box.size[2] -= out.size[2];
    if (box.size[2] == 0) changes_.erase(changes_.begin());
    return true;
}

void VolumeImage::copy(const Box &box, std::vector<uint8_t> &out) const
{
    size_t texel_bytes = size_t(bits_ / 8), row_bytes = texel_bytes * box.size[0];
    out.resize(texel_bytes * box.voxels());
    uint8_t *to = out.data();
    for (uint32_t k = 0; k < box.size[2]; k++)
        for (uint32_t j = 0; j < box.size[1]; j++, to += row_bytes) {
            size_t row = box.offset[0] + size_[0] * (box.offset[1] + j + size_t(size_[1]) * (box.offset[2] + k));
            std::memcpy(to, &texels_[texel_bytes * row], row_bytes);
        }
}

Box VolumeImage::visible_box(const std::vector<bool> &visible) const
{
    std::vector<int> before(visible.size() + 1, 0); // number of visible entries before each one
    for (size_t n = 0; n < visible.size(); n++) before[n + 1] = before[n] + visible[n];
    size_t top = visible.size() - 1;
    Size low = bricks_, high{{0, 0, 0}};
    for (uint32_t c = 0, brick = 0; c < bricks_[2]; c++)
        for (uint32_t b = 0; b < bricks_[1]; b++)
            for (uint32_t a = 0; a < bricks_[0]; a++, brick++) {
                size_t first = brick_low_[brick] * top / 65535, last = (brick_high_[brick] * top + 65534) / 65535;
                if (before[last + 1] == before[first]) continue;
                Size here{{a, b, c}};
                for (int d = 0; d < 3; d++) {
                    low[d] = std::min(low[d], here[d]);
                    high[d] = std::max(high[d], here[d] + 1);
                }
            }
    Box box;
    for (int d = 0; d < 3; d++) {
        if (high[d] <= low[d]) return Box();
        // a brick extends to the first layer of the next; the first brick extends to the volume's edge
        box.offset[d] = low[d] * BRICK;
        box.size[d] = std::min(high[d] * BRICK + 1, size_[d]) - box.offset[d];
    }
    return box;
}

} // namespace pliant_rviz
