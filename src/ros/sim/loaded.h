/* A scan in memory, and what was built from it. Shared by the threads that use it; the last one frees it. */
#ifndef PLIANT_ROS_SIM_LOADED_H
#define PLIANT_ROS_SIM_LOADED_H

#include "pliant/pliant.h"

#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace pliant_ros {

/* A status and its message, thrown inside the node only. */
struct Failure : std::runtime_error {
    Failure(pliant_status status_, const std::string &message) : std::runtime_error(message), status(status_) {}
    pliant_status status;
};
/* Throws for a negative status, with the last error of this thread. */
void check(pliant_status status);

struct Materials {
    pliant_material_table table{};
    Materials() = default;
    Materials(const Materials &) = delete;
    ~Materials() { pliant_material_table_free(&table); }
};

struct Scan {
    pliant_volume volume{};
    pliant_labels labels{}; /* voxels NULL: none */
    std::string path;        /* as it was named */
    float low = 0, high = 0; /* smallest and largest value */
    uint64_t checksum = 0;   /* of size, encoding and voxels (FNV-1a, 64 bits) */
    uint64_t labels_checksum = 0; /* of their voxels; 0: none */
    Scan() = default;
    Scan(const Scan &) = delete;
    ~Scan();
};

struct Loaded {
    std::shared_ptr<const Scan> scan;
    pliant_model *model = nullptr; /* constant once built */
    pliant_scene asked{};          /* that it was built for; the model's own has the settings that were chosen */
    pliant_choice choice{};        /* made: its settings were chosen */
    uint32_t revision = 0;         /* in messages, of the body at load; of later ones see revision_of */
    Loaded() = default;
    Loaded(const Loaded &) = delete;
    ~Loaded() { pliant_model_free(model); }
};

/* One more holder of a body. */
std::shared_ptr<const pliant_body> share(const pliant_body *body);
/* The surface of a body; of the one that was asked for last, Nullable, what is the same is taken over. Throws. */
std::shared_ptr<const pliant_surface> surface_of(const pliant_body &body, const std::shared_ptr<const pliant_surface> &last);
/* What messages call a body: no two of a node's life have the same number. */
inline uint32_t revision_of(const Loaded &loaded, uint64_t body) { return loaded.revision + static_cast<uint32_t>(body - 1); }

/* Of a scene: as many as it says, or as the machine has cores. */
int threads_of(const pliant_scene &scene);

/* Whether a recorded scan_id can be of a scan: it has the same name (older recordings have no checksum in it), or the scan has been renamed. */
bool is_id_of(const std::string &id, const Scan &scan);

/* The volume's id becomes its name and a checksum of voxels and geometry: "liver.nii.gz-0123456789abcdef". Throw Failure. Materials that are empty are read as the scene says; others are used as they are. */
std::shared_ptr<const Scan> read_scan(const pliant_scene &scene, const std::string &path, Materials *materials);
std::shared_ptr<Loaded> build(const pliant_scene &scene, std::shared_ptr<const Scan> scan,
                              const pliant_material_table &materials, pliant_progress progress);

/* The same, with the settings that the scene's group `choose` asks for. */
std::shared_ptr<Loaded> build_chosen(const pliant_scene &scene, std::shared_ptr<const Scan> scan,
                                     const pliant_material_table &materials, pliant_progress progress);
/* The error of a scene's settings as they are, on the probe load of a choice; made false: it could not be measured. */
pliant_choice measure(const pliant_scene &scene, const Scan &scan, const pliant_material_table &materials,
                      pliant_progress progress);

struct DataDeleter {
    void operator()(pliant_data *data) const { pliant_data_free(data); }
};
using Data = std::unique_ptr<pliant_data, DataDeleter>;
Data create_data(const pliant_model &model);
/* Throws when there is no such tool. */
pliant_tool_state tool_state(const pliant_data &data, int tool);
/* Where its shape presses. */
std::vector<pliant_contact> tool_contacts(const pliant_data &data, int tool);

} // namespace pliant_ros

#endif
