/* Backends: tables of functions that run the stages of a step. The CPU backend always exists and is the reference for
 * the others. The state stays in the backend's memory. Positions, pressures, tool forces and statistics are copied
 * to the host in every step. Drawing and segmentation have separate tables (warp/device.h, scan/segment.h). */
#ifndef PLIANT_BACKEND_BACKEND_H
#define PLIANT_BACKEND_BACKEND_H

#include "contact/advance/near_triangles.h"
#include "contact/detect/contact_surface.h"
#include "contact/detect/tissue.h"
#include "model_data/data.h"
#include "scene/gpu_choice.h"
#include "topology/body.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The host's state of a kind of solver (solver/kind), which all backends start from. It has no stages of a step. */
typedef struct pliant_host_solver {
    /* Creates its state in data, at rest. Errors: MEMORY, SCENE. */
    pliant_status (*create)(const pliant_model *model, pliant_data *data);
    /* Create the state after a cut in `next`, which has the new discretization, from the state of data, which stays
     * unchanged. Errors: MEMORY, SCENE, NUMERIC. */
    pliant_status (*carry_over_cut)(const pliant_model *model, const pliant_data *data, const pliant_body_map *map,
                                    pliant_data *next);
    pliant_status (*reset)(pliant_data *data); /* resets to rest. Errors: MEMORY (nothing changed) */
    /* Sets data's positions as well. */
    void (*set_positions)(const pliant_model *model, pliant_data *data, const double *positions);
    void (*limits)(pliant_data *data, int iterations, double tolerance);
    void (*discard_results)(
        pliant_data *data);           /* called after another backend failed: discards its results. Nullable */
    const pliant_backend *cpu, *cuda; /* backends that run its steps; cuda is NULL in a build without CUDA */
} pliant_host_solver;
extern const pliant_host_solver pliant_corotational, pliant_explicit;

/* The surface of contact: triangles, and the points of tetrahedra that are their corners (contact_surface.h). */
typedef struct pliant_near_surface {
    const pliant_body *body;
    const pliant_contact_surface *corners; /* Nullable: the corners are nodes */
} pliant_near_surface;

struct pliant_backend {
    const char *name;
    const pliant_host_solver *host_solver;
    /* It has no separate state: nothing to download or to free, and no fallback if it fails. */
    bool state_is_on_host;
    /* The result of a solve is in host memory when it ends, so it is not repeated if a later stage fails. */
    bool solves_on_host;
    bool handles_contacts; /* its solve handles contacts, like the host's solvers */
    pliant_probe probe;
    const pliant_tissue_searcher *searcher; /* collision detection between tissue and tissue; Nullable: on the CPU */

    /* STATE of a simulation, created from its host state. Errors: MEMORY, NUMERIC, UNAVAILABLE. */
    pliant_status (*create)(const pliant_model *model, pliant_data *data);
    void (*free)(pliant_data *data); /* NULL on the host */
    /* Update the state after a cut, where `before` has the state before it. map: pliant_data_set_body. If *possible is
     * false, or after an error, the state is created again. Nullable: it is always created again. Errors: MEMORY,
     * UNAVAILABLE. */
    pliant_status (*carry_over_cut)(const pliant_model *model, pliant_data *data, const pliant_data *before,
                                    const pliant_body_map *map, bool *possible);
    pliant_status (*restart)(const pliant_model *model, pliant_data *data); /* reads the host's changed state */
    /* Reads moved nodes, if nothing else has changed; Nullable: use restart. */
    pliant_status (*upload_positions)(const pliant_model *model, pliant_data *data);
    /* Copies the state of the last step to the host's solver; NULL: it is there already. */
    void (*download)(const pliant_model *model, pliant_data *data);

    /* STAGES, each starting from the result of the stage before. interact sets the pull of the tools, on the host. */
    pliant_status (*interact)(const pliant_model *model, pliant_data *data);
    pliant_status (*solve)(const pliant_model *model, pliant_data *data);
    pliant_status (*upsample)(const pliant_model *model, pliant_data *data);
    /* Copies the step's result to the host, after upsample and before later stages. Nullable: it is there already. */
    pliant_status (*copy_result_to_host)(const pliant_model *model, pliant_data *data);
    /* Return whether an element may be small (contact/volume/volume_bound.h). In a leg, test whether one may fall below
     * its limit between data->legs->positions and the positions. Otherwise test volume_near at the positions. Return
     * true if the backend does not have these positions. Nullable: the host tests all elements. */
    bool (*may_have_small_elements)(const pliant_model *model, pliant_data *data, bool in_leg);
    /* List the triangles of the surface that may be near one of the regions (contact/advance/near_triangles.h). In a
     * leg, nodes move from data->legs->positions to the positions; otherwise they are at the positions. Return false if
     * the backend does not have these positions. Nullable: the host tests all triangles. */
    bool (*find_near)(pliant_data *data, const pliant_near_surface *surface, bool in_leg, int32_t count,
                      const pliant_near_region *regions, pliant_triangle_list *out);
    pliant_status (*warp)(const pliant_model *model, pliant_data *data);
};

extern const pliant_backend pliant_cpu_backend;
extern const pliant_backend pliant_tled_backend; /* explicit dynamics on the CPU */
/* Functions shared by both CPU backends. */
bool pliant_cpu_probe(char *text, size_t size);
pliant_status pliant_cpu_skip_stage(const pliant_model *model, pliant_data *data);
pliant_status pliant_cpu_warp(const pliant_model *model, pliant_data *data);
/* Explicit dynamics: set the pull of the tools; compute positions from displacements, and the tools' reports. */
pliant_status pliant_explicit_interact(const pliant_model *model, pliant_data *data);
pliant_status pliant_tled_upsample(const pliant_model *model, pliant_data *data);
/* Corotational: set the pull of the tools. */
pliant_status pliant_corotational_interact(const pliant_model *model, pliant_data *data);

/* Set the grasp constraint and target of a tool before the corotational solve. Errors: MEMORY. */
pliant_status pliant_set_grasp_constraint(const pliant_model *model, pliant_data *data, int tool);
/* Return the leader of a tool. Rigid tools that hold one point (model_data/coincident_grasps.h) share one constraint
 * and its force, which belong to the first of them. Any other tool is its own leader. */
int pliant_grasp_leader(const pliant_data *data, int tool);
/* List the tools that share the constraint of a leader, the leader first.
 * @return Their number. */
int pliant_grasp_members(const pliant_data *data, int leader, int member[PLIANT_MAX_TOOLS]);
/* Set the contact points before the solve, if the host's solver has the positions. Errors: MEMORY. */
pliant_status pliant_set_contact_points(pliant_data *data);
/* Report every tool's held point and force after a solve. */
void pliant_report_grasps(pliant_data *data);

#ifdef PLIANT_WITH_CUDA
extern const pliant_backend pliant_cuda_backend, pliant_cuda_tled_backend;
#endif

/* Return whether the host moves nodes after the solve. Another backend must then copy its result to the host before,
 * and read the moved nodes afterwards. */
static inline bool pliant_host_moves_nodes(const pliant_data *data) { return data->patch || data->rigid_pieces; }

const pliant_host_solver *pliant_host_solver_of(const pliant_model *model);

/* Create the backend of a new simulation. A log line names it, and with `auto` also the reason why no GPU is used. */
pliant_status pliant_backend_create(const pliant_model *model, pliant_data *data);
/* Read the host's changed state in the backend, or fall back to the CPU. It fails only if both fail. */
pliant_status pliant_backend_restart(const pliant_model *model, pliant_data *data);
/* Do the same for moved nodes during a step, if nothing else has changed. Data of the present step is kept. */
pliant_status pliant_backend_upload_positions(const pliant_model *model, pliant_data *data);
/* Follow the host's state across a cut. `before` still has its arrays. The backend updates its state or creates it
 * again, or the CPU continues. */
void pliant_backend_carry_over_cut(const pliant_model *model, pliant_data *data, const pliant_data *before,
                                   const pliant_body_map *map);
/* Return whether a GPU solves for the fine nodes themselves, and none of them was moved since. Its state is then equal
 * to the positions. */
bool pliant_positions_are_state(const pliant_data *data);
/* Continue on the CPU from the last valid state, after a failure of the backend. Return false if the CPU itself
 * failed. */
bool pliant_backend_fall_back(const pliant_model *model, pliant_data *data, pliant_status status);

#ifdef __cplusplus
}
#endif
#endif
