/* Names of DICOM objects and compressions that are not supported, with remedies. */
#include "scan/read_dicom.h"

namespace pliant_read
{

namespace
{

const char *const UID_ROOT = "1.2.840.10008.";

struct named {
    const char *uid; /* behind the root */
    const char *what;
};

std::string name_in(const std::string &uid, const named *list, size_t count)
{
    for (size_t n = 0; n < count; n++)
        if (uid == UID_ROOT + std::string(list[n].uid)) return list[n].what;
    return "";
}

const named unsupported_syntaxes[] = {{"1.2.4.54", "JPEG, arithmetic coding"},
                                  {"1.2.4.56", "JPEG, arithmetic coding"},
                                  {"1.2.4.58", "JPEG, lossless process 15"},
                                  {"1.2.4.94", "JPIP, pixels on a server"},
                                  {"1.2.4.95", "JPIP, pixels on a server"},
                                  {"1.2.4.204", "JPIP, pixels on a server"},
                                  {"1.2.4.205", "JPIP, pixels on a server"},
                                  {"1.2.4.100", "MPEG-2 video"},
                                  {"1.2.4.100.1", "MPEG-2 video"},
                                  {"1.2.4.101", "MPEG-2 video"},
                                  {"1.2.4.101.1", "MPEG-2 video"},
                                  {"1.2.4.102", "MPEG-4 video"},
                                  {"1.2.4.102.1", "MPEG-4 video"},
                                  {"1.2.4.103", "MPEG-4 video"},
                                  {"1.2.4.103.1", "MPEG-4 video"},
                                  {"1.2.4.104", "MPEG-4 video"},
                                  {"1.2.4.104.1", "MPEG-4 video"},
                                  {"1.2.4.105", "MPEG-4 video"},
                                  {"1.2.4.105.1", "MPEG-4 video"},
                                  {"1.2.4.106", "MPEG-4 video"},
                                  {"1.2.4.106.1", "MPEG-4 video"},
                                  {"1.2.4.107", "HEVC video"},
                                  {"1.2.4.108", "HEVC video"},
                                  {"1.2.4.110", "JPEG XL"},
                                  {"1.2.4.111", "JPEG XL"},
                                  {"1.2.4.112", "JPEG XL"},
                                  {"1.2.4.201", "HTJ2K, high-throughput JPEG 2000"},
                                  {"1.2.4.202", "HTJ2K, high-throughput JPEG 2000"},
                                  {"1.2.4.203", "HTJ2K, high-throughput JPEG 2000"},
                                  {"1.2.8.1", "frames that are deflated"}};

const char *const read_syntaxes[] = {"1.2.5",    "1.2.4.50", "1.2.4.51", "1.2.4.52", "1.2.4.53",
                                     "1.2.4.55", "1.2.4.57", "1.2.4.70", "1.2.4.80", "1.2.4.81",
                                     "1.2.4.90", "1.2.4.91", "1.2.4.92", "1.2.4.93"};

struct object {
    const char *uid; /* behind the root */
    const char *what, *remedy;
};

const char *const EXPORT =
    "is not supported: export it as NIfTI or NRRD on the grid of its scan (3D Slicer does, for example)";
const char *const AS_LABELS =
    "is no scan: give it as material/labels, with the scan on which it was drawn, or export it as NIfTI or NRRD";
const char *const CONTOURS =
    "is not supported: load it with its CT in 3D Slicer (extension SlicerRT) and save the segmentation as .seg.nrrd, "
    "or run plastimatch convert --input RTSTRUCT --referenced-ct CT_FOLDER --output-labelmap labels.nrrd";

const object no_images[] = {{"5.1.4.1.1.66.4", "a DICOM segmentation (SEG)", AS_LABELS},
                            {"5.1.4.1.1.66.7", "a DICOM label map segmentation (SEG)", AS_LABELS},
                            {"5.1.4.1.1.66.5", "a DICOM surface segmentation", EXPORT},
                            {"5.1.4.1.1.481.3", "a DICOM RT structure set (RTSTRUCT: contours, not voxels)", CONTOURS},
                            {"5.1.4.1.1.66.1", "a DICOM spatial registration (REG)", EXPORT},
                            {"5.1.4.1.1.104.1", "a PDF document in DICOM", EXPORT}};

} // namespace

std::string unsupported_compression(const std::string &transfer_syntax)
{
    for (const char *uid : read_syntaxes)
        if (transfer_syntax == UID_ROOT + std::string(uid)) return "";
    std::string name =
        name_in(transfer_syntax, unsupported_syntaxes, sizeof unsupported_syntaxes / sizeof *unsupported_syntaxes);
    if (name.empty()) name = "no known compression: TransferSyntaxUID is missing or wrong";
    return "compressed pixels of transfer syntax " + transfer_syntax + " (" + name +
           ") are not supported; decompress the series first (gdcmconv --raw, dcmdjpeg or pydicom), or convert it to "
           "NIfTI";
}

std::string unsupported_object(const std::string &sop_class)
{
    for (const object &one : no_images)
        if (sop_class == UID_ROOT + std::string(one.uid)) return std::string(one.what) + ", which " + one.remedy;
    return "";
}

bool is_segmentation_object(const std::string &sop_class)
{
    return sop_class == UID_ROOT + std::string("5.1.4.1.1.66.4") ||
           sop_class == UID_ROOT + std::string("5.1.4.1.1.66.7");
}

} // namespace pliant_read
