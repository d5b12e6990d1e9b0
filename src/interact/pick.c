/* A ray marched through the deformed volume to its isosurface ([H] 3.2). */
#include "core/fail.h"
#include "pliant/pick.h"

#include <math.h>

/* the surface of the tissue and the isosurface may lie this many voxels apart: the volume is interpolated across it */
static const double skin = 2.0;

/* the ray in continuous voxel indices: index(t) = start + t * step, t in metres along the ray */
typedef struct march {
    const pliant_volume *volume;
    double start[3], step[3];
    double enter, leave; /* part of the ray inside the volume's box and within near and far [m] */
    double stride;       /* half a voxel [m] */
} march;

static double stored_at(const pliant_volume *volume, int32_t i, int32_t j, int32_t k)
{
    const int32_t *size = volume->geometry.size;
    size_t index = (size_t)i + (size_t)size[0] * ((size_t)j + (size_t)size[1] * (size_t)k);
    return pliant_volume_value(volume, index);
}

/* trilinear; beyond the centres of the outermost voxels their values go on */
static double value_at(const march *ray, double t)
{
    const int32_t *size = ray->volume->geometry.size;
    int32_t low[3], high[3];
    double part[3];
    for (int d = 0; d < 3; d++) {
        double index = fmin(fmax(ray->start[d] + t * ray->step[d], 0.0), size[d] - 1.0);
        low[d] = (int32_t)index;
        high[d] = low[d] + 1 < size[d] ? low[d] + 1 : low[d];
        part[d] = index - low[d];
    }
    double value = 0;
    for (int corner = 0; corner < 8; corner++) {
        int a = corner & 1, b = corner >> 1 & 1, c = corner >> 2;
        double weight = (a ? part[0] : 1 - part[0]) * (b ? part[1] : 1 - part[1]) * (c ? part[2] : 1 - part[2]);
        if (weight > 0)
            value += weight * stored_at(ray->volume, a ? high[0] : low[0], b ? high[1] : low[1], c ? high[2] : low[2]);
    }
    return value;
}

/* clip the ray against the box of the voxels' edges; false: it passes by */
static bool enter_box(const pliant_geometry *geometry, const double origin[3], const double unit[3], double near, double far,
                      march *ray)
{
    double tip[3], ahead[3];
    for (int d = 0; d < 3; d++) tip[d] = origin[d] + unit[d];
    pliant_geometry_to_index(geometry, origin, ray->start);
    pliant_geometry_to_index(geometry, tip, ahead);
    ray->enter = fmax(near, 0.0);
    ray->leave = far > 0 ? far : INFINITY;
    double voxels_a_metre = 0;
    for (int d = 0; d < 3; d++) {
        ray->step[d] = ahead[d] - ray->start[d];
        voxels_a_metre += ray->step[d] * ray->step[d];
        double low = -0.5 - ray->start[d], high = geometry->size[d] - 0.5 - ray->start[d];
        if (ray->step[d] == 0) {
            if (low > 0 || high < 0) return false;
            continue;
        }
        double a = low / ray->step[d], b = high / ray->step[d];
        ray->enter = fmax(ray->enter, fmin(a, b));
        ray->leave = fmin(ray->leave, fmax(a, b));
    }
    ray->stride = 0.5 / sqrt(voxels_a_metre);
    return ray->enter <= ray->leave;
}

/* below the threshold at `low`, not below at `high`: where it is crossed */
static double refine(const march *ray, double threshold, double low, double high)
{
    double enough = 2e-4 * ray->stride;
    while (high - low > enough) {
        double middle = 0.5 * (low + high);
        if (!(middle > low && middle < high)) break;
        if (value_at(ray, middle) >= threshold) high = middle;
        else low = middle;
    }
    return high;
}

/* the tissue at a point of the isosurface, or up to two voxels behind it */
static int32_t tissue_at(const march *ray, const pliant_mesh *mesh, const double *positions, const double origin[3],
                         const double unit[3], double t, double barycentric[4])
{
    for (double behind = 0; behind <= 2 * skin; behind += 1) {
        double point[3];
        for (int d = 0; d < 3; d++) point[d] = origin[d] + (t + behind * ray->stride) * unit[d];
        int32_t tet = pliant_mesh_locate_deformed(mesh, positions, point, barycentric);
        if (tet >= 0) return tet;
    }
    return -1;
}

static void fill(const march *ray, const pliant_mesh *mesh, const double origin[3], const double unit[3], double t, int32_t tet,
                 const double barycentric[4], pliant_picked *out)
{
    pliant_picked picked = {.hit = true, .distance = t, .tetrahedron = tet, .intensity = (float)value_at(ray, t)};
    for (int d = 0; d < 3; d++) picked.point[d] = origin[d] + t * unit[d];
    for (int v = 0; v < 4; v++) {
        picked.barycentric[v] = barycentric[v];
        for (int d = 0; d < 3; d++) picked.rest[d] += barycentric[v] * mesh->rest[3 * mesh->tets[4 * tet + v] + d];
    }
    *out = picked;
}

static bool ray_is_sound(const pliant_ray *ray, double threshold)
{
    bool finite = isfinite(threshold) && isfinite(ray->near) && isfinite(ray->far);
    for (int d = 0; d < 3; d++) finite = finite && isfinite(ray->origin[d]) && isfinite(ray->direction[d]);
    return finite;
}

pliant_status pliant_pick(const pliant_volume *volume, const pliant_mesh *mesh, const double *positions, const pliant_ray *given,
                          double threshold, pliant_picked *out)
{
    if (!ray_is_sound(given, threshold))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "pick: the ray's origin, direction, near and far, and the threshold must be finite");
    double length = sqrt(given->direction[0] * given->direction[0] + given->direction[1] * given->direction[1] +
                         given->direction[2] * given->direction[2]);
    if (!(length > 0) || !isfinite(length))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "pick: the ray's direction must have a length above 0 (it has %g)", length);
    double unit[3], barycentric[4];
    for (int d = 0; d < 3; d++) unit[d] = given->direction[d] / length;

    march ray = {.volume = volume};
    *out = (pliant_picked){.hit = false};
    if (!enter_box(&volume->geometry, given->origin, unit, given->near, given->far, &ray)) return PLIANT_OK;
    /* a NaN is below every threshold: comparisons with it are false */
    bool was_above = false;
    double last = ray.enter;
    /* the box's diagonal is shorter than the sum of its edges; from too far away rounding makes it longer */
    const int32_t *size = volume->geometry.size;
    int64_t most = 2 * ((int64_t)size[0] + size[1] + size[2]) + 2;
    for (int64_t n = 0; (last < ray.leave || n == 0) && n <= most; n++) {
        double t = fmin(ray.enter + (double)n * ray.stride, ray.leave);
        bool above = value_at(&ray, t) >= threshold;
        if (above && !was_above) {
            double surface = n == 0 ? t : refine(&ray, threshold, last, t);
            int32_t tet = tissue_at(&ray, mesh, positions, given->origin, unit, surface, barycentric);
            if (tet >= 0) {
                fill(&ray, mesh, given->origin, unit, surface, tet, barycentric, out);
                return PLIANT_OK;
            }
        }
        was_above = above;
        last = t;
    }
    return PLIANT_OK;
}
