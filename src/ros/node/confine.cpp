#include "ros/node/confine.h"

#include "pliant/contact.h"

#include <stdlib.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <memory>

namespace pliant_ros {

namespace {

bool real(const std::string &path, std::string *out)
{
    std::unique_ptr<char, decltype(&free)> resolved(realpath(path.c_str(), nullptr), &free);
    if (resolved) *out = resolved.get();
    return static_cast<bool>(resolved);
}

bool is_inside(const std::string &root, const std::string &path)
{
    return path == root || root == "/" || path.compare(0, root.size() + 1, root + "/") == 0;
}

std::string folder_of(const std::string &path)
{
    size_t slash = path.rfind('/');
    return slash == std::string::npos ? "." : slash == 0 ? "/" : path.substr(0, slash);
}

std::string joined(const std::string &folder, const std::string &path)
{
    return !path.empty() && path[0] == '/' ? path : folder + "/" + path;
}

/* Return whether the nearest existing parent folder of a path lies inside root. Error messages reveal the existence of
 * a file only if it lies inside. */
bool would_be_inside(const std::string &root, std::string path)
{
    std::string found;
    do {
        path = folder_of(path);
    } while (!real(path, &found) && path != "/" && path != ".");
    return is_inside(root, found);
}

bool real_root(const std::string &root, const std::string &parameter, std::string *out, std::string *why)
{
    if (root.empty()) *why = "no folder is set from which callers may name files; start the node with " + parameter;
    else if (!real(root, out)) *why = root + ": " + std::strerror(errno);
    else return true;
    return false;
}

} // namespace

bool confine_existing(const std::string &root, const std::string &path, std::string *resolved, std::string *why)
{
    std::string top, found;
    if (!real_root(root, "~scan_root", &top, why)) return false;
    if (path.empty()) {
        *why = "no file is named";
        return false;
    }
    const bool there = real(joined(top, path), &found);
    const int missing = errno;
    if (!there && would_be_inside(top, joined(top, path))) {
        *why = path + ": " + std::strerror(missing);
        return false;
    }
    if (!there || !is_inside(top, found)) {
        *why = path + " is outside " + top + "; move it there, or start the node with another ~scan_root";
        return false;
    }
    *resolved = found;
    return true;
}

bool confine_new(const std::string &root, const std::string &path, std::string *resolved, std::string *why)
{
    std::string top, folder;
    if (!real_root(root, "~output_root", &top, why)) return false;
    std::string whole = joined(top, path);
    size_t slash = whole.rfind('/');
    std::string name = whole.substr(slash + 1);
    if (path.empty() || name.empty() || name == "." || name == "..") {
        *why = "\"" + path + "\" names no file";
        return false;
    }
    const bool there = real(folder_of(whole), &folder);
    const int missing = errno;
    if (!there && would_be_inside(top, folder_of(whole))) {
        *why = folder_of(whole) + ": " + std::strerror(missing);
        return false;
    }
    if (!there || !is_inside(top, folder)) {
        *why = path + " is outside " + top + "; name a file in there, or start the node with another ~output_root";
        return false;
    }
    std::string target = folder + "/" + name;
    struct stat status;
    if (lstat(target.c_str(), &status) == 0 && !S_ISREG(status.st_mode)) {
        *why = target + " is there and not a plain file";
        return false;
    }
    *resolved = target;
    return true;
}

std::vector<std::string> files_of(const pliant_scene &scene)
{
    std::vector<std::string> files;
    std::string found;
    for (const char *path : {scene.material.file, scene.mesh.file})
        if (path[0] && real(path, &found)) files.push_back(found);
    /* Collect the files that the obstacle reader opens. A read error is ignored here; it is reported when a model is
     * built. */
    const auto note = [](const char *path, void *user) -> const char * {
        static_cast<std::vector<std::string> *>(user)->push_back(path);
        return nullptr;
    };
    const pliant_open_check before = pliant_set_open_check(pliant_open_check{note, &files});
    pliant_tool_shape shape{};
    const char *const obstacles = scene.contact.obstacles;
    if (obstacles[0] && pliant_tool_shape_read(obstacles, &shape) == PLIANT_OK) pliant_tool_shape_free(&shape);
    pliant_set_open_check(before);
    return files;
}

ConfinedReads::ConfinedReads(const std::string &root, const std::vector<std::string> &also) : also_(also)
{
    if (!root.empty()) real(root, &root_);
    before_ = pliant_set_open_check(pliant_open_check{
        [](const char *path, void *user) { return static_cast<ConfinedReads *>(user)->check_path(path); }, this});
}

ConfinedReads::~ConfinedReads() { pliant_set_open_check(before_); }

const char *ConfinedReads::check_path(const char *path) const
{
    if (!root_.empty() && is_inside(root_, path)) return nullptr;
    if (std::find(also_.begin(), also_.end(), path) != also_.end()) return nullptr;
    return "it is outside the folder from which callers may name files; move it there, or start the node with another "
           "~scan_root";
}

} // namespace pliant_ros
