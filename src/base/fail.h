/* Error reporting of the library; public, so that programs and other libraries report in the same way. */
#ifndef PLIANT_BASE_FAIL_H
#define PLIANT_BASE_FAIL_H

#include "pliant/fail.h"

#ifdef __cplusplus
extern "C" {
#endif

/* For the calling thread: log NUMERIC errors at debug level only, because the caller handles them. */
void pliant_fail_quietly(bool quiet);

#ifdef __cplusplus
}
#endif

#endif
