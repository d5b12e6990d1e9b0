/* NIfTI-1 and NIfTI-2, as one file or as header and image (https://nifti.nimh.nih.gov/nifti-1). ITK's reader is not
 * used. It replaces NaN by 0, fills truncated data with zeros, does not scale the origin of files in metres, and
 * refuses valid sforms far from the origin. */
#include "scan/read_segments.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace pliant_read {

namespace {

enum { SIZE_1 = 348, SIZE_2 = 540 };

/* Offsets of the fields in both versions [byte] */
struct layout {
    size_t dim, datatype, pixdim, vox_offset, scl_slope, scl_inter, xyzt_units, qform_code, sform_code, quatern,
        qoffset, srow, descrip;
};
const layout layout_1 = {40, 70, 76, 108, 112, 116, 123, 252, 254, 256, 268, 280, 148};
const layout layout_2 = {16, 12, 104, 168, 176, 184, 500, 344, 348, 352, 376, 400, 240};

/* Header bytes with version and byte order. */
class fields {
public:
    fields(std::string bytes, int version, bool swap) : bytes_(std::move(bytes)), version_(version), swap_(swap) {}
    const layout &at() const { return version_ == 1 ? layout_1 : layout_2; }
    bool swap() const { return swap_; }
    template <class T> T get(size_t offset) const
    {
        unsigned char raw[sizeof(T)];
        std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(offset), sizeof(T), raw);
        if (swap_) std::reverse(raw, raw + sizeof(T));
        T value;
        std::memcpy(&value, raw, sizeof(T));
        return value;
    }
    double real(size_t offset, size_t index = 0) const
    {
        return version_ == 1 ? static_cast<double>(get<float>(offset + 4 * index)) : get<double>(offset + 8 * index);
    }
    int64_t dim(size_t index) const
    {
        return version_ == 1 ? get<int16_t>(at().dim + 2 * index) : get<int64_t>(at().dim + 8 * index);
    }
    int code(size_t offset) const { return version_ == 1 ? get<int16_t>(offset) : get<int32_t>(offset); }
    double vox_offset() const
    {
        return version_ == 1 ? static_cast<double>(get<float>(at().vox_offset))
                             : static_cast<double>(get<int64_t>(at().vox_offset));
    }
    std::string descrip() const { return bytes_.substr(at().descrip, 80); }
    int length_unit() const { return (version_ == 1 ? bytes_[at().xyzt_units] : get<int32_t>(at().xyzt_units)) & 7; }

private:
    std::string bytes_;
    int version_;
    bool swap_;
};

/* Return 1, 2, or 0 for no NIfTI header; -1 for Analyze 7.5. */
int version_of(const std::string &bytes, bool *swap)
{
    if (bytes.size() < SIZE_1) return 0;
    int32_t size;
    std::memcpy(&size, bytes.data(), sizeof size);
    *swap = size != SIZE_1 && size != SIZE_2;
    if (*swap) size = static_cast<int32_t>(__builtin_bswap32(static_cast<uint32_t>(size)));
    if (size == SIZE_1) {
        std::string magic = bytes.substr(344, 4);
        return magic == std::string("n+1\0", 4) || magic == std::string("ni1\0", 4) ? 1 : -1;
    }
    if (size == SIZE_2) {
        std::string magic = bytes.substr(4, 4);
        return magic == std::string("n+2\0", 4) || magic == std::string("ni2\0", 4) ? 2 : 0;
    }
    return 0;
}

bool is_gzip(const std::string &path)
{
    std::string start = file_start(path, 2);
    return start.size() == 2 && start[0] == '\x1f' && start[1] == '\x8b';
}

/* Return the first bytes, decompressed; fewer if the file is shorter or damaged. */
std::string header_bytes(const std::string &path)
{
    std::string bytes(SIZE_2, '\0');
    byte_stream stream(path, 0, is_gzip(path) ? byte_stream::packing::deflate : byte_stream::packing::none);
    bytes.resize(stream.read(&bytes[0], bytes.size()));
    return bytes;
}

component component_of(const std::string &path, int datatype)
{
    switch (datatype) {
    case 2: return component::uint8;
    case 4: return component::int16;
    case 8: return component::int32;
    case 16: return component::float32;
    case 64: return component::float64;
    case 256: return component::int8;
    case 512: return component::uint16;
    case 768: return component::uint32;
    case 1024: return component::int64;
    case 1280: return component::uint64;
    case 32:
    case 1792:
    case 2048:
        fail(PLIANT_ERROR_FORMAT, "%s: a complex image; real values are needed (magnitude, for example)", path.c_str());
    case 128:
    case 2304: fail(PLIANT_ERROR_FORMAT, "%s: a colour image; one value per voxel is needed", path.c_str());
    default:
        fail(PLIANT_ERROR_FORMAT,
             "%s: NIfTI datatype %d is not supported; integers of 8 to 64 bits and reals of 32 or 64 bits are",
             path.c_str(), datatype);
    }
}

/* Return the modality from the description, since NIfTI has no field for it. DICOM converters write the echo time of an
 * MR there: "TE=30;Time=..." (0 for CT), "3T 3D GR TR=2300ms/TE=2.98ms". */
pliant_modality modality_in(const std::string &descrip)
{
    size_t echo = descrip.find("TE=");
    if (echo == std::string::npos) return PLIANT_MODALITY_UNKNOWN;
    std::vector<double> time;
    std::string digits = descrip.substr(echo + 3, descrip.find_first_not_of("0123456789.", echo + 3) - echo - 3);
    return parse_numbers(digits, ' ', &time) && time.size() == 1 && time[0] > 0.0 ? PLIANT_MODALITY_MR
                                                                                  : PLIANT_MODALITY_UNKNOWN;
}

/* Convert the columns of a RAS matrix [mm] to spacing, direction and origin in LPS. */
void from_affine(const double affine[12], grid *grid)
{
    for (int d = 0; d < 3; d++) {
        double x = affine[d], y = affine[4 + d], z = affine[8 + d];
        double length = std::sqrt(x * x + y * y + z * z);
        grid->spacing[d] = length;
        grid->direction[d] = (0.0 - x) / length; /* and no -0 */
        grid->direction[3 + d] = (0.0 - y) / length;
        grid->direction[6 + d] = z / length;
    }
    grid->origin[0] = 0.0 - affine[3];
    grid->origin[1] = 0.0 - affine[7];
    grid->origin[2] = affine[11];
}

/* Return whether the axes do not span space: a zero column, parallel columns, or numbers that are not finite. */
bool is_singular(const double affine[12])
{
    double lengths = 1.0;
    for (int d = 0; d < 3; d++)
        lengths *= std::sqrt(affine[d] * affine[d] + affine[4 + d] * affine[4 + d] + affine[8 + d] * affine[8 + d]);
    double determinant = affine[0] * (affine[5] * affine[10] - affine[6] * affine[9]) -
                         affine[1] * (affine[4] * affine[10] - affine[6] * affine[8]) +
                         affine[2] * (affine[4] * affine[9] - affine[5] * affine[8]);
    return !(std::fabs(determinant) > 1e-3 * lengths) || !std::isfinite(affine[3] + affine[7] + affine[11]);
}

bool is_sheared(const grid &grid)
{
    const double *d = grid.direction;
    for (int a = 0; a < 3; a++) {
        int b = (a + 1) % 3;
        if (std::fabs(d[a] * d[b] + d[3 + a] * d[3 + b] + d[6 + a] * d[6 + b]) > 1e-3) return true;
    }
    return false;
}

void affine_from_sform(const fields &header, double unit, double affine[12])
{
    for (size_t n = 0; n < 12; n++) affine[n] = unit * header.real(header.at().srow, n);
}

/* Compute the matrix of the qform: a unit quaternion (a, b, c, d), a >= 0 being omitted, and the handedness in
 * pixdim[0]. */
void affine_from_qform(const std::string &path, const fields &header, double unit, double affine[12])
{
    double b = header.real(header.at().quatern, 0), c = header.real(header.at().quatern, 1),
           d = header.real(header.at().quatern, 2);
    double rest = 1.0 - (b * b + c * c + d * d), a = std::sqrt(std::fmax(rest, 0.0));
    if (!(rest > -1e-3))
        fail(PLIANT_ERROR_FORMAT, "%s: the quaternion (%g, %g, %g) of the qform is not a rotation", path.c_str(), b, c,
             d);
    double norm = std::sqrt(a * a + b * b + c * c + d * d); /* 1, except for rounding errors of a half turn */
    a /= norm;
    b /= norm;
    c /= norm;
    d /= norm;
    const double rotation[9] = {a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c),
                                2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b),
                                2 * (b * d - a * c), 2 * (c * d + a * b), a * a + d * d - c * c - b * b};
    double sign = header.real(header.at().pixdim, 0) < 0.0 ? -1.0 : 1.0;
    for (size_t row = 0; row < 3; row++) {
        for (size_t column = 0; column < 3; column++) {
            double spacing = unit * header.real(header.at().pixdim, column + 1);
            affine[4 * row + column] = rotation[3 * row + column] * spacing * (column == 2 ? sign : 1.0);
        }
        affine[4 * row + 3] = unit * header.real(header.at().qoffset, row);
    }
}

/* Check pixdim against the spacing of a valid sform. pixdim may have a sign, which has no meaning, or be no length.
 * Another length is a contradiction. */
void check_pixdim(const std::string &path, const double pixdim[3], const grid &grid)
{
    for (int d = 0; d < 3; d++) {
        const double length = std::fabs(pixdim[d]), spacing = grid.spacing[d];
        if (length > 0.0 && std::isfinite(length) && std::fabs(spacing - length) > 0.01 * length)
            fail(
                PLIANT_ERROR_FORMAT,
                "%s: the header contradicts itself: voxel spacing %g mm in pixdim[%d], %g mm in the sform: correct the "
                "wrong value",
                path.c_str(), pixdim[d], d + 1, spacing);
        if (!(pixdim[d] > 0.0) || !std::isfinite(length))
            pliant_log(PLIANT_LOG_WARNING, "%s: voxel spacing pixdim[%d] is %g mm; the %g mm of the sform are taken",
                       path.c_str(), d + 1, pixdim[d], spacing);
    }
}

/* Read the grid from the sform if its axes are orthogonal, otherwise from the qform, otherwise from pixdim alone. These
 * are methods 3, 2, 1 of the standard. If a header has both forms, both describe the same voxels and the reader may
 * choose. */
void read_grid(const std::string &path, const fields &header, grid *grid)
{
    const layout &at = header.at();
    int64_t dimensions = header.dim(0);
    if (dimensions < 1 || dimensions > 7)
        fail(PLIANT_ERROR_FORMAT, "%s: damaged NIfTI header: dim[0] is %lld, it must be 1 to 7", path.c_str(),
             static_cast<long long>(dimensions));
    for (int64_t d = 1; d <= dimensions; d++) grid->size.push_back(header.dim(static_cast<size_t>(d)));

    if (grid->size.size() < 3) return;
    const int metre = 1, micrometre = 3;
    double unit = header.length_unit() == metre ? 1e3 : header.length_unit() == micrometre ? 1e-3 : 1.0;
    double affine[12], pixdim[3];
    for (size_t d = 0; d < 3; d++) pixdim[d] = unit * header.real(at.pixdim, d + 1);
    bool has_sform = header.code(at.sform_code) > 0, has_qform = header.code(at.qform_code) > 0;
    if (has_sform) {
        affine_from_sform(header, unit, affine);
        bool singular = is_singular(affine);
        if (singular && !has_qform)
            fail(
                PLIANT_ERROR_FORMAT,
                "%s: the sform (srow_x, srow_y, srow_z) is singular: its axes do not span space, and there is no qform",
                path.c_str());
        from_affine(affine, grid);
        bool sheared = singular || is_sheared(*grid);
        if (sheared && has_qform)
            pliant_log(
                PLIANT_LOG_WARNING,
                "%s: the sform (srow_x, srow_y, srow_z) is %s, which no grid with right angles can follow; the qform "
                "is taken instead, so positions may differ from what other programs show",
                path.c_str(), singular ? "singular" : "sheared");
        if (!has_qform || !sheared) {
            if (!sheared) check_pixdim(path, pixdim, *grid); /* sheared: refused below, with the other grids */
            return;
        }
    }
    for (int d = 0; d < 3; d++)
        if (!(pixdim[d] > 0.0) || !std::isfinite(pixdim[d]))
            fail(PLIANT_ERROR_FORMAT,
                 "%s: voxel spacing pixdim[%d] is %g mm, it must be above 0 where there is no sform", path.c_str(),
                 d + 1, pixdim[d]);
    if (has_qform) {
        affine_from_qform(path, header, unit, affine);
        from_affine(affine, grid);
        return;
    }
    pliant_log(PLIANT_LOG_WARNING,
               "%s: neither sform nor qform: the orientation of the patient is not known, axes are taken as "
               "right, anterior, superior",
               path.c_str());
    const double plain[12] = {pixdim[0], 0, 0, 0, 0, pixdim[1], 0, 0, 0, 0, pixdim[2], 0};
    from_affine(plain, grid);
}

/* Return the image file that belongs to a header file: .img for .hdr, compressed or not. */
std::string image_file(const std::string &path)
{
    std::string base = path;
    if (ends_with(lower_case(base), ".gz")) base.resize(base.size() - 3);
    base.resize(base.size() - 4);
    for (const char *ending : {".img", ".img.gz", ".IMG", ".IMG.gz"})
        if (open_file(base + ending)) return base + ending;
    fail(PLIANT_ERROR_FILE, "%s: its voxels should be in %s.img or %s.img.gz, but neither file exists", path.c_str(),
         base.c_str(), base.c_str());
}

/* Parse the label table of a header extension: <Label Key="5" ...><![CDATA[liver]]></Label> (Caret's XML, written by
 * TotalSegmentator). */
std::vector<pliant_label_segment> named_labels(const std::string &text)
{
    std::vector<pliant_label_segment> labels;
    std::vector<bool> used(UINT16_MAX + 1, false);
    const std::string start = "<Label ", key = "Key=\"", mark = "<![CDATA[", end = "</Label>";
    for (size_t at = text.find(start); at != std::string::npos; at = text.find(start, at + 1)) {
        const size_t head = text.find('>', at), tail = text.find(end, at), number = text.find(key, at);
        std::vector<double> value;
        if (tail == std::string::npos || head > tail || number > head) break;
        const size_t quote = text.find('"', number + key.size());
        if (quote > head ||
            !parse_numbers(text.substr(number + key.size(), quote - number - key.size()), ' ', &value) ||
            value.size() != 1)
            break;
        std::string name = trimmed(text.substr(head + 1, tail - head - 1));
        if (name.compare(0, mark.size(), mark) == 0) name = name.substr(mark.size(), name.find("]]>") - mark.size());
        if (!(value[0] >= 1 && value[0] <= UINT16_MAX) || value[0] != std::floor(value[0]) ||
            used[static_cast<size_t>(value[0])])
            continue;
        used[static_cast<size_t>(value[0])] = true;
        pliant_label_segment one = {};
        one.label = one.value = static_cast<uint16_t>(value[0]);
        one.is_class = 1;
        std::fill(one.color, one.color + 3, -1.0f); /* TotalSegmentator repeats a few colours */
        set_text(name, one.name);
        labels.push_back(one);
    }
    return labels;
}

class nifti_source : public image_source {
public:
    nifti_source(std::string path, uint64_t offset, bool compressed, bool swap)
        : path_(std::move(path)), offset_(offset), compressed_(compressed), swap_(swap)
    {
    }
    void read(void *voxels) override
    {
        if (compressed_) {
            byte_stream stream(path_, 0, byte_stream::packing::deflate);
            stream.skip(offset_, "the header");
            read_voxels(stream, header, swap_, voxels);
        } else {
            byte_stream stream(path_, offset_, byte_stream::packing::none);
            read_voxels(stream, header, swap_, voxels);
        }
    }
    void read_names() override
    {
        const uint64_t longest = 1 << 20;
        byte_stream stream(path_, 0, compressed_ ? byte_stream::packing::deflate : byte_stream::packing::none);
        std::string text(static_cast<size_t>(std::min(offset_, longest)), '\0');
        stream.read_exactly(&text[0], text.size(), "the header");
        segments = named_labels(text);
    }

private:
    std::string path_;
    uint64_t offset_;
    bool compressed_, swap_;
};

} // namespace

bool is_nifti(const std::string &path)
{
    bool swap;
    std::string name = lower_case(path);
    for (const char *ending : {".nii", ".nii.gz", ".hdr", ".hdr.gz"})
        if (ends_with(name, ending)) return true;
    return !is_gzip(path) && version_of(file_start(path, SIZE_2), &swap) > 0;
}

std::unique_ptr<image_source> open_nifti(const std::string &path)
{
    std::string bytes = header_bytes(path);
    bool swap = false;
    int version = version_of(bytes, &swap);
    if (version == -1)
        fail(PLIANT_ERROR_FORMAT,
             "%s: an Analyze 7.5 header or a damaged NIfTI header (no NIfTI magic): its orientation is unknown; "
             "convert it to NIfTI",
             path.c_str());
    size_t header_size = version == 2 ? SIZE_2 : SIZE_1;
    if (version == 0 || bytes.size() < header_size)
        fail(PLIANT_ERROR_FORMAT, "%s: not a NIfTI file, or its header is truncated (%zu bytes)", path.c_str(),
             bytes.size());

    fields header(bytes, version, swap);
    bool one_file = bytes[version == 1 ? 345 : 5] == '+';
    component type = component_of(path, header.get<int16_t>(header.at().datatype));
    grid grid;
    read_grid(path, header, &grid);

    std::string data_path = one_file ? path : image_file(path);
    double offset = header.vox_offset();
    /* Some writers leave 0 in one-file headers. The data then follow the header and its four extension bytes. */
    if (one_file && offset == 0.0) offset = static_cast<double>(header_size + 4);
    if (!(offset >= (one_file ? static_cast<double>(header_size) : 0.0)) || offset > 1e12 ||
        offset != std::floor(offset))
        fail(PLIANT_ERROR_FORMAT, "%s: vox_offset is %g, the voxels cannot begin there", path.c_str(), offset);

    bool compressed = is_gzip(data_path);
    std::unique_ptr<nifti_source> source(new nifti_source(data_path, static_cast<uint64_t>(offset), compressed, swap));
    source->header.geometry = checked_geometry(path, grid);
    source->header.type = type;
    source->header.whole_numbers = component_is_integer(type);
    double slope = header.real(header.at().scl_slope), intercept = header.real(header.at().scl_inter);
    /* By the standard a slope of 0 means no scaling. Some writers use NaN instead. */
    if (slope != 0.0 && std::isfinite(slope) && std::isfinite(intercept)) {
        source->header.slope = slope;
        source->header.intercept = intercept;
    }
    source->header.modality = modality_in(header.descrip());
    double data_bytes = voxel_count(source->header.geometry) * static_cast<double>(component_size(type));
    check_data_fits(data_path, data_bytes + offset, static_cast<double>(file_size(data_path)), compressed);
    return std::unique_ptr<image_source>(source.release());
}

} // namespace pliant_read
