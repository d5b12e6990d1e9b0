/* Results of background work: when steps start to use them. */
#ifndef PLIANT_MODEL_DATA_BACKGROUND_H
#define PLIANT_MODEL_DATA_BACKGROUND_H

#include "base/export.h"
#include "pliant/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* When steps use the results of background work: factors (solver/refresh_interval), patches (model/patch). */
typedef enum pliant_background_kind {
    /* A fixed number of steps after the start of the work; a step waits if needed. The same on every machine (the
     * default). */
    PLIANT_BACKGROUND_PLANNED,
    /* As soon as the work is ready. No step waits, but results depend on timing. */
    PLIANT_BACKGROUND_LIVE,
    /* In the steps that the caller prescribes. The record of a live run repeats that run, bitwise identical. */
    PLIANT_BACKGROUND_PRESCRIBED
} pliant_background_kind;
/* Results that a step can start to use (bits). */
typedef enum pliant_background_result {
    PLIANT_RESULT_FACTOR = 1,         /* a new factor; the secants are then converted to it */
    PLIANT_RESULT_HISTORY = 2,        /* the converted secants */
    PLIANT_RESULT_PATCH = 4,          /* a patch */
    PLIANT_RESULT_PATCH_END = 8,      /* a patch without grasps has ended */
    PLIANT_RESULT_PATCH_FACTOR = 16,  /* like the first two, for the patch in use */
    PLIANT_RESULT_PATCH_HISTORY = 32
} pliant_background_result;
typedef struct pliant_background {
    pliant_background_kind kind;
    uint32_t prescribed;      /* for the next step: pliant_background_result bits */
    uint32_t taken;           /* by the last step: pliant_background_result bits */
} pliant_background;

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

/* Set the kind from the next step on.
 *  @param prescribed for PLIANT_BACKGROUND_PRESCRIBED: the results that the next step uses; it waits for them if
 *                    needed. Set it before every step, to the value that pliant_data_get_background_taken returned for
 *                    the same step of the recorded run.
 *  Errors: ARGUMENT. */
PLIANT_INTERNAL pliant_status pliant_data_set_background(pliant_data *data, pliant_background_kind kind,
                                                         uint32_t prescribed);

/* Return the results that the last step started to use (pliant_background_result bits), for the record of the step. */
PLIANT_INTERNAL uint32_t pliant_data_get_background_taken(const pliant_data *data);

/* Return the clock's readings of the last step, for the record of the step [count] [s]. Without solver/budget_ms the
 * clock is not read. They belong to the simulation, and hold until its next step. */
PLIANT_INTERNAL const double *pliant_data_get_clock(const pliant_data *data, int32_t *count);
/* Prescribe the clock's readings of the next step, as pliant_data_get_clock returned them for the same step of the
 * recorded run. Errors: MEMORY. */
PLIANT_INTERNAL pliant_status pliant_data_prescribe_clock(pliant_data *data, const double *readings, int32_t count);

#ifdef __cplusplus
}
#endif
#endif
