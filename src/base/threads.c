#include "base/threads.h"

#include "base/fail.h"

#include <omp.h>
#include <stdio.h>

int pliant_threads_or_cores(int wanted) { return wanted > 0 ? wanted : omp_get_max_threads(); }

int pliant_threads_begin(int wanted)
{
    int before = omp_get_max_threads();
    omp_set_num_threads(pliant_threads_or_cores(wanted));
    return before;
}

void pliant_threads_end(int before) { omp_set_num_threads(before); }

pliant_status pliant_work_finish_item(pliant_work *work)
{
    int32_t now;
    bool wanted = true;
#pragma omp atomic capture
    now = ++work->done;
    if (now % work->interval == 0) {
#pragma omp critical(pliant_work_progress)
        wanted = pliant_report_progress(work->progress, work->begin + (work->end - work->begin) * now / work->count,
                                        work->stage);
    }
    return wanted ? PLIANT_OK : PLIANT_ERROR_CANCELLED;
}

void pliant_work_finish_thread(pliant_work *work, pliant_status status)
{
#pragma omp critical(pliant_work_worst)
    if (status < work->worst) {
        work->worst = status;
        snprintf(work->message, sizeof work->message, "%s", pliant_last_error());
    }
}

pliant_status pliant_work_result(const pliant_work *work)
{
    if (work->worst == PLIANT_OK) return PLIANT_OK;
    if (work->worst == PLIANT_ERROR_CANCELLED) return pliant_fail(work->worst, "%s was cancelled", work->what);
    return pliant_fail(work->worst, "%s", work->message);
}
