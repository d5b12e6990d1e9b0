/* Material tables: what the library needs beyond pliant/material.h. */
#ifndef PLIANT_MATERIAL_MATERIAL_H
#define PLIANT_MATERIAL_MATERIAL_H

#include "base/export.h"
#include "pliant/material.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Check that the built-in table can be meant for a scan, that is, that its values are Hounsfield units. The header says CT or nothing.
 *  At least one voxel in a thousand is below -20 HU, as air, lung and fat are. Fewer than one in a thousand is above 31000 HU, as padding
 *  is. Otherwise refused (MATERIAL) with a table to begin with. pliant_inputs_read checks scans whose scene names no table. */
pliant_status pliant_material_default_check(const pliant_volume *scan);

PLIANT_INTERNAL pliant_status pliant_material_table_copy(const pliant_material_table *table, pliant_material_table *out);

/* Ranges of numbers, overlapping intensity ranges, labels and segments named twice. */
PLIANT_INTERNAL pliant_status pliant_material_table_check(const pliant_material_table *table);

/* Return the index of the material that pliant_material_classify gives a segment, -1 if there is none. */
PLIANT_INTERNAL int pliant_material_of_segment(const pliant_material_table *table, const pliant_label_segment *segment);

/* The same of materials, for pliant_material_table_parse. */
PLIANT_INTERNAL size_t pliant_material_table_text(const pliant_material_table *table, size_t room, char *out);

#ifdef __cplusplus
}
#endif
#endif
