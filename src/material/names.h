/* Names of segments and materials. */
#ifndef PLIANT_MATERIAL_NAMES_H
#define PLIANT_MATERIAL_NAMES_H

#include "pliant/material.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Compare names of at most 63 bytes without case, blanks, punctuation and order of words: "Left Kidney" is
 * "kidney_left". */
bool pliant_same_name(const char *a, const char *b);

/* The property that decided the material of a segment. */
typedef enum pliant_segment_match {
    PLIANT_SEGMENT_UNKNOWN,
    PLIANT_SEGMENT_BY_NAME,
    PLIANT_SEGMENT_BY_IDENTIFIER,
    PLIANT_SEGMENT_BY_TERMINOLOGY,
    PLIANT_SEGMENT_BY_VALUE
} pliant_segment_match;

/* Do the same as pliant_material_of_segment.
 * @param match  Out: the deciding property. */
int pliant_segment_match_of(const pliant_material_table *table, const pliant_label_segment *segment,
                            pliant_segment_match *match);

/* Return the index of the material that has a name, or lists it under segments; -1: none. */
int pliant_material_named(const pliant_material_table *table, const char *name);

/* Write up to three names of the table that are similar to a name: "liver, liver_vessels". */
void pliant_nearest_names(const pliant_material_table *table, const char *name, char *out, size_t size);

/* Log the number of voxels of each material, with their labels or segments. Errors: MEMORY. */
pliant_status pliant_material_log_usage(const pliant_material_table *table, const pliant_volume *scan,
                                        const pliant_labels *labels, const uint8_t *material_of_voxel);

#ifdef __cplusplus
}
#endif

#endif
