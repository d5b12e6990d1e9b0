/** @file fail.h
 *  How functions of Pliant report, for whoever adds one: a message is kept for the thread and sent to the log callback.
 */
#ifndef PLIANT_FAIL_H
#define PLIANT_FAIL_H

#include "pliant/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#define PLIANT_PRINTF(text, first) __attribute__((format(printf, text, first)))
#else
#define PLIANT_PRINTF(text, first)
#endif

/** Keep the message for pliant_last_error, log it as an error (CANCELLED: for debugging), return the status. Arguments as of printf. */
PLIANT_API pliant_status pliant_fail(pliant_status status, const char *format, ...) PLIANT_PRINTF(2, 3);

/** PLIANT_ERROR_MEMORY, with a message that names what was wanted. */
PLIANT_API pliant_status pliant_fail_memory(const char *what);

/** A line for the log callback. Arguments as of printf. */
PLIANT_API void pliant_log(pliant_log_level level, const char *format, ...) PLIANT_PRINTF(2, 3);

/** Report progress. True: go on, as always where there is no function; false: the caller has cancelled. */
PLIANT_API bool pliant_report_progress(pliant_progress progress, double fraction, const char *stage);

#ifdef __cplusplus
}
#endif
#endif
