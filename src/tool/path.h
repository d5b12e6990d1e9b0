/* A recorded tool path: the motion of tools over time, for runs without a robot.
 *
 *   YAML:  tools:
 *            - name: grasper
 *              drive: spring            # spring | rigid | force
 *              grasp: [x, y, z]         # grasped rest point [m], LPS
 *              motion: [{time: 0, offset: [0, 0, 0]}, {time: 1, offset: [0, -0.03, 0]}]
 *
 * Offsets are relative to the grasped point [m]. With drive: force, the motion contains forces on the tissue [N]:
 *
 *              motion: [{time: 0, force: [0, 0, 0]}, {time: 1, force: [0, -5, 0]}]
 *
 * Values are interpolated linearly, and the last value stays. A tool releases the tissue after its optional `release`
 * time. Its optional `mass` [kg] acts at the grasped point. For a hanging weight, use drive: force with the force [0,
 * 0, 0].
 * Gravity may change too, with or without tools:
 *
 *       gravity: [{time: 0, acceleration: [0, 0, -9.81]}, {time: 2, acceleration: [0, 9.81, 0]}]       [m/s^2]
 *
 * Probes are points of the tissue whose positions are reported:
 *
 *       probes: [{name: tip, at: [x, y, z]}]                                                   rest point [m]
 *
 * A tool with a blade moves from pose to pose, and cuts during the listed times (scenes with cut/kind):
 *
 *            - name: knife
 *              blade: {name: scalpel}   # or its edge in the tool's frame [m]: {from: [0, 0, -0.03], to: [0, 0, 0]}
 *              poses: [{time: 0, position: [x, y, z], rotation: [0, 0, 0, 1]}, ...]  # tip [m], LPS; quaternion x y z w
 *              cut: [{from: 0.2, to: 1.4}]                                             # [s]
 *
 * Any tool with poses may have a shape, which pushes tissue in contact. A pose may have a jaw angle (default 0):
 *
 *            shape: {name: large_needle_driver}       # contact.h lists the names; or parts [m]:
 *            shape: {parts: [{kind: capsule, from: [0, 0, -0.1], to: [0, 0, 0], radius: 0.004}], offset: [0, 0, 0.01]}
 *            poses: [{time: 0, position: [x, y, z], jaw: 0.5}, ...]                  # [rad]
 *
 * The kind of a part is sphere (from: its centre), capsule (from, to: its axis) or box (from, to: corners). With moves:
 * jaw_plus or jaw_minus, a part rotates about the shape's joint: [x, y, z] and axis: [x, y, z]. With cuts: true, the
 * part has no contact while the blade is on. offset moves the whole shape.
 * User-defined solids (solid.h) have kind mesh, a closed surface from an STL file, or kind convex, the hull of such a
 * file or of points:
 *
 *              {kind: mesh, file: retractor.stl, unit: mm, rpy: [0, 0, 1.57], from: [0, 0, -0.02], resolution: 0.0003}
 *              {kind: convex, points: [[0, 0, 0], [0.01, 0, 0], [0, 0.01, 0], [0, 0, 0.01]], radius: 0.001}
 *
 * file is relative to the path file; unit is m or mm; rpy rotates (roll, pitch, yaw [rad]); from is the position of the
 * file's origin; radius rounds the solid off on its outside.
 * Immediate cuts need no tool. They run along a line of points of the deformed tissue, down to the vector `depth` [m]:
 *
 *       cuts: [{time: 1, points: [[x, y, z], [x, y, z]], depth: [0, 0.05, 0]}] */
#ifndef PLIANT_TOOL_PATH_H
#define PLIANT_TOOL_PATH_H

#include "base/export.h"
#include "pliant/contact.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_path_key {
    double time;     /**< [s] */
    double value[3]; /**< offset [m], force [N] or acceleration [m/s^2] */
} pliant_path_key;
typedef struct pliant_path_pose {
    double time;                      /**< [s] */
    double position[3], rotation[4];  /**< LPS [m], quaternion x y z w */
    double jaw;                       /**< angle [rad] */
} pliant_path_pose;
typedef struct pliant_path_span { double from, to; } pliant_path_span; /**< [s], both ends included */
typedef struct pliant_path_cut {
    double time;       /**< [s] */
    double *points;    /**< (num_points x 3) LPS [m] */
    uint32_t num_points;
    double depth[3];   /**< [m] */
} pliant_path_cut;
typedef struct pliant_path_tool {
    char name[48];
    pliant_drive drive;
    double grasp[3];
    double release; /**< [s]; 0: never */
    double mass;    /**< at the held point [kg] */
    pliant_path_key *motion;  /**< motion of the grasp; NULL: the tool has poses */
    uint32_t num_motion;
    double blade_from[3], blade_to[3]; /**< edge in the tool's frame [m]; both equal: no blade */
    pliant_tool_shape shape;  /**< without parts: no shape */
    pliant_path_pose *poses;  /**< Nullable */
    uint32_t num_poses;
    pliant_path_span *cut;    /**< Nullable; times when the blade is on */
    uint32_t num_cut;
} pliant_path_tool;
typedef struct pliant_path_probe {
    char name[48];
    double at[3]; /**< rest point [m], LPS */
} pliant_path_probe;
typedef struct pliant_path {
    pliant_path_tool *tools;
    uint32_t num_tools;
    pliant_path_cut *cuts;    /**< Nullable; ordered by time */
    uint32_t num_cuts;
    pliant_path_key *gravity; /**< Nullable: the scene's gravity */
    uint32_t num_gravity;
    pliant_path_probe *probes; /**< Nullable */
    uint32_t num_probes;
} pliant_path;

/** Read a path file. Free the result with pliant_path_free. Errors: FILE, FORMAT, MEMORY; messages name file, field and
 * line. */
PLIANT_INTERNAL pliant_status pliant_path_read(const char *path, pliant_path *out);
PLIANT_INTERNAL void pliant_path_free(pliant_path *path);
/** Compute the offset, or the force with drive: force, at a time. Return whether the tool still holds the tissue. */
PLIANT_INTERNAL bool pliant_path_at(const pliant_path_tool *tool, double time, double value[3]);
/** Compute a tool's pose at a time; the first and last poses are held. Return false if the tool has no poses. */
PLIANT_INTERNAL bool pliant_path_pose_at(const pliant_path_tool *tool, double time, double position[3],
                                         double rotation[4]);
/** Return the jaw angle at a time [rad], with the same rules; 0 without poses. */
PLIANT_INTERNAL double pliant_path_jaw_at(const pliant_path_tool *tool, double time);
/** Return whether the blade is on. */
PLIANT_INTERNAL bool pliant_path_cuts(const pliant_path_tool *tool, double time);
/** Compute gravity at a time. Return false if the path has no gravity. */
PLIANT_INTERNAL bool pliant_path_gravity(const pliant_path *path, double time, double gravity[3]);
/** Return the last time of all tools, cuts and gravity [s]. */
PLIANT_INTERNAL double pliant_path_end(const pliant_path *path);

#ifdef __cplusplus
}
#endif
#endif
