#include "ros/record/npy.h"

#include "ros/sim/loaded_model.h"

#include <cerrno>
#include <cstring>

namespace pliant_ros {

namespace {

const size_t ALIGNMENT = 64; /* alignment of the first array element in the file [bytes] */

std::string header(const std::string &kind, const std::vector<size_t> &shape)
{
    const char order = kind[1] == '1' ? '|' : __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__ ? '<' : '>';
    std::string text = "{'descr': '" + (order + kind) + "', 'fortran_order': False, 'shape': (";
    for (size_t size : shape) text += std::to_string(size) + ",";
    text += "), }";
    const size_t before = 10; /* size of magic number, version, and header length [bytes] */
    text.append((ALIGNMENT - (before + text.size() + 1) % ALIGNMENT) % ALIGNMENT, ' ');
    text += '\n';
    std::string out("\x93NUMPY\x01\x00", 8);
    out += static_cast<char>(text.size() & 0xff);
    out += static_cast<char>(text.size() >> 8);
    return out + text;
}

} // namespace

NpyFile::NpyFile(const std::string &path, const std::string &kind, const std::vector<size_t> &shape)
    : path_(path), file_(std::fopen(path.c_str(), "wb"))
{
    if (!file_) throw Failure(PLIANT_ERROR_FILE, path_ + ": " + std::strerror(errno));
    const std::string begin = header(kind, shape);
    append(begin.data(), begin.size());
}

NpyFile::~NpyFile()
{
    if (file_) std::fclose(file_);
}

void NpyFile::append(const void *numbers, size_t size)
{
    if (size > 0 && std::fwrite(numbers, 1, size, file_) != size)
        throw Failure(PLIANT_ERROR_FILE, path_ + ": " + std::strerror(errno));
}

void NpyFile::close()
{
    const bool unwritten = std::fclose(file_) != 0;
    file_ = nullptr;
    if (unwritten) throw Failure(PLIANT_ERROR_FILE, path_ + ": it could not be written completely");
}

} // namespace pliant_ros
