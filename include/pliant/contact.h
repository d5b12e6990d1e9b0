/** @file contact.h
 *  Shapes of instruments that press tissue, and contact points.
 *
 *  A shape in YAML (pliant_tool_shape_read; `shape` of a tool of a path):
 *
 *      shape: {name: large_needle_driver}       # an instrument of pliant_tool_shape_find, or parts [m]:
 *      shape: {parts: [{kind: capsule, from: [0, 0, -0.1], to: [0, 0, 0], radius: 0.004}], offset: [0, 0, 0.01]}
 *
 *  | key of a part | meaning |
 *  |---|---|
 *  | kind | sphere (from: centre), capsule (from, to: axis), box (from, to: corners), mesh, convex |
 *  | moves | jaw_plus or jaw_minus: the part turns about the shape's joint: [x, y, z] and axis: [x, y, z] |
 *  | cuts | true: the part touches nothing while the blade is on |
 *  | file, unit, rpy | STL file relative to the YAML file; m or mm; roll, pitch, yaw [rad] |
 *  | points | corners of a convex part without a file |
 *  | resolution | grid spacing of a mesh's distance field [m] |
 *  | radius | rounds the part on its outside [m] |
 *
 *  mesh is a closed surface from an STL file. convex is the convex hull of such a file, or of points. Their from is the
 *  position of the file's origin. offset moves the whole shape.
 */
#ifndef PLIANT_CONTACT_H
#define PLIANT_CONTACT_H

#include "pliant/data.h"
#include "pliant/solid.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- SHAPES */

/** Kind of a part. */
typedef enum pliant_part_kind {
    PLIANT_PART_SPHERE,
    PLIANT_PART_CAPSULE,
    PLIANT_PART_BOX,
    PLIANT_PART_HALF_SPACE, /**< obstacles only */
    PLIANT_PART_SOLID,
    PLIANT_NUM_PART_KINDS
} pliant_part_kind;

/** Frame that a part moves with. */
typedef enum pliant_part_frame {
    PLIANT_FRAME_TIP,       /**< the tool's pose */
    PLIANT_FRAME_JAW_PLUS,  /**< the tool's pose, turned about the joint by half the jaw angle */
    PLIANT_FRAME_JAW_MINUS, /**< the tool's pose, turned about the joint by minus half the jaw angle */
    PLIANT_NUM_PART_FRAMES
} pliant_part_frame;

/** A rigid part in the frame of the tool with its jaws closed [m]. The tip is at the origin, and the instrument arrives
 *  along z. */
typedef struct pliant_part {
    pliant_part_kind kind;
    pliant_part_frame frame;
    double from[3]; /**< sphere: centre; capsule: end of its axis; box: low corner; half-space: point of its surface;
                     *   solid: its origin */
    double to[3];   /**< capsule: other end of its axis; box: high corner; half-space (obstacles only): outward
                     *   normal */
    double radius;  /**< of a sphere or capsule; rounds a box or solid on its outside */
    bool cuts;      /**< the part touches nothing while the tool's blade is on */
    const pliant_solid *solid; /**< PLIANT_PART_SOLID; a shape that was read, and a tool, hold a reference to it */
} pliant_part;

enum { PLIANT_MAX_PARTS = 16 /**< maximum number of parts of a shape */ };

/** Shape of a tool. */
typedef struct pliant_tool_shape {
    int32_t num_parts;
    pliant_part part[PLIANT_MAX_PARTS]; /**< (num_parts) */
    double joint[3]; /**< point on the joint of the jaws [m] */
    double axis[3];  /**< direction of the joint */
} pliant_tool_shape;

/** Return the shape of an instrument by its name in the dVRK's tool files, with or without the model number:
 *  LARGE_NEEDLE_DRIVER_400006, prograsp_forceps; also probe and camera. src/contact/shapes/instruments.c lists the
 *  sources of all dimensions. The jaws turn about x. The dVRK's tool frame is at the joint of the jaws: such a robot
 *  needs pliant_tool_shape_move.
 *  @param name Name of the instrument.
 *  @param out  Out: the shape; it contains no solids.
 *  @return Errors: ARGUMENT (unknown name; the message lists all names). */
PLIANT_API pliant_status pliant_tool_shape_find(const char *name, pliant_tool_shape *out);

/** Read a shape from a YAML file, as the top of this file describes it.
 *  @param path The file.
 *  @param out  Out: free with pliant_tool_shape_free.
 *  @return Errors: FILE, FORMAT, MEMORY. The message names file, field and line. */
PLIANT_API pliant_status pliant_tool_shape_read(const char *path, pliant_tool_shape *out);

/** Release the solids of a shape that was read, and remove its parts.
 *  @param shape The shape. */
PLIANT_API void pliant_tool_shape_free(pliant_tool_shape *shape);

/** Move a shape in the tool's frame.
 *  @param shape  In/out: the shape.
 *  @param offset (3) Translation in the tool's frame [m]. */
PLIANT_API void pliant_tool_shape_move(pliant_tool_shape *shape, const double offset[3]);

/** Set the shape of a tool from the next step on. The tool then has a proxy, which tissue stops.
 *  @param data  The simulation.
 *  @param tool  Number of the tool.
 *  @param shape Copied, with references to its solids. Without parts (the default), the tool touches nothing.
 *  @return Errors: ARGUMENT (no such tool; a part is not finite, thinner than 0.1 mm, or has an axis of length 0). */
PLIANT_API pliant_status pliant_tool_set_shape(pliant_data *data, int tool, const pliant_tool_shape *shape);

/** Set the measured angle between the jaws of a tool from the next step on.
 *  @param data  The simulation.
 *  @param tool  Number of the tool.
 *  @param angle [rad]; 0: closed.
 *  @return Errors: ARGUMENT (no such tool, not finite). */
PLIANT_API pliant_status pliant_tool_set_jaw(pliant_data *data, int tool, double angle);

/* ---- CONTACT POINTS */

/** A contact point on tissue. */
typedef struct pliant_contact {
    int32_t tool;     /**< number of the pressing tool; -1: an obstacle, or tissue */
    int32_t part;     /**< part of the tool's shape; -1 without a tool */
    bool tissue;      /**< tissue presses */
    double place[3];  /**< position, LPS [m] */
    double normal[3]; /**< unit, into the pressed tissue; 0 0 0 for a slowed node (contact/response: paper) */
    double force[3];  /**< force on the pressed tissue, LPS [N] */
    double area;      /**< represented area of the tissue's surface at rest [m^2]; 0: the point keeps a corner of a
                       *   triangle out of a part's core, and other points of the triangle have its area */
    double depth;     /**< penetration depth [m]; negative: a gap */
} pliant_contact;

/** Copy the contact points of the last step. Their order stays the same while the points stay the same.
 *  @param data The simulation.
 *  @param capacity Size of out, in points.
 *  @param out  (capacity) Out; Nullable if capacity is 0.
 *  @return The number of contact points, which may exceed the capacity. */
PLIANT_API int32_t pliant_data_get_contacts(const pliant_data *data, int32_t capacity, pliant_contact *out);

/** Compute the contact force on every fine node in the last step.
 *  @param data The simulation.
 *  @param out  (body's fine.num_nodes x 3) Out: LPS [N]. */
PLIANT_API void pliant_data_get_contact_forces(const pliant_data *data, double *out);

#ifdef __cplusplus
}
#endif
#endif
