/* The header of a NRRD file. */
#ifndef PLIANT_SCAN_READ_NRRD_H
#define PLIANT_SCAN_READ_NRRD_H

#include "scan/read.h"

#include <map>

namespace pliant_read {

struct nrrd_header {
    std::string path;
    /* By name in lower case, without blanks: "space origin" is "spaceorigin". */
    std::map<std::string, std::string> fields;
    std::map<std::string, std::string> pairs;  /* "key:=value" lines, by key in lower case */
    uint64_t bytes = 0;                        /* start of attached data */

    std::string text(const std::string &name) const;
    bool has(const std::string &name) const { return !text(name).empty(); }
    std::string pair(const std::string &key) const; /* "" when missing */
    /* Return `count` numbers; an axis without a number has nan. */
    std::vector<double> numbers(const std::string &name, size_t count) const;
    double whole(const std::string &name, double otherwise) const;
};

/* Read the header. Fails with FORMAT. */
nrrd_header read_nrrd_header(const std::string &path);

/* Position of the voxels of a NRRD file. */
struct nrrd_data {
    std::string path;
    uint64_t offset = 0, skip = 0; /* offset in the file; skipped bytes of the data, after decompression */
    bool compressed = false, swap = false;

    std::unique_ptr<byte_stream> open() const;
};

/* The axis of a segmentation's layers. The file contains `below` voxels of a layer, then as many of the next layer. */
struct nrrd_layers {
    size_t count = 1, below = 1;
};

/* Return whether a header describes segments (3D Slicer's .seg.nrrd). */
bool has_segments(const nrrd_header &header);
/* Create the reader of such a file. Fails with FORMAT. */
std::unique_ptr<image_source> open_nrrd_segments(const nrrd_header &header, const nrrd_data &data, component type,
                                                 const pliant_geometry &geometry, const nrrd_layers &layers);

} // namespace pliant_read

#endif
