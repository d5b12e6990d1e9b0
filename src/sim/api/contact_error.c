/* Error of contact forces (src/contact/NUMERICS.md). */
#include "base/fail.h"
#include "base/vector3.h"
#include "sim/step/contact.h"
#include "sim/step/legs.h"

#include <math.h>

/* Relative standard deviations of a force, measured by bench_force calibrate: of the missing depth, and of all else. */
static const double error_of_depth = 0.152, error_of_rest = 0.022;

/* Add the force of a part's contact points, their sizes, and their displacements times sizes. */
static void add_points(const pliant_data *data, int tool, int part, double force[3], double *sum, double *moved)
{
    for (int32_t p = 0; p < data->contacts.count; p++) {
        const pliant_contact_point *point = data->contacts.point + p;
        double place[3], rest[3];
        if (point->kind != PLIANT_OBSTACLE_TOOL || point->tool != tool || point->part != part ||
            !pliant_contact_presses(data, point))
            continue;
        const double size = pliant_length3(point->force);
        pliant_contact_force_position(data->positions, point, place);
        pliant_contact_force_position(data->body->fine.rest, point, rest);
        for (int d = 0; d < 3; d++) force[d] += point->force[d];
        *sum += size;
        *moved += size * pliant_distance3(place, rest);
    }
}

double pliant_contact_force_error(const pliant_data *data, int tool)
{
    const double missing = data->tools[tool].proxy.missing.fraction;
    double squares = 0, sum = 0, moved = 0;
    for (int part = 0; part < data->tools[tool].shape.num_parts && data->tools[tool].present; part++) {
        double force[3] = {0, 0, 0};
        add_points(data, tool, part, force, &sum, &moved);
        squares += pliant_dot3(force, force);
    }
    const double position = data->statistics.error * sum, /* times the force, as `moved` */
        of_solver = position < moved ? position / moved : position > 0,
                 of_cells = missing < 1 ? hypot(error_of_depth * missing, error_of_rest) : 1;
    return sqrt(squares) * hypot(of_cells, of_solver);
}

void pliant_contact_warn_of_cells(pliant_data *data)
{
    for (int t = 0; t < data->num_tools; t++) {
        const pliant_missing_depth *missing = &data->tools[t].proxy.missing;
        double force[3], torque[3];
        if (data->tools[t].warned_of_cells || !(missing->compliance > 0) || missing->cells >= PLIANT_RESOLVED_CELLS)
            continue;
        const double error = pliant_contact_force_error(data, t);
        if (!(error > 0)) continue;
        data->tools[t].warned_of_cells = true;
        pliant_contact_wrench(data, t, force, torque);
        pliant_log(
            PLIANT_LOG_WARNING,
            "tool %s: its contact has a radius of %.2g cells, below two, so the mesh lacks %.0f %% of the dimple under "
            "it; its force of %.2g N has a standard error of about %.2g N (contact_force_error); use smaller cells "
            "(mesh/coarse_cells, mesh/ratio) or model/patch",
            data->tools[t].name, missing->cells, 100 * missing->fraction, pliant_length3(force), error);
    }
}
