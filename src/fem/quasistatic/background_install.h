/* Decides whether a step installs a background result (pliant_background). */
#ifndef PLIANT_FEM_QUASISTATIC_BACKGROUND_INSTALL_H
#define PLIANT_FEM_QUASISTATIC_BACKGROUND_INSTALL_H

#include "state/background.h"
#include "state/data.h"

/* Return whether steps are live or a replay of live steps. Live steps do not wait for results. Nullable background:
 * planned */
static inline bool pliant_background_is_live(const pliant_background *background)
{
    return background && background->kind != PLIANT_BACKGROUND_PLANNED;
}

/* Return whether the result is installed in this step.
 * @param background  Nullable: planned.
 * @param finished    The result is ready.
 * @param due         This is the planned step. */
static inline bool pliant_background_installs(pliant_background *background, uint32_t result, bool finished, bool due)
{
    const pliant_background_kind kind = background ? background->kind : PLIANT_BACKGROUND_PLANNED;
    const bool arrives = kind == PLIANT_BACKGROUND_LIVE         ? finished
                         : kind == PLIANT_BACKGROUND_PRESCRIBED ? (background->prescribed & result) != 0
                                                                : due;
    if (arrives && background) background->taken |= result;
    return arrives;
}

#endif
