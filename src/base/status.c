#include "base/fail.h"
#include "base/clock.h"

#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

enum { MESSAGE_SIZE = 2048 };

static _Thread_local char last_error[MESSAGE_SIZE];
static _Thread_local bool quietly;

static pthread_mutex_t log_lock = PTHREAD_MUTEX_INITIALIZER;
static pliant_log_function log_function;
static void *log_user;

const char *pliant_version(void) { return PLIANT_VERSION; }

const char *pliant_status_text(pliant_status status)
{
    switch (status) {
#define STATUS_CASE(name, value, text) \
    case name: return text;
        PLIANT_STATUS_LIST(STATUS_CASE)
#undef STATUS_CASE
    }
    return "unknown status";
}

const char *pliant_last_error(void) { return last_error; }

void pliant_set_log(pliant_log_function function, void *user)
{
    pthread_mutex_lock(&log_lock);
    log_function = function;
    log_user = user;
    pthread_mutex_unlock(&log_lock);
}

static void send(pliant_log_level level, const char *message)
{
    pthread_mutex_lock(&log_lock);
    if (log_function) log_function(level, message, log_user);
    pthread_mutex_unlock(&log_lock);
}

void pliant_fail_quietly(bool quiet) { quietly = quiet; }

pliant_status pliant_fail(pliant_status status, const char *format, ...)
{
    /* Use a buffer, since an argument may be the last error itself. */
    char message[MESSAGE_SIZE];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    memcpy(last_error, message, sizeof message);
    /* The caller has requested the cancellation, or handles the error itself. */
    bool known = status == PLIANT_ERROR_CANCELLED ||
                 (quietly && (status == PLIANT_ERROR_NUMERIC || status == PLIANT_ERROR_SCENE));
    send(known ? PLIANT_LOG_DEBUG : PLIANT_LOG_ERROR, message);
    return status;
}

pliant_status pliant_fail_memory(const char *what)
{
    return pliant_fail(PLIANT_ERROR_MEMORY, "out of memory for %s", what);
}

void pliant_log(pliant_log_level level, const char *format, ...)
{
    char message[MESSAGE_SIZE];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    send(level, message);
}

bool pliant_report_progress(pliant_progress progress, double fraction, const char *stage)
{
    return !progress.function || progress.function(fraction, stage, progress.user);
}

double pliant_seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}
