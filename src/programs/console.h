/* Console output of a command-line program: log lines and progress on stderr, and the stop request by Ctrl-C. */
#ifndef PLIANT_TOOLS_CONSOLE_H
#define PLIANT_TOOLS_CONSOLE_H

#include "pliant/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Write log lines from level `quietest` up to stderr. Ctrl-C and SIGTERM request a stop, which takes at most one second
 * (stop.h). With a level above INFO nothing is written to stdout. */
void console_start(pliant_log_level quietest);

bool console_stop_requested(void);

/* Return a callback that writes progress to stderr: one updated line on a terminal, otherwise one line per stage and
 * quarter. It cancels after a stop request. */
pliant_progress console_progress(void);

/* End the progress line, if there is one. */
void console_progress_end(void);

#ifdef __cplusplus
}
#endif
#endif
