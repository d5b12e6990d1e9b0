/* Queries of a model and a simulation. */
#include "base/fail.h"
#include "fem/element/scalar.h"
#include "material/partial_volume.h"
#include "sim/api/data.h"
#include "sim/build/model.h"
#include "sim/step/contact.h"

#include <math.h>
#include <string.h>

const pliant_scene *pliant_model_get_scene(const pliant_model *model) { return &model->scene; }
const pliant_volume *pliant_model_get_scan(const pliant_model *model) { return model->scan; }
const pliant_volume *pliant_model_get_drawn(const pliant_model *model) { return model->drawn; }
const pliant_material_table *pliant_model_get_materials(const pliant_model *model) { return &model->materials; }
const uint8_t *pliant_model_get_voxel_materials(const pliant_model *model) { return model->material_of_voxel; }
const pliant_body *pliant_model_get_body(const pliant_model *model) { return model->body; }

uint8_t pliant_model_material_at(const pliant_model *model, const double rest[3])
{
    const pliant_geometry *scan = &model->scan->geometry;
    double index[3];
    int32_t at[3];
    pliant_geometry_to_index(scan, rest, index);
    for (int d = 0; d < 3; d++) at[d] = (int32_t)lround(fmin(fmax(index[d], 0), scan->size[d] - 1));
    return pliant_material_for_display(&model->materials, scan->size, model->material_of_voxel, at);
}

void pliant_model_get_statistics(const pliant_model *model, pliant_build_statistics *out)
{
    memcpy(out->seconds, model->build_seconds, sizeof out->seconds);
    memcpy(out->bytes, model->build_bytes, sizeof out->bytes);
    out->condition_estimate = model->condition_estimate;
}

const pliant_body *pliant_data_get_body(const pliant_data *data) { return data->body; }
uint64_t pliant_data_get_last_revision(const pliant_data *data) { return data->last_revision; }
const pliant_statistics *pliant_data_get_statistics(const pliant_data *data) { return &data->statistics; }
const pliant_warp *pliant_data_get_warp(const pliant_data *data) { return data->warp; }
void pliant_data_get_gravity(const pliant_data *data, double out[3])
{
    memcpy(out, data->gravity, sizeof data->gravity);
}

const double *pliant_data_get_positions(const pliant_data *data, uint64_t *revision)
{
    if (revision) *revision = data->body->revision;
    return data->positions;
}

int32_t pliant_data_get_inverted(const pliant_data *data)
{
    return pliant_mesh_inverted(&data->body->fine, data->positions);
}

int pliant_data_get_num_tools(const pliant_data *data) { return data->num_tools; }

static pliant_status check(const pliant_data *data, int tool)
{
    return tool >= 0 && tool < data->num_tools
               ? PLIANT_OK
               : pliant_fail(PLIANT_ERROR_ARGUMENT, "there are %d tools, and none of index %d", data->num_tools, tool);
}

/* Report the proxy of the last step. Before the first step, and without a shape, the proxy is at the target. */
static void report_proxy(const pliant_tool *from, pliant_tool_state *out)
{
    const bool stepped = from->proxy.known && from->shape.num_parts > 0;
    out->has_proxy = from->present && from->shape.num_parts > 0;
    out->jaw = from->jaw;
    out->proxy_jaw = stepped ? from->proxy.jaw : from->jaw;
    out->jaw_error = out->jaw - out->proxy_jaw;
    out->saturated = stepped && from->proxy.saturated;
    memcpy(out->proxy_tip, stepped ? from->proxy.tip : from->tip, sizeof out->proxy_tip);
    memcpy(out->proxy_rotation, stepped ? from->proxy.rotation : from->rotation, sizeof out->proxy_rotation);
    for (int d = 0; d < 3; d++) out->proxy_error[d] = from->tip[d] - out->proxy_tip[d];
}

pliant_status pliant_tool_get(const pliant_data *data, int tool, pliant_tool_state *out)
{
    pliant_status status = check(data, tool);
    if (status != PLIANT_OK) return status;
    const pliant_tool *from = data->tools + tool;
    pliant_tool_state out_state = {.present = from->present,
                              .drive = from->drive,
                              .stiffness = from->stiffness,
                              .damping = from->damping,
                              .radius = from->radius,
                              .holding = pliant_tool_grips(from),
                              .hold = from->hold,
                              .num_held = pliant_tool_grips(from) ? from->num_held : 0,
                              .cutting = from->blade.cutting,
                              .engaged = from->blade.engaged_length > 0,
                              .engaged_length = from->blade.engaged_length,
                              .severed_area = from->blade.severed_area,
                              .stroke = from->blade.stroke,
                              .pieces = from->blade.pieces};
    memcpy(out_state.name, from->name, sizeof out_state.name);
    memcpy(out_state.tip, from->tip, sizeof out_state.tip);
    memcpy(out_state.rotation, from->rotation, sizeof out_state.rotation);
    memcpy(out_state.driving_force, from->driving_force, sizeof out_state.driving_force);
    memcpy(out_state.held_point, from->held_point, sizeof out_state.held_point);
    memcpy(out_state.force, from->force, sizeof out_state.force);
    pliant_contact_wrench(data, tool, out_state.contact_force, out_state.contact_torque);
    out_state.contact_force_error = pliant_contact_force_error(data, tool);
    report_proxy(from, &out_state);
    out_state.advanced = data->statistics.advanced;
    *out = out_state;
    return PLIANT_OK;
}

pliant_status pliant_tool_set_spring(pliant_data *data, int tool, double stiffness, double damping)
{
    pliant_status status = check(data, tool);
    if (status != PLIANT_OK) return status;
    if (!(stiffness > 0) || !(damping >= 0) || stiffness > 1e12 || damping > 1e9)
        return pliant_fail(
            PLIANT_ERROR_ARGUMENT,
            "a spring has %g N/m and %g N s/m; use a stiffness above 0 up to 1e12, and a damping from 0 to 1e9",
            stiffness, damping);
    data->tools[tool].stiffness = stiffness;
    data->tools[tool].damping = damping;
    return PLIANT_OK;
}

pliant_status pliant_tool_set_radius(pliant_data *data, int tool, double radius)
{
    pliant_status status = check(data, tool);
    if (status != PLIANT_OK) return status;
    if (!(radius >= 0) || radius > 1)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "the radius of the grasp is %g m; use 0 to 1", radius);
    data->tools[tool].radius = radius;
    return PLIANT_OK;
}
