#define _POSIX_C_SOURCE 200809L
#include "report_plot.h"

#include "pliant/fail.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

/* Exit code of a program; 127 when there is none of this name. */
static int run(const char *const *words)
{
    pid_t child = fork();
    if (child == 0) {
        execvp(words[0], (char *const *)words);
        _exit(127);
    }
    int state = 0;
    if (child < 0 || waitpid(child, &state, 0) < 0 || !WIFEXITED(state)) return 127;
    return WEXITSTATUS(state);
}

pliant_status report_plot(const char *folder, const char *setup, bool *drawn)
{
    /* another python3 may come first on the path than the one that the distribution's matplotlib belongs to */
    static const char *const pythons[] = {"python3", "/usr/bin/python3"};
    char path[4096];
    *drawn = false;
    snprintf(path, sizeof path, "%s/plot.py", folder);
    FILE *file = fopen(path, "w");
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    bool failed = fwrite(report_plot_script, 1, report_plot_script_size, file) != report_plot_script_size;
    failed |= fclose(file) != 0;
    if (failed) return pliant_fail(PLIANT_ERROR_FILE, "%s was not written whole: %s", path, strerror(errno));
    for (size_t p = 0; p < sizeof pythons / sizeof *pythons; p++) {
        const char *probe[] = {pythons[p], "-c", "import sys\ntry: import matplotlib\nexcept ImportError: sys.exit(3)", NULL};
        const char *draw[] = {pythons[p], path, folder, setup, NULL};
        if (run(probe) != 0) continue;
        *drawn = run(draw) == 0;
        if (!*drawn) pliant_log(PLIANT_LOG_WARNING, "%s failed: no pictures, or not all", path);
        return PLIANT_OK;
    }
    pliant_log(PLIANT_LOG_WARNING, "no pictures: python3 with matplotlib was not found (Debian, Ubuntu: python3-matplotlib). Install it and "
                                   "run: python3 %s %s %s", path, folder, setup);
    return PLIANT_OK;
}
