/* Scenes: what the library needs beyond pliant/scene.h. */
#ifndef PLIANT_SCENE_SCENE_H
#define PLIANT_SCENE_SCENE_H

#include "base/export.h"
#include "pliant/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

/* YAML with every option, of which pliant_scene_parse makes the same scene, bit for bit.
 *  @param out Nullable when room is 0; cut short where the room ends, with a 0 at its end. @return length of the whole text, as snprintf tells it */
PLIANT_INTERNAL size_t pliant_scene_text(const pliant_scene *scene, size_t room, char *out);

/* What the scene is made of: element/kind, or what auto becomes in this scene. A model's own scene (pliant_model_get_scene) has that.
 *  @param why Nullable, out: what made auto linear ("option: reason", static); NULL: nothing */
PLIANT_INTERNAL pliant_element_kind pliant_scene_element_kind(const pliant_scene *scene, const char **why);

#ifdef __cplusplus
}
#endif
#endif
