/* Structure of the readers. Every format has an opener that reads only the header and checks it against the file.
 * read.cpp checks the memory, reads the voxels through the opener's result, and converts them. Internally, errors are
 * thrown as failures; no exception crosses the C boundary. */
#ifndef PLIANT_SCAN_READ_H
#define PLIANT_SCAN_READ_H

#include "base/fail.h"
#include "pliant/scan.h"

#include <fstream>
#include <memory>
#include <string>
#include <vector>

namespace pliant_read {

/* Thrown internally, and reported by pliant_fail at the boundary. */
struct failure {
    pliant_status status;
    std::string text;
};
[[noreturn]] void fail(pliant_status status, const char *format, ...) PLIANT_PRINTF(2, 3);

/* Type of a number in a file. */
enum class component { none, uint8, int8, uint16, int16, uint32, int32, uint64, int64, float32, float64 };
inline size_t component_size(component type)
{
    switch (type) {
    case component::none: return 0;
    case component::uint8:
    case component::int8: return 1;
    case component::uint16:
    case component::int16: return 2;
    case component::uint32:
    case component::int32:
    case component::float32: return 4;
    case component::uint64:
    case component::int64:
    case component::float64: return 8;
    }
    return 0;
}
bool component_is_integer(component type);

struct image_header {
    pliant_geometry geometry = {};
    component type = component::none; /* type of the voxels from read() */
    bool whole_numbers = false;       /* the file stores integers, even if read() returns another type */
    double slope = 1.0, intercept = 0.0; /* value = slope * stored + intercept */
    pliant_modality modality = PLIANT_MODALITY_UNKNOWN;
};

/* A file or folder whose header has been read and checked. */
class image_source {
public:
    image_header header;
    std::vector<pliant_label_segment> segments; /* of a segmentation, whose voxels are their labels; empty for a scan */
    virtual ~image_source() = default;
    /* Read every voxel, i fastest, as header.type in the byte order of this machine. The voxels must be zero before. */
    virtual void read(void *voxels) = 0;
    /* Fill segments of a label map whose labels have names. */
    virtual void read_names() {}
};

/* Return the modality for a header's word: "CT", "MR", "PT". Other words are unknown. */
pliant_modality modality_of(const std::string &word);

/* The grid of a header; millimetres, LPS. */
struct grid {
    std::vector<int64_t> size;      /* one entry per dimension of the file */
    double spacing[3] = {1.0, 1.0, 1.0};
    double origin[3] = {0.0, 0.0, 0.0};
    double direction[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}; /* row-major, columns are the axes */
};
/* Check that the grid is a regular 3-D grid, correct rounding errors of the direction, and convert to metres. A size
 * may be 1. */
pliant_geometry checked_geometry(const std::string &path, const grid &grid);
/* Return the number of voxels; a double, since a malicious header may have more than an integer can hold. */
double voxel_count(const pliant_geometry &geometry);

/* The bytes of a file, decompressed if necessary. */
class byte_stream {
public:
    /* deflate: gzip or zlib, by the first bytes; raw_deflate: without a header */
    enum class packing { none, deflate, raw_deflate };
    byte_stream(const std::string &path, uint64_t offset, packing how);
    ~byte_stream();
    byte_stream(const byte_stream &) = delete;
    byte_stream &operator=(const byte_stream &) = delete;

    /* Return the number of bytes read; it is less than `wanted` only at the end of the data. Damaged compression
     * fails. */
    size_t read(void *buffer, size_t wanted);
    /* Fails if the data ends early; `what` names the data in the message. */
    void read_exactly(void *buffer, size_t wanted, const char *what);
    void skip(uint64_t bytes, const char *what);
    /* Check the checksum of compressed data, after the last voxel. */
    void finish();

private:
    struct inflater;
    std::string path_;
    std::ifstream file_;
    std::unique_ptr<inflater> inflater_; /* null: not compressed */
    size_t inflate_some(unsigned char *buffer, size_t wanted);
};

/* These functions open every file and query its size. They fail if it may not be read (pliant/open.h). */
/* Return the length of a byte order mark, which some editors write before text. */
inline size_t mark_of(const std::string &bytes) { return bytes.compare(0, 3, "\xEF\xBB\xBF") == 0 ? 3 : 0; }
std::ifstream open_file(const std::string &path); /* not good() if the file is missing */
uint64_t file_size(const std::string &path);
bool is_folder(const std::string &path);
/* Return the names in a folder in alphabetical order, without hidden ones. */
std::vector<std::string> names_in(const std::string &folder);
/* Return the first bytes of a file, or all if it is shorter. */
std::string file_start(const std::string &path, size_t bytes);
std::string folder_of(const std::string &path); /* including the slash; "" without a folder */
std::string lower_case(std::string text);
bool ends_with(const std::string &text, const std::string &ending);
std::string trimmed(const std::string &text);
/* Read numbers between separators, independent of the process's locale. Return false if an item is not a finite
 * number. */
bool parse_numbers(const std::string &text, char separator, std::vector<double> *out);

/* Fails if `bytes` of data cannot be in a file of this size, compressed or not. */
void check_data_fits(const std::string &path, double bytes, double bytes_in_file, bool compressed);
bool machine_is_big_endian();
/* Read the data of a header: decompressed, of exactly the grid's size, in the byte order of this machine. */
void read_voxels(byte_stream &stream, const image_header &header, bool swap_bytes, void *voxels);

/* The openers. They fail with FILE or FORMAT. */
std::unique_ptr<image_source> open_nifti(const std::string &path);
std::unique_ptr<image_source> open_metaimage(const std::string &path);
std::unique_ptr<image_source> open_nrrd(const std::string &path);
std::unique_ptr<image_source> open_dicom_folder(const std::string &path, const char *series);
std::unique_ptr<image_source> open_dicom_file(const std::string &path); /* with several frames */
/* Open a NIfTI, MetaImage or NRRD file; NULL: another format. */
std::unique_ptr<image_source> open_image_file(const std::string &path);
/* Open a folder with one mask per segment; NULL if no image in it can be a mask. Where masks overlap the later name
 * wins. */
std::unique_ptr<image_source> open_masks(const std::string &folder);
/* Open labels in the same way: a DICOM segmentation if there is one. */
std::unique_ptr<image_source> open_dicom_label_folder(const std::string &path);
std::unique_ptr<image_source> open_dicom_label_file(const std::string &path);
bool is_nifti(const std::string &path);
bool is_dicom_file(const std::string &path);

/* Voxels after conversion; free them with pliant_free. */
struct converted {
    pliant_encoding encoding;
    float background;
    void *voxels;
};
/* Return the maximum additional bytes per voxel during the conversion. */
double conversion_bytes(const image_header &header, bool labels);
/* Convert the voxels. The function takes ownership of *voxels (set to NULL), also after a failure. It fails with FORMAT
 * (not finite, out of range) or MEMORY. */
converted convert_values(const std::string &path, const image_header &header, void **voxels);
uint16_t *convert_labels(const std::string &path, const image_header &header, void **voxels);

} // namespace pliant_read

#endif
