/* Where tools are on their way through a step, how far they go in it, and how far tissue does. */
#include "base/rotate.h"
#include "fem/rigid/falling.h"
#include "sim/step/contact.h"

#include <math.h>
#include <string.h>

static const double fastest = 2.0; /* of a tool's tip [m/s]; beyond it, it has jumped, and touches nothing on its way */

static double distance(const double *a, const double *b) { return sqrt(pow(a[0] - b[0], 2) + pow(a[1] - b[1], 2) + pow(a[2] - b[2], 2)); }

bool pliant_contact_goes_on(const pliant_model *model, const pliant_tool *tool)
{
    return tool->present && tool->last.known && distance(tool->tip, tool->last.tip) <= fastest * model->scene.solver.step;
}

void pliant_contact_pose(const pliant_tool *end, double share, double tip[3], double rotation[4], double *jaw)
{
    memcpy(tip, end->tip, sizeof end->tip);
    memcpy(rotation, end->rotation, sizeof end->rotation);
    *jaw = end->jaw;
    if (!(share < 1)) return;
    for (int d = 0; d < 3; d++) tip[d] = end->last.tip[d] + share * (end->tip[d] - end->last.tip[d]);
    pliant_rotation_between(end->last.rotation, end->rotation, share, rotation);
    *jaw = end->last.jaw + share * (end->jaw - end->last.jaw);
}

void pliant_contact_go(const pliant_model *model, const pliant_tool *end, double share, pliant_tool *tool)
{
    pliant_contact_pose(end, pliant_contact_goes_on(model, end) ? share : 1, tool->tip, tool->rotation, &tool->jaw);
}

double pliant_contact_way_of(const pliant_tool *tool, const pliant_part *part)
{
    const double origin[3] = {0, 0, 0}, turn = part->frame == PLIANT_FRAME_TIP ? 0 : 0.5 * fabs(tool->jaw - tool->last.jaw);
    return distance(tool->tip, tool->last.tip) + turn * pliant_part_reach(part, tool->shape.joint) +
           pliant_rotation_angle(tool->last.rotation, tool->rotation) * pliant_part_reach(part, origin);
}

/* A tool with a shape comes so near to a point in the step [m] */
static bool comes_near(const pliant_model *model, const pliant_tool *tool, const double point[3], double near)
{
    bool any = false;
    for (int32_t p = 0; tool->present && p < tool->shape.num_parts && !any; p++) {
        const pliant_part *part = tool->shape.part + p;
        pliant_pose pose;
        double local[3], normal[3];
        pliant_part_pose(&tool->shape, part->frame, tool->tip, tool->rotation, tool->jaw, &pose);
        pliant_pose_from(&pose, point, local);
        any = pliant_part_distance(part, local, normal) < near + PLIANT_CONTACT_MARGIN + (pliant_contact_goes_on(model, tool) ? pliant_contact_way_of(tool, part) : 0);
    }
    return any;
}

static bool piece_meets_tools(const pliant_model *model, const pliant_data *data, const double centre[3], double radius)
{
    bool any = false;
    for (int t = 0; t < data->num_tools && !any; t++) any = comes_near(model, data->tools + t, centre, radius);
    return any;
}

void pliant_contact_mark_pieces(const pliant_model *model, pliant_data *data)
{
    for (int32_t p = 0; p < data->body->pieces->count; p++) {
        double centre[3], radius;
        const double goes = pliant_falling_ball(data->falling, p, false, centre, &radius);
        pliant_falling_mark(data->falling, p, goes > 0 && piece_meets_tools(model, data, centre, radius));
    }
}

bool pliant_contact_goes_far(const pliant_model *model, const pliant_data *data)
{
    const double *cell = data->body->fine.cell_size, far = 0.5 * fmax(fmax(cell[0], cell[1]), cell[2]);
    bool any = false;
    for (int t = 0; t < data->num_tools; t++) {
        const pliant_tool *tool = data->tools + t;
        for (int32_t p = 0; p < tool->shape.num_parts && !any && pliant_contact_goes_on(model, tool); p++) any = pliant_contact_way_of(tool, tool->shape.part + p) > far;
    }
    for (int32_t p = 0; data->falling && p < data->body->pieces->count && !any; p++) {
        double centre[3], radius;
        any = pliant_falling_ball(data->falling, p, true, centre, &radius) > far && piece_meets_tools(model, data, centre, radius);
    }
    return any;
}

/* ---- what stands still */

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

/* Whether tissue that goes far enough is beyond the part that the point is of: no half-space, and not tissue. */
static bool may_be_passed(const pliant_model *model, const pliant_contact_point *point)
{
    const pliant_regions *scene = &model->scene.obstacles;
    const int32_t index = point->feature >> 56 & 127, boxes = (int32_t)scene->num_boxes, planes = (int32_t)scene->num_planes; /* of an obstacle: find.h */
    if (point->kind != PLIANT_OBSTACLE_GROUND) return point->kind == PLIANT_OBSTACLE_TOOL;
    if (index < boxes + planes) return index < boxes;
    return index - boxes - planes < model->obstacles.num_parts && pliant_part_depth(model->obstacles.part + (index - boxes - planes)) < INFINITY;
}

bool pliant_contact_presses(const pliant_model *model, const pliant_data *data)
{
    bool any = false;
    for (int32_t n = 0; n < data->contacts.count && !any; n++) {
        const pliant_contact_point *point = data->contacts.point + n;
        any = point->begun && may_be_passed(model, point);
    }
    return any;
}

/* ---- how far all goes, over how deep parts are */

/* How far no point of the tool is from its tip [m] */
static double reach_of(const pliant_tool *tool)
{
    const double origin[3] = {0, 0, 0};
    double reach = 0;
    for (int32_t p = 0; p < tool->shape.num_parts; p++) {
        const pliant_part *part = tool->shape.part + p;
        const bool turns = part->frame != PLIANT_FRAME_TIP;
        reach = fmax(reach, turns ? distance(tool->shape.joint, origin) + pliant_part_reach(part, tool->shape.joint) : pliant_part_reach(part, origin));
    }
    return reach;
}

/* No point of an element is further from all of its nodes, unless it is stretched to more than twice its size [m] */
static double reach_of_elements(const pliant_model *model, const pliant_mesh *mesh)
{
    const double *cell = mesh->cell_size, largest = mesh->num_leaves > 0 ? ldexp(1, model->scene.mesh.depth) : 1;
    return largest * sqrt(cell[0] * cell[0] + cell[1] * cell[1] + cell[2] * cell[2]);
}

/* The farthest that a node goes that can come so near to the tip; -1: nothing of any element can [m]. elements: how far their points are from nodes */
static double way_near(const pliant_data *data, const double *tip, double near, double elements, const double *increment, int32_t times)
{
    double most = 0;
    bool any = false;
    for (int32_t n = 0; n < data->body->fine.num_nodes; n++) {
        const double *x = data->positions + 3 * (size_t)n, *d = increment + 3 * (size_t)n, way = times * sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
        if (any && !(way > most)) continue;
        const double apart = distance(x, tip) - near - way;
        any = any || apart <= elements;
        if (way > most && apart <= 0) most = way;
    }
    return any ? most : -1;
}

double pliant_contact_deeps(const pliant_model *model, const pliant_data *data, const double *increment, int32_t times)
{
    pliant_part obstacle[2 * PLIANT_MAX_FIXED];
    const double elements = reach_of_elements(model, &data->body->fine);
    double deeps = 0, centre[3];
    for (int t = 0; t < data->num_tools; t++) {
        const pliant_tool *tool = data->tools + t;
        const bool goes_on = pliant_contact_goes_on(model, tool);
        if (!tool->present || tool->shape.num_parts == 0) continue;
        double farthest = 0;
        for (int32_t p = 0; goes_on && p < tool->shape.num_parts; p++) farthest = fmax(farthest, pliant_contact_way_of(tool, tool->shape.part + p));
        const double tissue = way_near(data, tool->tip, reach_of(tool) + farthest + PLIANT_CONTACT_MARGIN, elements, increment, times);
        for (int32_t p = 0; p < tool->shape.num_parts && tissue >= 0; p++)
            deeps = fmax(deeps, ((goes_on ? pliant_contact_way_of(tool, tool->shape.part + p) : 0) + tissue) / pliant_part_depth(tool->shape.part + p));
    }
    for (int32_t n = 0, count = pliant_contact_obstacles(model, obstacle); n < count + model->obstacles.num_parts; n++) {
        const pliant_part *part = n < count ? obstacle + n : model->obstacles.part + (n - count);
        const double depth = pliant_part_depth(part);
        if (!(depth < INFINITY)) continue;
        pliant_part_centre(part, centre);
        deeps = fmax(deeps, way_near(data, centre, pliant_part_reach(part, centre) + PLIANT_CONTACT_MARGIN, elements, increment, times) / depth);
    }
    return deeps;
}
