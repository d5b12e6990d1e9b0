/* Error of contact forces (src/contact/NUMERICS.md). */
#include "base/fail.h"
#include "base/vector3.h"
#include "fem/patch/patch.h"
#include "sim/step/contact.h"
#include "sim/step/legs.h"
#include "sim/step/missing_compliance.h"

#include <math.h>
#include <string.h>

/* Contact points of one part. Moments are in the plane across the force. */
typedef struct pressed_part {
    double force[3], sum, area;         /* total force; sum of the points' forces [N]; of their areas [m^2] */
    double across[2][3];                /* unit vectors */
    double middle[2][3];                /* mean position, weighted by forces; by areas [m] */
    double moment[2][3];                /* second moments xx, xy, yy, weighted alike [m^2] */
    double cell;                        /* mean area of the cells, weighted by forces [m^2] */
    double moved;                       /* mean displacement, weighted by forces [m] */
} pressed_part;

static bool is_of(const pliant_data *data, const pliant_contact_point *point, int tool, int part)
{
    return point->kind == PLIANT_OBSTACLE_TOOL && point->tool == tool && point->part == part &&
           pliant_contact_presses(data, point);
}

/* Return the mean area of a face of the cells that the tool feels [m^2]. */
static double cell_area(const pliant_data *data, int tool)
{
    const double *size = pliant_felt_mesh(data, tool)->cell_size;
    return pow(size[0] * size[1] * size[2], 2.0 / 3);
}

static void add_means(const pliant_data *data, const pliant_contact_point *point, double cell, pressed_part *part)
{
    const double size = pliant_length3(point->force);
    double place[3], rest[3];
    pliant_contact_force_position(data->positions, point, place);
    pliant_contact_force_position(data->body->fine.rest, point, rest);
    for (int d = 0; d < 3; d++) {
        part->force[d] += point->force[d];
        part->middle[0][d] += size * place[d];
        part->middle[1][d] += point->area * place[d];
    }
    part->sum += size;
    part->area += point->area;
    part->cell += size * fmax(cell, point->area);
    part->moved += size * pliant_distance3(place, rest);
}

static void finish_means(pressed_part *part)
{
    for (int d = 0; d < 3; d++) {
        part->middle[0][d] /= part->sum;
        part->middle[1][d] /= part->area;
    }
    part->cell /= part->sum;
    part->moved /= part->sum;
    double normal[3] = {part->force[0], part->force[1], part->force[2]}, axis[3] = {0, 0, 0};
    pliant_normalize3(normal);
    const int least = fabs(normal[0]) < fabs(normal[1]) ? (fabs(normal[0]) < fabs(normal[2]) ? 0 : 2)
                                                        : (fabs(normal[1]) < fabs(normal[2]) ? 1 : 2);
    axis[least] = 1;
    pliant_cross3(normal, axis, part->across[0]);
    pliant_normalize3(part->across[0]);
    pliant_cross3(normal, part->across[0], part->across[1]);
}

static void add_moments(const pliant_data *data, const pliant_contact_point *point, pressed_part *part)
{
    const double weight[2] = {pliant_length3(point->force) / part->sum, point->area / part->area};
    double place[3];
    pliant_contact_force_position(data->positions, point, place);
    for (int m = 0; m < 2; m++) {
        double from[3];
        pliant_subtract3(place, part->middle[m], from);
        const double x = pliant_dot3(from, part->across[0]), y = pliant_dot3(from, part->across[1]);
        part->moment[m][0] += weight[m] * x * x;
        part->moment[m][1] += weight[m] * x * y;
        part->moment[m][2] += weight[m] * y * y;
    }
}

/* Return the error divided by the true force. spread: variance of the force along the narrow direction [m^2] */
static double relative_error(const pressed_part *part, double *spread)
{
    const double *force = part->moment[0], *area = part->moment[1], within = part->cell / 12,
                 half = 0.5 * (force[0] - force[2]), turn = 0.5 * atan2(-force[1], -half), c = cos(turn),
                 s = sin(turn), smaller = 0.5 * (force[0] + force[2]) - hypot(half, force[1]);
    *spread = fmax(smaller, 0) + within;
    const double of_area = c * c * area[0] + 2 * c * s * area[1] + s * s * area[2] + within;
    /* variance of the force over the variance of the area: for a pressure that vanishes at the border (Hertz), and for
     * a pressure that is infinite there (Sneddon) */
    const double hertz = 4.0 / 5, sneddon = 4.0 / 3, fraction = within / *spread,
                 border = fmin(fmax((*spread / of_area - hertz) / (sneddon - hertz), 0), 1);
    return hypot(fraction, border * sqrt(fraction));
}

/* Return the error of a part's force [N]. */
static double part_error(const pliant_data *data, int tool, int number, double *radius)
{
    const double cell = cell_area(data, tool);
    pressed_part part = {.sum = 0};
    *radius = INFINITY;
    for (int32_t p = 0; p < data->contacts.count; p++)
        if (is_of(data, data->contacts.point + p, tool, number))
            add_means(data, data->contacts.point + p, cell, &part);
    const double force = pliant_length3(part.force);
    if (!(force > 0) || !(part.area > 0)) return force;
    finish_means(&part);
    for (int32_t p = 0; p < data->contacts.count; p++)
        if (is_of(data, data->contacts.point + p, tool, number)) add_moments(data, data->contacts.point + p, &part);
    const double left = pliant_adds_missing_compliance(data, tool) ? 0.15 : 1; /* NUMERICS.md */
    double spread;
    const double relative = left * relative_error(&part, &spread), position = data->statistics.error;
    *radius = sqrt(5 * spread / part.cell); /* a pressure as of Hertz on this radius has this variance */
    return force * hypot(relative / (1 + relative), position < part.moved ? position / part.moved : position > 0);
}

double pliant_contact_force_error(const pliant_data *data, int tool, double *narrow)
{
    double squares = 0;
    if (narrow) *narrow = INFINITY;
    for (int part = 0; part < data->tools[tool].shape.num_parts && data->tools[tool].present; part++) {
        double radius;
        const double error = part_error(data, tool, part, &radius);
        squares += error * error;
        if (narrow) *narrow = fmin(*narrow, radius);
    }
    return sqrt(squares);
}

void pliant_contact_warn_of_cells(pliant_data *data)
{
    const double enough = 2; /* cells */
    for (int t = 0; t < data->num_tools; t++) {
        double radius, force[3], torque[3];
        const bool presses = data->tools[t].present && data->tools[t].proxy.coupling_load[0] > 0;
        if (data->legs->has_pressed[t] || !presses) continue;
        data->legs->has_pressed[t] = true;
        const double error = pliant_contact_force_error(data, t, &radius);
        if (!(radius < enough)) continue;
        pliant_contact_wrench(data, t, force, torque);
        pliant_log(PLIANT_LOG_WARNING,
                   "tool %s: its contact radius is %.2g cells, so its force of %.2g N has a standard error of about "
                   "%.2g N (contact_force_error); use smaller cells (mesh/coarse_cells, mesh/ratio) or model/patch",
                   data->tools[t].name, radius, pliant_length3(force), error);
    }
}
