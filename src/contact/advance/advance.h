/* Compute the largest fraction of a leg that keeps every rigid part's core out of the tissue's surface.
 *
 * A leg is one motion of all nodes and all parts. Nodes and tool tips move along straight lines. Tools turn at a
 * constant rate about their tip, and jaws turn at a constant rate about their joint. The core of a part is
 * everything deeper than `guard` below its surface. A pair of a surface triangle and a part has a core distance:
 * the smallest signed distance from the triangle to the core. If all core distances are above 0 at the start of a
 * leg, they stay above 0 up to the returned fraction, for any motion.
 *
 * Method: conservative advancement (Mirtich, Impulse-based dynamic simulation of rigid body systems, thesis, 1996;
 * Zhang, Lee, Kim, Interactive continuous collision detection for non-convex polyhedra, The Visual Computer 22:749,
 * 2006). Each iteration bounds the distance from below by linear functions and moves on to the time at which the
 * bound reaches the limit. */
#ifndef PLIANT_CONTACT_ADVANCE_H
#define PLIANT_CONTACT_ADVANCE_H

#include "contact/advance/near_triangles.h"
#include "contact/settings.h"
#include "pliant/contact.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Pose of a tool: its tip [m], its rotation (quaternion x y z w), its jaw angle [rad]. */
typedef struct pliant_tool_pose {
    double tip[3], rotation[4], jaw;
} pliant_tool_pose;

/* Compute the pose at a fraction of a leg. t = 0 and t = 1 return the two ends exactly. */
pliant_tool_pose pliant_tool_pose_between(const pliant_tool_pose *from, const pliant_tool_pose *to, double t);

/* One rigid part during a leg. */
typedef struct pliant_advance_part {
    const pliant_part *part;
    const pliant_tool_shape *shape; /* Nullable: the part stands still, and its frame is the scan's */
    pliant_tool_pose from, to;      /* not read without a shape */
    double guard;                   /* depth from the surface to the core [m] */
    /* exempt pairs that overlap at the start (core distance at most 0); otherwise such a pair gives t = 0 */
    bool released;
    int32_t num_held;
    const int32_t *held; /* (num_held) nodes that the tool holds, ascending; triangles with one of them are exempt */
} pliant_advance_part;

/* Buffers that are kept from leg to leg. */
typedef struct pliant_advance pliant_advance;
/* @param settings Nullable: the defaults. Errors: MEMORY */
pliant_status pliant_advance_create(const pliant_contact_settings *settings, pliant_advance **out);
void pliant_advance_free(pliant_advance *advance); /* Nullable */

/* Set a function that lists the triangles near the parts for pliant_advance_find. It may also set the positions `to` of
 * these triangles. Nullable */
void pliant_advance_set_finder(pliant_advance *advance, const pliant_near_finder *finder);

/* Return the guard depth of a part: the depth from its surface to its core [m]. smallest_cell: of the mesh [m] */
double pliant_advance_guard(const pliant_contact_settings *settings, const pliant_part *part, double smallest_cell);

/* Compute the largest fraction of a leg, 0 to 1. The result does not depend on the number of threads.
 * @param triangles (num_triangles x 3) nodes of the surface
 * @param from, to (nodes x 3) positions at both ends of the leg, finite [m]
 * @param every_pair also compute the fractions of pairs that do not limit the leg (pair.h)
 * Errors: MEMORY (fraction is not written). */
pliant_status pliant_advance_find(pliant_advance *advance, int32_t num_triangles, const int32_t *triangles,
                                  const double *from, const double *to, int32_t count, const pliant_advance_part *parts,
                                  int num_threads, bool every_pair, double *fraction);

typedef struct pliant_advance_audit_result {
    /* smallest core distance of all near pairs, without held and released ones; INFINITY: no pair is near [m] */
    double minimum;
    /* number of pairs in which an edge of the surface enters a core, or an edge or axis of a core enters a triangle */
    int32_t crossings;
} pliant_advance_audit_result;

/* Check one configuration: nodes at `positions`, parts at their `from` poses. Crossings and distances use different
 * algorithms. Released parts are left out, because tissue may overlap them. Errors: MEMORY (out is not written). */
pliant_status pliant_advance_audit(pliant_advance *advance, int32_t num_triangles, const int32_t *triangles,
                                   const double *positions, int32_t count, const pliant_advance_part *parts,
                                   int num_threads, pliant_advance_audit_result *out);

/* ---- tissue on tissue */

/* Pairs of a node and a triangle, and pairs of edges, of the surface. Pairs are left out that have a common node, an
 * exempt node on both sides, or all nodes in one rigid piece. A pair that starts nearer than the smallest distance that
 * a leg leaves is released: it is held after it has come apart. */
typedef struct pliant_advance_self {
    double thickness; /* replaces the guard in the rule [m] */
    /* Nullable, (nodes x 3) at rest: the thickness of a pair is at most its distance at rest; a pair
     * without thickness is not held [m] */
    const double *rest;
    const uint8_t *exempt; /* Nullable, (nodes) */
    const int32_t *piece;  /* Nullable, (nodes) number of the rigid piece; -1: none */
} pliant_advance_self;

/* Compute the largest fraction of a leg in which the surface does not pass through itself. Otherwise as
 * pliant_advance_find.
 * @param listed 0, or a distance up to which the last audit has listed all pairs at `from`. It must be at least the
 *   relative motion in the leg plus pliant_advance_self_margin. Then only listed pairs are tested, and the list
 *   stays [m]
 * Errors: MEMORY (fraction is not written). */
pliant_status pliant_advance_find_self(pliant_advance *advance, int32_t num_triangles, const int32_t *triangles,
                                       const double *from, const double *to, const pliant_advance_self *self,
                                       double listed, int num_threads, double *fraction);
/* Return a bound of the motion of two points of the surface relative to each other: the diagonal of the box around all
 * motions [m]. node: Nullable, (count); NULL: the nodes 0 to count - 1 */
double pliant_advance_relative_motion(int32_t count, const int32_t *node, const double *from, const double *to);
/* Return the distance above which a pair does not shorten a leg [m]. */
double pliant_advance_self_margin(const pliant_contact_settings *settings, double thickness);

/* List the pairs of the surface with itself that are nearer than the thickness in one configuration.
 * @param crossing Nullable, (nodes): set to 1 for the nodes of edges and triangles that cross
 * @param crossings Nullable, out: number of edges that pass through triangles. It is computed without distances.
 * Errors: MEMORY (crossings is not written). */
pliant_status pliant_advance_audit_self(pliant_advance *advance, int32_t num_triangles, const int32_t *triangles,
                                        const double *positions, const pliant_advance_self *self, uint8_t *crossing,
                                        int32_t *crossings);

#ifdef __cplusplus
}
#endif

#endif
