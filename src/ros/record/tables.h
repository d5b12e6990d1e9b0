/* Write recorded data as CSV tables. */
#ifndef PLIANT_ROS_RECORD_TABLES_H
#define PLIANT_ROS_RECORD_TABLES_H

#include <pliant/Cut.h>
#include <pliant/Step.h>

#include <cstdio>
#include <string>

namespace pliant_ros {

/* The constructor and the member functions throw Failure if the file cannot be written. */
class Table {
public:
    Table(const std::string &path, const std::string &heading);
    ~Table();
    Table(const Table &) = delete;
    Table &operator=(const Table &) = delete;
    void close();

protected:
    std::FILE *file() { return file_; }

private:
    const std::string path_;
    std::FILE *file_;
};

/* time: seconds since the start of the bag */
class StepsTable : public Table {
public:
    explicit StepsTable(const std::string &path);
    void append(double time, const pliant::Step &step);
};

class CutsTable : public Table {
public:
    explicit CutsTable(const std::string &path);
    void append(double time, const pliant::Cut &cut);
};

} // namespace pliant_ros

#endif
