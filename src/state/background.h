/* When steps put to use what is made for them in the background. */
#ifndef PLIANT_STATE_BACKGROUND_H
#define PLIANT_STATE_BACKGROUND_H

#include "base/export.h"
#include "pliant/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* When steps put to use what is made for them in the background: factors (solver/refresh_interval), patches (model/patch). */
typedef enum pliant_background_kind {
    PLIANT_BACKGROUND_PLANNED, /* a number of steps after its start, ready or waited for: the same on every machine (the default) */
    PLIANT_BACKGROUND_LIVE, /* as soon as it is ready: no step waits, but results depend on timing */
    PLIANT_BACKGROUND_PRESCRIBED /* when it is said to: with what a live run took in each step, that run again, bit for bit */
} pliant_background_kind;
/* What a step may take. */
typedef enum pliant_background_result {
    PLIANT_TAKES_FACTOR = 1,         /* a new factor; what the solver learned is now fitted to it */
    PLIANT_TAKES_HISTORY = 2,        /* and goes with it */
    PLIANT_TAKES_PATCH = 4,          /* a patch */
    PLIANT_TAKES_PATCH_END = 8,      /* one that no hold is left of has ended */
    PLIANT_TAKES_PATCH_FACTOR = 16,  /* as the first two, of the patch in use */
    PLIANT_TAKES_PATCH_HISTORY = 32
} pliant_background_result;
typedef struct pliant_background {
    pliant_background_kind kind;
    uint32_t prescribed;      /* for the next step: pliant_background_result, together */
    uint32_t taken;           /* by the last step, likewise */
} pliant_background;

/* From the next step on. @param prescribed PLIANT_BACKGROUND_PRESCRIBED: what the next step takes, waiting for it if need be; to be said
 *  before every step, as pliant_data_get_background_taken told it of the same step before. Errors: ARGUMENT. */
PLIANT_INTERNAL pliant_status pliant_data_set_background(pliant_data *data, pliant_background_kind kind,
                                                         uint32_t prescribed);

/* What the last step took (pliant_background_result, together): to be recorded beside the step's number. */
PLIANT_INTERNAL uint32_t pliant_data_get_background_taken(const pliant_data *data);

#ifdef __cplusplus
}
#endif
#endif
