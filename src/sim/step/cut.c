/* The first stage of a step: active blades cut the tissue that they sweep through. The blade of a tool with a shape
 * sweeps the motion of the proxy in the last step (pliant_blade_pose).
 *
 * A blade first drags tissue and then cuts it. A spring of stiffness k pulls the tissue at the edge's points towards
 * the blade. Its force is k y, where y is the distance that the blade has moved since the drag began. Real tissue
 * stiffens as it is stretched. Linear elements do not, so they carry less than this force. The blade slips when its
 * work pays for the cut (is_paid). Then the tissue is released, returns over the edge, and is cut up to the blade.
 * With k = 2 toughness width / drag the force is a saw-tooth of length `drag`, as Chanthasopeephan measured in liver
 * (Ann Biomed Eng 31:1372, 2003). Its mean is toughness times width.
 *
 * One account, blade->work, holds for all engines: the work of the blade's force minus toughness times swept area
 * (part, charge_pending). None of it is discarded while the blade is in tissue, so a stroke takes toughness times area.
 * While free tissue is cut, there is no drag, and the force balances the account (set_free_tissue_force). Tissue is
 * free if the blade moves by a large part of `drag` in one step, and if inertia delays the return of the tissue. */
#include "base/fail.h"
#include "base/rotate.h"
#include "base/vector3.h"
#include "tool/blade.h"
#include "tool/tool.h"
#include "sim/step/cut.h"

#include <math.h>
#include <string.h>

/* distance from the cut's end back to the sweep's start, so that no link between them is missed [voxels] */
static const double overlap_distance = 0.1;
static const double min_motion = 0.05; /* distance from the cut's end below which a blade counts as at rest [voxels] */
static const double max_chord_error = 0.25; /* maximum chord error of the sweep of a turning blade [voxels] */

typedef struct knife {
    const pliant_model *model;
    pliant_data *data;
    int index;
    pliant_tool *tool;
    pliant_tool_pose pose;     /* where the blade is in this step (pliant_blade_pose) */
    double min_edge, max_edge; /* smallest and largest voxel edge [m] */
    /* Distance ahead of a blade in which tissue resists [m]: a voxel, or two minimum edges of a subdivision. It moves
     * the ends of cuts by up to one. */
    double ahead;
} knife;

/* Return the distance that tissue is dragged before it is cut [m]. */
static double reach_of(const knife *work) { return fmax(work->model->scene.cut.drag, work->max_edge); }

/* Log a failure once. Return false. */
static bool log_failure(const knife *work)
{
    if (!work->tool->blade.failed)
        pliant_log(PLIANT_LOG_WARNING, "tool %s does not cut: %s; the tissue does not change", work->tool->name,
                   pliant_last_error());
    work->tool->blade.failed = true;
    return false;
}

static double longest_distance(const pliant_edge *edge)
{
    double longest = 0;
    for (int32_t p = 0; p < edge->count; p++)
        longest = fmax(longest, pliant_distance3(edge->now + 3 * p, edge->place + 3 * p));
    return longest;
}

/* Compute the displacement of the edge's middle from a previous position, without the part along the edge [m]. Return
 * its length. */
static double displacement_from(const pliant_edge *edge, const double middle[3], double out[3])
{
    double along[3];
    for (int d = 0; d < 3; d++) along[d] = edge->now[3 * (edge->count - 1) + d] - edge->now[d];
    pliant_normalize3(along);
    pliant_blade_middle(edge, edge->now, out);
    for (int d = 0; d < 3; d++) out[d] -= middle[d];
    const double slide = pliant_dot3(out, along);
    for (int d = 0; d < 3; d++) out[d] -= slide * along[d];
    return pliant_length3(out);
}

/* Move points by a distance along their direction from the cut's end to the blade. While the blade drags, all points
 * use the drag direction. A blade at rest keeps its direction [m]. */
static void extend(const pliant_blade *blade, const double *points, double by, double *out)
{
    const pliant_edge *edge = &blade->edge;
    double common[3] = {blade->drag_displacement[0], blade->drag_displacement[1], blade->drag_displacement[2]};
    const bool together = pliant_normalize3(common) > 0;
    for (int32_t p = 0; p < edge->count; p++) {
        double motion[3];
        for (int d = 0; d < 3; d++) motion[d] = together ? common[d] : edge->now[3 * p + d] - edge->place[3 * p + d];
        if (!(pliant_normalize3(motion) > 0)) memcpy(motion, blade->direction, sizeof motion);
        for (int d = 0; d < 3; d++) out[3 * p + d] = points[3 * p + d] + by * motion[d];
    }
}

/* ---- cutting */

/* Return whether a material point lies in a voxel of tissue. Elements at the surface also contain empty voxels.
 * tet: -1: none */
static bool is_in_tissue(const knife *work, int32_t tet, const double weight[4])
{
    const pliant_model *model = work->model;
    const pliant_mesh *fine = &work->data->body->fine;
    double rest[3] = {0, 0, 0};
    if (tet < 0) return false;
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++) rest[d] += weight[v] * fine->rest[3 * fine->tets[4 * tet + v] + d];
    const int64_t voxel = pliant_cut_voxel_at(&model->scan->geometry, rest);
    return voxel >= 0 && !model->materials.materials[model->material_of_voxel[voxel]].empty;
}

static int32_t count_in_tissue(const knife *work)
{
    int32_t count = 0;
    const pliant_edge *edge = &work->tool->blade.edge;
    for (int32_t p = 0; p < edge->count; p++) count += is_in_tissue(work, edge->tet[p], edge->weight + 4 * p);
    return count;
}

/* Return whether the blade has left the tissue in this step. */
static bool leaves_tissue(const knife *work)
{
    const pliant_edge *edge = &work->tool->blade.edge;
    bool leaves = work->data->body->subdivision && work->tool->blade.engaged_length > 0;
    for (int32_t p = 0; p < edge->count && leaves; p++) {
        int32_t tet = -1;
        double weight[4];
        leaves = !pliant_body_locate(work->data->body, work->data->positions, edge->now + 3 * p, &tet, weight) ||
                 !is_in_tissue(work, tet, weight);
    }
    return leaves;
}

/* Return toughness times area of a report, summed over materials [J]. */
static double energy_of(const knife *work, const pliant_cut_report *report)
{
    double energy = 0;
    const pliant_material_table *table = &work->model->materials;
    for (uint32_t m = 0; m < table->num_materials; m++) energy += table->materials[m].toughness * report->area_of[m];
    return work->model->scene.cut.resistance * energy;
}

static pliant_cut_sweep sweep_of(const knife *work, const double *from, const double *to, bool ends)
{
    return (pliant_cut_sweep){.count = work->tool->blade.edge.count,
                              .from = from,
                              .to = to,
                              .material_of_voxel = work->model->material_of_voxel,
                              .blade = (uint32_t)work->index,
                              .stroke = (uint32_t)work->tool->blade.stroke,
                              .ends = ends};
}

/* Compute the report of a sweep after which the cut would end, and change nothing. Return false on an error. */
static bool probe(const knife *work, const double *from, const double *to, pliant_cut_report *report)
{
    const pliant_data *data = work->data;
    const pliant_cut_sweep sweep = sweep_of(work, from, to, true);
    return pliant_body_cut(data->body, data->last_revision + 1, data->positions, &sweep, NULL, report) == PLIANT_OK ||
           log_failure(work);
}

/* Compute the start of the short sweep in which a cut ends, in `swept`. It has no area if the stroke has cut nothing.
 * end: positions of the edge's points */
static void step_back(const knife *work, const double *end)
{
    const pliant_blade *blade = &work->tool->blade;
    for (int32_t p = 0; p < blade->edge.count; p++)
        for (int d = 0; d < 3; d++)
            blade->edge.swept[3 * p + d] = end[3 * p + d] - overlap_distance * work->min_edge * blade->direction[d];
}

/* Cut the tissue between two positions of the edge's points, and charge the account for the severed area. On an error
 * return false and change nothing. */
static bool part(const knife *work, const double *from, const double *to, bool ends)
{
    pliant_blade *blade = &work->tool->blade;
    pliant_cut_report report = {0};
    const pliant_cut_sweep sweep = sweep_of(work, from, to, ends);
    const uint64_t before = work->data->body->revision;
    if (pliant_data_cut_along_sweep(work->model, work->data, work->index, &sweep, &report) != PLIANT_OK)
        return log_failure(work);
    if (work->data->body->revision == before) return true;
    blade->work -= energy_of(work, &report);
    blade->severed_area += report.area;
    blade->pieces = report.pieces;
    return true;
}

/* Charge the account for the swept area that has not separated yet: the area that would separate if the cut ended
 * here. The previous charge is credited, because its area has separated since, or is charged again. */
static void charge_pending(const knife *work)
{
    pliant_blade *blade = &work->tool->blade;
    pliant_cut_report report = {0};
    if (!work->data->body->subdivision || !(work->model->scene.cut.resistance > 0)) return;
    step_back(work, blade->edge.place);
    if (!probe(work, blade->edge.swept, blade->edge.place, &report)) return;
    blade->work += blade->pending;
    blade->pending = energy_of(work, &report);
    blade->work -= blade->pending;
}

/* Cut the faces in which the cut ends: a short sweep up to its end. Return false on an error. */
static bool end_cut(const knife *work)
{
    pliant_edge *edge = &work->tool->blade.edge;
    step_back(work, edge->place);
    return part(work, edge->swept, edge->place, true);
}

static void end_stroke(const knife *work)
{
    pliant_blade_move_with_tissue(work->data, &work->tool->blade.edge);
    end_cut(work);
    pliant_blade_end_stroke(work->tool);
}

/* Update the blade's direction. If it moves more back than aside, the cut ends in front of it. Return false on an
 * error. */
static bool turn(const knife *work)
{
    pliant_blade *blade = &work->tool->blade;
    double middle[3], motion[3];
    pliant_blade_middle(&blade->edge, blade->edge.place, middle);
    const double distance = displacement_from(&blade->edge, middle, motion);
    if (distance <= min_motion * work->min_edge) return true;
    const double back = -pliant_dot3(motion, blade->direction);
    if (work->data->body->subdivision && back > 0 && 2 * back * back > distance * distance && !end_cut(work))
        return false;
    pliant_normalize3(motion);
    memcpy(blade->direction, motion, sizeof motion);
    return true;
}

/* Cut the tissue from the cut's end to the blade, which becomes the cut's end. */
static bool cut_to_blade(const knife *work)
{
    pliant_blade *blade = &work->tool->blade;
    pliant_edge *edge = &blade->edge;
    if (!turn(work)) return false;
    extend(blade, edge->place, -overlap_distance * work->min_edge, edge->swept);
    if (!part(work, edge->swept, edge->now, leaves_tissue(work))) return false;
    pliant_blade_set_edge(work->data, edge);
    pliant_blade_middle(edge, edge->now, blade->cut_end);
    charge_pending(work);
    return true;
}

/* Cut without resistance. */
static void cut_freely(const knife *work)
{
    if (cut_to_blade(work)) pliant_blade_release(work->tool);
}

/* ---- resistance */

/* Resistance of the tissue ahead of a blade to a cut. */
typedef struct resistance {
    double force;  /* force that cuts it [N]; 0: no tissue is ahead */
    double energy; /* energy of its area up to `ahead` of the blade, after dragged tissue has returned [J] */
} resistance;

/* Return the distance from a previous position of the blade's middle to a row of the edge's points, along a unit vector
 * [m]. */
static double distance_since(const pliant_blade *blade, const double *points, const double along[3],
                             const double start[3])
{
    double motion[3];
    pliant_blade_middle(&blade->edge, points, motion);
    for (int d = 0; d < 3; d++) motion[d] -= start[d];
    return pliant_dot3(motion, along);
}

/* Return the distance that the edge's points have been dragged [m]. */
static double distance_dragged(const pliant_blade *blade)
{
    double along[3] = {blade->drag_displacement[0], blade->drag_displacement[1], blade->drag_displacement[2]};
    if (!blade->is_dragging || !(pliant_normalize3(along) > 0)) return 0;
    return fmax(distance_since(blade, blade->edge.place, along, blade->cut_end), 0);
}

/* Find the resistance: the toughness times the edge's width in tissue. Where the tissue ends, the force is smaller, so
 * that a voxel's length of it takes the remaining energy. Return false on an error. */
static bool find_resistance(const knife *work, resistance *out)
{
    pliant_blade *blade = &work->tool->blade;
    pliant_edge *edge = &blade->edge;
    pliant_cut_report report = {0};
    extend(blade, edge->now, work->ahead + distance_dragged(blade), edge->swept);
    if (!probe(work, edge->place, edge->swept, &report)) return false;
    const double total = energy_of(work, &report),
                 width = pliant_blade_length(blade) / edge->count * fmax(count_in_tissue(work), 1);
    out->energy = fmax(total - blade->pending, 0);
    out->force = out->energy > 0 ? fmin(total * (width / report.area), out->energy * (1 / work->max_edge)) : 0;
    return true;
}

/* Move the edge's points that are outside tissue with the blade until they enter tissue. Cut the tissue on their
 * path.
 * @param has_entered out: whether any point entered tissue
 * Return false if the tissue could not be cut. */
static bool move_edge_outside_tissue(const knife *work, bool *has_entered)
{
    pliant_blade *blade = &work->tool->blade;
    pliant_edge *edge = &blade->edge;
    const int32_t inside = pliant_blade_num_inside(edge);
    if (inside == edge->count) return true;
    extend(blade, edge->place, -overlap_distance * work->min_edge, edge->swept);
    for (int32_t p = 0; p < edge->count; p++)
        if (edge->tet[p] >= 0) memcpy(edge->swept + 3 * p, edge->place + 3 * p, 3 * sizeof *edge->swept);
    pliant_blade_move_to_tissue(work->data, edge, 0.5 * work->min_edge);
    *has_entered = pliant_blade_num_inside(edge) > inside;
    if (!part(work, edge->swept, edge->place, false)) return false;
    charge_pending(work);
    return true;
}

/* Add the work of the blade's motion in the last step, from the forces at both ends of it. */
static void add_blade_work(pliant_tool *tool)
{
    pliant_blade *blade = &tool->blade;
    for (int d = 0; d < 3; d++) blade->work += 0.5 * (blade->force[d] + tool->force[d]) * blade->moved[d];
    memcpy(blade->force, tool->force, sizeof blade->force);
}

static void find_drag_displacement(pliant_tool *tool)
{
    displacement_from(&tool->blade.edge, tool->blade.anchor, tool->blade.drag_displacement);
}

/* Update the spring from the dragged tissue to the blade. `reattach`: attach it to the tissue that the edge is in. */
static void drag(const knife *work, bool reattach)
{
    pliant_tool *tool = work->tool;
    pliant_edge *edge = &tool->blade.edge;
    const int32_t inside = pliant_blade_num_inside(edge);
    double along[3], motion[3] = {0, 0, 0}, held[3] = {0, 0, 0};
    if ((reattach || !tool->blade.is_dragging) && pliant_blade_hold(work->data->body, tool) != PLIANT_OK) {
        log_failure(work);
        return;
    }
    for (int d = 0; d < 3; d++) along[d] = edge->now[3 * (edge->count - 1) + d] - edge->now[d];
    pliant_normalize3(along);
    for (int32_t p = 0; p < edge->count; p++)
        for (int d = 0; d < 3 && edge->tet[p] >= 0; d++) {
            held[d] += edge->place[3 * p + d] / inside;
            motion[d] += (edge->now[3 * p + d] - edge->place[3 * p + d]) / inside;
        }
    const double slide = pliant_dot3(motion, along); /* the edge slides along itself without resistance */
    for (int d = 0; d < 3; d++) tool->tip_offset[d] = work->pose.tip[d] - (held[d] + motion[d] - slide * along[d]);
}

/* Release the tissue for a step. It returns over the edge and is cut in its unloaded state. */
static void slip(const knife *work, const double last[3])
{
    pliant_blade *blade = &work->tool->blade;
    pliant_tool_remove_grasp(work->tool);
    memcpy(blade->anchor, last, sizeof blade->anchor);
    blade->has_slipped = true;
}

/* Return whether released tissue still moves back: with inertia that takes more than a step. Then its points are away
 * from the blade's previous pose, which is `swept`. */
static bool is_returning(const knife *work)
{
    const pliant_edge *edge = &work->tool->blade.edge;
    const pliant_scene *scene = &work->model->scene;
    double farthest = 0;
    if (scene->solver.kind != PLIANT_TLED || scene->tled.quasi_static) return false;
    for (int32_t p = 0; p < edge->count; p++) {
        double motion[3];
        for (int d = 0; d < 3; d++) motion[d] = edge->place[3 * p + d] - edge->swept[3 * p + d];
        if (edge->tet[p] >= 0) farthest = fmax(farthest, pliant_dot3(motion, motion));
    }
    return farthest > pow(max_chord_error * work->min_edge, 2);
}

/* Return whether the blade moves so far in this step that steps cannot resolve a saw-tooth of length `drag`. `now`
 * is the blade at the end of the step. */
static bool moves_far(const knife *work, const double last[3])
{
    double motion[3];
    return displacement_from(&work->tool->blade.edge, last, motion) >
           work->model->contact.long_stroke * reach_of(work);
}

/* Set the force of a step in which tissue is free: `force`, which cuts the tissue ahead, corrected so that the account
 * returns to 0. The force acts over half of this step and half of the next one (trapezoidal rule). */
static void set_free_tissue_force(const knife *work, double force, const double last[3])
{
    pliant_tool *tool = work->tool;
    pliant_blade *blade = &tool->blade;
    double along[3];
    memcpy(blade->anchor, last, sizeof blade->anchor);
    find_drag_displacement(tool);
    memcpy(along, blade->drag_displacement, sizeof along);
    const double motion = pliant_normalize3(along), before = pliant_dot3(blade->force, along),
                 uncut = motion > 0 ? fmax(distance_since(blade, blade->edge.now, along, blade->cut_end), 0) : 0,
                 owed = force * uncut - blade->work - 0.5 * (before + force) * motion,
                 felt = motion > 0 ? fmin(fmax(force + owed / motion, 0), blade->stiffness * reach_of(work)) : 0;
    for (int d = 0; d < 3; d++) blade->free_tissue_force[d] = felt * along[d];
    pliant_blade_middle(&blade->edge, blade->edge.now, blade->anchor);
    blade->has_slipped = true;
}

/* Return whether the blade should slip in this step: the account is then nearer to 0 than if it slips in the next step.
 * A slip cuts tissue at the end of the next step. */
static bool is_paid(const knife *work, const resistance *ahead, double reach, const double last[3])
{
    const pliant_blade *blade = &work->tool->blade;
    double along[3] = {blade->drag_displacement[0], blade->drag_displacement[1], blade->drag_displacement[2]};
    const double motion = pliant_normalize3(along), step = fmax(distance_since(blade, blade->edge.now, along, last), 0),
                 uncut = fmax(distance_since(blade, blade->edge.now, along, blade->cut_end), 0),
                 gained = blade->work + 0.5 * pliant_dot3(blade->force, along) * step,
                 work_if_slipping = gained - fmin(ahead->force * (uncut + step), ahead->energy),
                 waits =
                     gained + blade->stiffness * motion * step - fmin(ahead->force * (uncut + 2 * step), ahead->energy);
    if (motion < 0.5 * reach || uncut + step <= min_motion * work->min_edge) return false; /* a slip cuts nothing */
    return work_if_slipping + fmax(waits, work_if_slipping) >= 0 || motion >= 2 * reach;
}

/* Cut the free tissue up to the blade. Return false if that failed.
 * @param returns out: whether tissue still moves back */
static bool cut_free_tissue(const knife *work, bool *returns)
{
    pliant_blade *blade = &work->tool->blade;
    *returns = is_returning(work);
    memset(blade->free_tissue_force, 0, sizeof blade->free_tissue_force);
    memset(blade->drag_displacement, 0, sizeof blade->drag_displacement);
    const bool is_cut = cut_to_blade(work);
    find_drag_displacement(work->tool);
    return is_cut;
}

/* Drag tissue, or slip. */
static void drag_or_slip(const knife *work, const resistance *ahead, bool reattach, const double last[3])
{
    pliant_blade *blade = &work->tool->blade;
    if (!blade->is_dragging && !blade->has_slipped) {
        memcpy(blade->anchor, last, sizeof blade->anchor);
        memcpy(blade->cut_end, last, sizeof blade->cut_end);
    }
    blade->has_slipped = false;
    find_drag_displacement(work->tool);
    if (blade->is_dragging && is_paid(work, ahead, reach_of(work), last)) slip(work, last);
    else drag(work, reattach);
}

/* Move a blade against resistance: drag tissue, slip or cut.
 * @param last middle of the edge in the last step
 * @param far the blade moves far in this step (moves_far) */
static void move_against_resistance(const knife *work, const double last[3], bool far)
{
    pliant_tool *tool = work->tool;
    pliant_blade *blade = &tool->blade;
    resistance ahead;
    bool returns = false, reattach = blade->has_slipped;
    if (blade->is_dragging) find_drag_displacement(tool);
    else if (!blade->has_slipped) memset(blade->drag_displacement, 0, sizeof blade->drag_displacement);
    if (blade->has_slipped && !cut_free_tissue(work, &returns)) return;
    if (!find_resistance(work, &ahead)) return;
    if (ahead.force > 0 && !blade->is_dragging && !move_edge_outside_tissue(work, &reattach)) return;
    const int32_t inside = pliant_blade_num_inside(&blade->edge);
    if (ahead.force == 0 || inside == 0) {
        /* the step that leaves the tissue pays the account, and in air there is no force */
        const bool has_left = ahead.force == 0 && count_in_tissue(work) == 0 && blade->engaged_length == 0;
        if (blade->is_dragging && inside > 0) slip(work, last);
        else if (!blade->has_slipped || has_left) cut_freely(work);
        else set_free_tissue_force(work, 0, last);
        return;
    }
    blade->stiffness = 2 * ahead.force / reach_of(work);
    if (!far && !returns) {
        drag_or_slip(work, &ahead, reattach, last);
        return;
    }
    if (blade->is_dragging) slip(work, last);
    else if (!blade->has_slipped && !cut_to_blade(work)) return;
    set_free_tissue_force(work, ahead.force, last);
}

/* ---- a step */

/* Return the number of parts of a turn whose sweeps stay within the chord error. */
static int32_t turns_of(const knife *work)
{
    const pliant_blade *blade = &work->tool->blade;
    const double *a = blade->rotation, *b = work->pose.rotation;
    const double sizes = sqrt((pliant_dot3(a, a) + a[3] * a[3]) * (pliant_dot3(b, b) + b[3] * b[3])),
                 cosine = sizes > 0 ? fabs(pliant_dot3(a, b) + a[3] * b[3]) / sizes : 1;
    const double angle = 2 * acos(fmin(cosine, 1)),
                 radius = sqrt(fmax(pliant_dot3(blade->from, blade->from), pliant_dot3(blade->to, blade->to)));
    const double off = max_chord_error * work->min_edge;
    if (radius <= off) return 1;
    return (int32_t)fmax(ceil(angle / (2 * acos(1 - off / radius))), 1);
}

static void begin(const knife *work)
{
    const double *cell = work->model->body->fine.cell_size;
    const double reach =
        work->model->contact.max_tool_speed * work->model->scene.solver.step + fmax(cell[0], fmax(cell[1], cell[2]));
    if (pliant_blade_begin_stroke(work->data, work->index, 0.5 * work->min_edge, reach) != PLIANT_OK) log_failure(work);
}

/* Return the distance that the edge's faster end has moved since the blade's previous pose [m]. */
static double way_of(const knife *work)
{
    const pliant_blade *blade = &work->tool->blade;
    double far = 0;
    for (int end = 0; end < 2; end++) {
        double before[3], now[3], motion[3];
        pliant_rotate(blade->rotation, end ? blade->to : blade->from, before);
        pliant_rotate(work->pose.rotation, end ? blade->to : blade->from, now);
        for (int d = 0; d < 3; d++) motion[d] = work->pose.tip[d] + now[d] - (blade->tip[d] + before[d]);
        far = fmax(far, pliant_length3(motion));
    }
    return far;
}

/* Return whether the blade's proxy has jumped to the measured pose. Warn once while the blade is on. */
static bool proxy_has_jumped(const knife *work)
{
    const pliant_tool *tool = work->tool;
    if (!(tool->shape.num_parts > 0 && tool->proxy.has_jumped)) return false;
    if (!tool->blade.failed)
        pliant_log(
            PLIANT_LOG_WARNING,
            "tool %s: its proxy has jumped to the measured pose (contact/max_proxy_error, or faster than %g m/s); "
            "its blade cuts nothing on its way. Move it more slowly, and out of the tissue that blocks it",
            tool->name, work->model->contact.max_tool_speed);
    return true;
}

/* Return whether the blade is too fast to cut in this step. Warn once while the blade is on. */
static bool is_too_fast(const knife *work)
{
    pliant_blade *blade = &work->tool->blade;
    const double fastest = work->model->contact.max_tool_speed, step = work->model->scene.solver.step,
                 far = pliant_blade_has_pose(blade) ? way_of(work) : 0;
    if (far <= fastest * step) return false;
    if (!blade->failed)
        pliant_log(
            PLIANT_LOG_WARNING,
            "tool %s is too fast to cut: its blade moves %.3g m in a step of %g s (%.3g m/s); above %g m/s it is taken "
            "for a jump and cuts nothing on its way. Move it more slowly",
            work->tool->name, far, step, far / step, fastest);
    return true;
}

static void cut_with(const knife *work)
{
    pliant_tool *tool = work->tool;
    pliant_blade *blade = &tool->blade;
    const bool jumped = proxy_has_jumped(work) || is_too_fast(work);
    if (jumped && blade->is_in_stroke) pliant_blade_end_stroke(tool);
    if (!blade->is_in_stroke) {
        begin(work);
        blade->failed = blade->failed || jumped;
        return;
    }
    double last[3], middle[3];
    if (blade->is_dragging || blade->has_slipped) add_blade_work(tool);
    pliant_blade_points(blade, blade->tip, blade->rotation, blade->edge.swept);
    pliant_blade_middle(&blade->edge, blade->edge.swept, last);
    pliant_blade_points(blade, work->pose.tip, work->pose.rotation, blade->edge.now);
    const bool far = moves_far(work, last);
    const int32_t turns = turns_of(work);
    for (int32_t k = 1; k <= turns; k++) {
        double tip[3], rotation[4], fraction = (double)k / turns;
        for (int d = 0; d < 3; d++) tip[d] = blade->tip[d] + fraction * (work->pose.tip[d] - blade->tip[d]);
        pliant_rotation_between(blade->rotation, work->pose.rotation, fraction, rotation);
        pliant_blade_points(blade, tip, rotation, blade->edge.now);
        pliant_blade_move_with_tissue(work->data, &blade->edge);
        if (!blade->is_dragging && longest_distance(&blade->edge) <= min_motion * work->min_edge) {
            memset(blade->free_tissue_force, 0, sizeof blade->free_tissue_force); /* at rest */
            continue;
        }
        if (work->model->scene.cut.resistance > 0 && !pliant_tool_grips(tool)) move_against_resistance(work, last, far);
        else cut_freely(work);
    }
    pliant_blade_middle(&blade->edge, blade->edge.now, middle);
    for (int d = 0; d < 3; d++) blade->moved[d] = blade->is_dragging || blade->has_slipped ? middle[d] - last[d] : 0;
    memcpy(blade->tip, work->pose.tip, sizeof blade->tip);
    memcpy(blade->rotation, work->pose.rotation, sizeof blade->rotation);
    blade->engaged_length = count_in_tissue(work) * pliant_blade_length(blade) / blade->edge.count;
}

pliant_status pliant_cut_stage(const pliant_model *model, pliant_data *data)
{
    const double *size = model->scan->geometry.spacing, max_edge = fmax(size[0], fmax(size[1], size[2]));
    const pliant_subdivision *subdivision = model->body->subdivision;
    for (int t = 0; t < data->num_tools; t++) {
        pliant_tool *tool = data->tools + t;
        if (!(tool->blade.cutting || tool->blade.is_ending) || !tool->present) continue;
        const knife work = {.model = model,
                            .data = data,
                            .index = t,
                            .tool = tool,
                            .pose = pliant_blade_pose(tool),
                            .min_edge = fmin(size[0], fmin(size[1], size[2])),
                            .max_edge = max_edge,
                            .ahead = fmax(max_edge, subdivision ? 2 * subdivision->min_edge : 0)};
        if (tool->blade.is_ending) end_stroke(&work);
        else cut_with(&work);
    }
    return PLIANT_OK;
}
