/* Check for free memory. Systems that overcommit memory may otherwise end the process later. */
#ifndef PLIANT_BASE_FREE_MEMORY_H
#define PLIANT_BASE_FREE_MEMORY_H

#include "pliant/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Return the free memory [bytes]; infinite if the system does not report it. */
double pliant_free_memory(void);

/* Check whether `bytes` fit in the free memory. Small amounts always fit. Errors: MEMORY, with `what` and both
 * figures. */
pliant_status pliant_memory_check(double bytes, const char *what);

#ifdef __cplusplus
}
#endif

#endif
