#include "contact/shapes/shapes.h"

#include "base/rotate.h"
#include "base/vector3.h"
#include "contact/shapes/solid.h"
#include "contact/shapes/tool_shape.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

static const double thinnest = 5e-5; /* minimum radius [m] */

/* ---- distances */

/* Distance from a point that is enlarged by a radius. */
static double from_centre(const double offset[3], double radius, double normal[3])
{
    const double far = pliant_length3(offset);
    for (int d = 0; d < 3; d++) normal[d] = far > 0 ? offset[d] / far : 0;
    return far - radius;
}

static double from_capsule(const pliant_part *part, const double p[3], double normal[3])
{
    double along[3], offset[3];
    for (int d = 0; d < 3; d++) {
        along[d] = part->to[d] - part->from[d];
        offset[d] = p[d] - part->from[d];
    }
    const double size = pliant_dot3(along, along),
                 fraction = size > 0 ? fmin(fmax(pliant_dot3(offset, along) / size, 0), 1) : 0;
    for (int d = 0; d < 3; d++) offset[d] -= fraction * along[d];
    return from_centre(offset, part->radius, normal);
}

static double from_box(const pliant_part *part, const double p[3], double normal[3])
{
    double beyond[3], outside[3], inside = -INFINITY;
    int nearest = 0;
    for (int d = 0; d < 3; d++) {
        const double from_middle = p[d] - 0.5 * (part->from[d] + part->to[d]);
        beyond[d] = fabs(from_middle) - 0.5 * (part->to[d] - part->from[d]);
        outside[d] = copysign(fmax(beyond[d], 0), from_middle);
        if (beyond[d] > inside) {
            inside = beyond[d];
            nearest = d;
        }
    }
    if (inside > 0) return from_centre(outside, part->radius, normal);
    for (int d = 0; d < 3; d++) normal[d] = d == nearest ? copysign(1, p[d] - 0.5 * (part->from[d] + part->to[d])) : 0;
    return inside - part->radius;
}

static_assert(PLIANT_NUM_PART_KINDS == 5, "a new kind of part needs its distance, depth, reach and box in this file");

double pliant_part_distance(const pliant_part *part, const double p[3], double normal[3])
{
    if (part->kind == PLIANT_PART_CAPSULE) return from_capsule(part, p, normal);
    if (part->kind == PLIANT_PART_BOX) return from_box(part, p, normal);
    const double offset[3] = {p[0] - part->from[0], p[1] - part->from[1], p[2] - part->from[2]};
    if (part->kind == PLIANT_PART_SPHERE) return from_centre(offset, part->radius, normal);
    if (part->kind == PLIANT_PART_SOLID) return pliant_solid_distance(part->solid, offset, normal) - part->radius;
    const double size = pliant_length3(part->to);
    for (int d = 0; d < 3; d++) normal[d] = part->to[d] / size;
    return pliant_dot3(offset, normal);
}

void pliant_part_exit_point(const pliant_part *part, const double p[3], const double direction[3], double out[3])
{
    enum { MAX_STEPS = 64 };
    double normal[3], distance = pliant_part_distance(part, p, normal);
    const double rounding = 1e-9;
    memcpy(out, p, 3 * sizeof *out);
    /* the remaining distance along the ray is at least the signed distance */
    for (int step = 0; step < MAX_STEPS && distance < -rounding; step++) {
        for (int d = 0; d < 3; d++) out[d] -= distance * direction[d];
        distance = pliant_part_distance(part, out, normal);
    }
}

double pliant_part_depth(const pliant_part *part)
{
    if (part->kind == PLIANT_PART_HALF_SPACE) return INFINITY;
    /* a solid that is not convex may be thinner elsewhere, down to the resolution of its field */
    if (part->kind == PLIANT_PART_SOLID)
        return part->radius +
               (part->solid->convex ? part->solid->depth : fmin(part->solid->depth, 2 * part->solid->cell));
    if (part->kind != PLIANT_PART_BOX) return part->radius;
    return part->radius +
           0.5 * fmin(fmin(part->to[0] - part->from[0], part->to[1] - part->from[1]), part->to[2] - part->from[2]);
}

pliant_part pliant_part_core(const pliant_part *part, double guard)
{
    pliant_part core = *part;
    if (part->kind == PLIANT_PART_HALF_SPACE) {
        const double size = pliant_length3(part->to);
        for (int d = 0; d < 3; d++) core.from[d] -= guard * part->to[d] / size;
        return core;
    }
    core.radius -= guard;
    if (part->kind == PLIANT_PART_BOX && core.radius < 0) {
        for (int d = 0; d < 3; d++) {
            core.from[d] -= core.radius;
            core.to[d] += core.radius;
        }
        core.radius = 0;
    }
    return core;
}

/* Low and high corner of the shape before it is enlarged by the radius; for a capsule, its two ends. */
static void corners_of(const pliant_part *part, double low[3], double high[3])
{
    const bool is_solid = part->kind == PLIANT_PART_SOLID;
    for (int d = 0; d < 3; d++) {
        low[d] = part->from[d] + (is_solid ? part->solid->low[d] : 0);
        high[d] = part->kind == PLIANT_PART_SPHERE ? part->from[d]
                  : is_solid                       ? part->from[d] + part->solid->high[d]
                                                   : part->to[d];
    }
}

void pliant_part_centre(const pliant_part *part, double out[3])
{
    double low[3], high[3];
    corners_of(part, low, high);
    for (int d = 0; d < 3; d++) out[d] = 0.5 * (low[d] + high[d]);
}

double pliant_part_reach(const pliant_part *part, const double from[3])
{
    double far = 0, low[3], high[3];
    corners_of(part, low, high);
    for (int corner = 0; corner < 8; corner++) { /* the ends of a capsule are two of the corners */
        double squares = 0;
        for (int d = 0; d < 3; d++) {
            squares += pow((corner >> d & 1 ? high : low)[d] - from[d], 2);
        }
        far = fmax(far, sqrt(squares));
    }
    return far + part->radius;
}

/* ---- validity of a part */

static const char *complain(char *reason, size_t size, const char *text)
{
    snprintf(reason, size, "%s", text);
    return reason;
}

const char *pliant_part_check(const pliant_part *part, bool of_tool, char *reason, size_t size)
{
    const double maximum = 10; /* [m] */
    for (int d = 0; d < 3; d++) {
        const bool has_end = part->kind != PLIANT_PART_SPHERE && part->kind != PLIANT_PART_SOLID;
        if (!(fabs(part->from[d]) <= maximum) || (has_end && !(fabs(part->to[d]) <= maximum)))
            return complain(reason, size, "its numbers must be finite and at most 10 m; use metres");
    }
    if (part->kind == PLIANT_PART_HALF_SPACE) {
        if (of_tool)
            return complain(
                reason, size,
                "a half-space is an obstacle of the scene; a tool's part is a sphere, capsule, box or solid");
        return pliant_length3(part->to) > 0 ? NULL : complain(reason, size, "its normal must not be zero");
    }
    if (part->kind == PLIANT_PART_BOX)
        for (int d = 0; d < 3; d++)
            if (!(part->from[d] <= part->to[d])) {
                snprintf(reason, size, "axis %d: low %g must not be above high %g", d, part->from[d], part->to[d]);
                return reason;
            }
    if (part->kind == PLIANT_PART_SOLID && !part->solid) return complain(reason, size, "it has no solid");
    if (!(part->radius >= 0 && part->radius <= maximum))
        return complain(reason, size, "its radius must be between 0 and 10 m");
    /* independent of the field's resolution */
    const double depth = part->kind == PLIANT_PART_SOLID ? part->radius + part->solid->depth : pliant_part_depth(part);
    if (!(depth >= thinnest)) return complain(reason, size, "it is thinner than 0.1 mm");
    return NULL;
}

void pliant_tool_shape_move(pliant_tool_shape *shape, const double offset[3])
{
    for (int d = 0; d < 3; d++) {
        shape->joint[d] += offset[d];
        for (int32_t p = 0; p < shape->num_parts; p++) {
            shape->part[p].from[d] += offset[d];
            if (shape->part[p].kind != PLIANT_PART_HALF_SPACE && shape->part[p].kind != PLIANT_PART_SOLID)
                shape->part[p].to[d] += offset[d];
        }
    }
}

bool pliant_tool_shape_has_jaws(const pliant_tool_shape *shape)
{
    for (int32_t p = 0; p < shape->num_parts; p++)
        if (shape->part[p].frame != PLIANT_FRAME_TIP) return true;
    return false;
}

bool pliant_tool_shape_holds(const pliant_scene *scene, const pliant_tool_shape *shape)
{
    switch (scene->grasp.kind) {
    case PLIANT_GRASP_AUTO: return pliant_tool_shape_has_jaws(shape);
    case PLIANT_GRASP_BLOB: return false;
    case PLIANT_GRASP_CONTACT: return true;
    }
    return false;
}

void pliant_tool_shape_free(pliant_tool_shape *shape)
{
    for (int32_t p = 0; p < shape->num_parts; p++) pliant_solid_release(shape->part[p].solid);
    *shape = (pliant_tool_shape){.num_parts = 0};
}

void pliant_tool_shape_retain(const pliant_tool_shape *shape)
{
    for (int32_t p = 0; p < shape->num_parts; p++) pliant_solid_retain(shape->part[p].solid);
}

double pliant_part_cell_size(const pliant_part *part)
{
    return part->kind == PLIANT_PART_SOLID && !part->solid->convex ? part->solid->cell : 0;
}

/* ---- poses */

void pliant_pose_turn(const pliant_pose *pose, const double local[3], double out[3])
{
    for (int d = 0; d < 3; d++) out[d] = pliant_dot3(pose->rotation + 3 * d, local);
}

void pliant_pose_turn_back(const pliant_pose *pose, const double v[3], double out[3])
{
    for (int d = 0; d < 3; d++)
        out[d] = pose->rotation[d] * v[0] + pose->rotation[3 + d] * v[1] + pose->rotation[6 + d] * v[2];
}

void pliant_pose_to(const pliant_pose *pose, const double local[3], double out[3])
{
    pliant_pose_turn(pose, local, out);
    for (int d = 0; d < 3; d++) out[d] += pose->place[d];
}

void pliant_pose_from(const pliant_pose *pose, const double x[3], double out[3])
{
    const double offset[3] = {x[0] - pose->place[0], x[1] - pose->place[1], x[2] - pose->place[2]};
    pliant_pose_turn_back(pose, offset, out);
}

void pliant_part_pose(const pliant_tool_shape *shape, pliant_part_frame frame, const double tip[3],
                      const double rotation[4], double jaw, pliant_pose *out)
{
    const double half = frame == PLIANT_FRAME_TIP ? 0 : frame == PLIANT_FRAME_JAW_PLUS ? 0.5 * jaw : -0.5 * jaw;
    const double size = pliant_length3(shape->axis), sine = size > 0 ? sin(0.5 * half) / size : 0;
    const double about[4] = {sine * shape->axis[0], sine * shape->axis[1], sine * shape->axis[2], cos(0.5 * half)};
    double joint[3], turned[3];
    for (int column = 0; column < 3; column++) {
        const double unit[3] = {column == 0, column == 1, column == 2};
        pliant_rotate(about, unit, turned);
        pliant_rotate(rotation, turned, joint);
        for (int d = 0; d < 3; d++) out->rotation[3 * d + column] = joint[d];
    }
    /* the joint stays fixed: l -> joint + rotated (l - joint), then the tool's pose */
    pliant_rotate(rotation, shape->joint, joint);
    pliant_pose_turn(out, shape->joint, turned);
    for (int d = 0; d < 3; d++) out->place[d] = tip[d] + joint[d] - turned[d];
}

void pliant_part_box(const pliant_part *part, const pliant_pose *pose, double low[3], double high[3])
{
    const bool has_corners = part->kind == PLIANT_PART_BOX || part->kind == PLIANT_PART_SOLID;
    double ends[2][3], middle[3], from[3], to[3];
    corners_of(part, ends[0], ends[1]);
    pliant_part_centre(part, middle);
    pliant_pose_to(pose, has_corners ? middle : part->from, from);
    pliant_pose_to(pose, part->kind == PLIANT_PART_CAPSULE ? part->to : has_corners ? middle : part->from, to);
    for (int d = 0; d < 3; d++) {
        double grow = part->kind == PLIANT_PART_HALF_SPACE ? INFINITY : part->radius;
        for (int e = 0; has_corners && e < 3; e++)
            grow += 0.5 * fabs(pose->rotation[3 * d + e]) * (ends[1][e] - ends[0][e]);
        low[d] = fmin(from[d], to[d]) - grow;
        high[d] = fmax(from[d], to[d]) + grow;
    }
}
