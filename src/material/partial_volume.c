#include "material/partial_volume.h"

#include <stddef.h>

enum { REACH = 2 }; /* voxels over which a scanner blurs a border, on either side */

typedef struct grid {
    const pliant_material_table *table;
    const int32_t *size;
    const uint8_t *voxels;
} grid;

/* Return the material at a distance along a direction; -1: outside of the volume. */
static int material_at(const grid *in, const int32_t at[3], const int32_t direction[3], int far)
{
    size_t voxel = 0, pitch = 1;
    for (int d = 0; d < 3; d++) {
        const int32_t index = at[d] + far * direction[d];
        if (index < 0 || index >= in->size[d]) return -1;
        voxel += pitch * (size_t)index;
        pitch *= (size_t)in->size[d];
    }
    return in->voxels[voxel];
}

static bool is_empty(const grid *in, int material) { return material < 0 || in->table->materials[material].empty; }

static bool is_heavy(const grid *in, int material, double density)
{
    return !is_empty(in, material) && in->table->materials[material].density > 2 * density;
}

/* Return the distance of the first dense voxel along a direction; 0: it is too far, or air comes first. */
static int find_tissue(const grid *in, const int32_t at[3], const int32_t direction[3], double density)
{
    for (int far = 1; far <= REACH; far++) {
        const int material = material_at(in, at, direction, far);
        if (is_heavy(in, material, density)) return far;
        if (is_empty(in, material)) return 0;
    }
    return 0;
}

/* Return the same distance for air that is two voxels deep. A single voxel is noise in light tissue. */
static int find_air(const grid *in, const int32_t at[3], const int32_t direction[3], double density)
{
    for (int far = 1; far <= REACH; far++) {
        const int material = material_at(in, at, direction, far);
        if (material >= 0 && is_empty(in, material))
            return is_empty(in, material_at(in, at, direction, far + 1)) ? far : 0;
        if (material < 0 || is_heavy(in, material, density)) return 0;
    }
    return 0;
}

uint8_t pliant_material_for_display(const pliant_material_table *table, const int32_t size[3],
                                    const uint8_t *material_of_voxel, const int32_t at[3])
{
    const grid in = {table, size, material_of_voxel};
    const int32_t here[3] = {0, 0, 0};
    const int own = material_at(&in, at, here, 0);
    int nearest = 2 * REACH + 1, found = own;
    if (is_empty(&in, own)) return (uint8_t)own;
    const double density = table->materials[own].density;
    /* Test directions to faces first, then edges, then corners. */
    for (int sides = 1; sides <= 3; sides++)
        for (int n = 0; n < 27; n++) {
            const int32_t direction[3] = {n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1},
                          back[3] = {-direction[0], -direction[1], -direction[2]};
            if ((direction[0] != 0) + (direction[1] != 0) + (direction[2] != 0) != sides) continue;
            const int tissue = find_tissue(&in, at, direction, density),
                      air = tissue ? find_air(&in, at, back, density) : 0;
            if (!air || tissue + air >= nearest) continue;
            nearest = tissue + air;
            found = material_at(&in, at, direction, tissue);
        }
    return (uint8_t)found;
}
