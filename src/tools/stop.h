/* The end of a program that is asked to stop while it computes or reads. */
#ifndef PLIANT_TOOLS_STOP_H
#define PLIANT_TOOLS_STOP_H

#ifdef __cplusplus
extern "C" {
#endif

/* Call the function on SIGINT and SIGTERM; it only sets flags. If the program still runs after 0.8 s, end it with EXIT_STOPPED: a factor or a
 * file cannot be left in between. A second signal ends the program at once. */
void stop_on_signals(void (*asked)(int number));

#ifdef __cplusplus
}
#endif
#endif
