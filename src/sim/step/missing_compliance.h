/* Compliance that a mesh lacks under a contact narrower than its cells (src/contact/NUMERICS.md, "Missing compliance").
 *
 * The surface of a mesh cannot form a dimple that is narrower than a cell, so it resists a tool too much. The coupling
 * of the tool's proxy gets the missing compliance: the proxy then stays behind its target by the missing depth. */
#ifndef PLIANT_SIM_MISSING_COMPLIANCE_H
#define PLIANT_SIM_MISSING_COMPLIANCE_H

#include "contact/advance/advance.h"
#include "fem/patch/patch.h"
#include "model_data/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Buffer for the forces on the nodes of a contact. Zero it before its first use; free `load` with pliant_free. */
typedef struct pliant_node_load {
    int32_t node, order;
    double force[3];
} pliant_node_load;
typedef struct pliant_node_loads {
    int32_t count, capacity;
    pliant_node_load *load;
} pliant_node_loads;

/* Compute the missing compliance of a tool's coupling from the forces of the contact points.
 * @param out zero and the fraction 1 if nothing is touched, or if the tool gets no missing compliance
 * @param pose of the proxy when these forces acted; @param goal desired pose of the proxy
 * Errors: MEMORY. */
pliant_status pliant_missing_compliance(const pliant_data *data, int tool, const pliant_tool_pose *pose,
                                        const pliant_tool_pose *goal, pliant_node_loads *buffer,
                                        pliant_missing_depth *out);

/* Return the mesh that a tool feels. */
static inline const pliant_mesh *pliant_felt_mesh(const pliant_data *data, int tool)
{
    const pliant_body *body = data->body;
    const bool is_coarse =
        body->coarse.num_nodes > 0 && data->solver && pliant_patch_solver(data, tool) == data->solver;
    return is_coarse ? &body->coarse : &body->fine;
}

/* Return whether a tool gets the missing compliance. The coarse nodes of `schur` respond as single fine nodes, so they
 * lack none. */
static inline bool pliant_adds_missing_compliance(const pliant_data *data, int tool)
{
    return !data->model->without_missing_compliance &&
           (pliant_felt_mesh(data, tool) == &data->body->fine || data->model->scene.model.method != PLIANT_SCHUR);
}

#ifdef __cplusplus
}
#endif

#endif
