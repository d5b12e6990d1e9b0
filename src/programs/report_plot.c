#include "report_plot.h"

#include "base/fail.h"
#include "python_run.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

pliant_status report_plot(const char *folder, const char *setup, bool *drawn)
{
    char path[4096];
    *drawn = false;
    snprintf(path, sizeof path, "%s/plot.py", folder);
    FILE *file = fopen(path, "w");
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    bool failed = fwrite(report_plot_script, 1, report_plot_script_size, file) != report_plot_script_size;
    failed |= fclose(file) != 0;
    if (failed) return pliant_fail(PLIANT_ERROR_FILE, "%s could not be written completely: %s", path, strerror(errno));
    const char *python = python_find("matplotlib");
    if (python) {
        const char *draw[] = {python, path, folder, setup, NULL};
        *drawn = python_run(draw) == 0;
        if (!*drawn) pliant_log(PLIANT_LOG_WARNING, "%s failed: pictures are missing", path);
        return PLIANT_OK;
    }
    pliant_log(
        PLIANT_LOG_WARNING,
        "no pictures: python3 with matplotlib was not found (Debian, Ubuntu: python3-matplotlib). Install it and "
        "run: python3 %s %s %s",
        path, folder, setup);
    return PLIANT_OK;
}
