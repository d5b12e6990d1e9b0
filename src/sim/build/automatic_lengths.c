#include "sim/build/build_stages.h"

#include "base/fail.h"
#include "base/memory.h"
#include "pliant/warp.h"
#include "scan/volume.h"
#include "sim/build/model.h"

#include <math.h>

static const double smallest_body = 0.05, largest_body = 0.6;        /* range of body sizes that need no scaling [m] */
static const double radius = 0.006, drag = 0.003, margin = 0.03;     /* lengths for bodies of that range [m] */
static const double max_growth = 4; /* maximum ratio of the deformed volume's voxels to the scan's */
static const double min_announced = 1e6;                          /* a smaller volume needs no warning [bytes] */

/* Return the cube root of the tissue's volume [m]. */
static double size_of(const pliant_geometry *scan, const uint8_t *material_of_voxel,
                      const pliant_material_table *materials)
{
    const size_t voxels = pliant_geometry_voxels(scan);
    size_t tissue = 0;
    for (size_t v = 0; v < voxels; v++) tissue += !materials->materials[material_of_voxel[v]].empty;
    return cbrt((double)tissue * scan->spacing[0] * scan->spacing[1] * scan->spacing[2]);
}

static double scale_of(double size)
{
    return size <= 0 ? 1 : size < smallest_body ? size / smallest_body : size > largest_body ? size / largest_body : 1;
}

pliant_status pliant_length_scale(const pliant_volume *scan, const pliant_labels *labels,
                                  const pliant_material_table *materials, double *out)
{
    uint8_t *material = pliant_calloc(pliant_geometry_voxels(&scan->geometry), 1);
    pliant_status status = material ? pliant_material_classify(materials, scan, labels, material)
                                    : pliant_fail_memory("the material of every voxel");
    if (status == PLIANT_OK) *out = scale_of(size_of(&scan->geometry, material, materials));
    pliant_free(material);
    return status;
}

/* Return the number of the deformed volume's voxels divided by the scan's. INFINITY: too many to count. */
static double growth_of(const pliant_model *model, double around, pliant_geometry *target)
{
    const pliant_mesh *mesh = &model->body->fine;
    const pliant_geometry *scan = &model->scan->geometry;
    for (int d = 0; d < 3; d++)
        if (scan->size[d] + 2 * around / scan->spacing[d] > 1e6) return INFINITY;
    const pliant_status status = pliant_warp_target(scan, mesh->rest, mesh->num_nodes, around, SIZE_MAX, target);
    return status == PLIANT_OK ? (double)pliant_geometry_voxels(target) / (double)pliant_geometry_voxels(scan)
                               : INFINITY;
}

/* Return the largest margin up to `maximum` with which the deformed volume is not too large, in steps of a voxel. */
static double margin_of(const pliant_model *model, double maximum)
{
    const double *spacing = model->scan->geometry.spacing, voxel = fmin(spacing[0], fmin(spacing[1], spacing[2]));
    pliant_geometry target;
    if (growth_of(model, maximum, &target) <= max_growth) return maximum;
    double low = 0, high = floor(maximum / voxel);
    while (high - low > 1) {
        const double middle = floor(0.5 * (low + high));
        if (growth_of(model, middle * voxel, &target) <= max_growth) low = middle;
        else high = middle;
    }
    return low * voxel;
}

void pliant_model_set_lengths(pliant_model *model)
{
    pliant_scene *scene = &model->scene;
    const bool by_body = scene->warp.margin == PLIANT_AUTO_LENGTH || scene->grasp.radius == PLIANT_AUTO_LENGTH ||
                         scene->cut.drag == PLIANT_AUTO_LENGTH;
    const double size = size_of(&model->scan->geometry, model->material_of_voxel, &model->materials),
                 scale = scale_of(size);
    pliant_geometry target;
    const bool is_requested = scene->warp.margin != PLIANT_AUTO_LENGTH;
    if (scene->grasp.radius == PLIANT_AUTO_LENGTH) scene->grasp.radius = scale * radius;
    if (scene->cut.drag == PLIANT_AUTO_LENGTH) scene->cut.drag = scale * drag;
    if (!is_requested) scene->warp.margin = margin_of(model, scale * margin);
    if (by_body && (scale != 1 || (!is_requested && scene->warp.margin != margin)))
        pliant_log(
            PLIANT_LOG_INFO,
            "lengths set to auto are scaled with the tissue, %.4g mm (cube root of its volume): warp/margin %.3g mm, "
            "grasp/radius %.3g mm, cut/drag %.3g mm",
            1e3 * size, 1e3 * scene->warp.margin, 1e3 * scene->grasp.radius, 1e3 * scene->cut.drag);
    const double growth = is_requested ? growth_of(model, scene->warp.margin, &target) : 1;
    if (!(growth > max_growth) || !isfinite(growth)) return;
    const double bytes = (double)pliant_geometry_voxels(&target) * (double)pliant_encoding_size(model->scan->encoding);
    if (bytes > min_announced)
        pliant_log(
            PLIANT_LOG_WARNING,
            "warp/margin %g m makes the deformed volume %d x %d x %d voxels, %.0f times the scan: it needs %.3g GB or "
            "more; use auto or a smaller margin",
            scene->warp.margin, target.size[0], target.size[1], target.size[2], growth, 1e-9 * bytes);
}
