/** @file contact.h
 *  Shapes of instruments, which push tissue that they touch.
 */
#ifndef PLIANT_CONTACT_H
#define PLIANT_CONTACT_H

#include "pliant/data.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum pliant_part_kind { PLIANT_PART_SPHERE, PLIANT_PART_CAPSULE, PLIANT_PART_BOX, PLIANT_PART_HALF_SPACE } pliant_part_kind;

/** What a part of an instrument moves with. */
typedef enum pliant_part_frame {
    PLIANT_FRAME_TIP,       /**< the tool's pose */
    PLIANT_FRAME_JAW_PLUS,  /**< and half the jaw's angle about the joint */
    PLIANT_FRAME_JAW_MINUS  /**< and minus half of it */
} pliant_part_frame;

/** A rigid part, in the frame of the tool with its jaw closed: the tip at the origin, the instrument coming along z. [m] */
typedef struct pliant_part {
    pliant_part_kind kind;
    pliant_part_frame frame;
    double from[3], to[3]; /**< sphere: its centre, and nothing; capsule: ends of its axis; box: low and high corner; half-space: a point of its
                            *   surface, and its outward normal (of a scene's obstacles alone) */
    double radius;         /**< sphere, capsule; a box is rounded off outside itself by it */
    bool cuts;             /**< touches nothing while the tool's blade is on */
} pliant_part;

enum { PLIANT_MAX_PARTS = 16 };
typedef struct pliant_tool_shape {
    int32_t num_parts;
    pliant_part part[PLIANT_MAX_PARTS];
    double joint[3], axis[3]; /**< a point on the jaws' joint, and its direction */
} pliant_tool_shape;

/** From the next step on; copied. No parts: the tool touches nothing, as at first.
 *  Errors: ARGUMENT (no such tool; a part that is none: not finite, thinner than 0.1 mm, an axis of no length). */
PLIANT_API pliant_status pliant_tool_set_shape(pliant_data *data, int tool, const pliant_tool_shape *shape);
/** Angle between the jaws [rad], from the next step on; 0: closed. Errors: ARGUMENT (no such tool, not finite). */
PLIANT_API pliant_status pliant_tool_set_jaw(pliant_data *data, int tool, double angle);

#ifdef __cplusplus
}
#endif
#endif
