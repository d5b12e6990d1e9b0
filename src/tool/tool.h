/* Tool functions for the step: grasps and their positions. The solver computes the forces (backend/cpu.c). */
#ifndef PLIANT_INTERACT_TOOL_H
#define PLIANT_INTERACT_TOOL_H

#include "base/memory.h"
#include "model_data/data.h"

#include <string.h>

/* Update a tool after the solve with the position of the grasped point.
 * @param force (3) Nullable; force on the tool; if NULL, the tool keeps its force */
void pliant_tool_report(pliant_data *data, int tool, const double *force);
/* Copy a tool to the next body at these positions. It grasps the tissue at the same rest point. Errors: MEMORY,
 * ARGUMENT (no tissue there); free both. */
pliant_status pliant_tool_transfer(const pliant_scene *scene, pliant_tool *tool, const pliant_tool *from,
                                   const pliant_data *data, const pliant_body *next, const double *positions);
/* Before a step: let a spring slip so that its force does not exceed grasp/slip. A grasp that has slipped too far is
 * released. */
void pliant_tool_slip(const pliant_scene *scene, pliant_data *data, int tool);
/* Remove the grasp; the solver is updated in the next step. */
static inline void pliant_tool_remove_grasp(pliant_tool *tool)
{
    pliant_free(tool->held);
    pliant_free(tool->weight);
    tool->held = NULL;
    tool->weight = NULL;
    tool->num_held = 0;
    tool->holding = tool->attached = tool->blade.is_dragging = false;
    memset(tool->force, 0, sizeof tool->force);
}
/* Remove the grasp, and use the spring drive again. */
void pliant_tool_reset_grasp(pliant_tool *tool);
/* Free all data of a tool. */
void pliant_tool_free(pliant_tool *tool);

#endif
