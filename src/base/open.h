/* Every file and folder that is read by its path is opened through here; see pliant/open.h. */
#ifndef PLIANT_BASE_OPEN_H
#define PLIANT_BASE_OPEN_H

#include "pliant/open.h"

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_opening {
    const char *name;    /* what to open, or stat, in place of the path; points into this struct or is the path */
    const char *refused; /* why it may not be read; NULL: it may */
    int descriptor;      /* -1: none is held */
    char link[32];
} pliant_opening;

/* False when it may not be read (refused says why) or cannot be reached (errno; refused is NULL). */
bool pliant_opening_begin(const char *path, pliant_opening *opening);
/* Once `name` has been opened. Keeps errno. */
void pliant_opening_end(pliant_opening *opening);

#ifdef __cplusplus
}
#endif
#endif
