#include "sim/build/build_stages.h"

#include "base/fail.h"
#include "topology/links.h"
#include "cut/cut.h"
#include "base/memory.h"

#include <string.h>

static const char *const separators = ", []";

/* Set the flag in `slides` of every material that the scene names. */
static pliant_status find_named(const pliant_model *model, uint8_t slides[256])
{
    const pliant_material_table *table = &model->materials;
    for (const char *name = model->scene.material.slides; *name;) {
        const size_t skipped = strspn(name, separators), length = strcspn(name + skipped, separators);
        uint32_t m = 0;
        name += skipped;
        if (length == 0) break;
        while (m < table->num_materials &&
               (strlen(table->materials[m].name) != length || strncmp(table->materials[m].name, name, length) != 0))
            m++;
        if (m == table->num_materials)
            return pliant_fail(PLIANT_ERROR_SCENE, "material/slides: the table has no material \"%.*s\"", (int)length,
                               name);
        slides[m] = 1;
        name += length;
    }
    return PLIANT_OK;
}

/* Return whether both voxels are tissue, and one slides along the other. */
static bool parts(const pliant_model *model, const uint8_t slides[256], int32_t a, int32_t b)
{
    const pliant_voxels *voxels = model->body->voxels;
    const uint8_t one = model->material_of_voxel[a], other = model->material_of_voxel[b];
    return one != other && (slides[one] || slides[other]) && voxels->owner[a] >= 0 && voxels->owner[b] >= 0 &&
           !model->materials.materials[one].empty && !model->materials.materials[other].empty;
}

/* List the severed links in ascending order, then the bridges. Return their number.
 * @param out Nullable */
static int32_t list_severed(const pliant_model *model, const uint8_t slides[256], uint32_t *out)
{
    const pliant_voxels *voxels = model->body->voxels;
    const int32_t count = (int32_t)pliant_geometry_voxels(&voxels->geometry);
    int32_t found = 0, at[3];
    for (int32_t voxel = 0; voxel < count; voxel++) {
        pliant_place_of(voxels, voxel, at);
        for (int axis = 0; axis < 3; axis++) {
            if (at[axis] + 1 >= voxels->geometry.size[axis] ||
                !parts(model, slides, voxel, voxel + pliant_stride_of(voxels, axis)))
                continue;
            if (out) out[found] = 4 * (uint32_t)voxel + (uint32_t)axis;
            found++;
        }
    }
    for (int32_t b = 0; b < voxels->num_bridges; b++) {
        if (!parts(model, slides, voxels->bridge[2 * b], voxels->bridge[2 * b + 1])) continue;
        if (out) out[found] = 4 * (uint32_t)b + 3;
        found++;
    }
    return found;
}

pliant_status pliant_model_part_slides(pliant_model *model)
{
    uint8_t slides[256] = {0};
    if (!model->scene.material.slides[0]) return PLIANT_OK;
    pliant_status status = find_named(model, slides);
    const int32_t count = status == PLIANT_OK ? list_severed(model, slides, NULL) : 0;
    if (status != PLIANT_OK || count == 0) return status;
    uint32_t *severed = pliant_calloc((size_t)count, sizeof *severed);
    if (!severed) return pliant_fail_memory("what slides");
    list_severed(model, slides, severed);
    pliant_body *next = NULL;
    status = pliant_body_sever(model->body, model->body->revision + 1, count, severed, &next);
    pliant_free(severed);
    if (status != PLIANT_OK) return status;
    pliant_body_release(model->body);
    model->body = next;
    if (next->pieces && !next->has_inertia)
        pliant_log(
            PLIANT_LOG_WARNING,
            "material/slides: %d pieces are not connected to fixed nodes; with a quasi-static solver they fall as "
            "rigid bodies",
            next->pieces->count);
    return PLIANT_OK;
}
