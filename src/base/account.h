/* Whose memory it is: a block counts for the account that the thread which asks for it has in use, until it is freed,
 * whoever frees it. So what a simulation holds is told apart from what others take and give back meanwhile. */
#ifndef PLIANT_BASE_ACCOUNT_H
#define PLIANT_BASE_ACCOUNT_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_account pliant_account;

/* An account of itself alone; it stays until who has opened it, who shares it and the last of its blocks are gone.
 * NULL: out of memory. */
pliant_account *pliant_account_open(void);
/* One more holder of an account, Nullable. */
pliant_account *pliant_account_share(pliant_account *of);
void pliant_account_close(pliant_account *of); /* Nullable */
/* From now on the calling thread asks for that one; NULL, as at first: for none. Returns the one before. */
pliant_account *pliant_account_use(pliant_account *of);
pliant_account *pliant_account_in_use(void); /* of the calling thread, for one that works for it */
size_t pliant_account_bytes(const pliant_account *of); /* 0: NULL */

#ifdef __cplusplus
}
#endif
#endif
