/** @file material.h
 *  From intensities and labels to Young's modulus, Poisson ratio and density, voxel by voxel and then summed
 *  over tetrahedra ([H] 2.1).
 */
#ifndef PLIANT_MATERIAL_H
#define PLIANT_MATERIAL_H

#include "pliant/scan.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_MAX_MATERIALS = 255, PLIANT_MAX_MATERIAL_LABELS = 128, PLIANT_MAX_MATERIAL_SEGMENTS = 128 };
/** [J/m^2] of a table's material that names none: porcine liver, cut by a blade (s10033-022-00767-4, table 2: 187 to 225). */
#define PLIANT_DEFAULT_TOUGHNESS 200.0

typedef struct pliant_material {
    char name[48];
    double young_modulus; /**< [Pa], > 0 */
    double poisson_ratio; /**< in [0, 0.5) */
    double density;       /**< [kg/m^3], >= 0 */
    double toughness;     /**< work that it takes to sever an area, >= 0 [J/m^2] */
    bool fixed;           /**< nodes inside it do not move (bone) */
    bool empty;           /**< not tissue (air): tetrahedra that hold nothing else are left out */
    double range[2];      /**< intensity low <= value < high */
    uint32_t num_range;   /**< 0: no range, or 2 */
    uint32_t labels[PLIANT_MAX_MATERIAL_LABELS]; /**< label ids; a label wins over a range */
    uint32_t num_labels;
    char segments[PLIANT_MAX_MATERIAL_SEGMENTS][48]; /**< names of segments with this material, in addition to its own name */
    uint32_t num_segments;
} pliant_material;

typedef struct pliant_material_table {
    pliant_material *materials;
    uint32_t num_materials;
} pliant_material_table;

/** Read a YAML table (launch/materials holds examples). Errors name file, field and line: FILE, FORMAT, MEMORY.
 *  Free with pliant_material_table_free. */
PLIANT_API pliant_status pliant_material_table_read(const char *path, pliant_material_table *out);
PLIANT_API pliant_status pliant_material_table_parse(const char *yaml, const char *name_for_messages, pliant_material_table *out);
/** The built-in table: launch/materials/abdomen_ct.yaml, compiled in. */
PLIANT_API pliant_status pliant_material_table_default(pliant_material_table *out);
PLIANT_API void pliant_material_table_free(pliant_material_table *table);

/** The material of every voxel: by its label if it has one, else by its intensity range. A table that names
 *  labels but is given no label map falls back to its ranges.
 *  Labels with segments take their materials by name. A segment has the material of this name, or with this name in its list of segments.
 *  Case, blanks, punctuation and the order of words do not matter. If the name is unknown, the identifier of the segment decides, then
 *  its terminology. A segment that is only numbered ("Segment_3") takes the material that lists its value as a label.
 *  @param labels            Nullable, or without voxels: none; must lie on the grid of the scan
 *  @param material_of_voxel (voxels) out, index into the table
 *  Errors: MATERIAL (lists every label, segment and intensity interval without a material), FORMAT (grids differ). */
PLIANT_API pliant_status pliant_material_classify(const pliant_material_table *table, const pliant_volume *scan,
                                                  const pliant_labels *labels, uint8_t *material_of_voxel);

/** What a tetrahedron holds, summed over the voxels that it owns. */
typedef struct pliant_tet_material {
    double lambda, mu;   /**< Lame parameters, mean over the voxels [Pa] */
    double density;      /**< mean [kg/m^3] */
    float tissue;        /**< fraction of voxels that are not empty */
    uint16_t material;   /**< the most frequent one */
    uint32_t num_voxels; /**< 0: smaller than a voxel, taken from the voxel nearest to the centroid */
} pliant_tet_material;

#ifdef __cplusplus
}
#endif
#endif
