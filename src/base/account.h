/* Memory accounting. A block counts for the account that its allocating thread has in use, until it is freed by any
 * thread. The memory of a simulation is thus separated from other allocations. */
#ifndef PLIANT_BASE_ACCOUNT_H
#define PLIANT_BASE_ACCOUNT_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_account pliant_account;

/* Open an account. It exists until it is closed by all holders and its last block is freed. NULL: out of memory. */
pliant_account *pliant_account_open(void);
/* Add a holder to an account. Nullable */
pliant_account *pliant_account_retain(pliant_account *of);
void pliant_account_close(pliant_account *of); /* Nullable */
/* Use an account for the calling thread's allocations. NULL, the initial state: no account. Return the previous
 * account. */
pliant_account *pliant_account_use(pliant_account *of);
pliant_account *pliant_account_in_use(void); /* account of the calling thread, to pass on to a worker thread */
size_t pliant_account_bytes(const pliant_account *of); /* 0 for NULL */

#ifdef __cplusplus
}
#endif
#endif
