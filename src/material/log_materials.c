/* Logs the material of each label and segment, for a check after loading a segmentation. */
#include "material/names.h"

#include "base/fail.h"
#include "base/memory.h"

#include <stdio.h>

enum { NUM_16 = 65536 };

/* A line of text with a maximum length. */
typedef struct line {
    char text[1700];
    size_t used;
    int left_out;
} line;

static void add(line *out, const char *item)
{
    const size_t capacity = sizeof out->text - out->used;
    const int length = snprintf(out->text + out->used, capacity, "%s%s", out->used ? ", " : "", item);
    if ((size_t)length < capacity) {
        out->used += (size_t)length;
        return;
    }
    out->text[out->used] = '\0';
    ++out->left_out;
}

static const char *decided_by(pliant_segment_match match)
{
    switch (match) {
    case PLIANT_SEGMENT_BY_IDENTIFIER: return ", by its identifier";
    case PLIANT_SEGMENT_BY_TERMINOLOGY: return ", by its terminology";
    case PLIANT_SEGMENT_BY_VALUE: return ", by its value";
    case PLIANT_SEGMENT_BY_NAME:
    case PLIANT_SEGMENT_UNKNOWN: break;
    }
    return "";
}

static void add_segment(line *out, const pliant_material_table *table, const pliant_label_segment *segment,
                        unsigned long long voxels)
{
    char item[320];
    pliant_segment_match match;
    pliant_segment_match_of(table, segment, &match);
    if (segment->is_class) {
        snprintf(item, sizeof item, "label %d \"%s\" %llu", (int)segment->value, segment->name, voxels);
        add(out, item);
        return;
    }
    snprintf(item, sizeof item, "segment \"%s\" %llu%s%s%s", segment->name, voxels, decided_by(match),
             match == PLIANT_SEGMENT_BY_IDENTIFIER || match == PLIANT_SEGMENT_BY_TERMINOLOGY ? " " : "",
             match == PLIANT_SEGMENT_BY_IDENTIFIER    ? segment->identifier
             : match == PLIANT_SEGMENT_BY_TERMINOLOGY ? segment->terminology
                                                      : "");
    add(out, item);
}

/* Number of voxels of every label (0: by intensity), and its material. */
typedef struct usage {
    uint64_t of_label[NUM_16];
    uint8_t material[NUM_16];
    bool has_name[NUM_16];
    uint64_t by_intensity[PLIANT_MAX_MATERIALS + 1];
} usage;

static void log_material(const pliant_material_table *table, const pliant_labels *labels, const usage *used, uint32_t m,
                         double voxel)
{
    line out = {.used = 0};
    uint64_t total = used->by_intensity[m];
    char item[64];
    for (uint32_t s = 0; s < labels->num_segments; ++s) {
        const pliant_label_segment *segment = labels->segments + s;
        if (!used->of_label[segment->label] || used->material[segment->label] != m) continue;
        total += used->of_label[segment->label];
        add_segment(&out, table, segment, (unsigned long long)used->of_label[segment->label]);
    }
    for (int label = 1; label < NUM_16; ++label) {
        if (!used->of_label[label] || used->material[label] != m || used->has_name[label]) continue;
        total += used->of_label[label];
        snprintf(item, sizeof item, "label %d %llu", label, (unsigned long long)used->of_label[label]);
        add(&out, item);
    }
    if (total == 0) return;
    snprintf(item, sizeof item, "by intensity %llu", (unsigned long long)used->by_intensity[m]);
    if (used->by_intensity[m]) add(&out, item);
    snprintf(item, sizeof item, " and %d more", out.left_out);
    pliant_log(PLIANT_LOG_INFO, "material %s: %llu voxels, %.4g ml: %s%s", table->materials[m].name,
               (unsigned long long)total, 1e6 * (double)total * voxel, out.text, out.left_out ? item : "");
}

/* Warn if classes have other materials than their names suggest, as with the table of another task. */
static void warn_of_names(const pliant_material_table *table, const pliant_labels *labels, const usage *used)
{
    line out = {.used = 0};
    for (uint32_t s = 0; s < labels->num_segments; ++s) {
        const pliant_label_segment *segment = labels->segments + s;
        const int named =
            segment->is_class && used->of_label[segment->label] ? pliant_material_named(table, segment->name) : -1;
        char item[240];
        if (named < 0 || named == used->material[segment->label]) continue;
        snprintf(item, sizeof item, "label %d is \"%s\", but has material %s, not %s", (int)segment->value,
                 segment->name, table->materials[used->material[segment->label]].name, table->materials[named].name);
        add(&out, item);
    }
    if (out.used > 0)
        pliant_log(PLIANT_LOG_WARNING,
                   "the label map and the material table disagree (is it the table of this task?): %s%s", out.text,
                   out.left_out ? " and more" : "");
}

pliant_status pliant_material_log_usage(const pliant_material_table *table, const pliant_volume *scan,
                                        const pliant_labels *labels, const uint8_t *material_of_voxel)
{
    if (!labels || !labels->voxels) return PLIANT_OK;
    const double *spacing = scan->geometry.spacing;
    const size_t voxels = pliant_geometry_voxels(&scan->geometry);
    usage *used = pliant_calloc(1, sizeof *used);
    if (!used) return pliant_fail_memory("counting voxels of materials");
    for (size_t v = 0; v < voxels; ++v) {
        const uint16_t label = labels->voxels[v];
        if (label == 0) {
            ++used->by_intensity[material_of_voxel[v]];
            continue;
        }
        ++used->of_label[label];
        used->material[label] = material_of_voxel[v];
    }
    for (uint32_t s = 0; s < labels->num_segments; ++s) used->has_name[labels->segments[s].label] = true;
    for (uint32_t m = 0; m < table->num_materials; ++m)
        log_material(table, labels, used, m, spacing[0] * spacing[1] * spacing[2]);
    warn_of_names(table, labels, used);
    line empty = {.used = 0};
    for (uint32_t s = 0; s < labels->num_segments; ++s)
        if (!labels->segments[s].is_class && !used->of_label[labels->segments[s].label])
            add(&empty, labels->segments[s].name);
    if (empty.used > 0)
        pliant_log(PLIANT_LOG_WARNING, "segments without a voxel in the scan: %s%s", empty.text,
                   empty.left_out ? " and more" : "");
    pliant_free(used);
    return PLIANT_OK;
}
