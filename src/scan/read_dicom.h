/* DICOM for the readers: the elements of a file, and one image of a series. */
#ifndef PLIANT_SCAN_READ_DICOM_H
#define PLIANT_SCAN_READ_DICOM_H

#include "scan/read.h"

#include <map>

namespace pliant_read {

/* The top level of a DICOM file up to its pixels, and the functional groups of each frame (PS3.3 C.7.6.16). Every
 * length has been checked against the file. */
struct dicom_file {
    struct part {
        uint64_t offset, length;
    };
    using elements = std::map<uint32_t, std::string>; /* by group << 16 | element; long ones and sequences are empty */
    std::string transfer_syntax;
    uint64_t deflated_from = 0; /* for dicom_bytes */
    elements values;
    elements shared; /* of all frames: the relevant values of their functional groups (position, spacing, scale) */
    std::vector<elements> frames; /* of each frame; empty if the file has no functional groups */
    std::vector<elements> segments; /* items of SegmentSequence, with the meaning of their property type */
    bool has_pixels = false, compressed = false;
    part pixels = {0, 0};         /* not compressed */
    part offset_table = {0, 0};   /* compressed: offsets of the frames, may be empty */
    std::vector<part> fragments;  /* compressed: the fragments after the table */

    bool has(uint32_t tag) const { return values.count(tag) != 0; }
    std::string text(uint32_t tag) const; /* trimmed; "" when missing */
    int whole(uint32_t tag, int otherwise) const; /* value of a 16-bit element */
    /* Return an element as text for a frame (from 0): the frame's value, otherwise the shared value, otherwise the
     * file's value. */
    std::string text_of_frame(size_t frame, uint32_t tag) const;
};

/* The bytes of a DICOM file by offset. A data set can be deflated (PS3.5 A.5); its offsets then count inflated bytes.
 * Reading forward is fast; reading backward inflates from the start. */
class dicom_bytes {
public:
    /* deflated_from: start of the deflated data set; 0: not deflated */
    dicom_bytes(const std::string &path, uint64_t deflated_from) : path_(path), deflated_from_(deflated_from) {}
    const std::string &path() const { return path_; }
    /* Fails with FORMAT if the file is too short; `what` names the bytes in the message. */
    void read(uint64_t offset, void *out, size_t count, const char *what);

private:
    std::string path_;
    uint64_t deflated_from_, at_ = 0;
    std::unique_ptr<byte_stream> stream_;
};

/* Read a file. Return false if it is no DICOM file. Fails if it is truncated or damaged. */
bool read_dicom_file(const std::string &path, dicom_file *out);

/* Properties that determine the values of an image. */
struct dicom_pixels {
    std::string transfer_syntax;
    uint64_t deflated_from = 0; /* for dicom_bytes */
    bool compressed = false;
    std::vector<dicom_file::part> parts; /* one part; compressed: all parts of the image */
    int rows = 0, columns = 0, bits_allocated = 16, bits_stored = 16;
    bool is_signed = false;
    double slope = 1.0, intercept = 0.0;
    bool has_rescale = false; /* the header names an intercept */
    bool has_padding = false;
    int padding_low = 0, padding_high = 0; /* PixelPaddingValue to PixelPaddingRangeLimit, as stored */

    size_t count() const { return static_cast<size_t>(rows) * static_cast<size_t>(columns); }
    component type() const
    {
        if (bits_allocated == 8) return is_signed ? component::int8 : component::uint8;
        if (bits_allocated == 16) return is_signed ? component::int16 : component::uint16;
        if (bits_allocated == 32) return is_signed ? component::int32 : component::uint32;
        return component::none;
    }
};

/* Return the numbers of an element of a frame (from 0), from its functional groups or the file; empty when missing.
 * Fails with FORMAT. */
std::vector<double> numbers_of_frame(const std::string &name, const dicom_file &file, size_t frame, uint32_t tag,
                                     size_t count, const char *what);
/* Return the number of frames, on which header and functional groups must agree. Fails with FORMAT. */
size_t frames_of(const std::string &path, const dicom_file &file);

/* Return the parts of each frame, by their count or by the table of offsets (PS3.5 A.4). Fails with FORMAT. */
std::vector<std::vector<dicom_file::part>> parts_of_frames(const std::string &path, const dicom_file &file,
                                                           size_t frames, size_t frame_bytes);

/* Read rows x columns numbers of type(), without slope and intercept. Fails with FORMAT.
 * @param bytes   Bytes of the file.
 * @param padded  Out: marks padding; empty if the file declares no padding. */
void read_dicom_pixels(dicom_bytes *bytes, const dicom_pixels &pixels, void *out, std::vector<bool> *padded);
/* Decompress one JPEG, JPEG-LS or JPEG 2000 image, including bits above the stored ones. Fails with FORMAT, MEMORY. */
void decompress_jpeg(const std::string &path, const dicom_pixels &pixels, const std::string &image, void *out);

/* Return the reason why pixels of a transfer syntax cannot be decompressed, with the remedy; "" if they can. */
std::string unsupported_compression(const std::string &transfer_syntax);
/* Return the description of an object without a readable image, by its SOP class, with the remedy; "" for all other
 * classes. */
std::string unsupported_object(const std::string &sop_class);

/* Return whether a SOP class is a segmentation: SEG or label map segmentation. */
bool is_segmentation_object(const std::string &sop_class);
/* Create the reader of a DICOM segmentation. Fails with FORMAT. */
std::unique_ptr<image_source> open_dicom_segments(const std::string &path, const dicom_file &file);

/* One image: a file, or a frame of a file. */
struct dicom_slice {
    std::string path, name;                    /* path of the file; name for messages, with the frame */
    std::string series, description, instance; /* UIDs of series and image, SeriesDescription */
    pliant_modality modality = PLIANT_MODALITY_UNKNOWN;
    bool inverted = false;                     /* low values are bright, and their unit permits inverting them */
    dicom_pixels pixels;
    std::vector<double> position;              /* 3, LPS [mm]; empty when missing */
    std::vector<double> orientation;           /* 6: direction of rows, and of columns */
    std::vector<double> spacing;               /* 2: between rows, between columns [mm] */
    std::string problem;                       /* reason why it cannot be read; used only if its series is chosen */
    bool is_picture = false;                   /* the problem: a colour image or a film, which is no slice of a stack */
    bool is_scout = false;                     /* ImageType says LOCALIZER */
    double along = 0.0;                        /* position along the normal [mm] */
};

/* Create a regular grid from the images of one series, in any order. */
std::unique_ptr<image_source> open_series(const std::string &folder, std::vector<dicom_slice> slices);

} // namespace pliant_read

#endif
