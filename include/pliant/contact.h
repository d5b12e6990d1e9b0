/** @file contact.h
 *  Shapes of instruments, which push tissue that they touch.
 */
#ifndef PLIANT_CONTACT_H
#define PLIANT_CONTACT_H

#include "pliant/data.h"
#include "pliant/solid.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum pliant_part_kind { PLIANT_PART_SPHERE, PLIANT_PART_CAPSULE, PLIANT_PART_BOX, PLIANT_PART_HALF_SPACE, PLIANT_PART_SOLID } pliant_part_kind;

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
                            *   surface, and its outward normal (of a scene's obstacles alone); solid: its origin, and nothing */
    double radius;         /**< sphere, capsule; a box or a solid is rounded off outside itself by it */
    bool cuts;             /**< touches nothing while the tool's blade is on */
    const pliant_solid *solid; /**< PLIANT_PART_SOLID; a part does not count as holding it, but who reads or keeps a shape does */
} pliant_part;

enum { PLIANT_MAX_PARTS = 16 };
typedef struct pliant_tool_shape {
    int32_t num_parts;
    pliant_part part[PLIANT_MAX_PARTS];
    double joint[3], axis[3]; /**< a point on the jaws' joint, and its direction */
} pliant_tool_shape;

/** The shape of an instrument by its name, that of the dVRK's tool files with or without the model's number: LARGE_NEEDLE_DRIVER_400006, prograsp_forceps;
 *  also probe and camera. Where dimensions are published and where they are estimates stands in src/contact/shapes/instruments.c. The jaws turn about x;
 *  a robot whose frame lies on their joint, as the dVRK's, needs what pliant_tool_shape_move does.
 *  Errors: ARGUMENT (another name; the message lists them). */
PLIANT_API pliant_status pliant_tool_shape_find(const char *name, pliant_tool_shape *out);
/** A shape from a YAML file, as a tool of a path has it (src/tool/path.h); files of solids lie relative to it. Errors name file, field and line: FILE, FORMAT,
 *  MEMORY. Free with pliant_tool_shape_free. */
PLIANT_API pliant_status pliant_tool_shape_read(const char *path, pliant_tool_shape *out);
/** Releases the solids of a shape that was read, and leaves it without parts. */
PLIANT_API void pliant_tool_shape_free(pliant_tool_shape *shape);
/** By an offset in the tool's frame [m]. */
PLIANT_API void pliant_tool_shape_move(pliant_tool_shape *shape, const double offset[3]);

/** From the next step on; copied, and its solids retained. No parts: the tool touches nothing, as at first.
 *  Errors: ARGUMENT (no such tool; a part that is none: not finite, thinner than 0.1 mm, an axis of no length). */
PLIANT_API pliant_status pliant_tool_set_shape(pliant_data *data, int tool, const pliant_tool_shape *shape);
/** Angle between the jaws [rad], from the next step on; 0: closed. Errors: ARGUMENT (no such tool, not finite). */
PLIANT_API pliant_status pliant_tool_set_jaw(pliant_data *data, int tool, double angle);

/** Where tissue is pressed. */
typedef struct pliant_contact {
    int32_t tool, part;    /**< that presses; -1: what does not move, or tissue */
    bool tissue;           /**< tissue presses */
    double place[3];       /**< LPS [m] */
    double normal[3];      /**< unit, into the tissue that is pressed; 0 0 0 of a node that is slowed (contact/response: paper) */
    double force[3];       /**< on it [N] */
    double area;           /**< of the tissue's surface that it stands for, at rest [m^2]; 0: it keeps a corner of a triangle out of a core, and the triangle's other points have its area */
    double depth;          /**< of it in what presses; below 0: it has moved away again [m] */
} pliant_contact;
/** Of the last step, in an order that stays the same while they are the same. @param room of out. @return how many there are, which may be more */
PLIANT_API int32_t pliant_data_get_contacts(const pliant_data *data, int32_t room, pliant_contact *out);
/** Force by contact on every node of the fine mesh in the last step. @param out (body's fine.num_nodes x 3) [N] */
PLIANT_API void pliant_data_get_contact_forces(const pliant_data *data, double *out);

#ifdef __cplusplus
}
#endif
#endif
