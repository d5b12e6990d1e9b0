/* Number of entries of an X-macro list. Static assertions compare it with tables, switches and messages that have one
 * entry for each, so that a new entry does not compile until all of them have it. */
#ifndef PLIANT_BASE_COUNT_H
#define PLIANT_BASE_COUNT_H

#include <assert.h>

#define PLIANT_COUNT_ONE(...) +1
#define PLIANT_COUNT_OF(list) (0 list(PLIANT_COUNT_ONE))

#endif
