/** @file session.h
 *  A simulation's scene and materials as text, so that a later process can build the model again. Its cuts are in pliant_cuts (body.h), which
 *  pliant_body_sever (cut.h) makes again. Its state is written and read by state.h.
 */
#ifndef PLIANT_SESSION_H
#define PLIANT_SESSION_H

#include "pliant/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/** YAML with every option, of which pliant_scene_parse makes the same scene, bit for bit.
 *  @param out Nullable when room is 0; cut short where the room ends, with a 0 at its end. @return length of the whole text, as snprintf tells it */
PLIANT_API size_t pliant_scene_text(const pliant_scene *scene, size_t room, char *out);
/** The same of materials, for pliant_material_table_parse. */
PLIANT_API size_t pliant_material_table_text(const pliant_material_table *table, size_t room, char *out);

#ifdef __cplusplus
}
#endif
#endif
