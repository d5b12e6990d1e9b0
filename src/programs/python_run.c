#define _POSIX_C_SOURCE 200809L
#include "python_run.h"

#include "programs/stop.h"

#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#ifdef __linux__
#include <sys/prctl.h>
#endif
#include <sys/wait.h>
#include <unistd.h>

int python_run(const char *const *words)
{
    pid_t child = fork();
    if (child == 0) {
        stop_signals_in_child();
#ifdef __linux__
        prctl(PR_SET_PDEATHSIG, SIGTERM); /* the script ends when the program ends */
#endif
        execvp(words[0], (char *const *)words);
        _exit(127);
    }
    int state = 0;
    if (child < 0 || waitpid(child, &state, 0) < 0 || !WIFEXITED(state)) return 127;
    return WEXITSTATUS(state);
}

const char *python_find(const char *packages)
{
    /* the first python3 on the path may lack the distribution's packages */
    static const char *const pythons[] = {"python3", "/usr/bin/python3"};
    char probe[256];
    snprintf(probe, sizeof probe, "import sys\ntry: import %s\nexcept ImportError: sys.exit(3)", packages);
    for (size_t p = 0; p < sizeof pythons / sizeof *pythons; p++) {
        const char *words[] = {pythons[p], "-c", probe, NULL};
        if (python_run(words) == 0) return pythons[p];
    }
    return NULL;
}
