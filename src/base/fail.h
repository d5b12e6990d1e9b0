/* How the library reports; public, so that programs and other libraries report alike. */
#ifndef PLIANT_BASE_FAIL_H
#define PLIANT_BASE_FAIL_H

#include "pliant/fail.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Of the calling thread: from now on NUMERIC goes to the log for debugging alone, since the caller has another way. */
void pliant_fail_quietly(bool quiet);

#ifdef __cplusplus
}
#endif

#endif
