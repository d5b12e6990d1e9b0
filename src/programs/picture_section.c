#include "picture_section.h"

#include "base/fail.h"
#include "base/memory.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static const uint8_t red[3] = {230, 25, 25}, white[3] = {255, 255, 255};

/* Return whether a point lies in a tetrahedron: on the inner side of its four faces. */
static bool holds(const double corner[4][3], const double at[3])
{
    double volume[5]; /* volume of the tetrahedron, and with each corner replaced by the point */
    for (int n = 0; n < 5; ++n) {
        const double *c[4] = {corner[0], corner[1], corner[2], corner[3]};
        double e[3][3];
        if (n > 0) c[n - 1] = at;
        for (int a = 0; a < 3; ++a)
            for (int d = 0; d < 3; ++d) e[a][d] = c[a + 1][d] - c[0][d];
        volume[n] = e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) -
                    e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
                    e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0]);
    }
    for (int n = 1; n < 5; ++n)
        if (volume[n] * volume[0] < 0.0) return false;
    return volume[0] != 0.0;
}

/* Find the pixels, first to last (exclusive), that a tetrahedron may cover along one axis of the panel. */
static void pixel_range(double low, double high, double origin, double pixel, int32_t size, int32_t *first,
                        int32_t *last)
{
    *first = (int32_t)fmin(fmax(floor((low - origin) / pixel), 0.0), size);
    *last = (int32_t)fmin(fmax(ceil((high - origin) / pixel), 0.0), size);
}

static void draw_tet(const picture_frame *frame, const double point[3], const double corner[4][3], int32_t tet,
                     int32_t *tet_of_pixel)
{
    const picture_plane *plane = frame->plane;
    double low[3], high[3];
    int32_t left, right, top, bottom;
    for (int d = 0; d < 3; ++d) {
        low[d] = fmin(fmin(corner[0][d], corner[1][d]), fmin(corner[2][d], corner[3][d]));
        high[d] = fmax(fmax(corner[0][d], corner[1][d]), fmax(corner[2][d], corner[3][d]));
    }
    if (low[plane->normal] > point[plane->normal] || high[plane->normal] < point[plane->normal]) return;
    const int across = plane->right;
    pixel_range(low[across], high[across], frame->low[across], frame->pixel, frame->width, &left, &right);
    const int down = plane->down;
    const double from = plane->upwards ? -high[down] : low[down], to = plane->upwards ? -low[down] : high[down];
    const double origin = plane->upwards ? -frame->high[down] : frame->low[down];
    pixel_range(from, to, origin, frame->pixel, frame->height, &top, &bottom);
    for (int32_t row = top; row < bottom; ++row)
        for (int32_t column = left; column < right; ++column) {
            double world[3];
            picture_world(frame, point, column, row, world);
            if (holds(corner, world)) tet_of_pixel[(size_t)row * (size_t)frame->width + (size_t)column] = tet;
        }
}

pliant_status picture_section(const picture_frame *frame, const double point[3], const pliant_mesh *mesh,
                              const double *positions, int32_t **tet_of_pixel)
{
    const size_t pixels = (size_t)frame->width * (size_t)frame->height;
    int32_t *out = pliant_calloc(pixels, sizeof *out);
    if (!out) return pliant_fail_memory("a section of the mesh");
    memset(out, 0xff, pixels * sizeof *out);
    for (int32_t tet = 0; tet < mesh->num_tets; ++tet) {
        double corner[4][3];
        for (int v = 0; v < 4; ++v) memcpy(corner[v], positions + 3 * mesh->tets[4 * tet + v], sizeof corner[v]);
        draw_tet(frame, point, corner, tet, out);
    }
    *tet_of_pixel = out;
    return PLIANT_OK;
}

static void material_colour(const picture_mesh *mesh, int material, uint8_t rgb[3])
{
    const uint8_t *own = mesh->colors ? mesh->colors + 3 * material : NULL;
    if (own && (own[0] || own[1] || own[2])) memcpy(rgb, own, 3);
    else picture_label_colour(material + 1, rgb);
}

static void colour_tets(const picture_frame *frame, const picture_mesh *mesh, const int32_t *section, uint8_t *rgb)
{
    for (int32_t row = 0; row < frame->height; ++row)
        for (int32_t column = 0; column < frame->width; ++column) {
            const size_t at = (size_t)row * (size_t)frame->width + (size_t)column;
            const int32_t tet = section[at];
            const bool edge = (column + 1 < frame->width && section[at + 1] != tet) ||
                              (row + 1 < frame->height && section[at + (size_t)frame->width] != tet);
            if (tet < 0 || edge) continue;
            if (mesh->collided[tet]) memcpy(rgb + 3 * at, red, sizeof red);
            else material_colour(mesh, mesh->material[tet], rgb + 3 * at);
        }
}

/* Find the intersection of an edge and the plane. */
static bool meets(const double *a, const double *b, int normal, double height, double out[3])
{
    const double from = a[normal] - height, to = b[normal] - height;
    if ((from > 0.0) == (to > 0.0)) return false;
    for (int d = 0; d < 3; ++d) out[d] = a[d] + (b[d] - a[d]) * from / (from - to);
    return true;
}

static void draw_strip(const picture_frame *frame, const double point[3], const double *strip, uint8_t *rgb)
{
    const picture_plane *plane = frame->plane;
    double end[4][3];
    int count = 0;
    for (int v = 0; v < 4; ++v) {
        const double *from = strip + 3 * v, *to = strip + 3 * ((v + 1) % 4);
        count += meets(from, to, plane->normal, point[plane->normal], end[count]);
    }
    if (count < 2) return;
    const double wide = end[1][plane->right] - end[0][plane->right], tall = end[1][plane->down] - end[0][plane->down];
    const int32_t steps = (int32_t)ceil(2.0 * fmax(fabs(wide), fabs(tall)) / frame->pixel) + 1;
    for (int32_t s = 0; s <= steps; ++s) {
        const double x = end[0][plane->right] + wide * s / steps, y = end[0][plane->down] + tall * s / steps;
        const int32_t column = (int32_t)floor((x - frame->low[plane->right]) / frame->pixel);
        const double down = plane->upwards ? frame->high[plane->down] - y : y - frame->low[plane->down];
        const int32_t row = (int32_t)floor(down / frame->pixel);
        if (column < 0 || column >= frame->width || row < 0 || row >= frame->height) continue;
        memcpy(rgb + 3 * ((size_t)row * (size_t)frame->width + (size_t)column), white, sizeof white);
    }
}

/* Return a grid of one voxel, slightly larger than the bounding box of the positions. */
static pliant_geometry box_of(const picture_mesh *mesh)
{
    pliant_geometry box = {.size = {1, 1, 1}, .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    for (int d = 0; d < 3; ++d) {
        double low = INFINITY, high = -INFINITY;
        for (int32_t n = 0; n < mesh->mesh->num_nodes; ++n) {
            low = fmin(low, mesh->positions[3 * n + d]);
            high = fmax(high, mesh->positions[3 * n + d]);
        }
        box.origin[d] = 0.5 * (low + high);
        box.spacing[d] = 1.05 * (high - low);
    }
    return box;
}

pliant_status picture_mesh_write(const char *folder, const char *suffix, const picture_mesh *mesh,
                                 const double point[3])
{
    const pliant_geometry box = box_of(mesh);
    pliant_status status = PLIANT_OK;
    for (int n = 0; status >= 0 && n < PICTURE_PLANES; ++n) {
        const picture_frame frame = picture_frame_of(&picture_planes[n], &box);
        char path[4096];
        int32_t *section;
        uint8_t *rgb = pliant_calloc((size_t)frame.width * (size_t)frame.height, 3);
        if (!rgb) return pliant_fail_memory("a picture");
        status = picture_section(&frame, point, mesh->mesh, mesh->positions, &section);
        if (status >= 0) {
            colour_tets(&frame, mesh, section, rgb);
            for (int32_t s = 0; s < mesh->num_strips; ++s) draw_strip(&frame, point, mesh->strips + 12 * s, rgb);
            snprintf(path, sizeof path, "%s/mesh%s_%s.png", folder, suffix, picture_planes[n].name);
            status = picture_png(path, rgb, frame.width, frame.height);
            pliant_free(section);
        }
        pliant_free(rgb);
    }
    return status;
}
