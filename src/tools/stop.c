#define _POSIX_C_SOURCE 200809L
#include "stop.h"

#include "command_line.h" /* EXIT_STOPPED */

#include <signal.h>
#include <string.h>
#include <sys/time.h>
#include <unistd.h>

static void (*told)(int number);

static void end(int number)
{
    (void)number;
    _exit(EXIT_STOPPED);
}

static void begin_to_stop(int number)
{
    const struct itimerval left = {.it_value = {.tv_usec = 800000}};
    told(number);
    setitimer(ITIMER_REAL, &left, NULL);
}

static void handle(int number, void (*handler)(int), int flags)
{
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = handler;
    action.sa_flags = flags;
    sigaction(number, &action, NULL);
}

void stop_on_signals(void (*asked)(int number))
{
    told = asked;
    handle(SIGALRM, end, 0);
    handle(SIGINT, begin_to_stop, (int)SA_RESETHAND);
    handle(SIGTERM, begin_to_stop, (int)SA_RESETHAND);
}
