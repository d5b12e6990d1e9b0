#define _GNU_SOURCE /* O_PATH */
#include "base/open.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

static _Thread_local pliant_open_check thread_check;

pliant_open_check pliant_set_open_check(pliant_open_check check)
{
    pliant_open_check before = thread_check;
    thread_check = check;
    return before;
}

/* Obtain a descriptor without opening the file, which has no effect on devices and pipes. */
static int hold(const char *path, char link[32])
{
    int descriptor = open(path, O_PATH | O_CLOEXEC);
    if (descriptor >= 0) snprintf(link, 32, "/proc/self/fd/%d", descriptor);
    return descriptor;
}

static const char *call_check(const char *link)
{
    char real[PATH_MAX];
    ssize_t length = readlink(link, real, sizeof real);
    if (length < 0 || length >= (ssize_t)sizeof real) return "its real path is not known";
    real[length] = 0;
    return thread_check.function(real, thread_check.user);
}

/* Check the nearest existing folder for a missing file. An error message then reveals nothing about folders that may
 * not be read. */
static const char *check_folder(const char *path)
{
    char folder[PATH_MAX], link[32];
    if (snprintf(folder, sizeof folder, "%s%s", path[0] == '/' ? "" : "./", path) >= (int)sizeof folder)
        return "its name is too long";
    int descriptor = -1;
    while (descriptor < 0) {
        char *slash = strrchr(folder, '/');
        if (!slash) return "its folder is not there";
        *slash = 0;
        descriptor = hold(folder[0] ? folder : "/", link);
    }
    const char *refused = call_check(link);
    close(descriptor);
    return refused;
}

bool pliant_opening_begin(const char *path, pliant_opening *opening)
{
    *opening = (pliant_opening){.name = path, .descriptor = -1};
    if (!thread_check.function) return true;
    opening->descriptor = hold(path, opening->link);
    if (opening->descriptor < 0) {
        int why = errno;
        opening->refused = check_folder(path);
        errno = why;
        return false;
    }
    opening->name = opening->link;
    opening->refused = call_check(opening->link);
    if (!opening->refused) return true;
    pliant_opening_end(opening);
    return false;
}

void pliant_opening_end(pliant_opening *opening)
{
    int why = errno;
    if (opening->descriptor >= 0) close(opening->descriptor);
    opening->descriptor = -1;
    errno = why;
}
