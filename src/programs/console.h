/* What a command-line program shows: log lines and progress on stderr, and whether Ctrl-C was pressed. */
#ifndef PLIANT_TOOLS_CONSOLE_H
#define PLIANT_TOOLS_CONSOLE_H

#include "pliant/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Log lines from `quietest` up go to stderr; Ctrl-C and SIGTERM ask the program to stop, which takes a second at most (stop.h).
 * Above INFO nothing goes to stdout from here on. */
void console_start(pliant_log_level quietest);

bool console_stop_asked(void);

/* Progress to stderr: one line that is rewritten on a terminal, a line a stage and quarter elsewhere. Cancels when a stop is asked. */
pliant_progress console_progress(void);

/* Ends the line of the progress, if there is one. */
void console_progress_end(void);

#ifdef __cplusplus
}
#endif
#endif
