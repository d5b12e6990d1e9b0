/* Restrict the files that a network client may name to one folder, after resolving links and file headers. Paths in a
 * request are checked first, which gives a clear error message. ConfinedReads makes the final decision when a file is
 * opened. */
#ifndef PLIANT_ROS_NODE_CONFINE_H
#define PLIANT_ROS_NODE_CONFINE_H

#include "pliant/open.h"
#include "pliant/scene.h"

#include <string>
#include <vector>

namespace pliant_ros {

/* Resolve the path of an existing file or folder inside root, including links. A relative path starts at root. Return
 * false and set *why if root is empty (nothing may be read), the path does not exist, or it lies outside. */
bool confine_existing(const std::string &root, const std::string &path, std::string *resolved, std::string *why);

/* Resolve the path of a file to be written. Its folder must exist inside root. An existing file is replaced only if it
 * is a regular file. */
bool confine_new(const std::string &root, const std::string &path, std::string *resolved, std::string *why);

/* Return the files that a scene names and the STL files that its obstacles name, with links resolved. */
std::vector<std::string> files_of(const pliant_scene &scene);

/* While an object of this class exists, readers in this thread open only files inside root and the files in `also`. The
 * restriction includes data files that headers name, images of a folder, and links. Either argument may be empty. */
class ConfinedReads {
public:
    ConfinedReads(const std::string &root, const std::vector<std::string> &also);
    ~ConfinedReads();
    ConfinedReads(const ConfinedReads &) = delete;
    ConfinedReads &operator=(const ConfinedReads &) = delete;

private:
    const char *check_path(const char *path) const;

    std::string root_; /* links resolved, as in also_ */
    std::vector<std::string> also_;
    pliant_open_check before_;
};

} // namespace pliant_ros

#endif
