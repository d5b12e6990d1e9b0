/* Arrays as files that numpy.load reads (.npy, version 1.0 of the format). */
#ifndef PLIANT_ROS_RECORD_NPY_H
#define PLIANT_ROS_RECORD_NPY_H

#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

namespace pliant_ros {

/* Throws Failure when the file cannot be written, as do those that follow. */
class NpyFile {
public:
    /* kind: numpy's name of the numbers without the order of their bytes, as f8, i8, u1; shape: rows first */
    NpyFile(const std::string &path, const std::string &kind, const std::vector<size_t> &shape);
    ~NpyFile();
    NpyFile(const NpyFile &) = delete;
    NpyFile &operator=(const NpyFile &) = delete;
    /* the next ones, row after row */
    void append(const void *numbers, size_t size);
    void close();

private:
    const std::string path_;
    std::FILE *file_;
};

} // namespace pliant_ros

#endif
