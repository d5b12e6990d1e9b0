/* What a step asks of the tools: holds and their places. Who solves tells them the forces (backend/pull.c). */
#ifndef PLIANT_INTERACT_TOOL_H
#define PLIANT_INTERACT_TOOL_H

#include "pliant/memory.h"
#include "state/data.h"

#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

/* after the solve: where the held point is
 * @param force (3) Nullable: what it took; without it, the tool keeps the force that it has */
void pliant_tool_report(pliant_data *data, int tool, const double *force);
/* the same tool on the next body, at these positions: it holds what is where it took hold. Errors: MEMORY, ARGUMENT (nothing is there);
 * free both. */
pliant_status pliant_tool_carry(pliant_tool *tool, const pliant_tool *from, const pliant_data *data, const pliant_body *next,
                                const double *positions);
/* Before a step: a spring that would take more than grasp/slip slips, so that it takes that; one that has slipped too far lets go. */
void pliant_tool_slip(const pliant_scene *scene, pliant_data *data, int tool);
/* free the hold; the solver is told at the next step */
static inline void pliant_tool_drop(pliant_tool *tool)
{
    pliant_free(tool->held);
    pliant_free(tool->weight);
    tool->held = NULL;
    tool->weight = NULL;
    tool->num_held = 0;
    tool->holding = tool->attached = tool->blade.drags = false;
    memset(tool->force, 0, sizeof tool->force);
}
/* and pull by the spring again */
void pliant_tool_forget(pliant_tool *tool);
/* all that it has */
void pliant_tool_free(pliant_tool *tool);

#ifdef __cplusplus
}
#endif

#endif
