/** @file status.h
 *  What every function of Pliant returns, and how it tells what went wrong.
 *
 *  Rule (CHOLMOD's): 0 done; negative failed and nothing changed; positive done, with a caveat.
 *  The library never prints, exits, aborts or throws: text goes to one log callback, and the message of
 *  the last failure of this thread is kept for whoever must show it to a person.
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

/** name, value, one-line meaning */
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
    X(PLIANT_ERROR_UNAVAILABLE, -8, "the backend or device asked for is not there")               \
    X(PLIANT_ERROR_CANCELLED, -9, "cancelled by the caller")

typedef enum pliant_status {
#define PLIANT_STATUS_ENUM(name, value, text) name = value,
    PLIANT_STATUS_LIST(PLIANT_STATUS_ENUM)
#undef PLIANT_STATUS_ENUM
} pliant_status;

/** One line in English for a status. Never NULL. */
PLIANT_API const char *pliant_status_text(pliant_status status);

/** Message of the last failure in the calling thread ("" when none). It names the file, the field and what
 *  would be right. Valid until this thread's next failing call. */
PLIANT_API const char *pliant_last_error(void);

typedef enum pliant_log_level { PLIANT_LOG_DEBUG, PLIANT_LOG_INFO, PLIANT_LOG_WARNING, PLIANT_LOG_ERROR } pliant_log_level;
typedef void (*pliant_log_function)(pliant_log_level level, const char *message, void *user);

/** The one log callback of the process. NULL (the default) drops messages. It may be called from any
 *  thread, one call at a time. */
PLIANT_API void pliant_set_log(pliant_log_function function, void *user);

/** Progress of long work. fraction is in [0, 1], stage a few words. Return false to cancel: the running
 *  call then ends with PLIANT_ERROR_CANCELLED and changes nothing. */
typedef bool (*pliant_progress_function)(double fraction, const char *stage, void *user);
typedef struct pliant_progress {
    pliant_progress_function function; /**< Nullable: no progress wanted */
    void *user;
} pliant_progress;

#ifdef __cplusplus
}
#endif
#endif
