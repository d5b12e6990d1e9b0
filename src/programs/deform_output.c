#include "deform_output.h"

#include "deform_fields.h"
#include "deform_view.h"
#include "base/fail.h"
#include "fem/element/scalar.h"
#include "material/material.h"
#include "picture.h"
#include "picture_scalar.h"
#include "picture_section.h"
#include "base/memory.h"
#include "topology/visible_surface.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

/* Return the column name of a scalar. */
static const char *column_of(pliant_scalar scalar)
{
    switch (scalar) {
    case PLIANT_SCALAR_VON_MISES: return "von_mises_pa";
    case PLIANT_SCALAR_STRAIN_ENERGY: return "strain_energy_j_m3";
    case PLIANT_SCALAR_VOLUME_RATIO: return "volume_ratio";
    case PLIANT_SCALAR_PRINCIPAL_STRESS: return "principal_stress_pa";
    case PLIANT_SCALAR_MASS_CHANGE: return "mass_change_m3";
    case PLIANT_SCALAR_CONTACT_FORCE: return "contact_force_n";
    case PLIANT_SCALAR_NONE: break;
    }
    return "";
}

/* consecutive arrays (num_scalars x count): node values, element values */
typedef struct scalar_values {
    int num_scalars;
    float *of_node, *of_tet;
} scalar_values;

static void free_scalars(scalar_values *values)
{
    pliant_free(values->of_node);
    pliant_free(values->of_tet);
}

static pliant_status find_scalars(const deform_run *run, scalar_values *out)
{
    const deform_arguments *arguments = run->arguments;
    const pliant_body *body = pliant_data_get_body(run->data);
    const pliant_mesh *mesh = &body->fine;
    pliant_status status = PLIANT_OK;
    *out = (scalar_values){.num_scalars = arguments->num_scalars};
    if (arguments->num_scalars == 0) return PLIANT_OK;
    out->of_node = pliant_calloc((size_t)mesh->num_nodes * (size_t)arguments->num_scalars, sizeof *out->of_node);
    out->of_tet = pliant_calloc((size_t)mesh->num_tets * (size_t)arguments->num_scalars, sizeof *out->of_tet);
    if (!out->of_node || !out->of_tet) status = pliant_fail_memory("the scalars");
    const double *positions = pliant_data_get_positions(run->data, NULL);
    for (int s = 0; status >= 0 && s < arguments->num_scalars; ++s) {
        status = pliant_data_get_scalar(run->model, run->data, arguments->scalars[s],
                                        out->of_node + (size_t)s * (size_t)mesh->num_nodes);
        if (status >= 0)
            status = pliant_data_tet_scalar(run->model, body, positions, arguments->scalars[s],
                                            out->of_tet + (size_t)s * (size_t)mesh->num_tets);
    }
    if (status < 0) free_scalars(out);
    return status;
}

static void write_scalars(FILE *file, const float *values, int num_scalars, int32_t count, int32_t index)
{
    for (int s = 0; s < num_scalars; ++s)
        fprintf(file, ",%.6g", (double)values[(size_t)s * (size_t)count + (size_t)index]);
    fputc('\n', file);
}

static void write_columns(FILE *file, const deform_arguments *arguments)
{
    for (int s = 0; s < arguments->num_scalars; ++s) fprintf(file, ",%s", column_of(arguments->scalars[s]));
    fputc('\n', file);
}

static pliant_status open_table(const deform_run *run, const char *name, const char *number, char path[4096],
                                FILE **out)
{
    snprintf(path, 4096, "%s/%s%s.csv", run->folder, name, number);
    *out = fopen(path, "w");
    return *out ? PLIANT_OK : pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
}

static pliant_status close_table(const char *path, FILE *file)
{
    int failed = ferror(file) | fclose(file);
    return failed ? pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno)) : PLIANT_OK;
}

static pliant_status write_nodes(const deform_run *run, const char *number, const scalar_values *scalars)
{
    const pliant_mesh *mesh = &pliant_data_get_body(run->data)->fine;
    char path[4096];
    FILE *file;
    pliant_status status = open_table(run, "nodes", number, path, &file);
    if (status < 0) return status;
    fputs("rest_x_m,rest_y_m,rest_z_m,x_m,y_m,z_m", file);
    write_columns(file, run->arguments);
    const double *positions = pliant_data_get_positions(run->data, NULL);
    for (int32_t node = 0; node < mesh->num_nodes; ++node) {
        const double *rest = mesh->rest + 3 * node, *now = positions + 3 * node;
        fprintf(file, "%.9g,%.9g,%.9g,%.9g,%.9g,%.9g", rest[0], rest[1], rest[2], now[0], now[1], now[2]);
        write_scalars(file, scalars->of_node, scalars->num_scalars, mesh->num_nodes, node);
    }
    return close_table(path, file);
}

static pliant_status write_elements(const deform_run *run, const char *number, const scalar_values *scalars)
{
    const pliant_body *body = pliant_data_get_body(run->data);
    const pliant_mesh *mesh = &body->fine;
    char path[4096];
    FILE *file;
    pliant_status status = open_table(run, "elements", number, path, &file);
    if (status < 0) return status;
    fputs("node_0,node_1,node_2,node_3,material", file);
    write_columns(file, run->arguments);
    for (int32_t tet = 0; tet < mesh->num_tets; ++tet) {
        const int32_t *nodes = mesh->tets + 4 * tet;
        fprintf(file, "%d,%d,%d,%d,%s", (int)nodes[0], (int)nodes[1], (int)nodes[2], (int)nodes[3],
                pliant_model_get_materials(run->model)->materials[body->fine_material[tet].material].name);
        write_scalars(file, scalars->of_tet, scalars->num_scalars, mesh->num_tets, tet);
    }
    return close_table(path, file);
}

void deform_picture_point(const deform_run *run, double point[3])
{
    const pliant_body *body = pliant_model_get_body(run->model);
    double mass = 0.0;
    if (deform_tools_point(&run->inputs->path, point)) return;
    for (int32_t n = 0; n < body->fine.num_nodes; ++n) {
        for (int d = 0; d < 3; ++d) point[d] += body->node_mass[n] * body->fine.rest[3 * n + d];
        mass += body->node_mass[n];
    }
    for (int d = 0; d < 3 && mass > 0.0; ++d) point[d] /= mass;
}

/* Mark the tetrahedra with contact forces on all corners of a face; overlapping tetrahedra have them on every corner
 * ([C] 5.2). */
static void mark_collided(const pliant_mesh *mesh, const double *force, uint8_t *collided)
{
    for (int32_t tet = 0; tet < mesh->num_tets; ++tet) {
        int pressed = 0;
        for (int v = 0; v < 4; ++v) {
            const double *of = force + 3 * (size_t)mesh->tets[4 * tet + v];
            pressed += of[0] != 0.0 || of[1] != 0.0 || of[2] != 0.0;
        }
        collided[tet] = pressed >= 3;
    }
}

/* Return the number of parallelograms that the path's cuts sweep in a step; store their corners unless out is NULL. */
static int32_t swept_strips(const pliant_path *path, double after, double until, double *out)
{
    int32_t count = 0;
    for (uint32_t c = 0; c < path->num_cuts; ++c) {
        const pliant_path_cut *cut = &path->cuts[c];
        if (cut->time <= after || cut->time > until) continue;
        for (uint32_t p = 0; p + 1 < cut->num_points; ++p, ++count)
            for (int d = 0; out && d < 3; ++d) {
                const double *from = cut->points + 3 * p, *to = from + 3;
                const double corners[4] = {from[d], to[d], to[d] + cut->depth[d], from[d] + cut->depth[d]};
                for (int v = 0; v < 4; ++v) out[12 * count + 3 * v + d] = corners[v];
            }
    }
    return count;
}

/* Set each material to the colour of its first segment with a colour.
 * colors: (PLIANT_MAX_MATERIALS x 3), zeroed by the caller */
static void segment_colors(const pliant_labels *labels, const pliant_material_table *table, uint8_t *colors)
{
    for (uint32_t s = 0; s < labels->num_segments; ++s) {
        const pliant_label_segment *segment = &labels->segments[s];
        const int material = pliant_material_of_segment(table, segment);
        if (material < 0 || segment->color[0] < 0) continue;
        uint8_t *color = colors + 3 * material;
        if (color[0] || color[1] || color[2]) continue;
        for (int c = 0; c < 3; ++c) color[c] = (uint8_t)(255.0f * segment->color[c] + 0.5f);
    }
}

static pliant_status write_mesh(const deform_run *run, const char *number, long step, const double point[3])
{
    const pliant_body *body = pliant_data_get_body(run->data);
    const size_t num_tets = (size_t)body->fine.num_tets;
    const double dt = run->scene.solver.step, after = (double)(step - 1) * dt, until = (double)step * dt;
    const int32_t num_strips = swept_strips(&run->inputs->path, after, until, NULL);
    uint8_t *material = pliant_calloc(num_tets, sizeof *material),
            *collided = pliant_calloc(num_tets, sizeof *collided);
    double *force = pliant_calloc((size_t)body->fine.num_nodes, 3 * sizeof *force);
    double *strips = pliant_calloc((size_t)num_strips + 1, 12 * sizeof *strips);
    pliant_status status =
        material && collided && force && strips ? PLIANT_OK : pliant_fail_memory("a picture of the mesh");
    uint8_t colors[3 * PLIANT_MAX_MATERIALS] = {0};
    segment_colors(&run->inputs->labels, &run->inputs->materials, colors);
    if (status >= 0) {
        for (size_t tet = 0; tet < num_tets; ++tet) material[tet] = (uint8_t)body->fine_material[tet].material;
        pliant_data_get_contact_forces(run->data, force);
        mark_collided(&body->fine, force, collided);
        swept_strips(&run->inputs->path, after, until, strips);
        picture_mesh shown = {
            &body->fine, pliant_data_get_positions(run->data, NULL), material, collided, strips, num_strips, colors};
        status = picture_mesh_write(run->folder, number, &shown, point);
    }
    pliant_free(material);
    pliant_free(collided);
    pliant_free(force);
    pliant_free(strips);
    return status;
}

static pliant_status write_pictures(const deform_run *run, const char *number, long step, const scalar_values *scalars)
{
    const pliant_data *data = run->data;
    picture_view view;
    pliant_status status = picture_window(&run->inputs->scan, &view.low, &view.high);
    if (status < 0) return status;
    deform_picture_point(run, view.before_point);
    memcpy(view.after_point, view.before_point, sizeof view.after_point);
    pliant_tool_state tool;
    if (pliant_data_get_num_tools(data) > 0 && pliant_tool_get(data, 0, &tool) >= 0 && tool.holding)
        memcpy(view.after_point, tool.held_point, sizeof view.after_point);
    const pliant_volume *after = pliant_warp_volume(pliant_data_get_warp(data));
    status = picture_write(run->folder, number, &run->inputs->scan, after, &view);
    if (status >= 0) status = write_mesh(run, number, step, view.before_point);
    for (int s = 0; status >= 0 && s < scalars->num_scalars; ++s) {
        const pliant_mesh *mesh = &pliant_data_get_body(data)->fine;
        char name[96];
        snprintf(name, sizeof name, "%s%s", column_of(run->arguments->scalars[s]), number);
        picture_scalars shown = {mesh, pliant_data_get_positions(data, NULL),
                                 scalars->of_tet + (size_t)s * (size_t)mesh->num_tets};
        status = picture_scalar(run->folder, name, &shown, &after->geometry, view.before_point);
    }
    return status;
}

static pliant_status write_surface(const deform_run *run, const char *number, const scalar_values *scalars)
{
    char path[4096];
    const char *names[PLIANT_NUM_SCALARS];
    pliant_surface *surface;
    for (int s = 0; s < scalars->num_scalars; ++s) names[s] = column_of(run->arguments->scalars[s]);
    pliant_status status = pliant_surface_create(pliant_data_get_body(run->data), NULL, &surface);
    if (status < 0) return status;
    snprintf(path, sizeof path, "%s/surface%s.ply", run->folder, number);
    status = pliant_surface_write(path, surface, pliant_data_get_positions(run->data, NULL), run->arguments->unit,
                                 scalars->num_scalars, names, scalars->of_node);
    pliant_surface_free(surface);
    return status;
}

pliant_status deform_write(const deform_run *run, long step)
{
    const deform_arguments *arguments = run->arguments;
    char path[4096], number[32] = "";
    scalar_values scalars;
    if (step > 0) snprintf(number, sizeof number, "_%06ld", step);
    pliant_status status = find_scalars(run, &scalars);
    if (status < 0) return status;
    status = write_nodes(run, number, &scalars);
    if (status >= 0 && (step == 0 || arguments->num_scalars > 0)) status = write_elements(run, number, &scalars);
    if (status >= 0) status = write_surface(run, number, &scalars);
    if (status >= 0 && pliant_data_get_warp(run->data)) {
        snprintf(path, sizeof path, "%s/deformed%s.nii.gz", run->folder, number);
        status = pliant_volume_write(path, pliant_warp_volume(pliant_data_get_warp(run->data)));
        if (status >= 0 && arguments->pictures) status = write_pictures(run, number, step, &scalars);
    }
    if (status >= 0) status = deform_view_write(run, number);
    if (status >= 0) status = deform_fields_write(run, number, step);
    free_scalars(&scalars);
    return status;
}
