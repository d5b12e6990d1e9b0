/* The end of a program that is asked to stop while it computes or reads. */
#ifndef PLIANT_TOOLS_STOP_H
#define PLIANT_TOOLS_STOP_H

#ifdef __cplusplus
extern "C" {
#endif

/* Call the function once on SIGINT or SIGTERM, from a thread of its own. If the program still runs after 0.7 s, or at a second signal, end it with
 * EXIT_STOPPED: a factor or a file cannot be left in between. To be called before any other thread begins: all of them then block these signals,
 * since METIS sets a handler for SIGTERM while it orders a matrix, and the signal would be lost there. */
void stop_on_signals(void (*asked)(int number));

/* After fork: let the child receive these signals. */
void stop_signals_in_child(void);

#ifdef __cplusplus
}
#endif
#endif
