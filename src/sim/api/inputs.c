/* Read the inputs of a model from their paths. */
#include "base/fail.h"
#include "base/threads.h"
#include "material/material.h"
#include "scan/volume.h"
#include "sim/build/model.h"
#include "pliant/segment.h"

#include <stdio.h>
#include <string.h>

static const int32_t phantom_size[3] = {160, 112, 136};

static bool names_labels(const pliant_material_table *table)
{
    for (uint32_t m = 0; m < table->num_materials; m++)
        if (table->materials[m].num_labels > 0) return true;
    return false;
}

/* Make the scan "phantom" or "phantom:256x160x122". The scene's resampling sets the phantom's size directly. */
static pliant_status make_phantom(const pliant_scene *scene, const char *path, pliant_volume *scan,
                                  pliant_labels *labels)
{
    int32_t size[3];
    for (int d = 0; d < 3; d++) size[d] = scene->scan.resample[d] > 0 ? scene->scan.resample[d] : phantom_size[d];
    if (path[7] == ':') {
        char rest;
        if (sscanf(path + 8, "%dx%dx%d%c", &size[0], &size[1], &size[2], &rest) != 3)
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "%s: the size of the phantom is written as phantom:256x160x122",
                               path);
    }
    return pliant_phantom(size, 1, scan, labels);
}

static pliant_status read_scan(const pliant_scene *scene, const char *path, pliant_volume *scan, pliant_labels *labels)
{
    pliant_status status = pliant_volume_read(path, scene->scan.series, 0, scan);
    if (status == PLIANT_OK && scene->material.labels[0]) {
        status = pliant_labels_read(scene->material.labels, 0, labels);
        if (status == PLIANT_OK) status = pliant_labels_to_grid(labels, &scan->geometry);
        if (status == PLIANT_ERROR_ARGUMENT)
            status = pliant_fail(PLIANT_ERROR_FORMAT, "material/labels: %s and the scan %s: %s", scene->material.labels,
                                 path, pliant_last_error());
    }
    return status;
}

static pliant_status resample(const pliant_scene *scene, pliant_volume *scan, pliant_labels *labels)
{
    int32_t size[3];
    bool same = true;
    for (int d = 0; d < 3; d++) {
        size[d] = scene->scan.resample[d] > 0 ? scene->scan.resample[d] : scan->geometry.size[d];
        same = same && size[d] == scan->geometry.size[d];
    }
    if (same) return PLIANT_OK;
    pliant_volume volume;
    pliant_labels map;
    pliant_status status = pliant_volume_resample(scan, size, &volume);
    if (status != PLIANT_OK) return status;
    pliant_volume_free(scan);
    *scan = volume;
    if (!labels->voxels) return PLIANT_OK;
    status = pliant_labels_resample(labels, size, &map);
    if (status != PLIANT_OK) return status;
    pliant_labels_free(labels);
    *labels = map;
    return PLIANT_OK;
}

/* Labels that the table does not name are dropped, so their voxels are classified by intensity. */
static void drop_unnamed(const pliant_material_table *table, pliant_labels *labels)
{
    bool named[UINT16_MAX + 1] = {false};
    for (uint32_t m = 0; m < table->num_materials; m++)
        for (uint32_t l = 0; l < table->materials[m].num_labels; l++)
            if (table->materials[m].labels[l] <= UINT16_MAX) named[table->materials[m].labels[l]] = true;
    size_t voxels = pliant_geometry_voxels(&labels->geometry);
    for (size_t v = 0; v < voxels; v++)
        if (!named[labels->voxels[v]]) labels->voxels[v] = 0;
}

static pliant_status segment(const pliant_scene *scene, const pliant_volume *scan, const pliant_material_table *table,
                             pliant_labels *labels)
{
    if (scene->material.labels[0])
        return pliant_fail(
            PLIANT_ERROR_SCENE,
            "segment/kind: gmm makes labels, but material/labels names a label map: one of them is enough");
    pliant_segment_options options;
    pliant_segmentation found;
    pliant_segment_options_from(scene, &scan->geometry, &options);
    pliant_status status = pliant_segment(scan, &options, &found);
    if (status != PLIANT_OK) return status;
    pliant_log(PLIANT_LOG_INFO, "segmentation: %d classes, %d pieces", found.num_classes, found.num_pieces);
    drop_unnamed(table, &found.labels);
    pliant_labels_free(labels);
    *labels = found.labels;
    found.labels.voxels = NULL;
    pliant_segmentation_free(&found);
    return PLIANT_OK;
}

pliant_status pliant_scan_inputs_read(const pliant_scene *scene, const pliant_material_table *materials,
                                      const char *scan_path, pliant_volume *scan, pliant_labels *labels)
{
    pliant_volume volume = {0};
    pliant_labels map = {0};
    bool phantom = strcmp(scan_path, "phantom") == 0 || strncmp(scan_path, "phantom:", 8) == 0;
    if (phantom && scene->material.labels[0])
        return pliant_fail(PLIANT_ERROR_SCENE,
                           "material/labels: %s: the phantom brings its own label map; leave the option empty",
                           scene->material.labels);
    int threads = pliant_threads_begin(scene->solver.threads);
    pliant_status status = phantom ? make_phantom(scene, scan_path, &volume, names_labels(materials) ? &map : NULL)
                                   : read_scan(scene, scan_path, &volume, &map);
    if (status == PLIANT_OK && !phantom) status = resample(scene, &volume, &map);
    if (status == PLIANT_OK && scene->segment.kind == PLIANT_SEGMENT_GMM)
        status = segment(scene, &volume, materials, &map);
    pliant_threads_end(threads);
    if (status != PLIANT_OK) {
        pliant_volume_free(&volume);
        pliant_labels_free(&map);
        return status;
    }
    *scan = volume;
    *labels = map;
    return PLIANT_OK;
}

pliant_status pliant_inputs_read(const pliant_scene *scene, const char *scan_path, pliant_volume *scan,
                                 pliant_labels *labels, pliant_material_table *materials)
{
    pliant_material_table table = {0};
    pliant_status status = scene->material.file[0] ? pliant_material_table_read(scene->material.file, &table)
                                                   : pliant_material_table_default(&table);
    pliant_volume volume = {0};
    pliant_labels map = {0};
    if (status == PLIANT_OK)
        status = pliant_material_table_check_scene(
            &table, scene, scene->material.file[0] ? scene->material.file : "built-in materials");
    if (status == PLIANT_OK) status = pliant_scan_inputs_read(scene, &table, scan_path, &volume, &map);
    if (status == PLIANT_OK && !scene->material.file[0]) status = pliant_material_default_check(&volume);
    if (status != PLIANT_OK) {
        pliant_volume_free(&volume);
        pliant_labels_free(&map);
        pliant_material_table_free(&table);
        return status;
    }
    *scan = volume;
    *labels = map;
    *materials = table;
    return PLIANT_OK;
}
