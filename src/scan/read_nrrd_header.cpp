/* The text header of a NRRD file: "field: value" and "key:=value" lines up to an empty line
 * (http://teem.sourceforge.net/nrrd/format.html). */
#include "scan/read_nrrd.h"

#include <cmath>
#include <limits>
#include <sstream>

namespace pliant_read {

std::string nrrd_header::text(const std::string &name) const
{
    auto found = fields.find(name);
    return found == fields.end() ? "" : found->second;
}

std::string nrrd_header::pair(const std::string &key) const
{
    auto found = pairs.find(key);
    return found == pairs.end() ? "" : found->second;
}

std::vector<double> nrrd_header::numbers(const std::string &name, size_t count) const
{
    std::istringstream words(text(name));
    std::vector<double> found, one;
    for (std::string word; words >> word;) {
        if (lower_case(word) == "nan") one.assign(1, std::numeric_limits<double>::quiet_NaN());
        else if (!parse_numbers(word, ' ', &one)) one.clear();
        if (one.size() != 1) break;
        found.push_back(one[0]);
    }
    if (found.size() != count || !words.eof())
        fail(PLIANT_ERROR_FORMAT, "%s: %s: %.100s: %zu numbers are needed", path.c_str(), name.c_str(),
             text(name).c_str(), count);
    return found;
}

double nrrd_header::whole(const std::string &name, double otherwise) const
{
    if (!has(name)) return otherwise;
    double value = numbers(name, 1)[0];
    if (value != std::floor(value))
        fail(PLIANT_ERROR_FORMAT, "%s: %s: %.40s: a whole number is needed", path.c_str(), name.c_str(),
             text(name).c_str());
    return value;
}

std::unique_ptr<byte_stream> nrrd_data::open() const
{
    std::unique_ptr<byte_stream> stream(
        new byte_stream(path, offset + (compressed ? 0 : skip),
                        compressed ? byte_stream::packing::deflate : byte_stream::packing::none));
    if (compressed) stream->skip(skip, "the bytes in front of the voxels");
    return stream;
}

namespace {

/* Resolve the escapes of a pair's value: new lines and backslashes are escaped by a backslash. */
std::string unescaped(const std::string &text)
{
    std::string out;
    for (size_t n = 0; n < text.size(); n++) {
        const char next = n + 1 < text.size() ? text[n + 1] : '\0';
        if (text[n] != '\\' || (next != 'n' && next != '\\')) {
            out += text[n];
            continue;
        }
        out += next == 'n' ? '\n' : '\\';
        n++;
    }
    return out;
}

} // namespace

nrrd_header read_nrrd_header(const std::string &path)
{
    const size_t longest = 1 << 20;
    nrrd_header header;
    header.path = path;
    std::string bytes = file_start(path, longest);
    if (bytes.compare(mark_of(bytes), 4, "NRRD") != 0)
        fail(PLIANT_ERROR_FORMAT, "%s: not a NRRD file: it does not begin with NRRD", path.c_str());
    size_t at = std::min(bytes.find('\n'), bytes.size() - 1) + 1;
    while (at < bytes.size()) {
        size_t end = bytes.find('\n', at);
        bool whole_line = end != std::string::npos;
        std::string line = trimmed(bytes.substr(at, whole_line ? end - at : end));
        at = whole_line ? end + 1 : bytes.size();
        header.bytes = at;
        if (line.empty() && whole_line) return header;
        size_t colon = line.find(": "), pair = line.find(":=");
        if (line[0] == '#') continue;
        if (pair != std::string::npos) {
            header.pairs[lower_case(trimmed(line.substr(0, pair)))] = unescaped(line.substr(pair + 2));
            continue;
        }
        if (colon == std::string::npos) continue;
        std::string name;
        for (char c : lower_case(line.substr(0, colon)))
            if (c != ' ') name += c;
        header.fields[name] = trimmed(line.substr(colon + 2));
    }
    /* A detached header needs no empty line. */
    if (header.has("datafile") && !bytes.empty() && bytes.back() == '\n') return header;
    fail(PLIANT_ERROR_FORMAT, "%s: truncated: the header does not end with an empty line", path.c_str());
}

} // namespace pliant_read
