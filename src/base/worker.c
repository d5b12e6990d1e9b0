#include "base/worker.h"

#include "base/buffer.h"

#include <errno.h>
#include <sched.h>
#include <sys/resource.h>

/* Lower the priority of the calling thread. */
static void lower_priority(void)
{
#ifdef __linux__
    const int nicer = 5; /* a higher value would delay background work on a busy machine until steps wait for it */
    const struct sched_param none = {0};
    pthread_setschedparam(pthread_self(), SCHED_OTHER, &none); /* leaves a real-time class of the caller */
    errno = 0;
    int before = getpriority(PRIO_PROCESS, 0); /* applies to the calling thread on Linux */
    if (before != -1 || errno == 0) setpriority(PRIO_PROCESS, 0, before + nicer < 19 ? before + nicer : 19);
#endif
}

static void *run(void *argument)
{
    pliant_worker *worker = argument;
    lower_priority();
    pliant_memory_set_background();
    pliant_account_use(worker->account);
    worker->work(worker->argument);
    __atomic_store_n(&worker->finished, true, __ATOMIC_SEQ_CST);
    return NULL;
}

void pliant_worker_start(pliant_worker *worker, void (*work)(void *argument), void *argument)
{
    *worker = (pliant_worker){.account = pliant_account_in_use(), .work = work, .argument = argument};
    worker->has_thread = pthread_create(&worker->thread, NULL, run, worker) == 0;
    if (worker->has_thread) return;
    work(argument);
    worker->finished = true;
}

bool pliant_worker_has_finished(const pliant_worker *worker)
{
    return __atomic_load_n(&worker->finished, __ATOMIC_SEQ_CST);
}

void pliant_worker_join(pliant_worker *worker)
{
    if (worker->has_thread) pthread_join(worker->thread, NULL);
    worker->has_thread = false;
}
