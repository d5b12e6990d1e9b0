/* Converts the numbers of a file to the encoding of a volume, or to labels. */
#include "scan/read.h"
#include "base/memory.h"

#include <cfloat>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <type_traits>
#include <utility>

namespace pliant_read {

bool component_is_integer(component type) { return type != component::float32 && type != component::float64; }

namespace {

/* Call action with a pointer of the matching type. */
template <class Action> void with_type(component type, const void *voxels, Action action)
{
    switch (type) {
    case component::none: break;
    case component::uint8: action(static_cast<const uint8_t *>(voxels)); break;
    case component::int8: action(static_cast<const int8_t *>(voxels)); break;
    case component::uint16: action(static_cast<const uint16_t *>(voxels)); break;
    case component::int16: action(static_cast<const int16_t *>(voxels)); break;
    case component::uint32: action(static_cast<const uint32_t *>(voxels)); break;
    case component::int32: action(static_cast<const int32_t *>(voxels)); break;
    case component::uint64: action(static_cast<const uint64_t *>(voxels)); break;
    case component::int64: action(static_cast<const int64_t *>(voxels)); break;
    case component::float32: action(static_cast<const float *>(voxels)); break;
    case component::float64: action(static_cast<const double *>(voxels)); break;
    }
}

struct range {
    double low, high;
};

[[noreturn]] void fail_at(const std::string &path, const image_header &header, size_t index, const char *what)
{
    size_t nx = static_cast<size_t>(header.geometry.size[0]), ny = static_cast<size_t>(header.geometry.size[1]);
    fail(PLIANT_ERROR_FORMAT, "%s: voxel (%zu, %zu, %zu) %s", path.c_str(), index % nx, index / nx % ny,
         index / (nx * ny), what);
}

/* Return the smallest and largest value. Fails if a value is not finite. */
range value_range(const std::string &path, const image_header &header, const void *voxels, size_t count)
{
    range found = {0.0, 0.0};
    with_type(header.type, voxels, [&](auto *v) {
        auto low = v[0], high = v[0];
        for (size_t i = 0; i < count; i++) {
            if (!std::isfinite(static_cast<double>(v[i])))
                fail_at(path, header, i, "is not a finite number: replace NaN and infinite values first");
            if (v[i] < low) low = v[i];
            if (v[i] > high) high = v[i];
        }
        found.low = header.slope * static_cast<double>(low) + header.intercept;
        found.high = header.slope * static_cast<double>(high) + header.intercept;
    });
    if (found.low > found.high) std::swap(found.low, found.high);
    return found;
}

bool is_whole(double value) { return std::floor(value) == value; }

/* Labels that were scaled in single precision are integers up to rounding. */
const double LABEL_ROUNDING = 1e-3;
bool is_label(double value) { return std::fabs(value - std::round(value)) <= LABEL_ROUNDING; }

bool values_are_whole(const image_header &header)
{
    return header.whole_numbers && is_whole(header.slope) && is_whole(header.intercept);
}

bool is_unscaled(const image_header &header) { return header.slope == 1.0 && header.intercept == 0.0; }

/* Frees the voxels whose ownership convert_* took. */
struct owned_voxels {
    void *voxels;
    explicit owned_voxels(void **taken) : voxels(*taken) { *taken = nullptr; }
    ~owned_voxels() { pliant_free(voxels); }
    void *release()
    {
        void *kept = voxels;
        voxels = nullptr;
        return kept;
    }
};

/* Convert the voxels, overwriting the input if the type's size is the same. This avoids a second copy in memory. */
template <class To> void *convert(const image_header &header, owned_voxels *raw, size_t count)
{
    const bool in_place = component_size(header.type) == sizeof(To);
    void *out = in_place ? raw->voxels : pliant_calloc(count, sizeof(To));
    if (!out) fail(PLIANT_ERROR_MEMORY, "out of memory for the voxels of a scan");
    with_type(header.type, raw->voxels, [&](auto *v) {
        const bool unscaled = is_unscaled(header);
        for (size_t i = 0; i < count; i++) {
            typename std::decay<decltype(*v)>::type from;
            std::memcpy(&from, v + i, sizeof from);
            double value =
                unscaled ? static_cast<double>(from) : header.slope * static_cast<double>(from) + header.intercept;
            To to = unscaled && component_is_integer(header.type)
                        ? static_cast<To>(from)
                        : static_cast<To>(std::is_integral<To>::value ? std::round(value) : value);
            std::memcpy(static_cast<To *>(out) + i, &to, sizeof to);
        }
    });
    return in_place ? raw->release() : out;
}

} // namespace

double conversion_bytes(const image_header &header, bool labels)
{
    double maximum = 0.0;
    auto may_become = [&](size_t size) {
        if (size != component_size(header.type)) maximum = std::fmax(maximum, static_cast<double>(size));
    };
    bool narrow = is_unscaled(header) && values_are_whole(header);
    if (labels) {
        may_become(sizeof(uint16_t));
    } else if (!values_are_whole(header)) {
        may_become(sizeof(float));
    } else {
        may_become(sizeof(uint8_t));
        if (!narrow || header.type != component::uint8) may_become(sizeof(int16_t));
        if (!narrow || (component_size(header.type) != 1 && header.type != component::int16)) may_become(sizeof(float));
    }
    return maximum;
}

converted convert_values(const std::string &path, const image_header &header, void **voxels)
{
    owned_voxels raw(voxels);
    size_t count = pliant_geometry_voxels(&header.geometry);
    range range = value_range(path, header, raw.voxels, count);
    if (range.low < -FLT_MAX || range.high > FLT_MAX)
        fail(PLIANT_ERROR_FORMAT, "%s: values from %g to %g are more than single precision holds", path.c_str(),
             range.low, range.high);

    converted result = {PLIANT_FLOAT32, 0.0f, nullptr};
    if (values_are_whole(header)) {
        if (range.low >= 0 && range.high <= UINT8_MAX) result.encoding = PLIANT_UINT8;
        else if (range.low >= INT16_MIN && range.high <= INT16_MAX) result.encoding = PLIANT_INT16;
    }
    /* Values far below zero are air: a CT, independent of values outside its field of view. */
    result.background = static_cast<float>(range.low < -500.0 ? std::fmax(range.low, -1024.0) : range.low);

    switch (result.encoding) {
    case PLIANT_UINT8: result.voxels = convert<uint8_t>(header, &raw, count); break;
    case PLIANT_INT16: result.voxels = convert<int16_t>(header, &raw, count); break;
    case PLIANT_FLOAT32: result.voxels = convert<float>(header, &raw, count); break;
    }
    return result;
}

uint16_t *convert_labels(const std::string &path, const image_header &header, void **voxels)
{
    owned_voxels raw(voxels);
    size_t count = pliant_geometry_voxels(&header.geometry);
    range range = value_range(path, header, raw.voxels, count);
    if (range.low < -LABEL_ROUNDING || range.high > UINT16_MAX + LABEL_ROUNDING)
        fail(PLIANT_ERROR_FORMAT,
             "%s: labels from %.9g to %.9g: they must be whole numbers from 0 to 65535; name a label map, not a scan, "
             "and resample it by nearest neighbour only",
             path.c_str(), range.low, range.high);
    if (!values_are_whole(header))
        with_type(header.type, raw.voxels, [&](auto *v) {
            for (size_t i = 0; i < count; i++) {
                const double value = header.slope * static_cast<double>(v[i]) + header.intercept;
                char what[200];
                if (is_label(value)) continue;
                snprintf(what, sizeof what,
                         "is %.9g, not a whole number: a label map holds labels from 0 to 65535; if it was resampled, "
                         "do it again by "
                         "nearest neighbour",
                         value);
                fail_at(path, header, i, what);
            }
        });
    return static_cast<uint16_t *>(convert<uint16_t>(header, &raw, count));
}

} // namespace pliant_read
