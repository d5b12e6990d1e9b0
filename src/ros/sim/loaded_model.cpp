#include "ros/sim/loaded_model.h"
#include "scan/volume.h"
#include "sim/build/model.h"

#include <algorithm>
#include <cinttypes>
#include <cstdio>
#include <thread>

namespace pliant_ros {

void check(pliant_status status)
{
    if (status >= 0) return;
    std::string message = pliant_last_error();
    throw Failure(status, message.empty() ? pliant_status_text(status) : message);
}

namespace {

uint64_t hash(uint64_t start, const void *data, size_t bytes)
{
    const uint8_t *byte = static_cast<const uint8_t *>(data);
    for (size_t i = 0; i < bytes; ++i) start = (start ^ byte[i]) * 0x100000001b3u;
    return start;
}

uint64_t checksum(const pliant_volume &volume)
{
    const int32_t *size = volume.geometry.size, head[4] = {size[0], size[1], size[2], volume.encoding};
    size_t bytes = pliant_geometry_voxels(&volume.geometry) * pliant_encoding_size(volume.encoding);
    return hash(hash(0xcbf29ce484222325u, head, sizeof head), volume.voxels, bytes);
}

const size_t HEX = 16; /* number of hexadecimal digits of a checksum */

/* Return an ID without the checksum at its end. */
std::string name_in(const std::string &id)
{
    if (id.size() <= HEX || id[id.size() - HEX - 1] != '-') return id;
    const bool is_checksum = id.find_first_not_of("0123456789abcdef", id.size() - HEX) == std::string::npos;
    return is_checksum ? id.substr(0, id.size() - HEX - 1) : id;
}

/* Append a checksum of voxels and geometry to the ID, because folders of different patients often have the same
 * name. */
void make_unique(uint64_t voxels, pliant_volume *volume)
{
    const pliant_geometry &geometry = volume->geometry;
    uint64_t sum = hash(voxels, geometry.origin, sizeof geometry.origin);
    sum = hash(hash(sum, geometry.spacing, sizeof geometry.spacing), geometry.direction, sizeof geometry.direction);
    char end[HEX + 2];
    std::snprintf(end, sizeof end, "-%0*" PRIx64, static_cast<int>(HEX), sum);
    const std::string id = std::string(volume->id).substr(0, sizeof volume->id - sizeof end) + end;
    std::copy_n(id.c_str(), id.size() + 1, volume->id);
}

} // namespace

Scan::~Scan()
{
    pliant_volume_free(&volume);
    pliant_labels_free(&labels);
}

bool is_id_of(const std::string &id, const Scan &scan)
{
    const std::string own = scan.volume.id;
    return name_in(id) == name_in(own) ||
           (id.size() > HEX && id.compare(id.size() - HEX, HEX, own, own.size() - HEX, HEX) == 0);
}

std::shared_ptr<const Scan> read_scan(const pliant_scene &scene, const std::string &path, Materials *materials)
{
    auto scan = std::make_shared<Scan>();
    if (materials->table.num_materials > 0)
        check(pliant_scan_inputs_read(&scene, &materials->table, path.c_str(), &scan->volume, &scan->labels));
    else
        check(pliant_inputs_read(&scene, path.c_str(), &scan->volume, &scan->labels, &materials->table));
    size_t voxels = pliant_geometry_voxels(&scan->volume.geometry);
    scan->low = scan->high = pliant_volume_value(&scan->volume, 0);
    for (size_t i = 1; i < voxels; ++i) {
        float value = pliant_volume_value(&scan->volume, i);
        scan->low = std::min(scan->low, value);
        scan->high = std::max(scan->high, value);
    }
    scan->path = path;
    scan->checksum = checksum(scan->volume);
    make_unique(scan->checksum, &scan->volume);
    if (scan->labels.voxels)
        scan->labels_checksum = hash(0xcbf29ce484222325u, scan->labels.voxels,
                                     pliant_geometry_voxels(&scan->labels.geometry) * sizeof *scan->labels.voxels);
    if (scan->labels.num_segments > 0 && !scan->labels.segments[0].is_class)
        scan->labels_checksum = hash(scan->labels_checksum, scan->labels.segments,
                                     scan->labels.num_segments * sizeof *scan->labels.segments);
    return scan;
}

std::shared_ptr<LoadedModel> build(const pliant_scene &scene, std::shared_ptr<const Scan> scan,
                                   const pliant_material_table &materials, pliant_progress progress)
{
    auto loaded = std::make_shared<LoadedModel>();
    loaded->scan = std::move(scan);
    const pliant_labels *labels = loaded->scan->labels.voxels ? &loaded->scan->labels : nullptr;
    check(pliant_model_build(&scene, &loaded->scan->volume, labels, &materials, progress, &loaded->model));
    loaded->requested = scene;
    return loaded;
}

namespace {

/* A part of a progress bar. */
struct Part {
    pliant_progress whole;
    double from, to;

    pliant_progress progress()
    {
        return pliant_progress{[](double fraction, const char *stage, void *user) {
                                   const Part *part = static_cast<Part *>(user);
                                   double at = part->from + fraction * (part->to - part->from);
                                   return !part->whole.function || part->whole.function(at, stage, part->whole.user);
                               },
                               this};
    }
};

pliant_choice choose(const pliant_scene &scene, const Scan &scan, const pliant_material_table &materials,
                     pliant_progress progress)
{
    pliant_choice choice;
    pliant_report_input input{&scene, &scan.volume, scan.labels.voxels ? &scan.labels : nullptr, &materials};
    check(pliant_choose(&input, nullptr, progress, &choice));
    return choice;
}

} // namespace

std::shared_ptr<LoadedModel> build_chosen(const pliant_scene &scene, std::shared_ptr<const Scan> scan,
                                          const pliant_material_table &materials, pliant_progress progress)
{
    const double chosen = scene.choose.budget_ms > 0 ? 0.9 : 0; /* fraction of the whole work */
    Part first{progress, 0, chosen}, last{progress, chosen, 1};
    pliant_choice choice = choose(scene, *scan, materials, first.progress());
    std::shared_ptr<LoadedModel> loaded = build(choice.scene, std::move(scan), materials, last.progress());
    loaded->requested = scene;
    loaded->choice = choice;
    return loaded;
}

pliant_choice measure(const pliant_scene &scene, const Scan &scan, const pliant_material_table &materials,
                      pliant_progress progress)
{
    pliant_scene fixed = scene;
    fixed.choose.budget_ms = 1e6; /* no time limit, since only the error is measured */
    fixed.choose.max_error = 0;
    fixed.choose.method = fixed.choose.coarse_cells = fixed.choose.ratio = fixed.choose.iterations = false;
    return choose(fixed, scan, materials, progress);
}

std::shared_ptr<const pliant_body> share_body(const pliant_body *body)
{
    return std::shared_ptr<const pliant_body>(pliant_body_retain(body), pliant_body_release);
}

std::shared_ptr<const pliant_surface> surface_of(const pliant_body &body,
                                                 const std::shared_ptr<const pliant_surface> &last)
{
    if (last && last->body == &body) return last;
    pliant_surface *made = nullptr;
    check(pliant_surface_create(&body, last.get(), &made));
    return std::shared_ptr<const pliant_surface>(
        made, [](const pliant_surface *done) { pliant_surface_free(const_cast<pliant_surface *>(done)); });
}

int threads_of(const pliant_scene &scene)
{
    if (scene.solver.threads > 0) return scene.solver.threads;
    return static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
}

Data create_data(const pliant_model &model)
{
    pliant_data *data = nullptr;
    check(pliant_data_create(&model, &data));
    return Data(data);
}

pliant_tool_state tool_state(const pliant_data &data, int tool)
{
    pliant_tool_state state;
    check(pliant_tool_get(&data, tool, &state));
    return state;
}

std::vector<pliant_contact> tool_contacts(const pliant_data &data, int tool)
{
    std::vector<pliant_contact> contacts(static_cast<size_t>(pliant_data_get_contacts(&data, 0, nullptr)));
    pliant_data_get_contacts(&data, static_cast<int32_t>(contacts.size()), contacts.data());
    contacts.erase(std::remove_if(contacts.begin(), contacts.end(),
                                  [tool](const pliant_contact &each) { return each.tool != tool; }),
                   contacts.end());
    return contacts;
}

} // namespace pliant_ros
