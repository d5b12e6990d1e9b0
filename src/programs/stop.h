/* Stop a program on request while it computes or reads. */
#ifndef PLIANT_TOOLS_STOP_H
#define PLIANT_TOOLS_STOP_H

#ifdef __cplusplus
extern "C" {
#endif

/* Call a function once on SIGINT or SIGTERM, from a separate thread. If the program still runs after 0.7 s, or at a
 * second signal, it exits with EXIT_STOPPED, because a factorization or a file read cannot be interrupted. Call this
 * before any other thread starts, so that all threads block these signals. METIS installs a handler for SIGTERM while
 * it orders a matrix, and would lose the signal. */
void stop_on_signals(void (*handler)(int number));

/* Unblock these signals in a child process after fork. */
void stop_signals_in_child(void);

#ifdef __cplusplus
}
#endif
#endif
