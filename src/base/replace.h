/* Writing a file in the folder of its target and renaming it: the target is complete or absent. */
#ifndef PLIANT_BASE_REPLACE_H
#define PLIANT_BASE_REPLACE_H

#include <limits.h>

/* Create an empty file in the target's folder with a unique name, open for writing. Return its descriptor, or -1 with
 * errno. temporary: out: its name; the caller renames it to the target, or unlinks it. */
int pliant_open_temporary(const char *target, char temporary[PATH_MAX]);

#endif
