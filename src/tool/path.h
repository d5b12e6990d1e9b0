/* A recorded tool path: what a tool does over time, for runs without a robot.
 *
 *  YAML:  tools:
 *           - name: grasper
 *             drive: spring            # spring | rigid | force
 *             grasp: [x, y, z]         # rest point that it holds [m], LPS
 *             motion: [{time: 0, offset: [0, 0, 0]}, {time: 1, offset: [0, -0.03, 0]}]
 *  Offsets are from the grasped point [m]. A tool of drive: force has forces on the tissue [N] in their place:
 *             motion: [{time: 0, force: [0, 0, 0]}, {time: 1, force: [0, -5, 0]}]
 *  Linear in between, held at the end. A tool lets go after its optional `release` time, and may have a `mass` [kg]
 *  at the held point: a weight that hangs there is of drive: force, with the force [0, 0, 0]. Gravity may turn too, beside tools or alone:
 *      gravity: [{time: 0, acceleration: [0, 0, -9.81]}, {time: 2, acceleration: [0, 9.81, 0]}]       [m/s^2]
 *  And points of the tissue whose places are wanted:
 *      probes: [{name: tip, at: [x, y, z]}]                                                                  rest point [m]
 *
 *  A tool with a blade goes from pose to pose, and cuts while it is said to (scenes with cut/kind):
 *           - name: knife
 *             blade: {name: scalpel}   # or its edge in the tool's frame [m]: {from: [0, 0, -0.03], to: [0, 0, 0]}
 *             poses: [{time: 0, position: [x, y, z], rotation: [0, 0, 0, 1]}, ...]    # of its tip [m], LPS; quaternion x y z w
 *             cut: [{from: 0.2, to: 1.4}]                                             # [s]
 *  Any tool with poses may have a shape, which pushes tissue that it touches, and a pose an angle of its jaws, 0 where it says none:
 *             shape: {name: large_needle_driver}                                      # contact.h lists them; or its own parts [m]:
 *             shape: {parts: [{kind: capsule, from: [0, 0, -0.1], to: [0, 0, 0], radius: 0.004}], offset: [0, 0, 0.01]}
 *             poses: [{time: 0, position: [x, y, z], jaw: 0.5}, ...]                  # [rad]
 *  Parts are of kind sphere (from: its centre), capsule (from, to: its axis) or box (from, to: corners); moves: jaw_plus or jaw_minus turns one about
 *  the shape's joint: [x, y, z] and axis: [x, y, z]; cuts: true leaves it out while the blade is on; offset moves the whole.
 *  Solids of one's own (solid.h) are of kind mesh, a closed surface from an STL file, or convex, the hull of such a file or of points:
 *             {kind: mesh, file: retractor.stl, unit: mm, rpy: [0, 0, 1.57], from: [0, 0, -0.02], resolution: 0.0003}
 *             {kind: convex, points: [[0, 0, 0], [0.01, 0, 0], [0, 0.01, 0], [0, 0, 0.01]], radius: 0.001}
 *  file lies relative to this one; unit is m or mm; rpy turns (roll, pitch, yaw [rad]), from is where the file's origin lies; radius rounds off outside.
 *  Cuts at once, without a tool, along a line of points of the tissue as it lies then, and as deep as `depth` [m]:
 *      cuts: [{time: 1, points: [[x, y, z], [x, y, z]], depth: [0, 0.05, 0]}]
 */
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
typedef struct pliant_path_span { double from, to; } pliant_path_span; /**< [s], both ends among it */
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
    pliant_path_key *motion;  /**< of what it grasps; NULL: it has poses */
    uint32_t num_motion;
    double blade_from[3], blade_to[3]; /**< its edge, in its frame [m]; both equal: none */
    pliant_tool_shape shape;  /**< without parts: none */
    pliant_path_pose *poses;  /**< Nullable */
    uint32_t num_poses;
    pliant_path_span *cut;    /**< Nullable; when its blade is on */
    uint32_t num_cut;
} pliant_path_tool;
typedef struct pliant_path_probe {
    char name[48];
    double at[3]; /**< rest point [m], LPS */
} pliant_path_probe;
typedef struct pliant_path {
    pliant_path_tool *tools;
    uint32_t num_tools;
    pliant_path_cut *cuts;    /**< Nullable; by time */
    uint32_t num_cuts;
    pliant_path_key *gravity; /**< Nullable: that of the scene */
    uint32_t num_gravity;
    pliant_path_probe *probes; /**< Nullable */
    uint32_t num_probes;
} pliant_path;

/** Errors name file, field and line: FILE, FORMAT, MEMORY. Free with pliant_path_free. */
PLIANT_INTERNAL pliant_status pliant_path_read(const char *path, pliant_path *out);
PLIANT_INTERNAL void pliant_path_free(pliant_path *path);
/** Offset, or force of a tool of drive: force, at a time, and whether the tool still holds. */
PLIANT_INTERNAL bool pliant_path_at(const pliant_path_tool *tool, double time, double value[3]);
/** Pose of a tool at a time, held before the first and after the last; false: it has none. */
PLIANT_INTERNAL bool pliant_path_pose_at(const pliant_path_tool *tool, double time, double position[3], double rotation[4]);
/** Angle of its jaw at a time [rad], likewise; 0 of a tool without poses. */
PLIANT_INTERNAL double pliant_path_jaw_at(const pliant_path_tool *tool, double time);
/** Whether its blade is on. */
PLIANT_INTERNAL bool pliant_path_cuts(const pliant_path_tool *tool, double time);
/** Gravity at a time; false: the path says nothing of it. */
PLIANT_INTERNAL bool pliant_path_gravity(const pliant_path *path, double time, double gravity[3]);
/** Last time of any tool, cut and of gravity [s]. */
PLIANT_INTERNAL double pliant_path_end(const pliant_path *path);

#ifdef __cplusplus
}
#endif
#endif
