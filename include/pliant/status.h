/** @file status.h
 *  Status codes, error messages, the log and progress.
 *
 *  Every function that can fail returns pliant_status, with CHOLMOD's sign rule: 0 is success. A negative status is an
 *  error, and nothing has changed. A positive status is success with a warning. The library never prints, exits, aborts
 *  or throws. Text goes to one log callback, and each thread keeps the message of its last error.
 */
#ifndef PLIANT_STATUS_H
#define PLIANT_STATUS_H

#include "pliant/version.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** X(name, value, meaning) */
#define PLIANT_STATUS_LIST(X)                                                                     \
    X(PLIANT_NOT_CONVERGED, 1, "the error is above the tolerance; the best state so far is kept") \
    X(PLIANT_OK, 0, "done")                                                                       \
    X(PLIANT_ERROR_ARGUMENT, -1, "an argument is out of its range")                               \
    X(PLIANT_ERROR_MEMORY, -2, "out of memory")                                                   \
    X(PLIANT_ERROR_FILE, -3, "a file cannot be opened, read or written")                          \
    X(PLIANT_ERROR_FORMAT, -4, "a file holds something that is not supported or not consistent")  \
    X(PLIANT_ERROR_SCENE, -5, "the scene asks for something that cannot be built")                \
    X(PLIANT_ERROR_MATERIAL, -6, "a label or intensity has no material")                          \
    X(PLIANT_ERROR_NUMERIC, -7, "the computation broke down; the last good state is kept")        \
    X(PLIANT_ERROR_UNAVAILABLE, -8, "the requested backend or device is not available")           \
    X(PLIANT_ERROR_CANCELLED, -9, "cancelled by the caller")

/** Result of a call. Documentation writes MEMORY for PLIANT_ERROR_MEMORY, and so on. */
typedef enum pliant_status {
#define PLIANT_STATUS_ENUM(name, value, text) name = value,
    PLIANT_STATUS_LIST(PLIANT_STATUS_ENUM)
#undef PLIANT_STATUS_ENUM
} pliant_status;

/** Return the meaning of a status as one line in English.
 *  @param status Any number.
 *  @return Static text, never NULL. */
PLIANT_API const char *pliant_status_text(pliant_status status);

/** Return the message of the last error in the calling thread. It names the file, the field, the value and the remedy.
 *  @return Text, "" if no call has failed. Valid until the next failing call of this thread. */
PLIANT_API const char *pliant_last_error(void);

/** Severity of a log message. */
typedef enum pliant_log_level {
    PLIANT_LOG_DEBUG,
    PLIANT_LOG_INFO,
    PLIANT_LOG_WARNING,
    PLIANT_LOG_ERROR
} pliant_log_level;
/** Receiver of log messages. The message is valid during the call. */
typedef void (*pliant_log_function)(pliant_log_level level, const char *message, void *user);

/** Set the log callback of the process. It may be called from any thread, by one thread at a time.
 *  @param function NULL (the default) drops all messages.
 *  @param user     Passed to every call; borrowed until another callback is set. */
PLIANT_API void pliant_set_log(pliant_log_function function, void *user);

/** Receiver of progress of a long call. fraction is in [0, 1]. Return false to cancel: the call then ends with
 *  CANCELLED and changes nothing. */
typedef bool (*pliant_progress_function)(double fraction, const char *stage, void *user);
/** Progress callback of a long call. */
typedef struct pliant_progress {
    pliant_progress_function function; /**< Nullable: no progress is reported */
    void *user;                        /**< passed to every call */
} pliant_progress;

#ifdef __cplusplus
}
#endif
#endif
