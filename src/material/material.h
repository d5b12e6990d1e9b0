/* Material tables: functions for the library, nodes and programs. */
#ifndef PLIANT_MATERIAL_MATERIAL_H
#define PLIANT_MATERIAL_MATERIAL_H

#include "base/export.h"
#include "pliant/material.h"
#include "pliant/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Check that a scan may use the built-in table, whose values are Hounsfield units. The header says CT or nothing. At
 * least one voxel in a thousand is below -20 HU (air, lung, fat). Fewer than one in a thousand is above 31000 HU
 * (padding). pliant_inputs_read checks scans whose scene names no table. Errors: MATERIAL (with a table to begin
 * with). */
pliant_status pliant_material_default_check(const pliant_volume *scan);

/* Copy a table. Errors: MEMORY. */
PLIANT_INTERNAL pliant_status pliant_material_table_copy(const pliant_material_table *table,
                                                         pliant_material_table *out);

/* Check ranges of numbers, overlapping intensity ranges, and labels and segments of two materials. Errors: FORMAT. */
PLIANT_INTERNAL pliant_status pliant_material_table_check(const pliant_material_table *table);

/* Refuse materials that the scene cannot simulate: zero density of a material that moves, in explicit dynamics; a
 * Poisson's ratio above 0.499, with coarse methods. name: of the table, for messages. Errors: SCENE. */
PLIANT_INTERNAL pliant_status pliant_material_table_check_scene(const pliant_material_table *table,
                                                                const pliant_scene *scene, const char *name);

/* Return the index of the material that pliant_material_classify gives a segment; -1 without one. */
PLIANT_INTERNAL int pliant_material_of_segment(const pliant_material_table *table, const pliant_label_segment *segment);

/* Write a table as YAML, for pliant_material_table_parse.
 * @param out (capacity) cut short at its end, with a final 0; Nullable if capacity is 0
 * @return length of the whole text, as of snprintf */
PLIANT_INTERNAL size_t pliant_material_table_text(const pliant_material_table *table, size_t capacity, char *out);

#ifdef __cplusplus
}
#endif
#endif
