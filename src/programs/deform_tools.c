#include "deform_tools.h"

#include "pliant/contact.h"
#include "base/clock.h"
#include "base/fail.h"

#include <errno.h>
#include <string.h>

static bool cuts_anything(const pliant_path *path)
{
    bool cuts = path->num_cuts > 0;
    for (uint32_t n = 0; n < path->num_tools; ++n) cuts = cuts || path->tools[n].num_cut > 0;
    return cuts;
}

static pliant_status begin_tool(const pliant_path_tool *tool, const pliant_model *model, pliant_data *data)
{
    const double none[3] = {0.0, 0.0, 0.0};
    double tip[3], rotation[4];
    int index;
    pliant_status status = pliant_tool_add(model, data, tool->name, &index);
    if (status < 0) return status;
    if (pliant_path_pose_at(tool, 0.0, tip, rotation)) {
        status = pliant_tool_set_pose(data, index, tip, rotation);
        if (status >= 0) status = pliant_tool_set_shape(data, index, &tool->shape);
        if (status >= 0) status = pliant_tool_set_jaw(data, index, pliant_path_jaw_at(tool, 0.0));
        if (status >= 0) status = pliant_tool_set_blade(data, index, tool->blade_from, tool->blade_to);
        return status >= 0 && pliant_path_cuts(tool, 0.0) ? pliant_tool_set_cutting(data, index, true) : status;
    }
    status = pliant_tool_set_pose(data, index, tool->grasp, NULL);
    if (status >= 0) status = pliant_tool_grasp(model, data, index, tool->grasp);
    if (status >= 0)
        status = pliant_tool_set_drive(data, index, tool->drive, tool->drive == PLIANT_DRIVE_FORCE ? none : NULL);
    return status < 0 ? status : pliant_tool_set_mass(data, index, tool->mass);
}

pliant_status deform_tools_begin(const pliant_path *path, const char *folder, const pliant_model *model,
                                 pliant_data *data, deform_tools *out)
{
    deform_tools tools = {.path = path};
    for (uint32_t n = 0; n < path->num_tools; ++n) {
        pliant_status status = begin_tool(&path->tools[n], model, data);
        if (status < 0) return status;
    }
    if (cuts_anything(path)) {
        char name[4096];
        snprintf(name, sizeof name, "%s/cuts.csv", folder);
        tools.cuts = fopen(name, "w");
        if (!tools.cuts) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", name, strerror(errno));
        fputs("step,time_s,tool,stroke,area_m2,severed_area_m2,pieces,revision,nodes,tetrahedra,cut_s\n", tools.cuts);
    }
    *out = tools;
    return PLIANT_OK;
}

static void add_row(const deform_tools *tools, const pliant_data *data, long step, double time, const char *name,
                    uint64_t stroke, double area, double severed, int32_t pieces, double seconds)
{
    const pliant_body *body = pliant_data_get_body(data);
    fprintf(tools->cuts, "%ld,%.6g,%s,%llu,%.6g,%.6g,%d,%llu,%d,%d,%.4g\n", step, time, name,
            (unsigned long long)stroke, area, severed, (int)pieces, (unsigned long long)body->revision,
            (int)body->fine.num_nodes, (int)body->fine.num_tets, seconds);
}

static void print_cut(const pliant_data *data, double time, const char *name, double area, int32_t pieces)
{
    printf("%.3f s: %s cut %.4g cm^2; %d %s, revision %llu\n", time, name, 1e4 * area, (int)pieces,
           pieces == 1 ? "piece" : "pieces", (unsigned long long)pliant_data_get_body(data)->revision);
}

/* Print a stroke's cut area at its end. */
static void print_stroke(deform_tools *tools, const pliant_data *data, int index, double time)
{
    pliant_tool_state state;
    if (pliant_tool_get(data, index, &state) < 0) return;
    if (state.severed_area > tools->before[index])
        print_cut(data, time, state.name, state.severed_area - tools->before[index], state.pieces);
    tools->before[index] = state.severed_area;
}

static pliant_status move_posed(deform_tools *tools, pliant_data *data, int index, double time)
{
    const pliant_path_tool *tool = &tools->path->tools[index];
    double tip[3], rotation[4];
    pliant_tool_state state;
    pliant_path_pose_at(tool, time, tip, rotation);
    pliant_status status = pliant_tool_set_pose(data, index, tip, rotation);
    if (status >= 0) status = pliant_tool_set_jaw(data, index, pliant_path_jaw_at(tool, time));
    if (status >= 0) status = pliant_tool_get(data, index, &state);
    const bool cuts = pliant_path_cuts(tool, time);
    if (status < 0 || cuts == state.cutting) return status;
    print_stroke(tools, data, index, time);
    return pliant_tool_set_cutting(data, index, cuts);
}

static pliant_status move_hold(const pliant_path_tool *tool, pliant_data *data, int index, double time)
{
    double value[3], tip[3];
    if (!pliant_path_at(tool, time, value)) {
        pliant_tool_release(data, index);
        return PLIANT_OK;
    }
    for (int d = 0; d < 3; ++d) tip[d] = tool->grasp[d] + value[d];
    return tool->drive == PLIANT_DRIVE_FORCE ? pliant_tool_set_drive(data, index, tool->drive, value)
                                             : pliant_tool_set_pose(data, index, tip, NULL);
}

pliant_status deform_tools_move(deform_tools *tools, const pliant_model *model, pliant_data *data, long step,
                                double time)
{
    const pliant_path *path = tools->path;
    pliant_status status = PLIANT_OK;
    for (uint32_t n = 0; n < path->num_tools && status >= 0; ++n)
        status = path->tools[n].num_poses > 0 ? move_posed(tools, data, (int)n, time)
                                              : move_hold(&path->tools[n], data, (int)n, time);
    for (; tools->next < path->num_cuts && path->cuts[tools->next].time <= time && status >= 0; ++tools->next) {
        const pliant_path_cut *cut = &path->cuts[tools->next];
        pliant_cut_report report;
        const double start = pliant_seconds();
        status = pliant_data_cut(model, data, (int32_t)cut->num_points, cut->points, cut->depth, &report);
        if (status < 0) break;
        add_row(tools, data, step, time, "", tools->next + 1, report.area, report.area, report.pieces,
                pliant_seconds() - start);
        print_cut(data, time, "the path", report.area, report.pieces);
    }
    return status;
}

void deform_tools_report(deform_tools *tools, const pliant_data *data, long step, double time)
{
    for (int n = 0; n < pliant_data_get_num_tools(data); ++n) {
        pliant_tool_state state;
        if (pliant_tool_get(data, n, &state) < 0 || state.severed_area == tools->area[n]) continue;
        add_row(tools, data, step, time, state.name, state.stroke, state.severed_area - tools->area[n],
                state.severed_area, state.pieces, pliant_data_get_statistics(data)->seconds[PLIANT_STEP_cut]);
        tools->area[n] = state.severed_area;
    }
}

pliant_status deform_tools_end(deform_tools *tools, const pliant_data *data, double time)
{
    if (!tools->cuts) return PLIANT_OK;
    for (int n = 0; n < pliant_data_get_num_tools(data); ++n) print_stroke(tools, data, n, time);
    int failed = ferror(tools->cuts) | fclose(tools->cuts);
    tools->cuts = NULL;
    return failed ? pliant_fail(PLIANT_ERROR_FILE, "cuts.csv could not be written completely: %s", strerror(errno))
                  : PLIANT_OK;
}

static void add_point(const double *point, double fraction, double out[3])
{
    for (int d = 0; d < 3; ++d) out[d] += fraction * point[d];
}

bool deform_tools_point(const pliant_path *path, double point[3])
{
    memset(point, 0, 3 * sizeof *point);
    for (uint32_t n = 0; n < path->num_tools; ++n) {
        const pliant_path_tool *tool = &path->tools[n];
        if (tool->num_poses == 0) add_point(tool->grasp, 1.0, point);
        for (uint32_t p = 0; p < tool->num_poses; ++p) add_point(tool->poses[p].position, 1.0 / tool->num_poses, point);
        return true;
    }
    if (path->num_cuts == 0) return false;
    const pliant_path_cut *cut = path->cuts;
    for (uint32_t p = 0; p < cut->num_points; ++p) add_point(cut->points + 3 * p, 1.0 / cut->num_points, point);
    add_point(cut->depth, 0.5, point);
    return true;
}
