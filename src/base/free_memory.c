/* Free memory of the machine and, if present, of the container. */
#include "base/free_memory.h"

#include "base/fail.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { SMALL = 64 << 20 }; /* bytes that are not checked */

/* Return the number after a name at the start of a line. Return -1 if there is no such file, line or number ("max"). */
static double number_after(const char *path, const char *name)
{
    FILE *file = fopen(path, "r");
    char line[256];
    double number = -1.0;
    size_t length = strlen(name);
    if (!file) return number;
    while (fgets(line, sizeof line, file))
        if (strncmp(line, name, length) == 0 && sscanf(line + length, "%lf", &number) == 1) break;
    fclose(file);
    return number;
}

double pliant_free_memory(void)
{
    double available = number_after("/proc/meminfo", "MemAvailable:");
    available = available < 0.0 ? HUGE_VAL : 1024.0 * available; /* the kernel reports kB */
    double limit = number_after("/sys/fs/cgroup/memory.max", ""),
           used = number_after("/sys/fs/cgroup/memory.current", "");
    if (limit < 0.0 || used < 0.0) return available;
    /* The container's file cache is released on demand. */
    double cache = number_after("/sys/fs/cgroup/memory.stat", "inactive_file ");
    return fmin(available, fmax(limit - used + fmax(cache, 0.0), 0.0));
}

pliant_status pliant_memory_check(double bytes, const char *what)
{
    if (bytes < SMALL) return PLIANT_OK;
    double available = pliant_free_memory();
    if (bytes <= available) return PLIANT_OK;
    return pliant_fail(PLIANT_ERROR_MEMORY, "%s: %.0f MB are needed, the machine has free %.0f MB", what, bytes / 1e6,
                       available / 1e6);
}
