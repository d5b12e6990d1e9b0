/* Number of threads, and their common progress and errors. */
#ifndef PLIANT_BASE_THREADS_H
#define PLIANT_BASE_THREADS_H

#include "pliant/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Return the requested number of threads; 0: the number of cores. */
int pliant_threads_or_cores(int wanted);

/* Set the number of threads for parallel loops without an explicit number, such as loops over voxels. It affects the
 * calling thread. begin returns the number that end restores. */
int pliant_threads_begin(int wanted);
void pliant_threads_end(int before);

/* Work items that threads take one after the other: number of finished items, and the worst error of any thread. */
typedef struct pliant_work {
    const char *what;          /* for the message of a cancellation */
    const char *stage;
    pliant_progress progress;
    double begin, end;         /* range of this work in the stage, as fractions */
    int32_t count, interval;   /* number of items, and items between two reports */
    int32_t done;
    pliant_status worst;
    char message[512];         /* message of the thread with the error, stored here for another thread */
} pliant_work;

/* Record a finished item, from any thread. Return CANCELLED if the work shall stop. */
pliant_status pliant_work_finish_item(pliant_work *work);
/* Call this from every thread after its last item. */
void pliant_work_finish_thread(pliant_work *work, pliant_status status);
/* Return the result, in the thread that has waited for all others. */
pliant_status pliant_work_result(const pliant_work *work);

#ifdef __cplusplus
}
#endif
#endif
