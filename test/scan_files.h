/* Synthetic scan files, so that the readers are tested against the formats and not against the writers. */
#ifndef PLIANT_TEST_SCAN_FILES_H
#define PLIANT_TEST_SCAN_FILES_H

#include "base/memory.h"
#include "pliant/pliant.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <dirent.h>
#include <fstream>
#include <map>
#include <string>
#include <sys/stat.h>
#include <unistd.h>
#include <vector>
#include <zlib.h>

/* A temporary folder, removed with its files. */
class temporary_folder {
public:
    temporary_folder()
    {
        char name[] = "/tmp/pliant-test-XXXXXX";
        path_ = mkdtemp(name);
    }
    ~temporary_folder() { remove_folder(path_); }
    temporary_folder(const temporary_folder &) = delete;
    temporary_folder &operator=(const temporary_folder &) = delete;
    std::string operator/(const std::string &name) const { return path_ + "/" + name; }
    const std::string &path() const { return path_; }
    std::vector<std::string> names() const { return names_in(path_); }

private:
    std::string path_;
    static std::vector<std::string> names_in(const std::string &folder)
    {
        std::vector<std::string> names;
        DIR *directory = opendir(folder.c_str());
        while (directory) {
            const dirent *entry = readdir(directory);
            if (!entry) break;
            std::string name = entry->d_name;
            if (name != "." && name != "..") names.push_back(name);
        }
        if (directory) closedir(directory);
        return names;
    }
    static void remove_folder(const std::string &folder)
    {
        for (const std::string &name : names_in(folder)) {
            std::string path = folder + "/" + name;
            if (unlink(path.c_str()) != 0) remove_folder(path);
        }
        rmdir(folder.c_str());
    }
};

inline void save(const std::string &path, const std::string &bytes)
{
    unlink(path.c_str()); /* some file systems flush an overwritten file to disk */
    std::ofstream(path, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

inline std::string load(const std::string &path)
{
    std::ifstream file(path, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
}

template <class T> std::string bytes_of(const std::vector<T> &values)
{
    return std::string(reinterpret_cast<const char *>(values.data()), values.size() * sizeof(T));
}

/* A NIfTI-1 file, little-endian, header and data in one file. */
struct nifti_file {
    std::vector<int16_t> dim = {3, 4, 3, 2};
    int16_t datatype = 4, bitpix = 16, qform_code = 0, sform_code = 1;
    std::vector<float> pixdim = {1, 1, 1, 1, 1, 1, 1, 1};
    float vox_offset = 352, slope = 1, intercept = 0;
    char units = 2;
    std::string descrip;
    std::vector<float> quatern_and_offset = {0, 0, 0, 0, 0, 0};
    std::vector<float> srow = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    std::string data = std::string(4 * 3 * 2 * 2, '\0');

    std::string bytes() const
    {
        std::string header(352, '\0');
        put(&header, 0, std::vector<int32_t>{348});
        put(&header, 40, dim);
        put(&header, 70, std::vector<int16_t>{datatype, bitpix});
        put(&header, 76, pixdim);
        put(&header, 108, std::vector<float>{vox_offset, slope, intercept});
        header[123] = units;
        header.replace(148, descrip.size(), descrip);
        put(&header, 252, std::vector<int16_t>{qform_code, sform_code});
        put(&header, 256, quatern_and_offset);
        put(&header, 280, srow);
        header.replace(344, 4, std::string("n+1\0", 4));
        return header + data;
    }
    template <class T> static void put(std::string *header, size_t at, const std::vector<T> &values)
    {
        header->replace(at, values.size() * sizeof(T), bytes_of(values));
    }
};

/* One image of a DICOM series: little-endian, explicit VR by default, 16 bit. An element with empty text is left
 * out. */
struct dicom_file {
    std::string syntax = "1.2.840.10008.1.2.1", object = "1.2.840.10008.5.1.4.1.1.2", image_type;
    std::string series = "1.2.3.1", description = "abdomen", instance = "1.2.3.4.1";
    std::string position = "-10\\-20\\30", orientation = "1\\0\\0\\0\\1\\0", spacing = "0.5\\0.75";
    std::string slope = "1", intercept = "-1024", photometric = "MONOCHROME2", frames, modality = "CT";
    std::string padding, padding_limit; /* bytes: number(...) */
    std::string code;                   /* compressed pixels, in one fragment */
    uint16_t rows = 3, columns = 4, samples = 1, bits_allocated = 16, bits_stored = 16, is_signed = 0,
             pixel_element = 0x10;
    bool has_types = true, has_preamble = true,
         has_meta = true; /* explicit VR; 128 bytes and DICM; the file meta group */
    std::vector<uint16_t> pixels = std::vector<uint16_t>(12, 1000);

    std::string bytes() const
    {
        std::string meta = (syntax.empty() ? "" : element(2, 0x10, "UI", syntax)) + element(2, 0x12, "UI", "1.2.3");
        std::string out = has_preamble ? std::string(128, '\0') + "DICM" : "";
        if (has_meta) out += element(2, 0, "UL", bytes_of(std::vector<uint32_t>{uint32_t(meta.size())})) + meta;
        auto add = [&](uint16_t group, uint16_t tag, const std::string &type, const std::string &value) {
            if (!value.empty()) out += has_types ? element(group, tag, type, value) : element(group, tag, "", value);
        };
        add(8, 8, "CS", image_type);
        add(8, 0x16, "UI", object);
        add(8, 0x18, "UI", instance);
        add(8, 0x60, "CS", modality);
        add(8, 0x103e, "LO", description);
        add(0x18, 0x50, "DS", "7.0");
        add(0x20, 0xe, "UI", series);
        add(0x20, 0x32, "DS", position);
        add(0x20, 0x37, "DS", orientation);
        add(0x28, 2, "US", number(samples));
        add(0x28, 4, "CS", photometric);
        add(0x28, 8, "IS", frames);
        add(0x28, 0x10, "US", number(rows));
        add(0x28, 0x11, "US", number(columns));
        add(0x28, 0x30, "DS", spacing);
        add(0x28, 0x100, "US", number(bits_allocated));
        add(0x28, 0x101, "US", number(bits_stored));
        add(0x28, 0x102, "US", number(uint16_t(bits_stored - 1)));
        add(0x28, 0x103, "US", number(is_signed));
        add(0x28, 0x120, "US", padding);
        add(0x28, 0x121, "US", padding_limit);
        add(0x28, 0x1052, "DS", intercept);
        add(0x28, 0x1053, "DS", slope);
        if (!code.empty()) return out + encapsulated();
        add(0x7fe0, pixel_element, "OW", bytes_of(pixels));
        return out;
    }
    static std::string number(uint16_t value) { return bytes_of(std::vector<uint16_t>{value}); }
    /* type "": implicit VR */
    static std::string element(uint16_t group, uint16_t tag, const std::string &type, std::string value)
    {
        if (value.size() % 2) value += type == "UI" ? '\0' : ' ';
        std::string head = bytes_of(std::vector<uint16_t>{group, tag}) + type,
                    length = bytes_of(std::vector<uint32_t>{uint32_t(value.size())});
        if (type == "OW") return head + std::string(2, '\0') + length + value;
        return head + (type.empty() ? length : number(uint16_t(value.size()))) + value;
    }

private:
    std::string encapsulated() const
    {
        const std::string item("\xfe\xff\x00\xe0", 4), end("\xfe\xff\xdd\xe0\0\0\0\0", 8), none(4, '\0');
        std::string image = code + std::string(code.size() % 2, '\0');
        return std::string("\xe0\x7f\x10\0OB\0\0\xff\xff\xff\xff", 12) + item + none + item +
               bytes_of(std::vector<uint32_t>{uint32_t(image.size())}) + image + end;
    }
};

inline std::string from_hex(const std::string &digits)
{
    std::string bytes;
    for (size_t n = 0; n < digits.size(); n += 2) bytes += char(std::stoi(digits.substr(n, 2), nullptr, 16));
    return bytes;
}

/* Compress. Window bits as in zlib: 16 added gives gzip, negative gives no header. */
inline std::string deflated(const std::string &bytes, int window_bits)
{
    std::string out(bytes.size() + 100, '\0');
    z_stream stream = {};
    deflateInit2(&stream, 9, Z_DEFLATED, window_bits, 9, Z_DEFAULT_STRATEGY);
    stream.next_in = reinterpret_cast<Bytef *>(const_cast<char *>(bytes.data()));
    stream.avail_in = uInt(bytes.size());
    stream.next_out = reinterpret_cast<Bytef *>(&out[0]);
    stream.avail_out = uInt(out.size());
    deflate(&stream, Z_FINISH);
    out.resize(stream.total_out);
    deflateEnd(&stream);
    return out;
}

const char *const DEFLATED_SYNTAX = "1.2.840.10008.1.2.1.99";

/* Deflate the data set of a DICOM file that already has the deflated transfer syntax. The file meta group stays
 * uncompressed. */
inline std::string with_deflated_data_set(const std::string &bytes)
{
    uint32_t length;
    std::memcpy(&length, &bytes[140], sizeof length);
    const size_t start = 144 + length;
    return bytes.substr(0, start) + deflated(bytes.substr(start), -MAX_WBITS);
}

/* A stack of slices 2 mm apart along z, in shuffled files. `change` alters an image before it is written. */
template <class Change> void save_series(const temporary_folder &folder, int count, Change change)
{
    for (int n = 0; n < count; n++) {
        dicom_file file;
        file.position = "-10\\-20\\" + std::to_string(30 + 2 * n);
        file.instance = "1.2.3.4." + std::to_string(n + 1);
        std::fill(file.pixels.begin(), file.pixels.end(), uint16_t(100 * n));
        file.pixels[1] = uint16_t(1024 + n);
        change(n, &file);
        save(folder / ("im" + std::to_string(n * 7 % 10) + "_" + std::to_string(n)), file.bytes());
    }
}

inline void save_series(const temporary_folder &folder, int count)
{
    save_series(folder, count, [](int, dicom_file *) {});
}

/* Collects the warnings of the library during its lifetime. */
class log_catcher
{
public:
    log_catcher()
    {
        logged().clear();
        pliant_set_log(
            [](pliant_log_level level, const char *message, void *) {
                if (level == PLIANT_LOG_WARNING) logged() += std::string(message) + "\n";
            },
            nullptr);
    }
    ~log_catcher() { pliant_set_log(nullptr, nullptr); }
    log_catcher(const log_catcher &) = delete;
    log_catcher &operator=(const log_catcher &) = delete;
    const std::string &warnings() const { return logged(); }

private:
    static std::string &logged()
    {
        static std::string text;
        return text;
    }
};

/* Return a warning with all these words, if there is one. */
inline void expect_words(const std::string &text, const std::vector<std::string> &words)
{
    EXPECT_EQ(text.empty(), words.empty()) << text;
    for (const std::string &word : words)
        EXPECT_NE(text.find(word), std::string::npos) << "\"" << word << "\" is not in: " << text;
}

/* Freed at the end of the test. */
struct volume_holder {
    pliant_volume volume = {};
    ~volume_holder() { pliant_volume_free(&volume); }
    pliant_volume *operator->() { return &volume; }
    pliant_volume *operator&() { return &volume; }
    float at(int i, int j, int k) const
    {
        const int32_t *size = volume.geometry.size;
        return pliant_volume_value(&volume, size_t(i) + size_t(size[0]) * (size_t(j) + size_t(size[1]) * size_t(k)));
    }
};

/* Expect that reading fails with this status and a message with all these words. The output is unchanged, and no memory
 * leaks. */
inline void expect_refused(const std::string &path, pliant_status status, const std::vector<std::string> &words,
                           const char *series = nullptr, size_t memory_limit = 0)
{
    SCOPED_TRACE(path);
    pliant_volume volume, before;
    std::memset(&volume, 0x5a, sizeof volume);
    std::memcpy(&before, &volume, sizeof volume);
    size_t in_use = pliant_memory_in_use();
    EXPECT_EQ(pliant_volume_read(path.c_str(), series, memory_limit, &volume), status);
    EXPECT_EQ(std::memcmp(&volume, &before, sizeof volume), 0);
    EXPECT_EQ(pliant_memory_in_use(), in_use);
    std::string message = pliant_last_error();
    for (const std::string &word : words)
        EXPECT_NE(message.find(word), std::string::npos) << "\"" << word << "\" is not in: " << message;
}

#endif
