#define _POSIX_C_SOURCE 200809L
#include "console.h"

#include "programs/stop.h"

#include <assert.h>
#include <signal.h> /* sig_atomic_t */
#include <stdio.h>
#include <string.h>
#include <unistd.h>

static volatile sig_atomic_t stop_requested;
static pliant_log_level lowest;
static bool terminal, line_open;
static char last_stage[64];
static int last_percent;

static void request_stop(int number)
{
    (void)number;
    stop_requested = 1;
}

static void print_log(pliant_log_level level, const char *message, void *user)
{
    static const char *const names[] = {"debug", "info", "warning", "error"};
    static_assert(sizeof names / sizeof *names == PLIANT_LOG_ERROR + 1, "each level has a name");
    (void)user;
    if (level < lowest) return;
    console_progress_end();
    if (level == PLIANT_LOG_INFO)
        fprintf(stderr, "%s\n", message);
    else
        fprintf(stderr, "%s: %s\n", names[level], message);
}

void console_start(pliant_log_level quietest)
{
    stop_on_signals(request_stop);
    lowest = quietest;
    if (quietest > PLIANT_LOG_INFO && !freopen("/dev/null", "w", stdout))
        fputs("/dev/null cannot be opened: tables are printed\n", stderr);
    terminal = isatty(STDERR_FILENO);
    pliant_set_log(print_log, NULL);
}

bool console_stop_requested(void) { return stop_requested != 0; }

static bool show_progress(double fraction, const char *stage, void *user)
{
    int percent = (int)(100.0 * fraction + 0.5);
    bool new_stage = strncmp(stage, last_stage, sizeof last_stage - 1) != 0;
    (void)user;
    if (lowest <= PLIANT_LOG_INFO && (new_stage || percent >= last_percent + (terminal ? 1 : 25))) {
        fprintf(stderr, terminal ? "\r%3d %% %-50s" : "%3d %% %s\n", percent, stage);
        fflush(stderr);
        line_open = terminal;
        last_percent = percent;
        snprintf(last_stage, sizeof last_stage, "%s", stage);
    }
    return !stop_requested;
}

pliant_progress console_progress(void)
{
    pliant_progress progress = {show_progress, NULL};
    return progress;
}

void console_progress_end(void)
{
    if (line_open) fputc('\n', stderr);
    line_open = false;
    last_stage[0] = '\0';
}
