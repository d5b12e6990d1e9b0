/* A thread that prepares later steps, with a lower priority than the threads of the present step. */
#ifndef PLIANT_BASE_WORKER_H
#define PLIANT_BASE_WORKER_H

#include "base/account.h"

#include <pthread.h>
#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_worker {
    pthread_t thread;
    bool has_thread; /* the thread was not joined yet */
    bool finished;   /* atomic */
    pliant_account *account;
    void (*work)(void *argument);
    void *argument;
} pliant_worker;

/* Start the work. Its memory counts for the caller's account. If no thread can be created, the caller does the work. */
void pliant_worker_start(pliant_worker *worker, void (*work)(void *argument), void *argument);
bool pliant_worker_has_finished(const pliant_worker *worker);
/* Wait until the work has finished, if it was started. */
void pliant_worker_join(pliant_worker *worker);

#ifdef __cplusplus
}
#endif
#endif
