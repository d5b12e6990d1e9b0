/* Error reporting of the library: each thread keeps its last message, and the log callback receives it. */
#ifndef PLIANT_BASE_FAIL_H
#define PLIANT_BASE_FAIL_H

#include "base/export.h"
#include "pliant/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#define PLIANT_PRINTF(text, first) __attribute__((format(printf, text, first)))
#else
#define PLIANT_PRINTF(text, first)
#endif

/* Keep the message for pliant_last_error, log it as an error (CANCELLED: at debug level), and return the status.
 * Arguments as of printf. */
PLIANT_INTERNAL pliant_status pliant_fail(pliant_status status, const char *format, ...) PLIANT_PRINTF(2, 3);

/* Return PLIANT_ERROR_MEMORY, with a message that names the missing object. */
PLIANT_INTERNAL pliant_status pliant_fail_memory(const char *what);

/* Send a line to the log callback. Arguments as of printf. */
PLIANT_INTERNAL void pliant_log(pliant_log_level level, const char *format, ...) PLIANT_PRINTF(2, 3);

/* Report progress. Return false if the caller has cancelled; true without a progress callback. */
PLIANT_INTERNAL bool pliant_report_progress(pliant_progress progress, double fraction, const char *stage);

/* For the calling thread: log NUMERIC errors at debug level only, because the caller handles them. */
void pliant_fail_quietly(bool quiet);

#ifdef __cplusplus
}
#endif
#endif
