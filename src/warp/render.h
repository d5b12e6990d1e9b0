/* Convert a camera and a style to a scene for rendering, and render it on the CPU. */
#ifndef PLIANT_WARP_RENDER_H
#define PLIANT_WARP_RENDER_H

#include "warp/ray.h"

/* Create the scene of a volume, without voxels, labels and bricks.
 * style: Nullable: radiograph
 * Errors: ARGUMENT. */
pliant_status render_scene_of(const pliant_volume *volume, const pliant_camera *camera, const pliant_style *style,
                              double water, render_scene *out);
size_t render_num_bricks(const render_scene *scene);
/* Return whether the bricks describe labels. */
static inline bool render_by_label(const render_scene *scene, const render_output *out)
{
    return !out->integral && scene->style.by_label;
}

/* Render on the CPU.
 * scene: with voxels and a buffer for bricks */
void render_fill_bricks(const render_scene *scene, bool by_label, int num_threads);
void render_draw(const render_scene *scene, const render_output *out, int num_threads);

#endif
