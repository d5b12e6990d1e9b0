/* The area of severed faces in voxels of tissue. Tetrahedra at the surface of an organ are partly empty. A face of such
 * a tetrahedron can lie in its tissue, or in its empty part. */
#include "cut/subdivide.h"

#include "base/vector3.h"
#include "pliant/scan.h"

#include <math.h>

int64_t pliant_cut_voxel_at(const pliant_geometry *scan, const double point[3])
{
    double index[3];
    int64_t voxel = 0;
    pliant_geometry_to_index(scan, point, index);
    for (int d = 2; d >= 0; d--) {
        const double nearest = floor(index[d] + 0.5);
        if (!(nearest >= 0 && nearest < scan->size[d])) return -1;
        voxel = voxel * scan->size[d] + (int64_t)nearest;
    }
    return voxel;
}

/* The face is divided into congruent triangles whose edges are at most a voxel's smallest edge long. */
void pliant_split_report_voxels(const cut_splitting *work, int32_t face, const uint8_t *material_of_voxel, double area,
                                pliant_cut_report *report)
{
    const pliant_subdivision *subdivision = work->body->subdivision;
    const double *spacing = subdivision->scan.spacing, *corner[3];
    for (int c = 0, n = 0; c < 4; c++) {
        if (c == face % 4) continue;
        const int32_t node = work->corners[4 * (size_t)(face / 4) + (size_t)c];
        /* a copy may have left the face */
        corner[n++] = work->rest + 3 * (size_t)(node < work->first_copy ? node : work->between[node].end[0]);
    }
    const double longest = fmax(fmax(pliant_distance3(corner[0], corner[1]), pliant_distance3(corner[1], corner[2])),
                                pliant_distance3(corner[2], corner[0]));
    const int parts = (int)ceil(longest / fmin(spacing[0], fmin(spacing[1], spacing[2])));
    const double part_area = area / ((double)parts * parts);
    for (int i = 0; i < parts; i++)
        for (int k = 0; k < 2 * (parts - i) - 1; k++) {
            /* in a row, triangles that point to corner 1 alternate with others */
            const double u = (i + (k % 2 ? 2 : 1) / 3.0) / parts, v = (k / 2 + (k % 2 ? 2 : 1) / 3.0) / parts;
            double point[3];
            for (int d = 0; d < 3; d++)
                point[d] = corner[0][d] + u * (corner[1][d] - corner[0][d]) + v * (corner[2][d] - corner[0][d]);
            const int64_t voxel = pliant_cut_voxel_at(&subdivision->scan, point);
            if (voxel < 0 || subdivision->is_empty[material_of_voxel[voxel]]) continue;
            report->area += part_area;
            report->area_of[material_of_voxel[voxel]] += part_area;
        }
}
