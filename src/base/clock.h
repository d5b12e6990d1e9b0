/* Time for statistics and limits. */
#ifndef PLIANT_BASE_CLOCK_H
#define PLIANT_BASE_CLOCK_H

#include "base/export.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Monotonic wall clock. [s] */
PLIANT_INTERNAL double pliant_seconds(void);

#ifdef __cplusplus
}
#endif
#endif
