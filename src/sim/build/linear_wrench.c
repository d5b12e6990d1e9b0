/* Linearize a tool's wrench after a step, for haptic loops between steps. */
#include "sim/build/linear_wrench.h"

#include "backend/backend.h"
#include "base/fail.h"
#include "base/dense.h"
#include "base/rotate.h"
#include "fem/patch/patch.h"
#include "fem/quasistatic/wrench_stiffness.h"
#include "sim/step/contact.h"

#include <math.h>
#include <string.h>

/* shortest motion for a secant [m]: below it, changes of the force are solver errors */
static const double min_motion = 1e-6;

static void read_wrench(const pliant_data *data, int index, double wrench[6])
{
    const pliant_tool *tool = data->tools + index;
    pliant_contact_wrench(data, index, wrench, wrench + 3);
    /* this force acts at the tip */
    for (int d = 0; d < 3 && (tool->holding || tool->blade.cutting); d++) wrench[d] += tool->force[d];
}

/* Update B by the secant y = B s: B + (r s' + s r') / s's - (r's) s s' / (s's)^2,  r = y - B s. This is the
 * symmetric matrix nearest to B that satisfies the secant (Dennis and Schnabel, Numerical Methods for Unconstrained
 * Optimization, 9.1). */
static void take_secant(const double s[3], const double y[3], double b[9])
{
    double r[3], length = 0, along = 0;
    for (int i = 0; i < 3; i++) r[i] = y[i] - (b[3 * i] * s[0] + b[3 * i + 1] * s[1] + b[3 * i + 2] * s[2]);
    for (int i = 0; i < 3; i++) {
        length += s[i] * s[i];
        along += r[i] * s[i];
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            b[3 * i + j] += (r[i] * s[j] + s[i] * r[j]) / length - along * s[i] * s[j] / (length * length);
}

/* Correct the translational stiffness by the secants of the last steps, and remove its negative eigenvalues. */
static void correct(const pliant_tool_linear *before, pliant_tool_linear *now)
{
    double s[3], rest[3], length = 0, whole[9], values[3], vectors[9];
    if (!before->known || before->hold != now->hold || now->step != before->step + 1 ||
        before->by_secants != now->by_secants)
        return;
    memcpy(now->correction, before->correction, sizeof now->correction);
    for (int d = 0; d < 3; d++) {
        s[d] = now->tip[d] - before->tip[d];
        length += s[d] * s[d];
    }
    for (int d = 0; d < 3; d++) {
        rest[d] = now->wrench[d] - before->wrench[d];
        for (int e = 0; e < 3; e++) rest[d] -= now->stiffness[6 * d + e] * s[e];
    }
    if (length > min_motion * min_motion) take_secant(s, rest, now->correction);
    for (int m = 0; m < 9; m++) whole[m] = now->stiffness[6 * (m / 3) + m % 3] + now->correction[m];
    pliant_dense_symmetric_eigen(3, whole, values, vectors);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double sum = 0;
            for (int v = 0; v < 3; v++) sum += fmax(values[v], 0) * vectors[3 * i + v] * vectors[3 * j + v];
            now->stiffness[6 * i + j] = sum;
        }
}

/* Move the pose from the proxy's to the target's, by the missing depth of the tissue under the tool. A small
 * motion hardly changes this depth, so the stiffness needs no correction. */
static void add_missing_depth(const pliant_data *data, int index, pliant_tool_linear *now)
{
    double force[3], torque[3];
    pliant_contact_wrench(data, index, force, torque);
    for (int d = 0; d < 3; d++) now->tip[d] += data->tools[index].proxy.missing.compliance * force[d];
}

pliant_status pliant_tool_linearize(const pliant_data *data, int index, pliant_tool_linear *at)
{
    if (index < 0 || index >= data->num_tools)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "there are %d tools, and none of index %d", data->num_tools, index);
    const pliant_tool *tool = data->tools + index;
    pliant_tool_linear now = {
        .known = tool->present && data->statistics.step > 0, .step = data->statistics.step, .hold = tool->hold};
    const bool stepped = tool->proxy.known; /* the wrench belongs to the proxy's pose in the step */
    memcpy(now.tip, stepped ? tool->proxy.tip : tool->tip, sizeof now.tip);
    memcpy(now.rotation, stepped ? tool->proxy.rotation : tool->rotation, sizeof now.rotation);
    if (now.known) {
        read_wrench(data, index, now.wrench);
        bool linear = data->solver && data->backend->state_is_on_host && !data->rigid_pieces;
        if (linear) {
            int member[PLIANT_MAX_TOOLS];
            const int leader = pliant_grasp_leader(data, index), count = pliant_grasp_members(data, leader, member);
            pliant_status status =
                pliant_solver_stiffness(pliant_patch_solver(data, leader), leader, now.tip, now.stiffness, &linear);
            if (status != PLIANT_OK) return status;
            /* each tool of a shared grasp moves the target by its fraction and takes its fraction of the force */
            for (int m = 0; m < 36 && count > 1; m++) now.stiffness[m] /= count * count;
        }
        if (stepped) add_missing_depth(data, index, &now);
        now.by_secants = !linear;
        correct(at, &now);
    }
    *at = now;
    return PLIANT_OK;
}

void pliant_tool_linear_wrench(const pliant_tool_linear *at, const double tip[3], const double rotation[4],
                               double maximum, double out[6])
{
    double motion[6], change[6], force = 0;
    for (int d = 0; d < 3; d++) motion[d] = tip[d] - at->tip[d];
    pliant_rotation_vector(at->rotation, rotation, motion + 3);
    for (int a = 0; a < 6; a++) {
        change[a] = 0;
        for (int b = 0; b < 6; b++) change[a] += at->stiffness[6 * a + b] * motion[b];
    }
    for (int d = 0; d < 3; d++) force += change[d] * change[d];
    force = sqrt(force);
    const double part = force > maximum ? maximum / force : 1;
    for (int a = 0; a < 6; a++) out[a] = at->wrench[a] + part * change[a];
}
