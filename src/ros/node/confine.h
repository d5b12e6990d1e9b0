/* Files that a caller over the network may name: only below one folder, whatever links and headers say. Paths in a
   request are checked first, for a plain answer; what is read in the end is decided by ConfinedReads. */
#ifndef PLIANT_ROS_NODE_CONFINE_H
#define PLIANT_ROS_NODE_CONFINE_H

#include "pliant/open.h"
#include "pliant/scene.h"

#include <string>
#include <vector>

namespace pliant_ros {

/* The path of an existing file or folder inside root, links resolved. A relative path starts at root.
   False with a message: root empty (nothing may be read), not there, outside. */
bool confine_existing(const std::string &root, const std::string &path, std::string *resolved, std::string *why);

/* The same for a file to be written: its folder must exist inside root; an existing file is replaced only when it is a
   plain one. */
bool confine_new(const std::string &root, const std::string &path, std::string *resolved, std::string *why);

/* The files that a scene names, and the STL files that its obstacles name; links resolved. */
std::vector<std::string> files_of(const pliant_scene &scene);

/* While it lives, the readers of this thread open what lies inside root and the files `also`, nothing else: data
   files of headers, images of a folder and links included. Either may be empty. */
class ConfinedReads {
public:
    ConfinedReads(const std::string &root, const std::vector<std::string> &also);
    ~ConfinedReads();
    ConfinedReads(const ConfinedReads &) = delete;
    ConfinedReads &operator=(const ConfinedReads &) = delete;

private:
    const char *ask(const char *path) const;

    std::string root_; /* links resolved, here and below */
    std::vector<std::string> also_;
    pliant_open_check before_;
};

} // namespace pliant_ros

#endif
