/* Account the memory that is allocated for a simulation to that simulation. */
#ifndef PLIANT_SIM_ACCOUNTING_H
#define PLIANT_SIM_ACCOUNTING_H

#include "model_data/data.h"

/* Begin and end the accounting. The end needs the value that the begin returned. */
static inline pliant_account *pliant_accounting_begin(const pliant_data *data)
{
    return pliant_account_use(data->account);
}
static inline void pliant_accounting_end(pliant_data *data, pliant_account *before)
{
    data->statistics.bytes = pliant_account_bytes(data->account);
    pliant_account_use(before);
}

/* As pliant_data_create, with an account that the simulation shares. */
pliant_status pliant_data_create_for(const pliant_model *model, pliant_account *account, pliant_data **out);

#endif
