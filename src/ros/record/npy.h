/* Write arrays in NumPy's .npy format, version 1.0. */
#ifndef PLIANT_ROS_RECORD_NPY_H
#define PLIANT_ROS_RECORD_NPY_H

#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

namespace pliant_ros {

/* The constructor and the member functions throw Failure if the file cannot be written. */
class NpyFile {
public:
    /* kind: NumPy type without byte order, such as f8, i8, u1
     * shape: slowest dimension first */
    NpyFile(const std::string &path, const std::string &kind, const std::vector<size_t> &shape);
    ~NpyFile();
    NpyFile(const NpyFile &) = delete;
    NpyFile &operator=(const NpyFile &) = delete;
    /* Append elements in row-major order.
     * size: in bytes */
    void append(const void *numbers, size_t size);
    void close();

private:
    const std::string path_;
    std::FILE *file_;
};

} // namespace pliant_ros

#endif
