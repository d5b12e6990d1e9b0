#include "tool/clearance.h"

#include "base/account.h"
#include "base/fail.h"
#include "contact/detect/contact_surface.h"
#include "contact/shapes/solid.h"
#include "fem/system.h"
#include "base/memory.h"
#include "model_data/model.h"

#include <math.h>
#include <string.h>

struct pliant_clearance {
    pliant_contact_surface outside; /* empty if contact uses the elements' own faces */
    uint64_t revision;              /* of the body of the lists; 0: none */
    int32_t num_corners, num_triangles;
    int32_t *corner;           /* (num_corners) surface nodes, ascending */
    int32_t *triangle;         /* (num_triangles x 3) indices into corner, oriented outwards */
    double *place;             /* (num_corners x 3) positions [m] */
};

pliant_clearance *pliant_clearance_create(void) { return pliant_calloc(1, sizeof(pliant_clearance)); }

static void free_lists(pliant_clearance *clearance)
{
    PLIANT_FREE(clearance->corner, clearance->triangle, clearance->place);
    clearance->corner = clearance->triangle = NULL;
    clearance->place = NULL;
    clearance->revision = 0;
}

void pliant_clearance_free(pliant_clearance *clearance)
{
    if (!clearance) return;
    free_lists(clearance);
    pliant_contact_surface_free(&clearance->outside);
    pliant_free(clearance);
}

/* ---- surface of a body */

/* List the nodes of the surface, and its triangles as indices of these. */
static pliant_status list_corners(pliant_clearance *clearance, const pliant_body *surface)
{
    const int32_t nodes = surface->fine.num_nodes;
    int32_t *index = pliant_calloc((size_t)nodes + 1, sizeof *index), count = 0;
    for (int32_t v = 0; index && v < 3 * surface->num_triangles; v++) index[surface->triangles[v]] = 1;
    for (int32_t n = 0; index && n < nodes; n++) count += index[n];
    clearance->corner = pliant_calloc((size_t)count + 1, sizeof *clearance->corner);
    clearance->place = pliant_calloc((size_t)count + 1, 3 * sizeof *clearance->place);
    clearance->triangle = pliant_calloc((size_t)surface->num_triangles + 1, 3 * sizeof *clearance->triangle);
    if (!index || !clearance->corner || !clearance->place || !clearance->triangle) {
        free_lists(clearance);
        pliant_free(index);
        return pliant_fail_memory("the distance of tools to the tissue");
    }
    clearance->num_corners = 0;
    for (int32_t n = 0; n < nodes; n++) {
        if (!index[n]) continue;
        index[n] = clearance->num_corners;
        clearance->corner[clearance->num_corners++] = n;
    }
    clearance->num_triangles = surface->num_triangles;
    for (int32_t v = 0; v < 3 * surface->num_triangles; v++) clearance->triangle[v] = index[surface->triangles[v]];
    pliant_free(index);
    return PLIANT_OK;
}

static pliant_status set_body(const pliant_model *model, const pliant_data *data)
{
    pliant_clearance *clearance = data->clearance;
    const pliant_body *surface = data->body;
    if (clearance->revision == data->body->revision) return PLIANT_OK;
    free_lists(clearance);
    if (model->scene.cut.kind != PLIANT_CUT_SUBDIVIDE) { /* same surface as contact (sim/step/contact_advance.c) */
        const pliant_contact_surface_voxels voxels = {.load = model->body,
                                              .geometry = &model->scan->geometry,
                                              .material_of_voxel = model->material_of_voxel,
                                              .materials = &model->materials,
                                              .min_cube_tissue = model->scene.element.kind == PLIANT_HEXAHEDRA
                                                                     ? model->contact.min_cube_tissue
                                                                     : 0,
                                              .has_self_contact =
                                                  model->scene.contact.self || model->scene.material.slides[0],
                                              .threads = data->discretization->system->num_threads};
        const pliant_status status = pliant_contact_surface_set_body(&clearance->outside, &voxels, data->body);
        if (status != PLIANT_OK) return status;
        surface = &clearance->outside.view;
    }
    const pliant_status status = list_corners(clearance, surface);
    if (status == PLIANT_OK) clearance->revision = data->body->revision;
    return status;
}

/* ---- distance of a point */

static double min3(double a, double b, double c)
{
    const double minimum = a < b ? a : b;
    return minimum < c ? minimum : c;
}

/* Return the squared distance to the triangle's bounding box, a lower bound of the distance to the triangle. */
static double squared_distance_to_box(const double p[3], const double *a, const double *b, const double *c)
{
    double sum = 0;
    for (int d = 0; d < 3; d++) {
        const double low = min3(a[d], b[d], c[d]), high = -min3(-a[d], -b[d], -c[d]),
                     out = p[d] < low    ? low - p[d]
                           : p[d] > high ? p[d] - high
                                         : 0;
        sum += out * out;
    }
    return sum;
}

static double squared_distance(const double p[3], const double *a, const double *b, const double *c)
{
    double nearest[3], sum = 0;
    pliant_triangle_nearest(a, b, c, p, nearest);
    for (int d = 0; d < 3; d++) sum += (p[d] - nearest[d]) * (p[d] - nearest[d]);
    return sum;
}

/* Return whether an edge crosses the ray from the point along x, in the xy plane. Both triangles of an edge compute the
 * same result. */
static bool crosses(const double p[3], const double *a, const double *b)
{
    const double *low = a[1] > p[1] ? b : a, *high = a[1] > p[1] ? a : b;
    if ((a[1] > p[1]) == (b[1] > p[1])) return false;
    return low[0] + (p[1] - low[1]) / (high[1] - low[1]) * (high[0] - low[0]) > p[0];
}

/* Return a triangle's contribution to the winding number of a closed surface around a point: 1 if the ray along z
 * leaves through the triangle, -1 if it enters. */
static int winding_of(const double p[3], const double *a, const double *b, const double *c)
{
    if (crosses(p, a, b) + crosses(p, b, c) + crosses(p, c, a) != 1) return 0;
    double u[3], w[3], n[3], height = 0;
    for (int d = 0; d < 3; d++) {
        u[d] = b[d] - a[d];
        w[d] = c[d] - a[d];
    }
    for (int d = 0; d < 3; d++) n[d] = u[(d + 1) % 3] * w[(d + 2) % 3] - u[(d + 2) % 3] * w[(d + 1) % 3];
    for (int d = 0; d < 3; d++) height += n[d] * (a[d] - p[d]);
    if (n[2] > 0) return height > 0;
    return n[2] < 0 && height < 0 ? -1 : 0;
}

/* Return the signed distance: negative inside, +infinity without a surface. */
static double signed_distance(const pliant_clearance *clearance, const double p[3])
{
    double nearest = INFINITY;
    int winding = 0;
    for (int32_t t = 0; t < clearance->num_triangles; t++) {
        const int32_t *corner = clearance->triangle + 3 * (size_t)t;
        const double *a = clearance->place + 3 * (size_t)corner[0], *b = clearance->place + 3 * (size_t)corner[1],
                     *c = clearance->place + 3 * (size_t)corner[2];
        if (squared_distance_to_box(p, a, b, c) < nearest) nearest = fmin(nearest, squared_distance(p, a, b, c));
        winding += winding_of(p, a, b, c);
    }
    return winding > 0 ? -sqrt(nearest) : sqrt(nearest);
}

double pliant_clearance_of(const pliant_model *model, const pliant_data *data, const double p[3])
{
    pliant_clearance *clearance = data->clearance;
    pliant_account *before = pliant_account_use(data->account);
    const pliant_status status = set_body(model, data);
    pliant_account_use(before);
    if (status != PLIANT_OK) return NAN;
    const bool moves = clearance->outside.revision == data->body->revision;
    for (int32_t c = 0; c < clearance->num_corners; c++)
        if (moves)
            pliant_contact_surface_corner(&clearance->outside, clearance->corner[c], data->positions,
                                          clearance->place + 3 * (size_t)c);
        else
            memcpy(clearance->place + 3 * (size_t)c, data->positions + 3 * (size_t)clearance->corner[c],
                   3 * sizeof *data->positions);
    return signed_distance(clearance, p);
}

double pliant_tool_clearance(const pliant_model *model, const pliant_data *data, int tool)
{
    if (tool < 0 || tool >= data->num_tools || !data->tools[tool].present) return INFINITY;
    return pliant_clearance_of(model, data, data->tools[tool].tip);
}
