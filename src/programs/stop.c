#define _POSIX_C_SOURCE 200809L
#include "programs/stop.h"

#include "programs/command_line.h" /* EXIT_STOPPED */

#include <pthread.h>
#include <signal.h>
#include <stddef.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

static void (*stop_handler)(int number);

static sigset_t signals_of_stop(void)
{
    sigset_t set;
    sigemptyset(&set);
    sigaddset(&set, SIGINT);
    sigaddset(&set, SIGTERM);
    return set;
}

static void *wait_for_signals(void *unused)
{
    const sigset_t set = signals_of_stop();
    const struct timespec left = {.tv_nsec = 700000000};
    int number;
    while (sigwait(&set, &number) != 0) {}
    stop_handler(number);
    sigtimedwait(&set, NULL, &left); /* returns early on a second signal */
    _exit(EXIT_STOPPED);
    return unused;
}

/* End the threads that OpenBLAS starts before main, which would receive the signals. OpenBLAS ends its threads at a
 * fork; threads that it starts later inherit the signal mask. */
static void end_early_threads(void)
{
    const pid_t child = fork();
    if (child == 0) _exit(0);
    if (child > 0) waitpid(child, NULL, 0);
}

void stop_on_signals(void (*handler)(int number))
{
    const sigset_t set = signals_of_stop();
    pthread_t thread;
    stop_handler = handler;
    if (pthread_sigmask(SIG_BLOCK, &set, NULL) != 0) return;
    end_early_threads();
    if (pthread_create(&thread, NULL, wait_for_signals, NULL) == 0) pthread_detach(thread);
    else pthread_sigmask(SIG_UNBLOCK, &set, NULL); /* the default action of the signals ends the program */
}

void stop_signals_in_child(void)
{
    const sigset_t set = signals_of_stop();
    sigprocmask(SIG_UNBLOCK, &set, NULL);
}
