/* Queries of the contacts of a step. */
#include "base/fail.h"
#include "base/memory.h"
#include "fem/element/scalar.h"
#include "sim/step/contact.h"

#include <math.h>
#include <string.h>

void pliant_contact_force_position(const double *positions, const pliant_contact_point *point, double out[3])
{
    double whole = 0;
    memset(out, 0, 3 * sizeof *out);
    for (int32_t k = 0; k < point->count; k++) {
        if (!(point->weight[k] > 0)) continue;
        whole += point->weight[k];
        for (int d = 0; d < 3; d++)
            out[d] += point->weight[k] * positions[3 * (size_t)point->node[k] + (size_t)d];
    }
    for (int d = 0; d < 3; d++) out[d] /= whole;
}

/* Points of the volume bound have no contact force, and an undone cut may have removed a point's nodes. */
bool pliant_contact_presses(const pliant_data *data, const pliant_contact_point *point)
{
    if (point->kind == PLIANT_OBSTACLE_ELEMENT) return false;
    for (int32_t k = 0; k < point->count; k++)
        if (point->node[k] >= data->body->fine.num_nodes) return false;
    return point->force[0] != 0 || point->force[1] != 0 || point->force[2] != 0;
}

int32_t pliant_data_get_contacts(const pliant_data *data, int32_t capacity, pliant_contact *out)
{
    int32_t count = 0;
    for (int32_t p = 0; p < data->contacts.count; p++) {
        const pliant_contact_point *point = data->contacts.point + p;
        if (!pliant_contact_presses(data, point)) continue;
        if (count++ >= capacity) continue;
        pliant_contact *out_state = out + count - 1;
        *out_state = (pliant_contact){
            .tool = point->kind == PLIANT_OBSTACLE_TOOL ? point->tool : -1, .part = point->part, .area = point->area};
        out_state->tissue = point->kind == PLIANT_OBSTACLE_TISSUE;
        pliant_contact_force_position(data->positions, point, out_state->place);
        memcpy(out_state->normal, point->normal, sizeof out_state->normal);
        memcpy(out_state->force, point->force, sizeof out_state->force);
        for (int d = 0; d < 3; d++) {
            double difference = -point->place[d];
            for (int32_t k = 0; k < point->count; k++)
                difference += point->weight[k] * data->positions[3 * (size_t)point->node[k] + (size_t)d];
            out_state->depth -= point->normal[d] * difference;
        }
    }
    return count;
}

void pliant_data_get_contact_forces(const pliant_data *data, double *out)
{
    memset(out, 0, 3 * (size_t)data->body->fine.num_nodes * sizeof *out);
    for (int32_t p = 0; p < data->contacts.count; p++) {
        const pliant_contact_point *point = data->contacts.point + p;
        for (int32_t k = 0; k < point->count && pliant_contact_presses(data, point); k++)
            for (int d = 0; d < 3; d++)
                out[3 * (size_t)point->node[k] + (size_t)d] += point->weight[k] * point->force[d];
    }
}

pliant_status pliant_data_get_scalar(const pliant_model *model, const pliant_data *data, pliant_scalar scalar,
                                     float *out)
{
    const int32_t nodes = data->body->fine.num_nodes;
    if (scalar != PLIANT_SCALAR_CONTACT_FORCE)
        return pliant_data_scalar(model, data->body, data->positions, scalar, out);
    double *force = pliant_calloc((size_t)nodes, 3 * sizeof *force);
    if (!force) return pliant_fail_memory("the scalar");
    pliant_data_get_contact_forces(data, force);
    for (int32_t n = 0; n < nodes; n++) {
        const double *of = force + 3 * (size_t)n;
        out[n] = (float)sqrt(of[0] * of[0] + of[1] * of[1] + of[2] * of[2]);
    }
    pliant_free(force);
    return PLIANT_OK;
}

/* Compute the force and torque of the contact points of a tool, about its tip. */
static void sum_contacts(const pliant_data *data, int tool, double force[3], double torque[3])
{
    const double *tip = data->tools[tool].proxy.tip;
    memset(force, 0, 3 * sizeof *force);
    memset(torque, 0, 3 * sizeof *torque);
    for (int32_t p = 0; p < data->contacts.count; p++) {
        const pliant_contact_point *point = data->contacts.point + p;
        if (point->kind != PLIANT_OBSTACLE_TOOL || point->tool != tool || !pliant_contact_presses(data, point))
            continue;
        double arm[3];
        pliant_contact_force_position(data->positions, point, arm);
        for (int d = 0; d < 3; d++) arm[d] -= tip[d];
        for (int d = 0; d < 3; d++) {
            force[d] += point->force[d];
            torque[d] += arm[(d + 1) % 3] * point->force[(d + 2) % 3] - arm[(d + 2) % 3] * point->force[(d + 1) % 3];
        }
    }
}

/* After a shortened leg the points' forces are no equilibrium, because some points have vanished. The load of the
 * coupling is. */
void pliant_contact_wrench(const pliant_data *data, int tool, double force[3], double torque[3])
{
    const double *load = data->tools[tool].proxy.load.wrench;
    if (!data->solver || data->statistics.advanced == 1) {
        sum_contacts(data, tool, force, torque);
        return;
    }
    for (int d = 0; d < 3; d++) {
        force[d] = -load[d];
        torque[d] = -load[3 + d];
    }
}
