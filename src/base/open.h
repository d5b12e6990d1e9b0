/* All files and folders are opened through these functions; see pliant/open.h. */
#ifndef PLIANT_BASE_OPEN_H
#define PLIANT_BASE_OPEN_H

#include "pliant/open.h"

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_opening {
    const char *name;    /* name to open instead of the path; points into this struct or is the path */
    const char *refused; /* reason why it may not be read; NULL: it may be read */
    int descriptor;      /* -1: no descriptor */
    char link[32];
} pliant_opening;

/* Begin to open a path. Return false if it may not be read (`refused` is set) or cannot be reached (errno is set,
 * `refused` is NULL). */
bool pliant_opening_begin(const char *path, pliant_opening *opening);
/* Finish after `name` has been opened. errno is preserved. */
void pliant_opening_end(pliant_opening *opening);

#ifdef __cplusplus
}
#endif
#endif
