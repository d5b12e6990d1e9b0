/* Render the tissue of a model: warp the volume and its labels when an image needs them. */
#include "base/fail.h"
#include "base/threads.h"
#include "material/partial_volume.h"
#include "base/memory.h"
#include "scan/volume.h"
#include "warp/render.h"
#include "model_data/model.h"
#include "warp/warp_state.h"
#include "warp/warp.h"

#include <string.h>

/* A warp of the view and its state. */
typedef struct view_warp {
    pliant_warp *warp;       /* NULL: not needed yet */
    const pliant_body *body; /* retained; the body that it draws */
    bool fresh;              /* whether it has drawn the current positions */
} view_warp;

struct pliant_view {
    const pliant_model *model;
    pliant_geometry target;
    pliant_style style;      /* default style of the scan */
    pliant_volume materials; /* UINT8, on the scan's grid; without voxels until labels are needed */
    view_warp values, labels;
    const pliant_warp *drawn; /* Nullable: borrowed; used instead of values */
    const pliant_body *body; /* retained */
    double *positions;
    size_t capacity; /* capacity of positions, in nodes */
    float *bricks;   /* NULL until the CPU needs them */
    enum { BRICKS_NONE, BRICKS_VALUES, BRICKS_LABELS } bricks_of;
    uint8_t shown[PLIANT_NUM_LABELS]; /* for BRICKS_LABELS: shown labels */
};

static int threads_of(const pliant_view *view) { return pliant_threads_or_cores(view->model->scene.solver.threads); }

static void free_warp(view_warp *of)
{
    pliant_warp_free(of->warp);
    pliant_body_release(of->body);
}

void pliant_view_free(pliant_view *view)
{
    if (!view) return;
    free_warp(&view->values);
    free_warp(&view->labels);
    pliant_volume_free(&view->materials);
    pliant_body_release(view->body);
    PLIANT_FREE(view->positions, view->bricks, view);
}

pliant_status pliant_view_create(const pliant_model *model, const pliant_geometry *target, pliant_view **out)
{
    const pliant_mesh *mesh = &model->body->fine;
    pliant_view *view = pliant_calloc(1, sizeof *view);
    if (!view) return pliant_fail_memory("a view");
    view->model = model;
    pliant_status status = PLIANT_OK;
    if (target) view->target = *target;
    else
        status = pliant_warp_target(&model->scan->geometry, mesh->rest, mesh->num_nodes, model->scene.warp.margin,
                                    (size_t)INT32_MAX, &view->target);
    if (status == PLIANT_OK) status = pliant_style_defaults(model->scan, &view->style);
    if (status == PLIANT_OK) status = pliant_view_set(view, model->body, mesh->rest, NULL);
    if (status != PLIANT_OK) {
        pliant_view_free(view);
        return status;
    }
    *out = view;
    return PLIANT_OK;
}

pliant_status pliant_view_set(pliant_view *view, const pliant_body *body, const double *positions,
                              const pliant_warp *drawn)
{
    const size_t nodes = (size_t)body->fine.num_nodes;
    for (size_t v = 0; v < 3 * nodes; v++)
        if (!isfinite(positions[v]))
            return pliant_fail(PLIANT_ERROR_ARGUMENT,
                               "the position of node %zu is not finite; the view does not change", v / 3);
    if (drawn && !pliant_geometry_equal(&view->target, pliant_warp_geometry(drawn)))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "the deformed volume of a view must have the grid of the view");
    if (nodes > view->capacity) {
        double *longer = pliant_calloc(nodes + nodes / 4, 3 * sizeof *longer);
        if (!longer) return pliant_fail_memory("a view");
        pliant_free(view->positions);
        view->positions = longer;
        view->capacity = nodes + nodes / 4;
    }
    memcpy(view->positions, positions, 3 * nodes * sizeof *positions);
    pliant_body_retain(body);
    pliant_body_release(view->body);
    view->body = body;
    view->drawn = drawn;
    view->values.fresh = view->labels.fresh = false;
    view->bricks_of = BRICKS_NONE;
    return PLIANT_OK;
}

/* Compute the labels of the scan's voxels: material of the image plus 1, or 0 for empty voxels. */
static pliant_status find_materials(pliant_view *view)
{
    const pliant_model *model = view->model;
    pliant_status status = pliant_volume_create(&model->scan->geometry, PLIANT_UINT8, &view->materials);
    if (status != PLIANT_OK) return status;
    uint8_t *labels = view->materials.voxels;
    const int32_t *size = model->scan->geometry.size;
    view->materials.slope = 1;
#pragma omp parallel for num_threads(threads_of(view)) schedule(static)
    for (int32_t k = 0; k < size[2]; k++)
        for (int32_t j = 0; j < size[1]; j++)
            for (int32_t i = 0; i < size[0]; i++) {
                const size_t v = (size_t)i + (size_t)size[0] * ((size_t)j + (size_t)size[1] * (size_t)k);
                if (model->materials.materials[model->material_of_voxel[v]].empty) continue;
                labels[v] = (uint8_t)(pliant_material_for_display(&model->materials, size, model->material_of_voxel,
                                                                  (const int32_t[3]){i, j, k}) +
                                      1);
            }
    return PLIANT_OK;
}

static pliant_status create_warp(pliant_view *view, bool labels, view_warp *of)
{
    const pliant_scene *scene = &view->model->scene;
    const pliant_body *body = view->model->body;
    pliant_warp *warp;
    pliant_status status = labels && !view->materials.voxels ? find_materials(view) : PLIANT_OK;
    if (status == PLIANT_OK)
        status = pliant_warp_create(labels ? &view->materials : view->model->drawn, &body->fine, &view->target,
                                    threads_of(view), &warp);
    if (status != PLIANT_OK) return status;
    if (body->cuts) status = pliant_warp_set_body(warp, body);
    if (status == PLIANT_OK && labels) status = pliant_warp_nearest(warp);
    if (status == PLIANT_OK && !labels && scene->warp.kind == PLIANT_FIT)
        status = pliant_warp_fit(warp, PLIANT_FIT_STEP);
    if (status == PLIANT_OK) status = pliant_warp_backend(warp, scene->solver.backend);
    if (status != PLIANT_OK) {
        pliant_warp_free(warp);
        return status;
    }
    *of = (view_warp){.warp = warp, .body = pliant_body_retain(body)};
    return PLIANT_OK;
}

/* Return the warp, drawn for the current positions. */
static pliant_status draw_warp(pliant_view *view, bool labels, const pliant_warp **out)
{
    view_warp *of = labels ? &view->labels : &view->values;
    if (!labels && view->drawn) {
        *out = view->drawn;
        return PLIANT_OK;
    }
    pliant_status status = of->warp ? PLIANT_OK : create_warp(view, labels, of);
    if (status == PLIANT_OK && of->body != view->body) {
        status = pliant_warp_set_body(of->warp, view->body);
        if (status == PLIANT_OK) {
            pliant_body_release(of->body);
            of->body = pliant_body_retain(view->body);
        }
    }
    if (status == PLIANT_OK && !of->fresh) status = pliant_warp_update(of->warp, view->positions);
    if (status != PLIANT_OK) return status;
    of->fresh = true;
    *out = of->warp;
    return PLIANT_OK;
}

/* Render on the GPU if all volumes are there. Return false if the CPU must render. */
static bool draw_there(const pliant_warp *values, const pliant_warp *labels, const render_scene *scene,
                       const render_output *out)
{
    if (!values->accelerated || !values->device->draw_image || (labels && !labels->accelerated)) return false;
    if (values->device->draw_image(values->accelerated, labels ? labels->accelerated : NULL, scene, out) == PLIANT_OK)
        return true;
    pliant_log(PLIANT_LOG_WARNING, "GPU rendering failed (%s); using the CPU", pliant_last_error());
    return false;
}

/* Compute the bricks once for all images of the same volume or labels. */
static void fill_bricks(pliant_view *view, const render_scene *scene, bool by_label)
{
    const bool kept =
        by_label ? view->bricks_of == BRICKS_LABELS && memcmp(view->shown, scene->style.shown, sizeof view->shown) == 0
                 : view->bricks_of == BRICKS_VALUES;
    if (kept) return;
    render_fill_bricks(scene, by_label, threads_of(view));
    view->bricks_of = by_label ? BRICKS_LABELS : BRICKS_VALUES;
    memcpy(view->shown, scene->style.shown, sizeof view->shown);
}

static pliant_status draw(pliant_view *view, render_scene *scene, const render_output *out)
{
    const bool by_label = render_by_label(scene, out), labelled = by_label || out->label;
    const pliant_warp *values, *labels = NULL;
    pliant_status status = draw_warp(view, false, &values);
    if (status == PLIANT_OK && labelled) status = draw_warp(view, true, &labels);
    if (status != PLIANT_OK) return status;
    if (draw_there(values, labels, scene, out)) return PLIANT_OK;
    if (!view->bricks && !(view->bricks = pliant_calloc(render_num_bricks(scene), sizeof *view->bricks)))
        return pliant_fail_memory("a view");
    scene->voxels = pliant_warp_volume(values)->voxels;
    scene->labels = labels ? pliant_warp_volume(labels)->voxels : NULL;
    scene->brick_high = view->bricks;
    fill_bricks(view, scene, by_label);
    render_draw(scene, out, threads_of(view));
    return PLIANT_OK;
}

/* Return the header of a volume on the target grid, from which a scene is created. */
static pliant_volume header(const pliant_view *view)
{
    pliant_volume volume = *view->model->scan;
    volume.geometry = view->target;
    return volume;
}

pliant_status pliant_view_render(pliant_view *view, const pliant_camera *camera, const pliant_style *style,
                                 const pliant_image *out)
{
    const render_output output = {.rgb = out->rgb, .depth = out->depth, .label = out->label};
    const pliant_volume volume = header(view);
    render_scene scene;
    pliant_status status = render_scene_of(&volume, camera, style ? style : &view->style, 0, &scene);
    return status == PLIANT_OK ? draw(view, &scene, &output) : status;
}

pliant_status pliant_view_radiograph(pliant_view *view, const pliant_camera *camera, double water, float *out)
{
    const render_output output = {.integral = out};
    const pliant_volume volume = header(view);
    render_scene scene;
    pliant_status status = render_scene_of(&volume, camera, NULL, water, &scene);
    return status == PLIANT_OK ? draw(view, &scene, &output) : status;
}
