/* What a step asks of the tools: holds and their places. Who solves tells them the forces (backend/pull.c). */
#ifndef PLIANT_INTERACT_TOOL_H
#define PLIANT_INTERACT_TOOL_H

#include "state/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* after the solve: where the held point is
 * @param force (3) Nullable: what it took; without it, the tool keeps the force that it has */
void pliant_tool_report(pliant_data *data, int tool, const double *force);
/* the same tool on the fine mesh of the next body: it holds what is where it took hold. Errors: MEMORY, ARGUMENT (nothing is there); free
 * the hold of either. */
pliant_status pliant_tool_carry(pliant_tool *tool, const pliant_tool *from, const pliant_mesh *mesh);
/* free the hold; the solver is told at the next step */
void pliant_tool_forget(pliant_tool *tool);

#ifdef __cplusplus
}
#endif

#endif
