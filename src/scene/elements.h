/* What hexahedra do not go with (element/kind), and what auto becomes. */
#ifndef PLIANT_SCENE_ELEMENTS_H
#define PLIANT_SCENE_ELEMENTS_H

#include "pliant/scene.h"

/* Errors: SCENE: hexahedra by name, and something that they do not go with. */
pliant_status pliant_scene_check_elements(const pliant_scene *scene);

#endif
