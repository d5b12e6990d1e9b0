/* Files that a caller over the network may name: only below one folder, whatever links and headers say. */
#ifndef PLIANT_ROS_CONFINE_H
#define PLIANT_ROS_CONFINE_H

#include <string>

namespace pliant_ros {

/* The path of an existing file or folder inside root, links resolved. A relative path starts at root.
   For a folder, every file in it must lie inside root too; so must the files that a MetaImage or NRRD header points to.
   False with a message: root empty (nothing may be read), not there, outside. */
bool confine_existing(const std::string &root, const std::string &path, std::string *resolved, std::string *why);

/* The same for a file to be written: its folder must exist inside root; an existing file is replaced only when it is a
   plain one. */
bool confine_new(const std::string &root, const std::string &path, std::string *resolved, std::string *why);

} // namespace pliant_ros

#endif
