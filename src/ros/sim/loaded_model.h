/* A scan in memory and the model built from it. Threads share them; the last owner frees them. */
#ifndef PLIANT_ROS_SIM_LOADED_MODEL_H
#define PLIANT_ROS_SIM_LOADED_MODEL_H

#include "pliant/pliant.h"
#include "topology/visible_surface.h"

#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace pliant_ros {

/* A status with a message; thrown only inside the node. */
struct Failure : std::runtime_error {
    Failure(pliant_status status_, const std::string &message) : std::runtime_error(message), status(status_) {}
    pliant_status status;
};
/* Throw Failure for a negative status, with the last error of this thread. */
void check(pliant_status status);

struct Materials {
    pliant_material_table table{};
    Materials() = default;
    Materials(const Materials &) = delete;
    ~Materials() { pliant_material_table_free(&table); }
};

struct Scan {
    pliant_volume volume{};
    pliant_labels labels{}; /* voxels NULL: no labels */
    std::string path;        /* path as given by the user */
    float low = 0, high = 0; /* minimum and maximum value */
    uint64_t checksum = 0;   /* checksum of size, encoding and voxels (FNV-1a, 64 bits) */
    uint64_t labels_checksum = 0; /* checksum of the label voxels; 0: no labels */
    Scan() = default;
    Scan(const Scan &) = delete;
    ~Scan();
};

struct LoadedModel {
    std::shared_ptr<const Scan> scan;
    pliant_model *model = nullptr; /* constant once built */
    pliant_scene requested{};      /* requested scene; the model's own scene has the automatically selected settings */
    pliant_choice choice{};        /* made: settings were selected automatically */
    uint32_t revision = 0;         /* revision of the initial body in messages; for later bodies see revision_of */
    LoadedModel() = default;
    LoadedModel(const LoadedModel &) = delete;
    ~LoadedModel() { pliant_model_free(model); }
};

/* Return a shared pointer that retains the body. */
std::shared_ptr<const pliant_body> share_body(const pliant_body *body);
/* Return the surface of a body. Throws Failure.
 * last: Nullable; previously computed surface, whose unchanged parts are reused */
std::shared_ptr<const pliant_surface> surface_of(const pliant_body &body,
                                                 const std::shared_ptr<const pliant_surface> &last);
/* Return the revision of a body in messages, which is unique in the life of a node. */
inline uint32_t revision_of(const LoadedModel &loaded, uint64_t body)
{
    return loaded.revision + static_cast<uint32_t>(body - 1);
}

/* Return the number of threads of a scene, or the number of CPU cores if it has none. */
int threads_of(const pliant_scene &scene);

/* Return whether a recorded scan_id matches a scan: the names are equal (older recordings contain no checksum), or the
 * scan has been renamed. */
bool is_id_of(const std::string &id, const Scan &scan);

/* Read a scan. The volume's ID becomes its name and a checksum of voxels and geometry: "liver.nii.gz-0123456789abcdef".
 * materials: input and output; if empty, they are read from the scene's file
 * Throws Failure. */
std::shared_ptr<const Scan> read_scan(const pliant_scene &scene, const std::string &path, Materials *materials);
std::shared_ptr<LoadedModel> build(const pliant_scene &scene, std::shared_ptr<const Scan> scan,
                                   const pliant_material_table &materials, pliant_progress progress);

/* Build a model with the settings selected automatically according to the scene's group `choose`. */
std::shared_ptr<LoadedModel> build_chosen(const pliant_scene &scene, std::shared_ptr<const Scan> scan,
                                          const pliant_material_table &materials, pliant_progress progress);
/* Measure the error of a scene's settings under the probe load of the automatic selection. If it cannot be measured,
 * the result's `made` is false. */
pliant_choice measure(const pliant_scene &scene, const Scan &scan, const pliant_material_table &materials,
                      pliant_progress progress);

struct DataDeleter {
    void operator()(pliant_data *data) const { pliant_data_free(data); }
};
using Data = std::unique_ptr<pliant_data, DataDeleter>;
Data create_data(const pliant_model &model);
/* Throws Failure if the tool does not exist. */
pliant_tool_state tool_state(const pliant_data &data, int tool);
/* Return the contacts of a tool's shape. */
std::vector<pliant_contact> tool_contacts(const pliant_data &data, int tool);

} // namespace pliant_ros

#endif
