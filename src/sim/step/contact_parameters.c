/* Parameters of contact in a leg, from the scene and the contact settings. */
#include "sim/step/contact_workspace.h"
#include "base/fail.h"
#include "base/memory.h"

#include <math.h>

pliant_status pliant_contact_search_create(const pliant_contact_settings *settings, pliant_contact_search **out)
{
    if (*out) return PLIANT_OK;
    pliant_contact_search *search = pliant_calloc(1, sizeof *search);
    if (!search) return pliant_fail_memory("contacts");
    search->settings = *settings;
    pliant_status status = pliant_contact_detector_create(settings, &search->detector);
    if (status == PLIANT_OK) *out = search;
    else pliant_free(search);
    return status;
}

bool pliant_contact_touches_itself(const pliant_model *model)
{
    return model->scene.contact.self || model->scene.material.slides[0];
}

bool pliant_contact_is_within_elements(const pliant_model *model)
{
    return model->scene.cut.kind != PLIANT_CUT_SUBDIVIDE;
}

double pliant_contact_core_offset(const pliant_part *part)
{
    return part->kind == PLIANT_PART_SOLID && !part->solid->convex ? part->solid->error : 0;
}

double pliant_contact_guard(const pliant_model *model, const pliant_data *data, const pliant_part *part)
{
    const double *cell = data->body->fine.cell_size,
                 guard = pliant_advance_guard(&model->contact, part, fmin(fmin(cell[0], cell[1]), cell[2]));
    return fmax(guard, pliant_contact_core_offset(part) + (1 - model->contact.advance_stop) * guard);
}

static double seconds_of(const pliant_model *model, const pliant_data *data)
{
    return model->scene.solver.step * data->fraction;
}

double pliant_contact_leg_distance(const pliant_data *data)
{
    const double *cell = data->body->fine.cell_size;
    return data->model->contact.leg_distance * fmax(fmax(cell[0], cell[1]), cell[2]);
}

double pliant_contact_max_recovery(const pliant_model *model, const pliant_data *data)
{
    return data->legs->holds_proxies ? 0 : model->contact.recovery_speed * seconds_of(model, data);
}

double pliant_contact_remaining_depth_fraction(const pliant_model *model, const pliant_data *data)
{
    return data->body->has_inertia ? exp(-seconds_of(model, data) / model->contact.recovery_time) : 0;
}

pliant_tissue_rule pliant_contact_tissue_rule(const pliant_model *model, const pliant_data *data,
                                              double max_piece_motion)
{
    const double *cell = data->body->fine.cell_size, smallest = fmin(fmin(cell[0], cell[1]), cell[2]),
                 thickness = model->contact.self_thickness * smallest;
    const double margin = model->contact.self_margin * data->contact_search->tissue.shortest + thickness;
    return (pliant_tissue_rule){.margin = margin,
                                .max_margin = data->body->has_inertia ? 2 * margin : 0,
                                .thickness = thickness,
                                .recovery = pliant_contact_max_recovery(model, data),
                                .friction = model->scene.contact.friction,
                                .max_piece_motion = max_piece_motion,
                                .nodes = data->positions,
                                .remaining_depth_fraction = pliant_contact_remaining_depth_fraction(model, data),
                                .settings = &model->contact};
}
