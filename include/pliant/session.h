/** @file session.h
 *  A simulation told so that a later process can go on: what it was made from as text, and what its tools hold. Cuts are told by
 *  pliant_cuts (body.h) and made again by pliant_body_sever (cut.h), positions by pliant_data_set_positions (data.h).
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

/** What a tool has hold of, and how. */
typedef struct pliant_tool_hold {
    bool holding;
    double rest[3], radius; /**< middle of the blob at rest, LPS [m]; of it [m] */
    double grip[3];         /**< the tip pulls the held point to tip - grip [m] */
    double slipped;         /**< how far it has slipped in this hold (grasp/slip) [m] */
    double force[3];        /**< of the tool on the tissue in the last step [N] */
} pliant_tool_hold;
/** Errors: ARGUMENT (no such tool). */
PLIANT_API pliant_status pliant_tool_get_hold(const pliant_data *data, int tool, pliant_tool_hold *out);
/** Take that hold, wherever the tip is now; not holding: let go. Errors: ARGUMENT (no such tool, no pose, not finite, no tissue there), MEMORY. */
PLIANT_API pliant_status pliant_tool_set_hold(const pliant_model *model, pliant_data *data, int tool, const pliant_tool_hold *hold);

#ifdef __cplusplus
}
#endif
#endif
