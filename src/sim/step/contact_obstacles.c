/* Distances that tools and tissue move in a step, and fixed obstacles. */
#include "fem/rigid/rigid_pieces.h"
#include "base/vector3.h"
#include "sim/step/contact.h"
#include "sim/step/legs.h"

#include <math.h>
#include <string.h>

/* Return whether a tool with a shape comes nearer to a point than `near` during the leg [m]. */
static bool comes_near(const pliant_tool *tool, const pliant_leg_tool *leg, const double point[3], double near)
{
    bool any = false;
    for (int32_t p = 0; tool->present && p < tool->shape.num_parts && !any; p++) {
        const pliant_part *part = tool->shape.part + p;
        pliant_pose pose;
        double local[3], normal[3];
        pliant_part_pose(&tool->shape, part->frame, leg->begin.tip, leg->begin.rotation, leg->begin.jaw, &pose);
        pliant_pose_from(&pose, point, local);
        any = pliant_part_distance(part, local, normal) <
              near + pliant_part_max_motion(&tool->shape, part, &leg->begin, &leg->goal);
    }
    return any;
}

void pliant_contact_mark_pieces(pliant_data *data)
{
    for (int32_t p = 0; p < data->body->pieces->count; p++) {
        double centre[3], radius;
        const double goes = pliant_rigid_pieces_ball(data->rigid_pieces, p, false, centre, &radius);
        bool any = false;
        for (int t = 0; t < data->num_tools && goes > 0 && !any; t++)
            any =
                comes_near(data->tools + t, data->legs->tool + t, centre, radius + data->model->contact.search_margin);
        pliant_rigid_pieces_mark(data->rigid_pieces, p, any);
    }
}

/* ---- obstacles */

int32_t pliant_contact_obstacles(const pliant_model *model, pliant_part out[2 * PLIANT_MAX_FIXED])
{
    const pliant_regions *regions = &model->scene.obstacles;
    int32_t count = 0;
    for (uint32_t b = 0; b < regions->num_boxes; b++) {
        pliant_part *part = out + count++;
        *part = (pliant_part){.kind = PLIANT_PART_BOX};
        memcpy(part->from, regions->boxes[b].low, sizeof part->from);
        memcpy(part->to, regions->boxes[b].high, sizeof part->to);
    }
    for (uint32_t p = 0; p < regions->num_planes; p++) {
        pliant_part *part = out + count++;
        *part = (pliant_part){.kind = PLIANT_PART_HALF_SPACE};
        memcpy(part->from, regions->planes[p].point, sizeof part->from);
        memcpy(part->to, regions->planes[p].normal, sizeof part->to);
    }
    return count;
}

/* ---- motion relative to the depth of parts */

/* Return an upper bound of the distance between the tip and any point of the tool [m]. */
static double reach_of(const pliant_tool *tool)
{
    const double origin[3] = {0, 0, 0};
    double reach = 0;
    for (int32_t p = 0; p < tool->shape.num_parts; p++) {
        const pliant_part *part = tool->shape.part + p;
        const bool turns = part->frame != PLIANT_FRAME_TIP;
        reach =
            fmax(reach, turns ? pliant_distance3(tool->shape.joint, origin) + pliant_part_reach(part, tool->shape.joint)
                              : pliant_part_reach(part, origin));
    }
    return reach;
}

/* Return an upper bound of the distance from a point of an element to its nearest node [m]. It holds up to a stretch
 * of 2. */
static double reach_of_elements(const pliant_model *model, const pliant_mesh *mesh)
{
    const double *cell = mesh->cell_size, largest = mesh->num_leaves > 0 ? ldexp(1, model->scene.mesh.depth) : 1;
    return largest * sqrt(cell[0] * cell[0] + cell[1] * cell[1] + cell[2] * cell[2]);
}

/* Return the largest motion of a node that can come within `near` of the tip [m], or -1 if no point of an element
 * can.
 * @param elements upper bound of the distance from a point of an element to its nearest node [m] */
static double find_motion_near(const pliant_data *data, const double *tip, double near, double elements,
                               const double *increment, int32_t times)
{
    double maximum = 0;
    bool any = false;
    for (int32_t n = 0; n < data->body->fine.num_nodes; n++) {
        const double *x = data->positions + 3 * (size_t)n, *d = increment + 3 * (size_t)n,
                     motion = times * sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
        if (any && !(motion > maximum)) continue;
        const double distance = pliant_distance3(x, tip) - near - motion;
        any = any || distance <= elements;
        if (motion > maximum && distance <= 0) maximum = motion;
    }
    return any ? maximum : -1;
}

double pliant_contact_max_motion_ratio(const pliant_model *model, const pliant_data *data, const double *increment,
                                       int32_t times, double *tool_motion)
{
    pliant_part obstacle[2 * PLIANT_MAX_FIXED];
    const double elements = reach_of_elements(model, &data->body->fine);
    const double margin = model->contact.search_margin;
    double motion_ratio = 0, centre[3];
    *tool_motion = 0;
    for (int t = 0; t < data->num_tools; t++) {
        const pliant_tool *tool = data->tools + t;
        const pliant_leg_tool *leg = data->legs->tool + t;
        if (!tool->present || tool->shape.num_parts == 0) continue;
        const double farthest = pliant_tool_max_motion(tool, &leg->begin, &leg->behind);
        const double tissue =
            find_motion_near(data, leg->begin.tip, reach_of(tool) + farthest + margin, elements, increment, times);
        if (tissue >= 0) *tool_motion = fmax(*tool_motion, farthest + tissue);
        for (int32_t p = 0; p < tool->shape.num_parts && tissue >= 0; p++)
            motion_ratio = fmax(
                motion_ratio,
                (pliant_part_max_motion(&tool->shape, tool->shape.part + p, &leg->begin, &leg->behind) + tissue) /
                    pliant_part_depth(tool->shape.part + p));
    }
    for (int32_t n = 0, count = pliant_contact_obstacles(model, obstacle); n < count + model->obstacles.num_parts;
         n++) {
        const pliant_part *part = n < count ? obstacle + n : model->obstacles.part + (n - count);
        const double depth = pliant_part_depth(part);
        if (!(depth < INFINITY)) continue;
        pliant_part_centre(part, centre);
        motion_ratio = fmax(motion_ratio, find_motion_near(data, centre, pliant_part_reach(part, centre) + margin,
                                                           elements, increment, times) /
                                              depth);
    }
    return motion_ratio;
}
