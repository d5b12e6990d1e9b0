/* Writes a file in the folder of its target and renames it. */
#include "base/replace.h"

#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

int pliant_open_temporary(const char *target, char temporary[PATH_MAX])
{
    static atomic_uint counter;
    const char *slash = strrchr(target, '/');
    int folder = slash ? (int)(slash - target) + 1 : 0;
    for (int attempt = 0; attempt < 100; attempt++) {
        int length = snprintf(temporary, PATH_MAX, "%.*s.pliant-%ld-%u.tmp", folder, target, (long)getpid(),
                              atomic_fetch_add(&counter, 1));
        if (length >= PATH_MAX) {
            errno = ENAMETOOLONG;
            return -1;
        }
        int file = open(temporary, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        if (file >= 0 || errno != EEXIST) return file;
    }
    return -1;
}
