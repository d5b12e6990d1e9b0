/* Find the links that a blade severs. The fragments map both ends of a link to their deformed positions, where the
 * blade is tested. The inverse map only selects candidates. All links of a voxel therefore agree on its side of the
 * blade. */
#include "cut/cut_stages.h"

#include "cut/segment_through_triangle.h"

#include "base/buffer.h"
#include "base/fail.h"
#include "base/matrix.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <stdlib.h>
#include <string.h>

static inline double lesser(double a, double b) { return a < b ? a : b; }
static inline double greater(double a, double b) { return a > b ? a : b; }

/* map from voxel indices of a fragment to deformed positions: x = axes index + origin */
typedef struct voxel_map {
    double axes[9], origin[3];
} voxel_map;

/* Group of triangles whose common bounding box is tested first. */
enum { RUN = 8 };
typedef struct triangle_run {
    double low[3], high[3];
} triangle_run;

typedef struct severing {
    cut_work *work;
    double rest_of_index[9]; /* voxel axes times spacing */
    double slack;            /* [m] */
    double reach;            /* two voxels in a stretched tetrahedron, as a fraction of its extent */
    double scan_handedness;  /* handedness of the scan: 1 or -1 */
    cut_strip strip;
    int32_t *near;           /* triangles near the current fragment */
    int32_t num_near;
    triangle_run *run;       /* groups of these triangles */
    /* planes around the triangles near a fragment: voxels are candidates if slab[3] <= slab[0..2] . index <= slab[4] */
    double slab[5];
    double between[2];       /* the same triangles lie between these two values, according to the fragment's map */
    cut_sparse map_of;       /* per fine tetrahedron: 1 + index into maps */
    int32_t num_maps, map_capacity;
    voxel_map *maps;
} severing;

/* The strip is shifted by less than 1/50 voxel, along no axis or diagonal. Voxel centres exactly on a blade, up to
 * rounding and the tolerance of the tissue's positions, then all lie on the same side. */
static const double tie_breaking_shift[3] = {-1. / 64, -0.7549 / 64, -0.5698 / 64};

/* ---- maps */

static void find_map(const severing *cut, int32_t tet, voxel_map *map)
{
    const pliant_mesh *fine = &cut->work->body->fine;
    const pliant_geometry *geometry = &cut->work->voxels->geometry;
    const int32_t *nodes = fine->tets + 4 * (size_t)tet;
    double gradients[12], spread[9] = {0};
    pliant_mesh_gradients(fine, tet, gradients);
    for (int v = 0; v < 4; v++)
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                spread[3 * r + c] += cut->work->positions[3 * (size_t)nodes[v] + r] * gradients[3 * v + c];
    for (int r = 0; r < 3; r++) {
        map->origin[r] = cut->work->positions[3 * (size_t)nodes[0] + r];
        for (int c = 0; c < 3; c++) {
            map->axes[3 * r + c] = 0;
            for (int m = 0; m < 3; m++) map->axes[3 * r + c] += spread[3 * r + m] * cut->rest_of_index[3 * m + c];
            map->origin[r] += spread[3 * r + c] * (geometry->origin[c] - fine->rest[3 * (size_t)nodes[0] + c]);
        }
    }
}

static const voxel_map *map_of(severing *cut, int32_t tet)
{
    const int32_t known = cut_sparse_get(&cut->map_of, tet);
    if (known > 0) return cut->maps + known - 1;
    if (!pliant_reserve(&cut->maps, &cut->map_capacity, cut->num_maps, 256, sizeof *cut->maps) ||
        !cut_sparse_set(&cut->map_of, tet, cut->num_maps + 1))
        return NULL;
    find_map(cut, tet, cut->maps + cut->num_maps);
    return cut->maps + cut->num_maps++;
}

static void place_in(const voxel_map *map, const int32_t at[3], double out[3])
{
    for (int r = 0; r < 3; r++)
        out[r] =
            map->axes[3 * r] * at[0] + map->axes[3 * r + 1] * at[1] + map->axes[3 * r + 2] * at[2] + map->origin[r];
}

/* ---- intersection test */

/* Return whether two boxes are disjoint. */
static inline bool boxes_are_disjoint(const double low[3], const double high[3], const double other_low[3],
                                      const double other_high[3])
{
    return low[0] > other_high[0] || high[0] < other_low[0] || low[1] > other_high[1] || high[1] < other_low[1] ||
           low[2] > other_high[2] || high[2] < other_low[2];
}

/* Return the triangle that separates two points, or NULL. */
static const cut_triangle *find_separating_triangle(const severing *cut, const double a[3], const double b[3])
{
    double low[3], high[3];
    for (int d = 0; d < 3; d++) {
        low[d] = lesser(a[d], b[d]) - cut->slack;
        high[d] = greater(a[d], b[d]) + cut->slack;
    }
    for (int32_t first = 0; first < cut->num_near; first += RUN) {
        const triangle_run *run = cut->run + first / RUN;
        if (boxes_are_disjoint(run->low, run->high, low, high)) continue;
        for (int32_t n = first; n < cut->num_near && n < first + RUN; n++) {
            const cut_triangle *one = cut->strip.triangles + cut->near[n];
            if (!boxes_are_disjoint(one->low, one->high, low, high) &&
                pliant_passes_through(a, b, one->corner, one->normal, cut->slack))
                return one;
        }
    }
    return NULL;
}

/* Return the area contribution of a severed link at rest, |n_d| A_d. n is the blade's unit normal, and A_d the area of
 * the face between two voxels. A staircase of such faces then has the area of the plane that it approximates
 * (Gauss). */
static double area_of(const severing *cut, const voxel_map *map, const double normal[3], int axis)
{
    const double *spacing = cut->work->voxels->geometry.spacing;
    double along[3], squares = 0;
    for (int d = 0; d < 3; d++) { /* normals transform with the transposed map */
        along[d] =
            (map->axes[d] * normal[0] + map->axes[3 + d] * normal[1] + map->axes[6 + d] * normal[2]) / spacing[d];
        squares += along[d] * along[d];
    }
    const double face = spacing[(axis + 1) % 3] * spacing[(axis + 2) % 3];
    return squares > 0 ? face * fabs(along[axis]) / sqrt(squares) : face;
}

pliant_status pliant_cut_add_link(cut_work *work, uint32_t link, double area)
{
    if (work->num_links == work->link_capacity) {
        const int32_t capacity = work->link_capacity > 0 ? 2 * work->link_capacity : 1024;
        if (!pliant_grow(&work->link, (size_t)capacity, sizeof *work->link) ||
            !pliant_grow(&work->link_area, (size_t)capacity, sizeof *work->link_area))
            return pliant_fail_memory("the severed links");
        work->link_capacity = capacity;
    }
    work->link[work->num_links] = link;
    work->link_area[work->num_links++] = area;
    return PLIANT_OK;
}

static pliant_status add_bridge(cut_work *work, int32_t bridge)
{
    if (!pliant_reserve(&work->bridge, &work->bridge_capacity, work->num_bridges, 64, sizeof *work->bridge))
        return pliant_fail_memory("the severed bridges");
    work->bridge[work->num_bridges++] = bridge;
    return PLIANT_OK;
}

/* Return the fine tetrahedron to which an owned voxel belongs. */
static int32_t carrier_of(const cut_work *work, int32_t voxel)
{
    const int32_t tet = work->voxels->owner[voxel], state = cut_state(work, tet);
    return state == 0
               ? tet
               : work->cuts
                     ->voxel_fragment[work->cuts->voxel_start[-state - 1] + pliant_voxel_in(work->voxels, tet, voxel)];
}

/* side: slab[0..2] . at */
static pliant_status try_link(severing *cut, int32_t tet, int32_t voxel, const int32_t at[3], double side, int axis,
                              int direction)
{
    cut_work *work = cut->work;
    const pliant_voxels *voxels = work->voxels;
    if (at[axis] + direction < 0 || at[axis] + direction >= voxels->geometry.size[axis]) return PLIANT_OK;
    const int32_t other = voxel + direction * pliant_stride_of(voxels, axis);
    if (voxels->owner[other] < 0) return PLIANT_OK;
    const int32_t with = carrier_of(work, other);
    if (with == tet) {
        const double beyond = side + cut->slab[axis];
        if (direction < 0) return PLIANT_OK; /* tested from the other end */
        if ((side < cut->between[0] && beyond < cut->between[0]) ||
            (side > cut->between[1] && beyond > cut->between[1]))
            return PLIANT_OK;
    }
    int32_t there[3] = {at[0], at[1], at[2]};
    double a[3], b[3];
    there[axis] += direction;
    const voxel_map *to = map_of(cut, with), *from = map_of(cut, tet);
    if (!to || !from) return pliant_fail_memory("the maps of fragments");
    place_in(from, at, a);
    place_in(to, there, b);
    /* both orders of the points give the same floating-point result */
    const cut_triangle *one = direction > 0 ? find_separating_triangle(cut, a, b) : find_separating_triangle(cut, b, a);
    if (!one) return PLIANT_OK;
    const pliant_links links = {.voxels = voxels, .cuts = work->cuts};
    const int32_t lower = direction > 0 ? voxel : other;
    if (pliant_link_severed(&links, lower, direction > 0 ? at : there, axis)) return PLIANT_OK;
    return pliant_cut_add_link(work, 4 * (uint32_t)lower + (uint32_t)axis,
                               area_of(cut, direction > 0 ? from : to, one->normal, axis));
}

static pliant_status try_bridge(severing *cut, int32_t bridge)
{
    cut_work *work = cut->work;
    const voxel_map *map[2];
    double at[2][3];
    for (int end = 0; end < 2; end++) { /* map_of may move the array of maps, so no pointer is kept */
        if (!map_of(cut, carrier_of(work, work->voxels->bridge[2 * bridge + end])))
            return pliant_fail_memory("the maps of fragments");
    }
    for (int end = 0; end < 2; end++) {
        const int32_t voxel = work->voxels->bridge[2 * bridge + end];
        int32_t place[3];
        map[end] = map_of(cut, carrier_of(work, voxel));
        pliant_place_of(work->voxels, voxel, place);
        place_in(map[end], place, at[end]);
    }
    return find_separating_triangle(cut, at[0], at[1]) && !pliant_bridge_severed(work->cuts, bridge)
               ? add_bridge(work, bridge)
               : PLIANT_OK;
}

/* ---- candidates */

/* Collect the triangles that overlap a box around a fragment, its tetrahedron enlarged by two voxels. Return false if
 * no triangle does. Otherwise the box becomes its intersection with the triangles' box. */
static bool find_near(severing *cut, double low[3], double high[3])
{
    double from[3] = {INFINITY, INFINITY, INFINITY}, to[3] = {-INFINITY, -INFINITY, -INFINITY};
    cut->num_near = 0;
    for (int32_t t = 0; t < cut->strip.count; t++) {
        const cut_triangle *one = cut->strip.triangles + t;
        if (boxes_are_disjoint(one->low, one->high, low, high)) continue;
        triangle_run *run = cut->run + cut->num_near / RUN;
        if (cut->num_near % RUN == 0)
            *run = (triangle_run){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
        cut->near[cut->num_near++] = t;
        for (int d = 0; d < 3; d++) {
            run->low[d] = lesser(run->low[d], one->low[d]);
            run->high[d] = greater(run->high[d], one->high[d]);
            from[d] = lesser(from[d], one->low[d]);
            to[d] = greater(to[d], one->high[d]);
        }
    }
    for (int d = 0; d < 3; d++) {
        low[d] = greater(low[d], from[d]);
        high[d] = lesser(high[d], to[d]);
    }
    return cut->num_near > 0;
}

/* Map a box back to voxel indices, enlarged by two voxels. Return all voxels where the map is singular or inverted. */
static void map_box_to_index(const voxel_map *map, double scan_handedness, const double low[3], const double high[3],
                             double from[3], double to[3])
{
    const double *m = map->axes;
    const double minors[9] = {m[4] * m[8] - m[5] * m[7], m[2] * m[7] - m[1] * m[8], m[1] * m[5] - m[2] * m[4],
                              m[5] * m[6] - m[3] * m[8], m[0] * m[8] - m[2] * m[6], m[2] * m[3] - m[0] * m[5],
                              m[3] * m[7] - m[4] * m[6], m[1] * m[6] - m[0] * m[7], m[0] * m[4] - m[1] * m[3]};
    const double determinant = m[0] * minors[0] + m[1] * minors[3] + m[2] * minors[6];
    double lengths = 1;
    for (int c = 0; c < 3; c++) lengths *= sqrt(m[c] * m[c] + m[3 + c] * m[3 + c] + m[6 + c] * m[6 + c]);
    for (int r = 0; r < 3; r++) {
        from[r] = INFINITY;
        to[r] = -INFINITY;
        for (int corner = 0; corner < 8; corner++) {
            double at = 0;
            for (int d = 0; d < 3; d++)
                at += minors[3 * r + d] / determinant * ((corner >> d & 1 ? high[d] : low[d]) - map->origin[d]);
            from[r] = lesser(from[r], at - 2);
            to[r] = greater(to[r], at + 2);
        }
        if (!(scan_handedness * determinant > 1e-3 * lengths) || !(from[r] <= to[r])) {
            from[r] = -INFINITY;
            to[r] = INFINITY;
        }
    }
}

/* Find two planes in voxel indices that enclose the triangles near a fragment, enlarged by three links on either
 * side. */
static void find_slab(severing *cut, const voxel_map *map)
{
    double normal[3] = {0}, low = INFINITY, high = -INFINITY, steps = 0, offset = 0, length = 0;
    for (int32_t n = 0; n < cut->num_near; n++)
        for (int d = 0; d < 3; d++) normal[d] += cut->strip.triangles[cut->near[n]].normal[d];
    for (int32_t n = 0; n < cut->num_near; n++)
        for (int v = 0; v < 3; v++) {
            const double *corner = cut->strip.triangles[cut->near[n]].corner + 3 * v;
            const double at = normal[0] * corner[0] + normal[1] * corner[1] + normal[2] * corner[2];
            low = lesser(low, at);
            high = greater(high, at);
        }
    for (int c = 0; c < 3; c++) {
        cut->slab[c] = normal[0] * map->axes[c] + normal[1] * map->axes[3 + c] + normal[2] * map->axes[6 + c];
        steps += fabs(cut->slab[c]);
        offset += normal[c] * map->origin[c];
        length += fabs(normal[c]);
    }
    /* tolerance of the intersection test plus rounding of these sums */
    const double more = 1e-3 * steps + 4 * length * cut->slack;
    cut->between[0] = low - offset - more;
    cut->between[1] = high - offset + more;
    cut->slab[3] = low - offset - 3 * steps;
    cut->slab[4] = high - offset + 3 * steps;
}

/* Test the links of the voxels of an initial tetrahedron between two indices that belong to one fine tetrahedron, and
 * its bridges. */
static pliant_status try_voxels(severing *cut, int32_t tet, int32_t owner, const double from[3], const double to[3])
{
    const cut_work *work = cut->work;
    const pliant_voxels *voxels = work->voxels;
    const int32_t first = voxels->start[owner], state = cut_state(work, owner);
    const int32_t *carrier = state < 0 ? work->cuts->voxel_fragment + work->cuts->voxel_start[-state - 1] : NULL;
    pliant_status status = PLIANT_OK;
    int32_t last = -2, at[3] = {0};
    for (int32_t v = first; v < voxels->start[owner + 1] && status == PLIANT_OK; v++) {
        if (carrier && carrier[v - first] != tet) continue;
        pliant_place_after(voxels, voxels->voxel[v], &last, at);
        if (at[0] < from[0] || at[0] > to[0] || at[1] < from[1] || at[1] > to[1] || at[2] < from[2] || at[2] > to[2])
            continue;
        const double side = cut->slab[0] * at[0] + cut->slab[1] * at[1] + cut->slab[2] * at[2];
        if (side < cut->slab[3] || side > cut->slab[4]) continue;
        for (int axis = 0; axis < 3 && status == PLIANT_OK; axis++) {
            status = try_link(cut, tet, voxels->voxel[v], at, side, axis, 1);
            if (status == PLIANT_OK) status = try_link(cut, tet, voxels->voxel[v], at, side, axis, -1);
        }
    }
    for (int32_t b = voxels->bridge_start[owner]; b < voxels->bridge_start[owner + 1] && status == PLIANT_OK; b++)
        status = try_bridge(cut, b);
    for (int32_t b = voxels->adjacent_start[owner]; b < voxels->adjacent_start[owner + 1] && status == PLIANT_OK; b++)
        status = try_bridge(cut, voxels->adjacent[b]);
    return status;
}

static pliant_status try_fragment(severing *cut, int32_t tet)
{
    const cut_work *work = cut->work;
    const int32_t *nodes = work->body->fine.tets + 4 * (size_t)tet;
    double low[3], high[3], from[3], to[3];
    for (int d = 0; d < 3; d++) {
        const double x[4] = {work->positions[3 * (size_t)nodes[0] + d], work->positions[3 * (size_t)nodes[1] + d],
                             work->positions[3 * (size_t)nodes[2] + d], work->positions[3 * (size_t)nodes[3] + d]};
        low[d] = lesser(lesser(x[0], x[1]), lesser(x[2], x[3]));
        high[d] = greater(greater(x[0], x[1]), greater(x[2], x[3]));
        const double more = cut->reach * (high[d] - low[d]) + cut->slack;
        if (!(low[d] - more <= cut->strip.high[d] && high[d] + more >= cut->strip.low[d])) return PLIANT_OK;
    }
    const voxel_map *map = map_of(cut, tet);
    if (!map) return pliant_fail_memory("the maps of fragments");
    for (int d = 0; d < 3; d++) {
        const double more = 2 * (fabs(map->axes[3 * d]) + fabs(map->axes[3 * d + 1]) + fabs(map->axes[3 * d + 2]));
        low[d] -= more;
        high[d] += more;
    }
    if (!find_near(cut, low, high)) return PLIANT_OK;
    map_box_to_index(map, cut->scan_handedness, low, high, from, to);
    find_slab(cut, map);
    pliant_status status = try_voxels(cut, tet, cut_parent(work, tet), from, to);
    for (int32_t c = 0; work->cuts && c < work->cuts->num_chips && status == PLIANT_OK; c++)
        if (work->cuts->chip[2 * c + 1] == tet) status = try_voxels(cut, tet, work->cuts->chip[2 * c], from, to);
    return status;
}

/* ---- sort and remove duplicates */

typedef struct severed {
    uint32_t link;
    double area;
} severed;

static int by_link(const void *a, const void *b)
{
    const severed *i = a, *j = b;
    return i->link < j->link ? -1 : i->link > j->link;
}

pliant_status pliant_cut_sort_severed(cut_work *work)
{
    if (work->num_links > 0) {
        severed *all = pliant_calloc((size_t)work->num_links, sizeof *all);
        if (!all) return pliant_fail_memory("the severed links");
        for (int32_t i = 0; i < work->num_links; i++) all[i] = (severed){work->link[i], work->link_area[i]};
        qsort(all, (size_t)work->num_links, sizeof *all, by_link);
        int32_t count = 0;
        for (int32_t i = 0; i < work->num_links; i++) {
            if (count > 0 && work->link[count - 1] == all[i].link) continue;
            work->link[count] = all[i].link;
            work->link_area[count++] = all[i].area;
        }
        work->num_links = count;
        pliant_free(all);
    }
    if (work->num_bridges > 0) work->num_bridges = sort_once(work->bridge, work->num_bridges);
    return PLIANT_OK;
}

pliant_status pliant_cut_sever(cut_work *work, const pliant_cut_sweep *sweep)
{
    const pliant_geometry *geometry = &work->voxels->geometry;
    const double spacing = lesser(geometry->spacing[0], lesser(geometry->spacing[1], geometry->spacing[2]));
    severing cut = {.work = work, .slack = 1e-9 * spacing};
    const double aside[3] = {tie_breaking_shift[0] * spacing, tie_breaking_shift[1] * spacing,
                             tie_breaking_shift[2] * spacing};
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            cut.rest_of_index[3 * r + c] = geometry->direction[3 * r + c] * geometry->spacing[c];
    const double *cell = work->body->fine.cell_size; /* for an octree, the size of its smallest leaves */
    cut.scan_handedness = pliant_determinant(geometry->direction) < 0 ? -1 : 1;
    /* the minimum height of the lattice's tetrahedra is 0.58 of a cube's side, and less next to bone */
    cut.reach = (work->body->fine.num_moved > 0 ? 8 : 4) *
                greater(geometry->spacing[0], greater(geometry->spacing[1], geometry->spacing[2])) /
                lesser(cell[0], lesser(cell[1], cell[2]));
    uint8_t *may = NULL;
    pliant_status status = pliant_cut_strip(sweep, aside, &cut.strip);
    if (status == PLIANT_OK && cut.strip.count > 0) {
        cut.near = pliant_calloc((size_t)cut.strip.count, sizeof *cut.near);
        cut.run = pliant_calloc((size_t)(cut.strip.count / RUN) + 1, sizeof *cut.run);
        if (!cut_sparse_create(work->body->fine.num_tets, &cut.map_of) || !cut.near || !cut.run)
            status = pliant_fail_memory("the maps of fragments");
        if (status == PLIANT_OK)
            status = pliant_cut_find_near_tets(work->body, work->positions, &cut.strip, cut.reach, cut.slack, &may);
        const size_t tets = (size_t)work->body->fine.num_tets;
        for (const uint8_t *at = may; status == PLIANT_OK && (at = memchr(at, 1, tets - (size_t)(at - may))); at++)
            status = try_fragment(&cut, (int32_t)(at - may));
        if (status == PLIANT_OK) status = pliant_cut_sort_severed(work);
    }
    PLIANT_FREE(cut.strip.triangles, cut.near, cut.run, may);
    cut_sparse_free(&cut.map_of);
    pliant_free(cut.maps);
    return status;
}
