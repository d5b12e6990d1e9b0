#include "confine.h"

#include <dirent.h>
#include <limits.h>
#include <stdlib.h>
#include <strings.h>
#include <sys/stat.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <memory>

namespace pliant_ros {

namespace {

enum { MAX_HEADER_LINES = 4096, MAX_HEADER_LINE = 4096 };

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

std::string trimmed(const std::string &text)
{
    const char *blank = " \t\r\n";
    size_t first = text.find_first_not_of(blank);
    return first == std::string::npos ? "" : text.substr(first, text.find_last_not_of(blank) - first + 1);
}

bool ends_with(const std::string &path, const char *ending)
{
    size_t length = std::strlen(ending);
    return path.size() >= length && strcasecmp(path.c_str() + path.size() - length, ending) == 0;
}

bool real_root(const std::string &root, std::string *out, std::string *why)
{
    if (root.empty()) *why = "no folder is set from which callers may name files";
    else if (!real(root, out)) *why = root + ": " + std::strerror(errno);
    else return true;
    return false;
}

/* a data file that a header names */
bool check_reference(const std::string &root, const std::string &header, const std::string &name, std::string *why)
{
    std::string target = joined(folder_of(header), name), resolved;
    bool climbs = name == ".." || name.find("../") != std::string::npos;
    bool outside = real(target, &resolved) ? !is_inside(root, resolved) : climbs || name[0] == '/';
    if (outside) *why = header + " points to " + name + ", which is outside " + root;
    return !outside;
}

/* MetaImage: "ElementDataFile = x"; NRRD: "data file: x"; either may say LIST, then one name a line follows. */
bool check_header(const std::string &root, const std::string &header, std::string *why)
{
    bool meta = ends_with(header, ".mha") || ends_with(header, ".mhd");
    if (!meta && !ends_with(header, ".nrrd") && !ends_with(header, ".nhdr")) return true;
    std::ifstream file(header, std::ios::binary);
    std::string line;
    bool is_list = false;
    for (int count = 0; count < MAX_HEADER_LINES && std::getline(file, line); ++count) {
        if (line.size() > MAX_HEADER_LINE) break; /* no header any more */
        line = trimmed(line);
        if (line.empty() && !meta) break; /* the data of a NRRD file follow */
        if (is_list) {
            if (!line.empty() && !check_reference(root, header, line, why)) return false;
            continue;
        }
        size_t sign = line.find(meta ? '=' : ':');
        if (sign == std::string::npos) continue;
        std::string key = trimmed(line.substr(0, sign)), value = trimmed(line.substr(sign + 1));
        bool names_data = meta ? strcasecmp(key.c_str(), "ElementDataFile") == 0
                               : strcasecmp(key.c_str(), "data file") == 0 || strcasecmp(key.c_str(), "datafile") == 0;
        if (!names_data || value.empty()) continue;
        if (meta && strcasecmp(value.c_str(), "LOCAL") == 0) break;
        is_list = strncasecmp(value.c_str(), "LIST", 4) == 0;
        if (!is_list && !check_reference(root, header, value, why)) return false;
    }
    return true;
}

struct CloseFolder {
    void operator()(DIR *folder) const { closedir(folder); }
};

bool check_folder(const std::string &root, const std::string &folder, std::string *why)
{
    std::unique_ptr<DIR, CloseFolder> entries(opendir(folder.c_str()));
    if (!entries) {
        *why = folder + ": " + std::strerror(errno);
        return false;
    }
    while (const dirent *entry = readdir(entries.get())) {
        std::string name = entry->d_name, resolved;
        if (name == "." || name == "..") continue;
        if (!real(folder + "/" + name, &resolved)) continue; /* a dangling link holds nothing to read */
        if (is_inside(root, resolved)) continue;
        *why = folder + "/" + name + " is a link to outside " + root;
        return false;
    }
    return true;
}

} // namespace

bool confine_existing(const std::string &root, const std::string &path, std::string *resolved, std::string *why)
{
    std::string top, found;
    struct stat status;
    if (!real_root(root, &top, why)) return false;
    if (path.empty()) {
        *why = "no file is named";
        return false;
    }
    if (!real(joined(top, path), &found) || stat(found.c_str(), &status) != 0) {
        *why = path + ": " + std::strerror(errno);
        return false;
    }
    if (!is_inside(top, found)) {
        *why = path + " is outside " + top;
        return false;
    }
    if (S_ISDIR(status.st_mode) ? !check_folder(top, found, why) : !check_header(top, found, why)) return false;
    *resolved = found;
    return true;
}

bool confine_new(const std::string &root, const std::string &path, std::string *resolved, std::string *why)
{
    std::string top, folder;
    if (!real_root(root, &top, why)) return false;
    std::string whole = joined(top, path);
    size_t slash = whole.rfind('/');
    std::string name = whole.substr(slash + 1);
    if (path.empty() || name.empty() || name == "." || name == "..") {
        *why = "\"" + path + "\" names no file";
        return false;
    }
    if (!real(folder_of(whole), &folder)) {
        *why = folder_of(whole) + ": " + std::strerror(errno);
        return false;
    }
    if (!is_inside(top, folder)) {
        *why = path + " is outside " + top;
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

} // namespace pliant_ros
