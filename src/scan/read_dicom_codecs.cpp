/* Decompresses JPEG, JPEG-LS and JPEG 2000 images with ITK's GDCM.
 *
 * A failed assertion of GDCM ends its process. Therefore a child process decompresses every image and writes the result
 * to shared memory. If the child ends without a result, the image is refused. */
#include "scan/read_dicom.h"

#include <gdcmImageReader.h>

#include <csignal>
#include <cstring>
#include <fcntl.h>
#include <sstream>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

namespace pliant_read
{

namespace
{

/* A compressed image with its own number of bits. The file's header may store more bits. */
struct coded_image {
    std::string bytes;
    int precision = 0; /* bits of a number */
    bool is_signed = false;
    int bits_allocated() const { return precision <= 8 ? 8 : precision <= 16 ? 16 : 32; }
};

/* The bytes of an image; 0 after its end. */
class big_endian
{
public:
    explicit big_endian(const std::string &bytes) : bytes_(bytes) {}
    uint32_t number(size_t at, size_t count) const
    {
        uint32_t value = 0;
        for (size_t n = at; n < at + count; n++)
            value = value << 8 | (n < bytes_.size() ? static_cast<unsigned char>(bytes_[n]) : 0u);
        return value;
    }

private:
    const std::string &bytes_;
};

[[noreturn]] void damaged(const std::string &path, const dicom_pixels &pixels, const char *what)
{
    fail(PLIANT_ERROR_FORMAT,
         "%s: the compressed pixels are damaged: no %s image of %d x %d numbers of at most %d bits", path.c_str(), what,
         pixels.columns, pixels.rows, pixels.bits_allocated);
}

/* Return whether the image has the end mark of JPEG and JPEG 2000. Decoders fill a missing end with arbitrary data. */
bool has_end(const std::string &image)
{
    size_t end = image.find_last_not_of('\0');
    if (end != std::string::npos && image[end] == '\xff') end--; /* a byte of padding */
    return end != std::string::npos && end > 0 && image[end] == '\xd9' && image[end - 1] == '\xff';
}

/* Return a JPEG or JPEG-LS image with only the necessary segments (ISO 10918-1 annex B), which are checked. */
coded_image bare_jpeg(const std::string &path, const dicom_pixels &pixels, const std::string &image)
{
    const big_endian bytes(image);
    const uint32_t start = 0xffd8, scan = 0xda, frame_jpeg_ls = 0xf7;
    coded_image out;
    out.bytes = image.substr(0, 2);
    size_t at = 2;
    for (bool going = bytes.number(0, 2) == start && has_end(image); going;) {
        while (bytes.number(at, 2) == 0xffff) at++; /* fill */
        const uint32_t marker = bytes.number(at + 1, 1), length = bytes.number(at + 2, 2);
        if (bytes.number(at, 1) != 0xff || length < 2 || at + 2 + length > image.size()) break;
        const bool frame = (marker >= 0xc0 && marker <= 0xc3) || marker == frame_jpeg_ls;
        const bool table = marker == 0xc4 || marker == 0xdb || marker == 0xdd || marker == 0xf8;
        const bool comment = (marker >= 0xe0 && marker <= 0xef) || marker == 0xfe;
        if (frame) {
            const int precision = static_cast<int>(bytes.number(at + 4, 1));
            if (out.precision || length < 11 || precision < 2 || precision > pixels.bits_allocated ||
                static_cast<int>(bytes.number(at + 5, 2)) != pixels.rows ||
                static_cast<int>(bytes.number(at + 7, 2)) != pixels.columns || bytes.number(at + 9, 1) != 1)
                break;
            out.precision = precision;
        } else if (marker == scan) {
            if (!out.precision || bytes.number(at + 4, 1) != 1) break;
            out.bytes += image.substr(at);
            return out;
        } else if (!table && !comment) {
            break;
        }
        if (!comment) out.bytes += image.substr(at, 2 + length);
        at += 2 + length;
    }
    damaged(path, pixels, "JPEG");
}

/* Return the codestream of a JPEG 2000 image, which may be in a file of boxes, and the properties from its first
 * segment (SIZ, ISO 15444-1 A.5.1). */
coded_image bare_jpeg_2000(const std::string &path, const dicom_pixels &pixels, const std::string &image)
{
    coded_image out;
    const size_t begin = image.find("\xff\x4f\xff\x51"), end = image.find_last_not_of('\0');
    if (begin == std::string::npos || !has_end(image)) damaged(path, pixels, "JPEG 2000");
    out.bytes = image.substr(begin, end + 1 - begin);
    const big_endian bytes(out.bytes);
    const uint32_t stored = bytes.number(42, 1);
    out.precision = static_cast<int>(stored & 0x7f) + 1;
    out.is_signed = (stored & 0x80) != 0;
    if (bytes.number(8, 4) - bytes.number(16, 4) != static_cast<uint32_t>(pixels.columns) ||
        bytes.number(12, 4) - bytes.number(20, 4) != static_cast<uint32_t>(pixels.rows) || bytes.number(40, 2) != 1 ||
        bytes.number(43, 2) != 0x0101 || out.precision > pixels.bits_allocated)
        damaged(path, pixels, "JPEG 2000");
    return out;
}

std::string little_endian(uint32_t value, int bytes)
{
    std::string out;
    for (int n = 0; n < bytes; n++) out += static_cast<char>(value >> 8 * n & 0xff);
    return out;
}

std::string element(uint16_t group, uint16_t tag, const char *type, std::string value)
{
    if (value.size() % 2) value += std::strcmp(type, "UI") == 0 ? '\0' : ' ';
    return little_endian(group, 2) + little_endian(tag, 2) + type +
           little_endian(static_cast<uint32_t>(value.size()), 2) + value;
}

/* Create a DICOM file with only the elements needed for decompression, so that other elements cannot interfere. Its
 * header matches the compressed image, as GDCM requires. */
std::string bare_file(const dicom_pixels &pixels, const coded_image &coded)
{
    const char *const ct_image = "1.2.840.10008.5.1.4.1.1.2";
    std::string meta =
        element(2, 2, "UI", ct_image) + element(2, 3, "UI", "1.2.3") + element(2, 0x10, "UI", pixels.transfer_syntax);
    std::string file = std::string(128, '\0') + "DICM" +
                       element(2, 0, "UL", little_endian(static_cast<uint32_t>(meta.size()), 4)) + meta;
    auto number = [](int value) { return little_endian(static_cast<uint32_t>(value), 2); };
    file +=
        element(8, 0x16, "UI", ct_image) + element(8, 0x18, "UI", "1.2.3") + element(0x28, 2, "US", number(1)) +
        element(0x28, 4, "CS", "MONOCHROME2") + element(0x28, 0x10, "US", number(pixels.rows)) +
        element(0x28, 0x11, "US", number(pixels.columns)) + element(0x28, 0x100, "US", number(coded.bits_allocated())) +
        element(0x28, 0x101, "US", number(coded.precision)) + element(0x28, 0x102, "US", number(coded.precision - 1)) +
        element(0x28, 0x103, "US", number(coded.is_signed));
    std::string image = coded.bytes;
    if (image.size() % 2) image += '\0';
    const std::string item("\xfe\xff\x00\xe0", 4);
    return file + little_endian(0x7fe0, 2) + little_endian(0x10, 2) + "OB" + std::string(2, '\0') + "\xff\xff\xff\xff" +
           item + little_endian(0, 4) + item + little_endian(static_cast<uint32_t>(image.size()), 4) + image +
           std::string("\xfe\xff\xdd\xe0", 4) + little_endian(0, 4);
}

/* Decompress; runs in the child process. */
bool decode(const std::string &file, size_t bytes, char *out)
{
    std::istringstream stream(file);
    gdcm::ImageReader reader;
    reader.SetStream(stream);
    return reader.Read() && reader.GetImage().GetBufferLength() == bytes && reader.GetImage().GetBuffer(out);
}

/* Memory shared by this process and child processes started during its lifetime. */
class shared_bytes
{
public:
    explicit shared_bytes(size_t count)
        : count_(count), at_(mmap(nullptr, count, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0))
    {
        if (at_ == MAP_FAILED) throw std::bad_alloc();
    }
    ~shared_bytes() { munmap(at_, count_); }
    shared_bytes(const shared_bytes &) = delete;
    shared_bytes &operator=(const shared_bytes &) = delete;
    char *data() const { return static_cast<char *>(at_); }

private:
    size_t count_;
    void *at_;
};

/* Time limit: a damaged image can keep a decoder busy for ever. */
const unsigned LONGEST_SECONDS = 120;

void end_child(int) { _exit(1); }

/* Decompress a file in a child process. The first byte of `out` is 1 after success. */
void decode_apart(const std::string &path, const std::string &file, size_t bytes, const shared_bytes &out)
{
    const pid_t child = fork();
    if (child < 0)
        fail(PLIANT_ERROR_MEMORY, "%s: no process can be started to decompress it: %s", path.c_str(), strerror(errno));
    if (child == 0) {
        for (int signal_number : {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGALRM})
            std::signal(signal_number, end_child); /* no core file */
        sigset_t none;
        sigemptyset(&none);
        pthread_sigmask(SIG_SETMASK, &none, nullptr); /* the caller's thread may block signals */
        alarm(LONGEST_SECONDS);
        const int nowhere = open("/dev/null", O_WRONLY); /* GDCM and its codecs write to the console */
        dup2(nowhere, STDOUT_FILENO);
        dup2(nowhere, STDERR_FILENO);
        try {
            out.data()[0] = decode(file, bytes, out.data() + 1);
        } catch (...) {
        }
        _exit(0);
    }
    while (waitpid(child, nullptr, 0) < 0 && errno == EINTR) {}
}

template <class From, class To> void widen(const char *from, size_t count, void *to)
{
    for (size_t n = 0; n < count; n++) {
        From value;
        std::memcpy(&value, from + n * sizeof value, sizeof value);
        static_cast<To *>(to)[n] = static_cast<To>(value);
    }
}

/* Convert numbers to the stored width, with sign extension. */
template <class From> void widen_any(const char *from, const dicom_pixels &pixels, void *to)
{
    switch (component_size(pixels.type())) {
    case 1: return widen<From, uint8_t>(from, pixels.count(), to);
    case 2: return widen<From, uint16_t>(from, pixels.count(), to);
    default: return widen<From, uint32_t>(from, pixels.count(), to);
    }
}

} // namespace

void decompress_jpeg(const std::string &path, const dicom_pixels &pixels, const std::string &image, void *out)
{
    const bool is_jpeg_2000 = pixels.transfer_syntax >= "1.2.840.10008.1.2.4.90";
    const coded_image coded = is_jpeg_2000 ? bare_jpeg_2000(path, pixels, image) : bare_jpeg(path, pixels, image);
    const size_t bytes = pixels.count() * static_cast<size_t>(coded.bits_allocated() / 8);
    const shared_bytes numbers(1 + bytes);
    decode_apart(path, bare_file(pixels, coded), bytes, numbers);
    const char *const from = numbers.data() + 1;
    if (numbers.data()[0] != 1) damaged(path, pixels, is_jpeg_2000 ? "JPEG 2000" : "JPEG");
    switch (coded.bits_allocated()) {
    case 8: return coded.is_signed ? widen_any<int8_t>(from, pixels, out) : widen_any<uint8_t>(from, pixels, out);
    case 16: return coded.is_signed ? widen_any<int16_t>(from, pixels, out) : widen_any<uint16_t>(from, pixels, out);
    default: return widen_any<uint32_t>(from, pixels, out);
    }
}

} // namespace pliant_read
