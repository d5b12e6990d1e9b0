/* Whether a step takes what was made in the background (pliant_background). */
#ifndef PLIANT_FEM_QUASISTATIC_BACKGROUND_H
#define PLIANT_FEM_QUASISTATIC_BACKGROUND_H

#include "state/data.h"

/* No step waits; nor when the same is done again. background is Nullable: as planned */
static inline bool pliant_background_is_live(const pliant_background *background) { return background && background->kind != PLIANT_BACKGROUND_PLANNED; }

/* finished: it is ready. due: the step has come that it was planned for. background is Nullable: as planned */
static inline bool pliant_background_arrives(pliant_background *background, uint32_t result, bool finished, bool due)
{
    const pliant_background_kind kind = background ? background->kind : PLIANT_BACKGROUND_PLANNED;
    const bool arrives = kind == PLIANT_BACKGROUND_LIVE         ? finished
                         : kind == PLIANT_BACKGROUND_PRESCRIBED ? (background->prescribed & result) != 0
                                                                : due;
    if (arrives && background) background->taken |= result;
    return arrives;
}

#endif
