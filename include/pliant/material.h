/** @file material.h
 *  Material tables: Young's modulus, Poisson's ratio and density from labels, segments or intensities ([H] 2.1).
 */
#ifndef PLIANT_MATERIAL_H
#define PLIANT_MATERIAL_H

#include "pliant/scan.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    PLIANT_MAX_MATERIALS = 255,        /**< of a table */
    PLIANT_MAX_MATERIAL_LABELS = 128,  /**< of a material */
    PLIANT_MAX_MATERIAL_SEGMENTS = 128 /**< of a material */
};
/** Fracture toughness of a material without a value in its table [J/m^2]: porcine liver, cut by a blade
 *  (s10033-022-00767-4, table 2: 187 to 225). */
#define PLIANT_DEFAULT_TOUGHNESS 200.0

/** A material and the voxels that have it. */
typedef struct pliant_material {
    char name[48];
    double young_modulus; /**< > 0 [Pa] */
    double poisson_ratio; /**< in [0, 0.4999] */
    double density;       /**< >= 0; tissue that moves in explicit dynamics needs > 0 [kg/m^3] */
    double toughness;     /**< fracture toughness: work per severed area, >= 0 [J/m^2] */
    bool fixed;           /**< nodes inside it do not move (bone) */
    bool empty;           /**< not tissue (air): tetrahedra without any other material are left out */
    double range[2];      /**< intensities: low <= value < high */
    uint32_t num_range;   /**< 2, or 0 for a material without a range */
    uint32_t labels[PLIANT_MAX_MATERIAL_LABELS]; /**< (num_labels) values in the label map, which take precedence over
                                                  *   ranges */
    uint32_t num_labels;
    char segments[PLIANT_MAX_MATERIAL_SEGMENTS][48]; /**< (num_segments) names of segments, in addition to the
                                                      *   material's name */
    uint32_t num_segments;
} pliant_material;

/** A material table. */
typedef struct pliant_material_table {
    pliant_material *materials; /**< (num_materials) owned; pliant_material_table_free */
    uint32_t num_materials;
} pliant_material_table;

/** Mean material of a tetrahedron over the voxels that it owns. */
typedef struct pliant_tet_material {
    double lambda, mu;   /**< Lame parameters, mean over the voxels [Pa] */
    double density;      /**< mean over the voxels [kg/m^3] */
    float tissue;        /**< fraction of voxels that are not empty */
    uint16_t material;   /**< the most frequent material */
    uint32_t num_voxels; /**< 0: the tetrahedron is smaller than a voxel and has the material of the voxel nearest to
                          *   its centroid */
} pliant_tet_material;

/** Read and check a material table. launch/materials contains examples.
 *  @param path YAML file.
 *  @param out  Out: free with pliant_material_table_free. Unchanged after an error.
 *  @return Errors: FILE, FORMAT, MEMORY. The message names file, field and line. */
PLIANT_API pliant_status pliant_material_table_read(const char *path, pliant_material_table *out);

/** Read a material table from text, as pliant_material_table_read does from a file.
 *  @param yaml              Text that ends with 0.
 *  @param name_for_messages Name of the text in error messages.
 *  @param out               Out: free with pliant_material_table_free. Unchanged after an error.
 *  @return Errors: FORMAT, MEMORY. */
PLIANT_API pliant_status pliant_material_table_parse(const char *yaml, const char *name_for_messages,
                                                     pliant_material_table *out);

/** Return a copy of the built-in table (launch/materials/abdomen_ct.yaml).
 *  @param out Out: free with pliant_material_table_free.
 *  @return Errors: MEMORY. */
PLIANT_API pliant_status pliant_material_table_default(pliant_material_table *out);

/** Free the materials of a table and zero the struct.
 *  @param table Nullable. */
PLIANT_API void pliant_material_table_free(pliant_material_table *table);

/** Assign a material to every voxel: by its label, else by its intensity.
 *
 *  A segment has the material with its name, or the material that lists its name. Case, blanks, punctuation and the
 *  order of words do not matter. For an unknown name, the identifier of the segment decides, then its terminology. A
 *  segment with a number as its name ("Segment_3") has the material that lists its value as a label.
 *  @param table             The table.
 *  @param scan              The scan.
 *  @param labels            Nullable, or without voxels: only intensities decide. On the grid of the scan.
 *  @param material_of_voxel (voxels) Out: index into the table.
 *  @return Errors: MATERIAL (lists every label, segment and intensity interval without a material), FORMAT (grids
 *          differ), MEMORY. */
PLIANT_API pliant_status pliant_material_classify(const pliant_material_table *table, const pliant_volume *scan,
                                                  const pliant_labels *labels, uint8_t *material_of_voxel);

#ifdef __cplusplus
}
#endif
#endif
