/* What a step asks of the tools. */
#ifndef PLIANT_INTERACT_TOOL_H
#define PLIANT_INTERACT_TOOL_H

#include "pliant/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* before the solve: tell the solver what the tool pulls at and where to */
pliant_status pliant_tool_interact(const pliant_model *model, pliant_data *data, int tool);
/* after the solve: where the held point is and what force it took */
void pliant_tool_report(pliant_data *data, int tool);
/* the same tool on the fine mesh of the next body: it holds what is where it took hold. Errors: MEMORY, ARGUMENT (nothing is there); free
 * the hold of either. */
pliant_status pliant_tool_carry(pliant_tool *tool, const pliant_tool *from, const pliant_mesh *mesh);
/* free the hold; the solver is told at the next step */
void pliant_tool_forget(pliant_tool *tool);

#ifdef __cplusplus
}
#endif

#endif
