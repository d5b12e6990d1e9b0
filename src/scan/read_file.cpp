/* Files, compressed or not, and checks shared by all formats. */
#include "scan/read.h"

#include "base/open.h"

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <dirent.h>
#include <locale>
#include <sstream>
#include <sys/stat.h>
#include <zlib.h>

namespace pliant_read {

void fail(pliant_status status, const char *format, ...)
{
    char text[1800];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    throw failure{status, text};
}

namespace {

/* A path that may be read during the lifetime of this object. */
class opening {
public:
    explicit opening(const std::string &path) : is_opened_(pliant_opening_begin(path.c_str(), &opening_))
    {
        if (opening_.refused) fail(PLIANT_ERROR_FILE, "%s: may not be read: %s", path.c_str(), opening_.refused);
    }
    ~opening() { pliant_opening_end(&opening_); }
    opening(const opening &) = delete;
    opening &operator=(const opening &) = delete;
    /* Null: the file is missing, see errno. */
    const char *name() const { return is_opened_ ? opening_.name : nullptr; }

private:
    pliant_opening opening_;
    bool is_opened_;
};

} // namespace

std::ifstream open_file(const std::string &path)
{
    opening open(path);
    std::ifstream file;
    if (open.name()) file.open(open.name(), std::ios::binary);
    else file.setstate(std::ios::failbit);
    return file;
}

uint64_t file_size(const std::string &path)
{
    struct stat status;
    opening open(path);
    if (!open.name() || stat(open.name(), &status) != 0)
        fail(PLIANT_ERROR_FILE, "%s: %s", path.c_str(), strerror(errno));
    return static_cast<uint64_t>(status.st_size);
}

bool is_folder(const std::string &path)
{
    struct stat status;
    opening open(path);
    return open.name() && stat(open.name(), &status) == 0 && S_ISDIR(status.st_mode);
}

std::vector<std::string> names_in(const std::string &folder)
{
    opening open(folder);
    DIR *directory = open.name() ? opendir(open.name()) : nullptr;
    if (!directory) fail(PLIANT_ERROR_FILE, "%s: the folder cannot be read: %s", folder.c_str(), strerror(errno));
    std::vector<std::string> names;
    while (const dirent *entry = readdir(directory))
        if (entry->d_name[0] != '.') names.push_back(entry->d_name);
    closedir(directory);
    std::sort(names.begin(), names.end()); /* a folder's order differs between machines */
    return names;
}

std::string file_start(const std::string &path, size_t bytes)
{
    std::ifstream file = open_file(path);
    if (!file) fail(PLIANT_ERROR_FILE, "%s: cannot be opened: %s", path.c_str(), strerror(errno));
    std::string start(bytes, '\0');
    file.read(&start[0], static_cast<std::streamsize>(bytes));
    start.resize(static_cast<size_t>(file.gcount()));
    return start;
}

std::string folder_of(const std::string &path)
{
    size_t slash = path.rfind('/');
    return slash == std::string::npos ? "" : path.substr(0, slash + 1);
}

std::string lower_case(std::string text)
{
    std::transform(text.begin(), text.end(), text.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return text;
}

bool ends_with(const std::string &text, const std::string &ending)
{
    return text.size() >= ending.size() && text.compare(text.size() - ending.size(), ending.size(), ending) == 0;
}

std::string trimmed(const std::string &text)
{
    const std::string blank(" \t\r\n\0", 5); /* DICOM also pads with zero bytes */
    size_t first = text.find_first_not_of(blank), last = text.find_last_not_of(blank);
    return first == std::string::npos ? "" : text.substr(first, last - first + 1);
}

bool parse_numbers(const std::string &text, char separator, std::vector<double> *out)
{
    std::istringstream words(text);
    out->clear();
    for (std::string word; std::getline(words, word, separator);) {
        word = trimmed(word);
        if (word.empty() && separator == ' ') continue;
        std::istringstream stream(word);
        stream.imbue(std::locale::classic());
        double number;
        if (!(stream >> number) || stream.peek() != std::istringstream::traits_type::eof() || !std::isfinite(number))
            return false;
        out->push_back(number);
    }
    return true;
}

/* --- byte_stream --- */

struct byte_stream::inflater {
    z_stream stream = {};
    std::vector<unsigned char> input = std::vector<unsigned char>(1 << 16);
    bool ended = false; /* end of the data, with correct checksum */
    bool is_raw = false;
    ~inflater() { inflateEnd(&stream); }
};

byte_stream::byte_stream(const std::string &path, uint64_t offset, packing how) : path_(path), file_(open_file(path))
{
    if (!file_) fail(PLIANT_ERROR_FILE, "%s: cannot be opened: %s", path.c_str(), strerror(errno));
    file_.seekg(static_cast<std::streamoff>(offset));
    if (how == packing::none) return;
    inflater_.reset(new inflater);
    const int gzip_or_zlib = 32;
    inflater_->is_raw = how == packing::raw_deflate;
    if (inflateInit2(&inflater_->stream, inflater_->is_raw ? -MAX_WBITS : MAX_WBITS + gzip_or_zlib) != Z_OK)
        fail(PLIANT_ERROR_MEMORY, "%s: out of memory for decompression", path.c_str());
}

byte_stream::~byte_stream() = default;

size_t byte_stream::inflate_some(unsigned char *buffer, size_t wanted)
{
    z_stream &stream = inflater_->stream;
    size_t got = 0;
    while (got < wanted && !inflater_->ended) {
        if (stream.avail_in == 0) {
            file_.read(reinterpret_cast<char *>(inflater_->input.data()),
                       static_cast<std::streamsize>(inflater_->input.size()));
            stream.next_in = inflater_->input.data();
            stream.avail_in = static_cast<uInt>(file_.gcount());
            if (stream.avail_in == 0) break;
        }
        uInt capacity = static_cast<uInt>(std::min(wanted - got, size_t(1) << 30));
        stream.next_out = buffer + got;
        stream.avail_out = capacity;
        int result = inflate(&stream, Z_NO_FLUSH);
        got += capacity - stream.avail_out;
        if (result == Z_STREAM_END) {
            /* A gzip file may continue with another member; other trailing bytes are ignored. */
            if (stream.avail_in == 0 && file_.peek() != std::ifstream::traits_type::eof()) {
                file_.read(reinterpret_cast<char *>(inflater_->input.data()),
                           static_cast<std::streamsize>(inflater_->input.size()));
                stream.next_in = inflater_->input.data();
                stream.avail_in = static_cast<uInt>(file_.gcount());
            }
            if (!inflater_->is_raw && stream.avail_in > 0 && stream.next_in[0] == 0x1f) inflateReset(&stream);
            else inflater_->ended = true;
        } else if (result != Z_OK && result != Z_BUF_ERROR) {
            fail(PLIANT_ERROR_FORMAT, "%s: the compressed data are damaged (%s)", path_.c_str(),
                 stream.msg ? stream.msg : "zlib");
        }
    }
    return got;
}

size_t byte_stream::read(void *buffer, size_t wanted)
{
    if (inflater_) return inflate_some(static_cast<unsigned char *>(buffer), wanted);
    file_.read(static_cast<char *>(buffer), static_cast<std::streamsize>(wanted));
    return static_cast<size_t>(file_.gcount());
}

void byte_stream::read_exactly(void *buffer, size_t wanted, const char *what)
{
    size_t got = read(buffer, wanted);
    if (got < wanted)
        fail(PLIANT_ERROR_FORMAT, "%s: truncated: %s needs %zu bytes, the file has %zu", path_.c_str(), what, wanted,
             got);
}

void byte_stream::skip(uint64_t bytes, const char *what)
{
    std::vector<char> block(1 << 16);
    while (bytes > 0) {
        size_t next = static_cast<size_t>(std::min<uint64_t>(bytes, block.size()));
        read_exactly(block.data(), next, what);
        bytes -= next;
    }
}

void byte_stream::finish()
{
    if (!inflater_) return;
    unsigned char more[64];
    read(more, sizeof more);
    if (!inflater_->ended && file_.eof() && inflater_->stream.avail_in == 0)
        fail(PLIANT_ERROR_FORMAT, "%s: truncated: the compressed data end before their checksum", path_.c_str());
}

pliant_modality modality_of(const std::string &word)
{
    std::string name = lower_case(trimmed(word));
    if (name.compare(0, 8, "met_mod_") == 0) name.erase(0, 8);
    if (name.empty() || name == "ot" || name == "other" || name == "unknown") return PLIANT_MODALITY_UNKNOWN;
    if (name == "ct") return PLIANT_MODALITY_CT;
    return name.find("mr") != std::string::npos ? PLIANT_MODALITY_MR : PLIANT_MODALITY_OTHER; /* dwmri, too */
}

/* --- checks --- */

void check_data_fits(const std::string &path, double bytes, double bytes_in_file, bool compressed)
{
    /* The maximum compression ratio of deflate is 1032. */
    if (compressed ? bytes > 1032.0 * bytes_in_file : bytes > bytes_in_file)
        fail(PLIANT_ERROR_FORMAT,
             "%s: truncated, or its header is wrong: %.0f bytes of voxels cannot be in the %.0f bytes%s that there are",
             path.c_str(), bytes, std::fmax(bytes_in_file, 0.0), compressed ? " (compressed)" : "");
}

bool machine_is_big_endian()
{
    const uint16_t one = 1;
    return *reinterpret_cast<const unsigned char *>(&one) == 0;
}

void read_voxels(byte_stream &stream, const image_header &header, bool swap_bytes, void *voxels)
{
    size_t size = component_size(header.type), bytes = pliant_geometry_voxels(&header.geometry) * size;
    stream.read_exactly(voxels, bytes, "the voxel data");
    stream.finish();
    if (!swap_bytes || size == 1) return;
    unsigned char *v = static_cast<unsigned char *>(voxels);
    for (size_t i = 0; i < bytes; i += size) std::reverse(v + i, v + i + size);
}

namespace {

void check_sizes(const std::string &path, const std::vector<int64_t> &size)
{
    std::string text;
    for (size_t d = 0; d < size.size(); d++) text += (d ? " x " : "") + std::to_string(size[d]);
    for (int64_t n : size)
        if (n < 1) fail(PLIANT_ERROR_FORMAT, "%s: size %s: every size must be at least 1", path.c_str(), text.c_str());
    for (size_t d = 3; d < size.size(); d++)
        if (size[d] > 1)
            fail(
                PLIANT_ERROR_FORMAT,
                "%s: %zu dimensions (%s), one 3-D volume is needed: write one time point or channel to a separate file",
                path.c_str(), size.size(), text.c_str());
    if (size.size() < 3)
        fail(PLIANT_ERROR_FORMAT, "%s: a 2-D image (%s), a 3-D volume is needed", path.c_str(), text.c_str());
    for (size_t d = 0; d < 3; d++)
        if (size[d] > INT32_MAX)
            fail(PLIANT_ERROR_FORMAT, "%s: size %s: at most %d along an axis", path.c_str(), text.c_str(), INT32_MAX);
}

/* Return the orthonormality error of the columns: largest entry of D'D - I. */
double orthonormal_error(const double d[9])
{
    double error = 0.0;
    for (int a = 0; a < 3; a++)
        for (int b = a; b < 3; b++) {
            double difference = std::fabs(d[a] * d[b] + d[3 + a] * d[3 + b] + d[6 + a] * d[6 + b] - (a == b));
            if (!(difference <= error)) error = difference; /* also takes NaN over */
        }
    return error;
}

/* Compute the nearest orthonormal matrix by Newton's iteration D <- D (3 - D'D) / 2 (N. Higham, Computing the polar
 * decomposition, 1986). Three steps reduce an error of 1e-2 below rounding. */
void repair_rounding(double d[9])
{
    for (int step = 0; step < 4; step++) {
        double gram[9], next[9];
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++) gram[3 * a + b] = d[a] * d[b] + d[3 + a] * d[3 + b] + d[6 + a] * d[6 + b];
        for (int row = 0; row < 3; row++)
            for (int b = 0; b < 3; b++) {
                double product = d[3 * row] * gram[b] + d[3 * row + 1] * gram[3 + b] + d[3 * row + 2] * gram[6 + b];
                next[3 * row + b] = 1.5 * d[3 * row + b] - 0.5 * product;
            }
        std::copy(next, next + 9, d);
    }
}

} // namespace

pliant_geometry checked_geometry(const std::string &path, const grid &grid)
{
    const double metres_per_millimetre = 1e-3;
    check_sizes(path, grid.size);
    pliant_geometry geometry = {};
    for (int d = 0; d < 3; d++) {
        if (!(grid.spacing[d] > 0.0) || !std::isfinite(grid.spacing[d]))
            fail(PLIANT_ERROR_FORMAT, "%s: voxel spacing %g x %g x %g mm: every spacing must be above 0", path.c_str(),
                 grid.spacing[0], grid.spacing[1], grid.spacing[2]);
        if (!std::isfinite(grid.origin[d])) fail(PLIANT_ERROR_FORMAT, "%s: the origin is not finite", path.c_str());
        geometry.size[d] = static_cast<int32_t>(grid.size[static_cast<size_t>(d)]);
        geometry.spacing[d] = grid.spacing[d] * metres_per_millimetre;
        geometry.origin[d] = grid.origin[d] * metres_per_millimetre;
    }
    std::copy(grid.direction, grid.direction + 9, geometry.direction);
    double error = orthonormal_error(geometry.direction);
    if (!(error <= 2e-3))
        fail(PLIANT_ERROR_FORMAT,
             "%s: the direction cosines are not orthonormal (off by %.3g): the grid is sheared or the header is wrong; "
             "resample it to a grid with right angles first",
             path.c_str(), error);
    if (error > 1e-12) repair_rounding(geometry.direction);
    return geometry;
}

double voxel_count(const pliant_geometry &geometry)
{
    return static_cast<double>(geometry.size[0]) * geometry.size[1] * geometry.size[2];
}

} // namespace pliant_read
