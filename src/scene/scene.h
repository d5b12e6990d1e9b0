/* Internal functions of scenes, in addition to pliant/scene.h. */
#ifndef PLIANT_SCENE_SCENE_H
#define PLIANT_SCENE_SCENE_H

#include "base/export.h"
#include "pliant/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Write all options as YAML. pliant_scene_parse makes a bitwise identical scene from it.
 *   @param out Nullable if capacity is 0; truncated to the capacity, with a terminating 0
 * Return the length of the whole text, like snprintf. */
PLIANT_INTERNAL size_t pliant_scene_text(const pliant_scene *scene, size_t capacity, char *out);

/* Return the element kind of a scene: element/kind, or the resolved value of auto. The scene of a model
 * (pliant_model_get_scene) has the resolved value.
 *   @param why Nullable, out: why auto became linear ("option: reason", static); NULL: it did not */
PLIANT_INTERNAL pliant_element_kind pliant_scene_element_kind(const pliant_scene *scene, const char **why);

/* Return the message about an option that was removed or renamed, with its replacement; NULL: there was no such option.
 *   @param option path of the option, as "cut/snap" */
PLIANT_INTERNAL const char *pliant_scene_removed_option(const char *option);

#ifdef __cplusplus
}
#endif
#endif
