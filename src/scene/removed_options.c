/* Options of earlier versions. An error refuses them and names the remedy. */
#include "scene/scene.h"

#include <string.h>

const char *pliant_scene_removed_option(const char *option)
{
    static const char *const removed[][2] = {
        {"contact/punishment", "was renamed; use contact/overlap_damping"},
        {"model/touch", "was renamed; use model/submesh"},
        {"segment/most_classes", "was renamed; use segment/max_classes"},
        {"segment/smallest", "was renamed; use segment/min_volume"},
        {"cut/snap", "was removed; a cut closer to a node than 0.1 of the shortest edge passes through the node"},
        {"model/lod_seconds", "was removed; lod refuses a model whose preparation takes more than 300 s"},
        {"model/lod_memory", "was removed; lod refuses a model that takes more than 4096 MiB"},
        {"warp/fit_step", "was removed; fitted points are 4 voxels apart"},
    };
    for (size_t i = 0; i < sizeof removed / sizeof *removed; ++i)
        if (strcmp(option, removed[i][0]) == 0) return removed[i][1];
    return NULL;
}
