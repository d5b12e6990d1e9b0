/* Decide whether a GPU runs a stage, according to solver/backend or a similar option. The step, the warp and the
 * segmentation each have a table of GPU functions, and each table has a probe. */
#ifndef PLIANT_SCENE_GPU_CHOICE_H
#define PLIANT_SCENE_GPU_CHOICE_H

#include "pliant/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

/* a table for the GPU; NULL in a build without CUDA */
#ifdef PLIANT_WITH_CUDA
#define PLIANT_ON_GPU(table) &(table)
#else
#define PLIANT_ON_GPU(table) NULL
#endif

enum { PLIANT_BACKEND_TEXT = 256 };

/* Return whether the GPU can be used. text: the device's name, or the reason. Does not log. */
typedef bool (*pliant_probe)(char *text, size_t size);

/* Decide whether the GPU is used.
 * use: output
 * text: output; name of the GPU, or the reason why it is not used
 * @param probe of the GPU's table; Nullable: there is no table
 * Errors: UNAVAILABLE, with the reason, if cuda was requested and cannot be used. */
pliant_status pliant_gpu_choose(pliant_backend_choice choice, pliant_probe probe, char text[PLIANT_BACKEND_TEXT],
                                bool *use);

#ifdef __cplusplus
}
#endif
#endif
