/* Whether a GPU runs what solver/backend (or an argument of that type) is about: each of the step, the warp and the segmentation has a
 * table of functions for the GPU, and each table a probe. */
#ifndef PLIANT_SCENE_GPU_CHOICE_H
#define PLIANT_SCENE_GPU_CHOICE_H

#include "pliant/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

/* a table for the GPU, or NULL in a build without CUDA */
#ifdef PLIANT_WITH_CUDA
#define PLIANT_ON_GPU(table) &(table)
#else
#define PLIANT_ON_GPU(table) NULL
#endif

enum { PLIANT_BACKEND_TEXT = 256 };

/* Whether it can be used here. text: the device's name, or the reason why not. Says nothing itself. */
typedef bool (*pliant_probe)(char *text, size_t size);

/* use: whether the GPU is to run it; text: what the GPU is called, or why it is not used.
 *  @param probe   of the GPU's table; Nullable: there is none
 *  Errors: UNAVAILABLE, with the reason, when cuda was asked for and cannot be used. */
pliant_status pliant_gpu_choose(pliant_backend_choice choice, pliant_probe probe, char text[PLIANT_BACKEND_TEXT], bool *use);

#ifdef __cplusplus
}
#endif
#endif
