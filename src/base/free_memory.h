/* Is there room? Where the system promises memory that it does not have, too much ends the process later. */
#ifndef PLIANT_BASE_FREE_MEMORY_H
#define PLIANT_BASE_FREE_MEMORY_H

#include "pliant/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Bytes; infinite where the system does not tell. */
double pliant_free_memory(void);

/* Errors: MEMORY, naming what and both figures. Small amounts are always said to fit. */
pliant_status pliant_memory_suffices(double bytes, const char *what);

#ifdef __cplusplus
}
#endif

#endif
