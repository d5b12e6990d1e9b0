#include "material/material.h"

#include "base/fail.h"
#include "base/memory.h"

#include "material/names.h"
#include "scan/volume.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { NONE = 255, NUM_16 = 65536, MAX_LISTED = 16 };
_Static_assert((int)PLIANT_MAX_MATERIALS <= (int)NONE,
               "one byte tells the material, one value of it tells that there is none");

/* An intensity range and its material. */
typedef struct range {
    double low, high;
    uint8_t material;
} range;

/* The inverted table: from the value or label of a voxel to its material. */
typedef struct lookup {
    uint8_t of_label[NUM_16];
    uint8_t of_stored[NUM_16]; /* integer scans: by the bits of the stored value */
    range ranges[PLIANT_MAX_MATERIALS]; /* ascending */
    int num_ranges;
} lookup;

/* Return the material of a value; NaN is in no range. */
static uint8_t of_value(const lookup *l, double value)
{
    int below = 0, above = l->num_ranges;
    while (below < above) {
        int middle = (below + above) / 2;
        if (l->ranges[middle].high <= value) below = middle + 1;
        else above = middle;
    }
    return below < l->num_ranges && value >= l->ranges[below].low ? l->ranges[below].material : NONE;
}

static void fill(const pliant_material_table *table, const pliant_volume *scan, const pliant_labels *labels, lookup *l)
{
    memset(l->of_label, NONE, sizeof l->of_label);
    for (uint32_t m = 0; m < table->num_materials; ++m) {
        const pliant_material *material = &table->materials[m];
        for (uint32_t i = 0; i < material->num_labels; ++i) l->of_label[material->labels[i]] = (uint8_t)m;
        if (!material->num_range) continue;
        int at = l->num_ranges++;
        for (; at > 0 && l->ranges[at - 1].low > material->range[0]; --at) l->ranges[at] = l->ranges[at - 1];
        l->ranges[at] = (range){material->range[0], material->range[1], (uint8_t)m};
    }
    for (uint32_t s = 0; labels && s < labels->num_segments; ++s) {
        const int material = pliant_material_of_segment(table, labels->segments + s);
        l->of_label[labels->segments[s].label] = material < 0 ? (uint8_t)NONE : (uint8_t)material;
    }
    for (int bits = 0; bits < NUM_16; ++bits) {
        int stored = scan->encoding == PLIANT_INT16 && bits >= NUM_16 / 2 ? bits - NUM_16 : bits;
        l->of_stored[bits] = of_value(l, scan->slope * (float)stored + scan->intercept);
    }
}

static inline uint8_t of_voxel(const lookup *l, const pliant_volume *scan, const uint16_t *labels, size_t v)
{
    /* A label without a material is an error; the intensity is not used instead. */
    if (labels && labels[v]) return l->of_label[labels[v]];
    switch (scan->encoding) {
    case PLIANT_UINT8: return l->of_stored[((const uint8_t *)scan->voxels)[v]];
    case PLIANT_INT16: return l->of_stored[((const uint16_t *)scan->voxels)[v]];
    case PLIANT_FLOAT32: break;
    }
    return of_value(l, scan->slope * ((const float *)scan->voxels)[v] + scan->intercept);
}

/* A list in words with a maximum length. */
typedef struct listing {
    char text[1200];
    size_t used;
    int items, listed;
} listing;

static void add(listing *list, const char *item, uint64_t voxels)
{
    const size_t more = sizeof " and 65535 more", capacity = sizeof list->text - more - list->used;
    if (list->items++ > list->listed || list->listed == MAX_LISTED) return;
    const int length = snprintf(list->text + list->used, capacity, "%s%s: %llu voxels", list->items > 1 ? ", " : "",
                                item, (unsigned long long)voxels);
    if ((size_t)length < capacity) {
        list->used += (size_t)length;
        ++list->listed;
    }
    list->text[list->used] = '\0';
}

static void finish(listing *list)
{
    if (list->items > list->listed)
        snprintf(list->text + list->used, sizeof list->text - list->used, " and %d more", list->items - list->listed);
}

/* Return true if names decide materials, false if class ids do. */
static bool has_segments(const pliant_labels *labels)
{
    return labels->num_segments > 0 && !labels->segments[0].is_class;
}

static void list_segments(const lookup *l, const pliant_material_table *table, const pliant_labels *labels,
                          const uint64_t *counts, listing *list)
{
    for (uint32_t s = 0; s < labels->num_segments; ++s) {
        const pliant_label_segment *segment = labels->segments + s;
        char near[160], item[260];
        if (!counts[segment->label] || l->of_label[segment->label] != NONE) continue;
        pliant_nearest_names(table, segment->name, near, sizeof near);
        snprintf(item, sizeof item, "\"%s\" (nearest names: %s)", segment->name, near);
        add(list, item, counts[segment->label]);
    }
    finish(list);
}

static void list_labels(const lookup *l, const pliant_material_table *table, const pliant_labels *labels,
                        uint64_t *counts, listing *list)
{
    const size_t voxels = pliant_geometry_voxels(&labels->geometry);
    for (size_t v = 0; v < voxels; ++v) ++counts[labels->voxels[v]];
    if (has_segments(labels)) {
        list_segments(l, table, labels, counts, list);
        return;
    }
    for (int label = 1; label < NUM_16; ++label) {
        char item[100];
        const char *name = "";
        if (!counts[label] || l->of_label[label] != NONE) continue;
        for (uint32_t s = 0; s < labels->num_segments; ++s)
            if (labels->segments[s].label == label) name = labels->segments[s].name;
        snprintf(item, sizeof item, name[0] ? "%d (%s)" : "%d", label, name);
        add(list, item, counts[label]);
    }
    finish(list);
}

/* List values without a material. counts[g] belongs to the gap before range g; the last one belongs to NaN. */
static void list_gaps(const lookup *l, const pliant_volume *scan, const uint16_t *labels, uint64_t *counts,
                      listing *list)
{
    size_t voxels = pliant_geometry_voxels(&scan->geometry);
    memset(counts, 0, NUM_16 * sizeof *counts);
    for (size_t v = 0; v < voxels; ++v) {
        if ((labels && labels[v]) || of_voxel(l, scan, labels, v) != NONE) continue;
        double value = pliant_volume_value(scan, v);
        int gap = 0;
        while (gap < l->num_ranges && l->ranges[gap].low <= value) ++gap;
        ++counts[isnan(value) ? l->num_ranges + 1 : gap];
    }
    for (int gap = 0; gap <= l->num_ranges + 1; ++gap) {
        char item[64];
        if (!counts[gap]) continue;
        if (gap > l->num_ranges) snprintf(item, sizeof item, "not a number");
        else if (l->num_ranges == 0) snprintf(item, sizeof item, "any");
        else if (gap == 0) snprintf(item, sizeof item, "below %g", l->ranges[0].low);
        else if (gap == l->num_ranges) snprintf(item, sizeof item, "from %g", l->ranges[gap - 1].high);
        else snprintf(item, sizeof item, "[%g, %g)", l->ranges[gap - 1].high, l->ranges[gap].low);
        add(list, item, counts[gap]);
    }
    finish(list);
}

static const char *remedy_for(const pliant_labels *labels, bool names_labels)
{
    if (has_segments(labels))
        return "; rename the segments, or add their names to \"segments\" of a material in the table";
    return names_labels ? "" : " (the material table names no labels: give one that does, or no label map)";
}

static pliant_status complain(const lookup *l, const pliant_material_table *table, const pliant_volume *scan,
                              const pliant_labels *labels)
{
    listing missing = {.used = 0}, gaps = {.used = 0};
    bool names_labels = false;
    for (uint32_t m = 0; m < table->num_materials; ++m) names_labels |= table->materials[m].num_labels > 0;
    uint64_t *counts = pliant_calloc(NUM_16, sizeof *counts);
    if (!counts) return pliant_fail_memory("counting voxels without a material");
    if (labels) list_labels(l, table, labels, counts, &missing);
    list_gaps(l, scan, labels ? labels->voxels : NULL, counts, &gaps);
    pliant_free(counts);
    return pliant_fail(PLIANT_ERROR_MATERIAL, "%s: no material for%s%s%s%s%s%s", scan->id[0] ? scan->id : "scan",
                       !missing.items         ? ""
                       : has_segments(labels) ? " segments "
                                              : " labels ",
                       missing.text, missing.items && gaps.items ? "; nor for" : "", gaps.items ? " intensities " : "",
                       gaps.text, missing.items ? remedy_for(labels, names_labels) : "");
}

pliant_status pliant_material_classify(const pliant_material_table *table, const pliant_volume *scan,
                                       const pliant_labels *labels, uint8_t *material_of_voxel)
{
    pliant_status status = pliant_material_table_check(table);
    if (status < 0) return status;
    if (labels && !labels->voxels) labels = NULL;
    if (labels && !pliant_geometry_equal(&scan->geometry, &labels->geometry))
        return pliant_fail(PLIANT_ERROR_FORMAT,
                           "%s: the label map lies on another grid than the scan: pliant_labels_to_grid puts it there, "
                           "or says what differs",
                           scan->id[0] ? scan->id : "scan");
    lookup *l = pliant_calloc(1, sizeof *l);
    if (!l) return pliant_fail_memory("classifying voxels");
    fill(table, scan, labels, l);

    const uint16_t *label = labels ? labels->voxels : NULL;
    ptrdiff_t voxels = (ptrdiff_t)pliant_geometry_voxels(&scan->geometry);
    /* This first pass ensures that nothing is written if a material is missing. */
    int missing = 0;
#pragma omp parallel for schedule(static) reduction(| : missing)
    for (ptrdiff_t v = 0; v < voxels; ++v) missing |= of_voxel(l, scan, label, (size_t)v) == NONE;
    if (missing) {
        status = complain(l, table, scan, labels);
    } else {
#pragma omp parallel for schedule(static)
        for (ptrdiff_t v = 0; v < voxels; ++v) material_of_voxel[v] = of_voxel(l, scan, label, (size_t)v);
    }
    pliant_free(l);
    return status;
}
