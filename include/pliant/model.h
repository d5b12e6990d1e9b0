/** @file model.h
 *  The model: everything that is computed once for a scan and a scene, and is constant during the simulation.
 *
 *  Which parts stay valid (x) after a change:
 *  | change                    | scan | materials | meshes | element matrices | symbolic factor | numeric factor |
 *  |---------------------------|------|-----------|--------|------------------|-----------------|----------------|
 *  | new tool pose, gravity    |  x   |     x     |   x    |        x         |        x        |  x *           |
 *  | new material              |  x   |           |   x    |                  |        x        |                |
 *  | new method, cells, ratio  |  x   |     x     |        |                  |                 |                |
 *  | new scan                  |      |           |        |                  |                 |                |
 *
 *  * The solver refreshes the factor in the background.
 */
#ifndef PLIANT_MODEL_H
#define PLIANT_MODEL_H

#include "pliant/body.h"
#include "pliant/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

/** X(name) for the stages of building, in order. */
#define PLIANT_BUILD_STAGE_LIST(X) X(classify) X(mesh) X(integrate) X(fix) X(link) X(homogenize) X(analyze) X(factorize)
/** Stage of building. */
typedef enum pliant_build_stage {
#define PLIANT_STAGE_ENUM(name) PLIANT_BUILD_##name,
    PLIANT_BUILD_STAGE_LIST(PLIANT_STAGE_ENUM)
#undef PLIANT_STAGE_ENUM
    PLIANT_NUM_BUILD_STAGES
} pliant_build_stage;

typedef struct pliant_model pliant_model; /**< opaque; pliant_model_get_* return its parts */

/* ---- CREATE */

/** Read the scan, the labels and the material table that a scene names. Resample and segment the scan as the scene
 *  says.
 *  @param scene     The scene.
 *  @param scan_path "phantom", "phantom:256x160x122", or a path for pliant_volume_read.
 *  @param scan      Out: free with pliant_volume_free.
 *  @param labels    Out: without voxels if the scene names no labels. Free with pliant_labels_free.
 *  @param materials Out: free with pliant_material_table_free.
 *  @return Errors: as of pliant_volume_read, pliant_labels_read, pliant_segment and pliant_material_table_read;
 *          MATERIAL (the built-in table is for Hounsfield units, and the scan has other values); SCENE (also tissue
 *          without density in explicit dynamics). Outputs are then unchanged. */
PLIANT_API pliant_status pliant_inputs_read(const pliant_scene *scene, const char *scan_path, pliant_volume *scan,
                                            pliant_labels *labels, pliant_material_table *materials);

/** Build a model ([H] 2). A coarse model/method with gravity logs a warning.
 *  @param scene     Copied.
 *  @param scan      Borrowed until pliant_model_free; resampled already (scan/resample).
 *  @param labels    Nullable, or without voxels: only intensities decide. Borrowed during the call.
 *  @param materials Copied.
 *  @param progress  Callback; it can cancel the call.
 *  @param out       Out: free with pliant_model_free.
 *  @return Errors: SCENE, MATERIAL, FORMAT, MEMORY, NUMERIC (too few fixed nodes), CANCELLED. */
PLIANT_API pliant_status pliant_model_build(const pliant_scene *scene, const pliant_volume *scan,
                                            const pliant_labels *labels, const pliant_material_table *materials,
                                            pliant_progress progress, pliant_model **out);

/** Free a model. Free its simulations, states and views first.
 *  @param model Nullable. */
PLIANT_API void pliant_model_free(pliant_model *model);

/* ---- READ: results are constant and valid until pliant_model_free */

/** Return the scene of a model, with numbers instead of `auto`.
 *  @param model The model.
 *  @return The scene. */
PLIANT_API const pliant_scene *pliant_model_get_scene(const pliant_model *model);

/** Return the scan of a model.
 *  @param model The model.
 *  @return The scan that pliant_model_build received. */
PLIANT_API const pliant_volume *pliant_model_get_scan(const pliant_model *model);

/** Return the material table of a model.
 *  @param model The model.
 *  @return The table. */
PLIANT_API const pliant_material_table *pliant_model_get_materials(const pliant_model *model);

/** Return the material at a point, as pictures show it. A voxel that tissue shares with air has the tissue's material.
 *  @param model The model.
 *  @param rest  (3) Point at rest, LPS [m]. Outside of the scan, the nearest voxel counts.
 *  @return Index into the material table. */
PLIANT_API uint8_t pliant_model_material_at(const pliant_model *model, const double rest[3]);

/** Return the body at load: meshes, materials, masses and surface. pliant_data_get_body returns the current body of a
 *  simulation.
 *  @param model The model.
 *  @return The body. */
PLIANT_API const pliant_body *pliant_model_get_body(const pliant_model *model);

/** Time and memory of building, by stage. */
typedef struct pliant_build_statistics {
    double seconds[PLIANT_NUM_BUILD_STAGES]; /**< [s] */
    size_t bytes[PLIANT_NUM_BUILD_STAGES];   /**< memory after the stage minus memory before it [bytes] */
    double condition_estimate;               /**< of the stiffness matrix, 1-norm (CHOLMOD's rcond inverted); 0:
                                              *   unknown */
} pliant_build_statistics;

/** Copy the statistics of building.
 *  @param model The model.
 *  @param out   Out: the statistics. */
PLIANT_API void pliant_model_get_statistics(const pliant_model *model, pliant_build_statistics *out);

#ifdef __cplusplus
}
#endif
#endif
