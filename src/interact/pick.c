/* A ray marched through the deformed volume to its isosurface ([H] 3.2). */
#include "base/fail.h"
#include "pliant/cut.h"
#include "scan/march.h"
#include "pliant/pick.h"
#include "warp/state.h"

/* the surface of the tissue and the isosurface may lie this many voxels apart: the volume is interpolated across it */
static const double skin = 2.0;

/* clip the ray against the box of the voxels' edges; false: it passes by */
static bool enter_box(const pliant_geometry *geometry, const double origin[3], const double unit[3], double near, double far,
                      march_ray *ray)
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
    /* the box's diagonal is shorter than the sum of its edges; from too far away rounding makes it longer */
    ray->most = 2;
    for (int d = 0; d < 3; d++) {
        ray->size[d] = geometry->size[d];
        ray->most += 2 * (int64_t)geometry->size[d];
    }
    return ray->enter <= ray->leave;
}

/* the tissue at a point of the isosurface, or up to two voxels behind it; body: Nullable, to tell fragments of a tetrahedron apart */
static int32_t tissue_at(const march_ray *ray, const pliant_body *body, const pliant_mesh *mesh, const double *positions, const double origin[3],
                         const double unit[3], double t, double barycentric[4])
{
    const bool cut = body && body->cuts;
    for (double behind = 0; behind <= 2 * skin; behind += 1) {
        double point[3];
        for (int d = 0; d < 3; d++) point[d] = origin[d] + (t + behind * ray->stride) * unit[d];
        int32_t tet = cut ? -1 : pliant_mesh_locate_deformed(mesh, positions, point, barycentric);
        if (cut && !pliant_body_locate(body, positions, point, &tet, barycentric)) continue;
        if (tet >= 0) return tet;
    }
    return -1;
}

static void fill(const pliant_mesh *mesh, const double origin[3], const double unit[3], const march_crossing *at, int32_t tet,
                 const double barycentric[4], pliant_picked *out)
{
    pliant_picked picked = {.hit = true, .distance = at->t, .tetrahedron = tet, .intensity = at->value};
    for (int d = 0; d < 3; d++) picked.point[d] = origin[d] + at->t * unit[d];
    for (int v = 0; v < 4; v++) {
        picked.barycentric[v] = barycentric[v];
        for (int d = 0; d < 3; d++) picked.rest[d] += barycentric[v] * mesh->rest[3 * mesh->tets[4 * tet + v] + d];
    }
    *out = picked;
}

/* Where the volume is: with the warp that draws it, perhaps on a GPU, or (then a warp is not looked at) here. */
typedef struct place {
    const pliant_warp *warp;
    const pliant_volume *volume;
} place;

/* The first crossing at this sample or after it; the sample before it counts as above, where there is one. */
static march_crossing next_crossing(place *in, const march_ray *ray, int64_t first)
{
    march_crossing found = {.sample = -1};
    if (!in->volume && pliant_warp_cross(in->warp, ray, first, &found)) return found;
    if (!in->volume) in->volume = pliant_warp_volume(in->warp);
    const march_voxels voxels = {in->volume->voxels, in->volume->encoding, in->volume->slope, in->volume->intercept};
    bool was_above = first > 0;
    for (int64_t n = first; march_has(ray, n); n++) {
        bool above = march_above(&voxels, ray, march_at(ray, n));
        if (above && !was_above) return march_refine(&voxels, ray, n);
        was_above = above;
    }
    return found;
}

static bool ray_is_sound(const pliant_ray *ray, double threshold)
{
    bool finite = isfinite(threshold) && isfinite(ray->near) && isfinite(ray->far);
    for (int d = 0; d < 3; d++) finite = finite && isfinite(ray->origin[d]) && isfinite(ray->direction[d]);
    return finite;
}

static pliant_status pick(place in, const pliant_geometry *geometry, const pliant_mesh *mesh, const double *positions,
                          const pliant_ray *given, double threshold, pliant_picked *out)
{
    if (!ray_is_sound(given, threshold))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "pick: the ray's origin, direction, near and far, and the threshold must be finite");
    double length = sqrt(given->direction[0] * given->direction[0] + given->direction[1] * given->direction[1] +
                         given->direction[2] * given->direction[2]);
    if (!(length > 0) || !isfinite(length))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "pick: the ray's direction must have a length above 0 (it has %g)", length);
    double unit[3], barycentric[4];
    for (int d = 0; d < 3; d++) unit[d] = given->direction[d] / length;

    march_ray ray = {.threshold = threshold};
    *out = (pliant_picked){.hit = false};
    if (!enter_box(geometry, given->origin, unit, given->near, given->far, &ray)) return PLIANT_OK;
    const pliant_body *body = in.warp ? in.warp->body : NULL;
    march_crossing at = next_crossing(&in, &ray, 0);
    while (at.sample >= 0) {
        int32_t tet = tissue_at(&ray, body, mesh, positions, given->origin, unit, at.t, barycentric);
        if (tet >= 0) {
            fill(mesh, given->origin, unit, &at, tet, barycentric, out);
            return PLIANT_OK;
        }
        at = next_crossing(&in, &ray, at.sample + 1);
    }
    return PLIANT_OK;
}

pliant_status pliant_pick(const pliant_volume *volume, const pliant_mesh *mesh, const double *positions, const pliant_ray *ray,
                          double threshold, pliant_picked *out)
{
    return pick((place){.volume = volume}, &volume->geometry, mesh, positions, ray, threshold, out);
}

pliant_status pliant_pick_warped(const pliant_warp *warp, const double *positions, const pliant_ray *ray, double threshold,
                                 pliant_picked *out)
{
    return pick((place){.warp = warp}, pliant_warp_geometry(warp), pliant_warp_mesh(warp), positions, ray, threshold, out);
}
