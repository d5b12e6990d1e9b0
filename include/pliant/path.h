/** @file path.h
 *  A recorded tool path: what a tool does over time, for runs without a robot.
 *
 *  YAML:  tools:
 *           - name: grasper
 *             drive: spring            # spring | rigid | force
 *             grasp: [x, y, z]         # rest point that it holds [m], LPS
 *             motion: [{time: 0, offset: [0, 0, 0]}, {time: 1, offset: [0, -0.03, 0]}]
 *  Offsets are from the grasped point [m]. A tool of drive: force has forces on the tissue [N] in their place:
 *             motion: [{time: 0, force: [0, 0, 0]}, {time: 1, force: [0, -5, 0]}]
 *  Linear in between, held at the end. A tool lets go after its optional `release` time. Gravity may turn too, beside tools or alone:
 *      gravity: [{time: 0, acceleration: [0, 0, -9.81]}, {time: 2, acceleration: [0, 9.81, 0]}]       [m/s^2]
 *  And points of the tissue whose places are wanted:
 *      probes: [{name: tip, at: [x, y, z]}]                                                                  rest point [m]
 */
#ifndef PLIANT_PATH_H
#define PLIANT_PATH_H

#include "pliant/data.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_path_key {
    double time;     /**< [s] */
    double value[3]; /**< offset [m], force [N] or acceleration [m/s^2] */
} pliant_path_key;
typedef struct pliant_path_tool {
    char name[48];
    pliant_drive drive;
    double grasp[3];
    double release; /**< [s]; 0: never */
    pliant_path_key *motion;
    uint32_t num_motion;
} pliant_path_tool;
typedef struct pliant_path_probe {
    char name[48];
    double at[3]; /**< rest point [m], LPS */
} pliant_path_probe;
typedef struct pliant_path {
    pliant_path_tool *tools;
    uint32_t num_tools;
    pliant_path_key *gravity; /**< Nullable: that of the scene */
    uint32_t num_gravity;
    pliant_path_probe *probes; /**< Nullable */
    uint32_t num_probes;
} pliant_path;

/** Errors name file, field and line: FILE, FORMAT, MEMORY. Free with pliant_path_free. */
PLIANT_API pliant_status pliant_path_read(const char *path, pliant_path *out);
PLIANT_API void pliant_path_free(pliant_path *path);
/** Offset, or force of a tool of drive: force, at a time, and whether the tool still holds. */
PLIANT_API bool pliant_path_at(const pliant_path_tool *tool, double time, double value[3]);
/** Gravity at a time; false: the path says nothing of it. */
PLIANT_API bool pliant_path_gravity(const pliant_path *path, double time, double gravity[3]);
/** Last time of any tool and of gravity [s]. */
PLIANT_API double pliant_path_end(const pliant_path *path);

#ifdef __cplusplus
}
#endif
#endif
