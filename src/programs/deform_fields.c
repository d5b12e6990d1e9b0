#include "deform_fields.h"

#include "pliant/contact.h"
#include "pliant/displacement.h"
#include "base/fail.h"
#include "base/memory.h"
#include "pliant/save.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

enum { PATH_CAPACITY = 4096 };

/* Insert a number before the extension of a name. A name without a folder is placed in the run's folder. If several
 * methods are compared, a name with a folder also gets the name of the method. */
static void path_of(const deform_run *run, const char *name, const char *number, char path[PATH_CAPACITY])
{
    const bool has_folder = strchr(name, '/'), is_one_of_many = has_folder && run->arguments->num_compared > 0;
    const char *dot = strrchr(name, '.');
    size_t stem = dot ? (size_t)(dot - name) : strlen(name);
    if (stem >= 4 && strcasecmp(name + stem - 4, ".nii.gz") == 0) stem -= 4;
    const char *method = is_one_of_many ? deform_method_name(run->scene.model.method) : "";
    snprintf(path, PATH_CAPACITY, "%s%s%.*s%s%s%s%s", has_folder ? "" : run->folder, has_folder ? "" : "/", (int)stem,
             name, is_one_of_many ? "_" : "", method, number, name + stem);
}

static pliant_status write_displacement(const deform_run *run, const char *name, const char *number,
                                        pliant_displacement_sense sense)
{
    const pliant_warp *warp = pliant_data_get_warp(run->data);
    pliant_displacement field;
    char path[PATH_CAPACITY];
    if (!name) return PLIANT_OK;
    pliant_status status = pliant_displacement_create(
        run->model, pliant_data_get_body(run->data), pliant_data_get_positions(run->data, NULL), sense,
        warp && sense == PLIANT_DISPLACEMENT_RESAMPLE ? &pliant_warp_volume(warp)->geometry : NULL, &field);
    if (status < 0) return status;
    path_of(run, name, number, path);
    status = pliant_displacement_write(path, &field);
    pliant_displacement_free(&field);
    return status;
}

/* List the files of all steps so far. */
static pliant_status write_series(const deform_run *run, const char *name, const char *ending, long last)
{
    char path[PATH_CAPACITY];
    snprintf(path, sizeof path, "%s/%s.pvd", run->folder, name);
    FILE *file = fopen(path, "w");
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    fputs(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n"
        "  <Collection>\n",
        file);
    for (long step = run->arguments->every; step <= last; step += run->arguments->every)
        fprintf(file, "    <DataSet timestep=\"%.9g\" part=\"0\" file=\"%s_%06ld.%s\"/>\n",
                (double)step * run->scene.solver.step, name, step, ending);
    fputs("  </Collection>\n</VTKFile>\n", file);
    int failed = ferror(file) | fclose(file);
    return failed ? pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno)) : PLIANT_OK;
}

static pliant_status write_vtk(const deform_run *run, const char *number, long step)
{
    static const struct { const char *name, *ending; } files[] = {{"mesh", "vtu"}, {"surface", "vtp"}};
    const pliant_body *body = pliant_data_get_body(run->data);
    double *force = pliant_calloc((size_t)body->fine.num_nodes, 3 * sizeof *force);
    pliant_status status = force ? PLIANT_OK : pliant_fail_memory("a file of the mesh");
    if (status >= 0) pliant_data_get_contact_forces(run->data, force);
    for (size_t f = 0; status >= 0 && f < sizeof files / sizeof *files; f++) {
        char path[PATH_CAPACITY];
        snprintf(path, sizeof path, "%s/%s%s.%s", run->folder, files[f].name, number, files[f].ending);
        status = pliant_mesh_save(path, run->model, body, pliant_data_get_positions(run->data, NULL), force,
                                  run->arguments->unit);
        if (status >= 0 && step > 0) status = write_series(run, files[f].name, files[f].ending, step);
    }
    pliant_free(force);
    return status;
}

pliant_status deform_fields_write(const deform_run *run, const char *number, long step)
{
    const deform_arguments *arguments = run->arguments;
    pliant_status status = write_displacement(run, arguments->displacement, number, PLIANT_DISPLACEMENT_RESAMPLE);
    if (status >= 0)
        status = write_displacement(run, arguments->tissue_displacement, number, PLIANT_DISPLACEMENT_TISSUE);
    return status >= 0 && arguments->vtk ? write_vtk(run, number, step) : status;
}
