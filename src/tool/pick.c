/* Follow a ray through the deformed volume to its isosurface ([H] 3.2). */
#include "base/fail.h"
#include "cut/cut.h"
#include "mesh/mesh.h"
#include "tool/pick.h"
#include "scan/march.h"
#include "model_data/model.h"
#include "warp/warp_state.h"

/* maximum distance between the tissue's surface and the isosurface, caused by interpolation [voxels] */
static const double skin = 2.0;

/* Clip the ray to the box of the voxels' edges; false: it misses the box. */
static bool enter_box(const pliant_geometry *geometry, const double origin[3], const double unit[3], double near,
                      double far, march_ray *ray)
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
    /* upper bound, because the diagonal is shorter than the sum of the edges; rounding errors from far away are
     * corrected */
    ray->maximum = 2;
    for (int d = 0; d < 3; d++) {
        ray->size[d] = geometry->size[d];
        ray->maximum += 2 * (int64_t)geometry->size[d];
    }
    return ray->enter <= ray->leave;
}

/* Tissue for ray queries. */
typedef struct tissue {
    const pliant_body *body; /* Nullable; distinguishes fragments of a tetrahedron */
    const pliant_mesh *mesh;
    const double *positions;
    const double *origin, *unit; /* of the ray */
    const pliant_model *model;   /* Nullable; its empty materials are not tissue */
} tissue;

/* Return whether the scan's voxel at a point of a tetrahedron has an empty material. */
static bool is_empty(const tissue *of, int32_t tet, const double barycentric[4])
{
    double rest[3] = {0}, index[3];
    size_t voxel = 0, pitch = 1;
    if (!of->model) return false;
    const pliant_geometry *scan = &of->model->scan->geometry;
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++) rest[d] += barycentric[v] * of->mesh->rest[3 * of->mesh->tets[4 * tet + v] + d];
    pliant_geometry_to_index(scan, rest, index);
    for (int d = 0; d < 3; d++) {
        voxel += pitch * (size_t)lround(fmin(fmax(index[d], 0), scan->size[d] - 1));
        pitch *= (size_t)scan->size[d];
    }
    return of->model->materials.materials[of->model->material_of_voxel[voxel]].empty;
}

/* Return the tetrahedron at a point of the ray; -1: none. */
static int32_t tissue_at(const tissue *of, double t, double barycentric[4])
{
    double point[3];
    int32_t tet = -1;
    for (int d = 0; d < 3; d++) point[d] = of->origin[d] + t * of->unit[d];
    if (!of->body || !of->body->cuts) return pliant_mesh_locate_deformed(of->mesh, of->positions, point, barycentric);
    return pliant_body_locate(of->body, of->positions, point, &tet, barycentric) ? tet : -1;
}

/* Return the tetrahedron at a crossing, or up to two voxels behind it. If the ray begins above the threshold, it
 * crosses no surface, and an empty material is not tissue. */
static int32_t tissue_behind(const tissue *of, const march_ray *ray, const march_crossing *at, double barycentric[4])
{
    for (double behind = 0; behind <= 2 * skin; behind += 1) {
        const int32_t tet = tissue_at(of, at->t + behind * ray->stride, barycentric);
        if (tet >= 0) return at->sample == 0 && is_empty(of, tet, barycentric) ? -1 : tet;
    }
    return -1;
}

/* Return where the ray enters a tetrahedron between two distances; INFINITY: it does not. */
static double enter_tet(const tissue *of, int32_t tet, double from, double to)
{
    const double *corner[4];
    double edge[3][3], side[2][3];
    for (int v = 0; v < 4; v++) corner[v] = of->positions + 3 * of->mesh->tets[4 * tet + v];
    for (int d = 0; d < 3; d++) {
        for (int v = 0; v < 3; v++) edge[v][d] = corner[v + 1][d] - corner[0][d];
        side[0][d] = of->origin[d] + from * of->unit[d] - corner[0][d];
        side[1][d] = of->origin[d] + to * of->unit[d] - corner[0][d];
        const double low = fmin(fmin(0, edge[0][d]), fmin(edge[1][d], edge[2][d])),
                     high = fmax(fmax(0, edge[0][d]), fmax(edge[1][d], edge[2][d]));
        if (fmax(side[0][d], side[1][d]) < low || fmin(side[0][d], side[1][d]) > high) return INFINITY;
    }
    /* barycentric coordinates are linear along the ray */
    double part[2][4] = {{1}, {1}}, enter = 0, leave = 1;
    for (int v = 0; v < 3; v++) {
        const double *a = edge[(v + 1) % 3], *b = edge[(v + 2) % 3];
        const double normal[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
        const double height = edge[v][0] * normal[0] + edge[v][1] * normal[1] + edge[v][2] * normal[2];
        if (height == 0) return INFINITY;
        for (int end = 0; end < 2; end++) {
            part[end][v + 1] =
                (side[end][0] * normal[0] + side[end][1] * normal[1] + side[end][2] * normal[2]) / height;
            part[end][0] -= part[end][v + 1];
        }
    }
    for (int v = 0; v < 4; v++) {
        const double first = part[0][v], change = part[1][v] - first;
        if (change > 0) enter = fmax(enter, -first / change);
        else if (change < 0) leave = fmin(leave, -first / change);
        else if (first < 0) return INFINITY;
    }
    return enter <= leave ? from + enter * (to - from) : INFINITY;
}

static void fill(const pliant_mesh *mesh, const double origin[3], const double unit[3], const march_crossing *at,
                 int32_t tet, const double barycentric[4], pliant_picked *out)
{
    pliant_picked picked = {.hit = true, .distance = at->t, .tetrahedron = tet, .intensity = at->value, .reason = ""};
    for (int d = 0; d < 3; d++) picked.point[d] = origin[d] + at->t * unit[d];
    for (int v = 0; v < 4; v++) {
        picked.barycentric[v] = barycentric[v];
        for (int d = 0; d < 3; d++) picked.rest[d] += barycentric[v] * mesh->rest[3 * mesh->tets[4 * tet + v] + d];
    }
    *out = picked;
}

/* Location of the volume: in the warp that draws it, possibly on a GPU, or in host memory. */
typedef struct place {
    const pliant_warp *warp;
    const pliant_volume *volume;
    const pliant_model *model; /* Nullable */
} place;

/* Return the first crossing at sample `first` or later; the sample before it, if any, counts as above the threshold. */
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

/* At a crossing without tissue, find the first tissue before the values fall below the threshold. */
static int32_t tissue_beyond(place *in, const march_ray *ray, const tissue *of, march_crossing *at,
                             double barycentric[4])
{
    if (!in->volume) in->volume = pliant_warp_volume(in->warp);
    const march_voxels voxels = {in->volume->voxels, in->volume->encoding, in->volume->slope, in->volume->intercept};
    double first = INFINITY, last = at->t;
    for (int64_t n = at->sample + 1; march_has(ray, n) && march_above(&voxels, ray, march_at(ray, n)); n++)
        last = march_at(ray, n);
    for (int32_t tet = 0; tet < of->mesh->num_tets; tet++) first = fmin(first, enter_tet(of, tet, at->t, last));
    for (double t = first; t <= last; t += ray->stride) {
        const int32_t tet = march_above(&voxels, ray, t) ? tissue_at(of, t, barycentric) : -1;
        if (tet < 0 || is_empty(of, tet, barycentric)) continue;
        at->t = t;
        at->value = (float)march_value(&voxels, ray, t);
        return tet;
    }
    return -1;
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
        return pliant_fail(PLIANT_ERROR_ARGUMENT,
                           "pick: the ray's origin, direction, near and far, and the threshold must be finite");
    double length = sqrt(given->direction[0] * given->direction[0] + given->direction[1] * given->direction[1] +
                         given->direction[2] * given->direction[2]);
    if (!(length > 0) || !isfinite(length))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "pick: the ray's direction must have a length above 0 (it has %g)",
                           length);
    double unit[3], barycentric[4];
    for (int d = 0; d < 3; d++) unit[d] = given->direction[d] / length;

    march_ray ray = {.threshold = threshold};
    *out = (pliant_picked){.hit = false, .reason = "the ray does not meet the deformed volume between near and far"};
    if (!enter_box(geometry, given->origin, unit, given->near, given->far, &ray)) return PLIANT_OK;
    const tissue of = {in.warp ? in.warp->body : NULL, mesh, positions, given->origin, unit, in.model};
    march_crossing at = next_crossing(&in, &ray, 0);
    out->reason = at.sample < 0 ? "no value along the ray reaches the threshold"
                                : "where values along the ray reach the threshold there is no tissue";
    while (at.sample >= 0) {
        int32_t tet = tissue_behind(&of, &ray, &at, barycentric);
        if (tet < 0) tet = tissue_beyond(&in, &ray, &of, &at, barycentric);
        if (tet >= 0) {
            fill(mesh, given->origin, unit, &at, tet, barycentric, out);
            return PLIANT_OK;
        }
        at = next_crossing(&in, &ray, at.sample + 1);
    }
    return PLIANT_OK;
}

pliant_status pliant_pick(const pliant_volume *volume, const pliant_mesh *mesh, const double *positions,
                          const pliant_ray *ray, double threshold, pliant_picked *out)
{
    return pick((place){.volume = volume}, &volume->geometry, mesh, positions, ray, threshold, out);
}

pliant_status pliant_pick_warped(const pliant_warp *warp, const double *positions, const pliant_ray *ray,
                                 double threshold, pliant_picked *out)
{
    return pick((place){.warp = warp}, pliant_warp_geometry(warp), pliant_warp_mesh(warp), positions, ray, threshold,
                out);
}

pliant_status pliant_pick_tissue(const pliant_model *model, const pliant_warp *warp, const double *positions,
                                 const pliant_ray *ray, double threshold, pliant_picked *out)
{
    return pick((place){.warp = warp, .model = model}, pliant_warp_geometry(warp), pliant_warp_mesh(warp), positions,
                ray, threshold, out);
}
