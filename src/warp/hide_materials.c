#include "warp/hide_materials.h"
#include "scan/volume.h"
#include "warp/warp_state.h"

#include <string.h>

pliant_status pliant_volume_hide(const pliant_volume *scan, const uint8_t *material_of_voxel, const bool hidden[256],
                                 pliant_volume *out)
{
    const raster_source source = pliant_warp_source(scan);
    const size_t count = pliant_geometry_voxels(&scan->geometry), size = pliant_encoding_size(scan->encoding);
    pliant_volume volume;
    pliant_status status = pliant_volume_create(&scan->geometry, scan->encoding, &volume);
    if (status != PLIANT_OK) return status;
    char *voxels = volume.voxels;
    volume = *scan;
    volume.voxels = voxels;
    memcpy(voxels, scan->voxels, count * size);
    for (size_t v = 0; v < count; v++)
        if (hidden[material_of_voxel[v]]) memcpy(voxels + size * v, &source.background, size);
    *out = volume;
    return PLIANT_OK;
}
