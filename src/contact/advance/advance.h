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

#include "contact/settings.h"
#include "pliant/contact.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Pose of a tool: its tip [m], its rotation (quaternion x y z w), its jaw angle [rad]. */
typedef struct pliant_tool_pose {
    double tip[3], rotation[4], jaw;
} pliant_tool_pose;

/* The pose at a fraction of a leg. t = 0 and t = 1 return both ends. */
void pliant_tool_pose_between(const pliant_tool_pose *from, const pliant_tool_pose *to, double t,
                              pliant_tool_pose *out);

/* One rigid part through a leg. */
typedef struct pliant_advance_part {
    const pliant_part *part;
    const pliant_tool_shape *shape; /* Nullable: the part stands still, and its frame is the scan's */
    pliant_tool_pose from, to;      /* not read without a shape */
    double guard;                   /* depth from the surface to the core [m] */
    bool released; /* pairs whose core distance is at most 0 at the start are exempt; otherwise such a pair gives t = 0
                    */
    int32_t num_held;
    const int32_t *held; /* (num_held) ascending nodes that the tool holds: triangles with one of them are exempt */
} pliant_advance_part;

typedef struct pliant_advance_result {
    double t;               /* fraction of the leg, 0 to 1 */
    int32_t part, triangle; /* the pair that limits t; -1: none */
    int32_t pairs;          /* pairs that the broad phase left */
    int64_t distances;      /* distances evaluated */
    double least; /* smallest core distance of these pairs at t, exempt ones left out; INFINITY: none is near [m] */
} pliant_advance_result;

/* Buffers, kept from leg to leg. */
typedef struct pliant_advance pliant_advance;
/* @param settings Nullable: the defaults. Errors: MEMORY */
pliant_status pliant_advance_create(const pliant_contact_settings *settings, pliant_advance **out);
void pliant_advance_free(pliant_advance *advance); /* Nullable */

/* The depth from a part's surface to its core [m], of a mesh with this smallest cell [m]. */
double pliant_advance_guard(const pliant_contact_settings *settings, const pliant_part *part, double smallest_cell);

/* The largest fraction of a leg. The result does not depend on the number of threads.
 * @param triangles (num_triangles x 3) nodes of the surface; @param from, to (nodes x 3) positions at both ends of the
 * leg, which are finite [m]
 * Errors: MEMORY (out is not written) */
pliant_status pliant_advance_find(pliant_advance *advance, int32_t num_triangles, const int32_t *triangles,
                                  const double *from, const double *to, int32_t count, const pliant_advance_part *parts,
                                  int num_threads, pliant_advance_result *out);

typedef struct pliant_advance_audit_result {
    double least; /* smallest core distance of all pairs that are near, held and released ones left out; INFINITY: none
                     is near [m] */
    int32_t part, triangle; /* its pair; -1: none */
    int32_t crossings; /* pairs in which an edge of the surface enters a core, or an edge or axis of a core enters a
                          triangle */
    int32_t crossing_part, crossing_triangle; /* the first of them; -1: none */
} pliant_advance_audit_result;

/* Check one configuration: nodes at `positions`, parts in their `from` poses. Crossings are found by other code than
 * distances. A part that is released is left out: its tissue may overlap it. Errors: MEMORY (out is not written) */
pliant_status pliant_advance_audit(pliant_advance *advance, int32_t num_triangles, const int32_t *triangles,
                                   const double *positions, int32_t count, const pliant_advance_part *parts,
                                   int num_threads, pliant_advance_audit_result *out);

/* ---- tissue on tissue */

/* Pairs of a node and a triangle, and of two edges, of the surface. Pairs that share a node are left out. */
typedef struct pliant_advance_self {
    double thickness; /* replaces the guard in the rule [m] */
    const int32_t
        *component; /* Nullable, (nodes): label of the part of the surface that a node belongs to, 0 or more */
    int32_t num_released;
    const int32_t (
        *released)[2]; /* (num_released) pairs of labels, the smaller one first: pairs between them are exempt */
} pliant_advance_self;

typedef struct pliant_advance_self_result {
    double t;        /* fraction of the leg, 0 to 1 */
    int32_t node[4]; /* the pair that limits t: a node and a triangle's, or two edges'; -1: none */
    bool is_edges;
    int32_t pairs; /* pairs that the broad phase left */
    int64_t distances;
} pliant_advance_self_result;

/* The largest fraction of a leg that keeps the surface from passing through itself; otherwise as pliant_advance_find.
 * Errors: MEMORY (out is not written) */
pliant_status pliant_advance_find_self(pliant_advance *advance, int32_t num_triangles, const int32_t *triangles,
                                       const double *from, const double *to, const pliant_advance_self *self,
                                       int num_threads, pliant_advance_self_result *out);

typedef struct pliant_advance_self_audit {
    double least;      /* smallest distance of pairs nearer than the thickness; INFINITY: none is [m] */
    int32_t crossings; /* edges that pass through triangles, by other code than distances */
    int32_t node[5];   /* edge and triangle of one of them; -1: none */
} pliant_advance_self_audit;
pliant_status pliant_advance_audit_self(pliant_advance *advance, int32_t num_triangles, const int32_t *triangles,
                                        const double *positions, const pliant_advance_self *self, int num_threads,
                                        pliant_advance_self_audit *out);

#ifdef __cplusplus
}
#endif

#endif
