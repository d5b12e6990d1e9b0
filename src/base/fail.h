/* How the library reports; public, so that programs and other libraries report alike. */
#ifndef PLIANT_BASE_FAIL_H
#define PLIANT_BASE_FAIL_H

#include "pliant/fail.h"

#endif
