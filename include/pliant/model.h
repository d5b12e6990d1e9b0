/** @file model.h
 *  Everything that is computed once for a scan and a scene, and stays constant while stepping.
 *
 *  What survives what:
 *  | change                    | scan | materials | meshes | element matrices | symbolic factor | numeric factor |
 *  | new tool pose, gravity    |  x   |     x     |   x    |        x         |        x        |  x (refreshed in the background) |
 *  | new material              |  x   |           |   x    |                  |        x        |                |
 *  | new method, cells, ratio  |  x   |     x     |        |                  |                 |                |
 *  | new scan                  |      |           |        |                  |                 |                |
 */
#ifndef PLIANT_MODEL_H
#define PLIANT_MODEL_H

#include "pliant/body.h"
#include "pliant/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Stages of building, in order. */
#define PLIANT_BUILD_STAGE_LIST(X) X(classify) X(mesh) X(integrate) X(fix) X(link) X(homogenize) X(analyze) X(factorize)
typedef enum pliant_build_stage {
#define PLIANT_STAGE_ENUM(name) PLIANT_BUILD_##name,
    PLIANT_BUILD_STAGE_LIST(PLIANT_STAGE_ENUM)
#undef PLIANT_STAGE_ENUM
    PLIANT_NUM_BUILD_STAGES
} pliant_build_stage;

typedef struct pliant_model pliant_model; /**< opaque: asked by pliant_model_get_* */

/** @param scan      borrowed until pliant_model_free; already resampled as the scene asks
 *  @param labels    Nullable, or without voxels: none; used while building only
 *  @param materials copied
 *  Errors: SCENE, MATERIAL, FORMAT, MEMORY, NUMERIC (not enough is fixed), CANCELLED. */
PLIANT_API pliant_status pliant_model_build(const pliant_scene *scene, const pliant_volume *scan, const pliant_labels *labels,
                                            const pliant_material_table *materials, pliant_progress progress, pliant_model **out);
PLIANT_API void pliant_model_free(pliant_model *model); /**< Nullable */

/** What a model was built from and holds; constant, valid until pliant_model_free. */
PLIANT_API const pliant_scene *pliant_model_get_scene(const pliant_model *model);
PLIANT_API const pliant_volume *pliant_model_get_scan(const pliant_model *model);
PLIANT_API const pliant_material_table *pliant_model_get_materials(const pliant_model *model);
/** Return the material at a point at rest, LPS [m], as pictures show it: a voxel that tissue shares with air has the tissue's material. A point outside
 *  of the scan has the material of the nearest voxel. */
PLIANT_API uint8_t pliant_model_material_at(const pliant_model *model, const double rest[3]);
/** Meshes, materials, masses and surface at load; that of a simulation now is pliant_data_get_body. */
PLIANT_API const pliant_body *pliant_model_get_body(const pliant_model *model);

typedef struct pliant_build_statistics {
    double seconds[PLIANT_NUM_BUILD_STAGES];
    size_t bytes[PLIANT_NUM_BUILD_STAGES]; /**< held after the stage minus before [bytes] */
    double condition_estimate;             /**< of the stiffness matrix, 1-norm (CHOLMOD's rcond inverted); 0: not known */
} pliant_build_statistics;
PLIANT_API void pliant_model_get_statistics(const pliant_model *model, pliant_build_statistics *out);

/** Read, resample, label and tabulate what the scene names: the common way from paths to a model's inputs.
 *  @param scan_path "phantom", "phantom:256x160x122", or a path for pliant_volume_read
 *  Free scan, labels and materials. Errors: as of the readers. */
PLIANT_API pliant_status pliant_inputs_read(const pliant_scene *scene, const char *scan_path, pliant_volume *scan, pliant_labels *labels,
                                            pliant_material_table *materials);

#ifdef __cplusplus
}
#endif
#endif
