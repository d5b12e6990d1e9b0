/* How many threads work, and what they met while they did. */
#ifndef PLIANT_BASE_THREADS_H
#define PLIANT_BASE_THREADS_H

#include "pliant/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* As many as are wanted; 0: as many as the machine has cores. */
int pliant_threads_of(int wanted);

/* Loops that are told of no number, as those over a scan's voxels, run on that many in between. Of the calling thread
 * alone. begin returns what end is to bring back. */
int pliant_threads_begin(int wanted);
void pliant_threads_end(int before);

/* By a thread that works ahead of a step: from now on it lets those go first that the step waits for. */
void pliant_threads_step_back(void);

/* Pieces of work that threads take one after the other: how many are done, and the worst that any thread met. */
typedef struct pliant_work {
    const char *what;          /* for the message of a cancelled one */
    const char *stage;
    pliant_progress progress;
    double begin, end;         /* of the stage, in fractions of it */
    int32_t count, interval;   /* pieces; between two reports */
    int32_t done;
    pliant_status worst;
    char message[512];         /* belongs to the thread that met it: kept here, so that another can hand it on */
} pliant_work;

/* By any thread: one more piece is done. CANCELLED: no more are wanted. */
pliant_status pliant_work_done(pliant_work *work);
/* By every thread, after its last piece. */
void pliant_work_leave(pliant_work *work, pliant_status status);
/* By the thread that waited for them all. */
pliant_status pliant_work_outcome(const pliant_work *work);

#ifdef __cplusplus
}
#endif
#endif
