/* Check which features work with hexahedra (element/kind), and choose the elements for `auto`. */
#ifndef PLIANT_SCENE_ELEMENTS_H
#define PLIANT_SCENE_ELEMENTS_H

#include "pliant/scene.h"

/* Errors: SCENE: the scene requests hexahedra together with a feature that does not work with them. */
pliant_status pliant_scene_check_elements(const pliant_scene *scene);

#endif
