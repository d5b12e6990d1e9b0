/* Identify comparable results by a hash of eight characters. */
#include "report/rows.h"
#include "scan/volume.h"

#include <stdio.h>
#include <string.h>

uint64_t report_hash(uint64_t hash, const void *bytes, size_t size)
{
    for (const unsigned char *at = bytes; size-- > 0; at++) hash = (hash ^ *at) * 1099511628211u; /* FNV-1a */
    return hash;
}

static uint64_t add_materials(uint64_t hash, const pliant_material_table *table)
{
    for (uint32_t m = 0; m < table->num_materials; m++) {
        const pliant_material *material = table->materials + m;
        double numbers[5] = {material->young_modulus, material->poisson_ratio, material->density, 0, 0};
        uint8_t flags[2] = {material->fixed, material->empty};
        if (material->num_range) memcpy(numbers + 3, material->range, sizeof material->range);
        hash = report_hash(hash, material->name, strlen(material->name));
        hash = report_hash(hash, numbers, sizeof numbers);
        hash = report_hash(hash, flags, sizeof flags);
        hash = report_hash(hash, material->labels, material->num_labels * sizeof *material->labels);
    }
    return hash;
}

/* Segment names matter where they determine materials. */
static uint64_t add_segments(uint64_t hash, const pliant_labels *labels, const pliant_material_table *table)
{
    hash = report_hash(hash, labels->segments, labels->num_segments * sizeof *labels->segments);
    for (uint32_t m = 0; m < table->num_materials; m++) {
        const pliant_material *material = table->materials + m;
        hash = report_hash(hash, material->segments, material->num_segments * sizeof *material->segments);
    }
    return hash;
}

void pliant_report_setup(const pliant_report_input *input, const pliant_sweep *sweep, char out[9])
{
    pliant_scene scene = *input->scene; /* padding is zero, because pliant_scene_defaults created it */
    scene.model.method = PLIANT_FINE;
    scene.model.submesh = PLIANT_SUBMESH_OVERLAP;
    scene.mesh.ratio = 1;
    scene.solver.iterations = 1;
    uint64_t hash = report_hash(14695981039346656037u, PLIANT_VERSION, strlen(PLIANT_VERSION));
    hash = report_hash(hash, &scene, sizeof scene);
    hash = report_hash(hash, &input->scan->geometry, sizeof input->scan->geometry);
    hash = report_hash(hash, input->scan->voxels,
                       pliant_geometry_voxels(&input->scan->geometry) * pliant_encoding_size(input->scan->encoding));
    if (input->labels)
        hash = report_hash(hash, input->labels->voxels, 2 * pliant_geometry_voxels(&input->labels->geometry));
    if (input->labels && input->labels->num_segments > 0) hash = add_segments(hash, input->labels, input->materials);
    hash = add_materials(hash, input->materials);
    if (sweep) {
        hash = report_hash(hash, sweep->pull, sizeof sweep->pull);
        hash = report_hash(hash, &sweep->frames, sizeof sweep->frames);
        for (int p = 0; p < sweep->num_points; p++)
            hash = report_hash(hash, sweep->points[p].rest, sizeof sweep->points[p].rest);
    }
    snprintf(out, 9, "%08x", (unsigned)(hash ^ hash >> 32));
}
