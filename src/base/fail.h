/* How the library reports: one line per failure, kept for the thread and sent to the log callback. */
#ifndef PLIANT_BASE_FAIL_H
#define PLIANT_BASE_FAIL_H

#include "pliant/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#define PLIANT_PRINTF(a, b) __attribute__((format(printf, a, b)))
#else
#define PLIANT_PRINTF(a, b)
#endif

/* keep the message, log it as an error (CANCELLED: for debugging), return the status */
pliant_status pliant_fail(pliant_status status, const char *format, ...) PLIANT_PRINTF(2, 3);

/* PLIANT_ERROR_MEMORY, naming what was wanted */
pliant_status pliant_fail_memory(const char *what);

void pliant_log(pliant_log_level level, const char *format, ...) PLIANT_PRINTF(2, 3);

/* true: go on; a NULL function always goes on */
bool pliant_report_progress(pliant_progress progress, double fraction, const char *stage);

#ifdef __cplusplus
}
#endif
#endif
