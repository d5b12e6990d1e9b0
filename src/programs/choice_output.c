#include "choice_output.h"

#include "command_line.h"
#include "console.h"
#include "base/fail.h"
#include "report/report.h"
#include "report_plot.h"

#include <stdio.h>

static pliant_status write(const pliant_report_input *input, const char *folder, bool pictures,
                           const pliant_report_tables *tables)
{
    char path[4096];
    bool drawn;
    if (snprintf(path, sizeof path, "%s/choice", folder) >= (int)sizeof path)
        return pliant_fail(PLIANT_ERROR_FILE, "%s: the name is too long", folder);
    pliant_status status = command_line_folder(path);
    if (status >= 0) status = pliant_report_write(path, tables);
    const char *setup = pliant_results_cell(tables->choice, 0, 0);
    if (status >= 0) status = pliant_report_json(path, setup, input->scene, tables);
    return status >= 0 && pictures ? report_plot(path, setup, &drawn) : status;
}

pliant_status choice_output(const pliant_report_input *input, const char *folder, bool pictures, pliant_choice *out)
{
    pliant_report_tables tables = {0};
    pliant_choice choice;
    pliant_status status = pliant_report_open(NULL, &tables);
    if (status >= 0) status = pliant_choose(input, &tables, console_progress(), &choice);
    console_progress_end();
    if (status >= 0 && choice.made) {
        printf(
            "chosen: %s\nerrors on the probe load, worst frame, in %% of the largest displacement: max %.3g, p95 %.3g, "
            "rms %.3g; by choose/measure, from when patches are there and the tissue has sagged: %.3g; "
            "a step takes %.3g ms\n",
            choice.options, 100 * choice.max, 100 * choice.p95, 100 * choice.rms, 100 * choice.settled_error,
            1e3 * choice.seconds);
        status = write(input, folder, pictures, &tables);
    }
    pliant_report_close(&tables);
    if (status >= 0) *out = choice;
    return status;
}
