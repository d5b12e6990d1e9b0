/* What is made for a simulation counts as its own. */
#ifndef PLIANT_SIM_HELD_H
#define PLIANT_SIM_HELD_H

#include "state/data.h"

/* Who begins hands what begin returned to the end. */
static inline pliant_account *pliant_held_begin(const pliant_data *data) { return pliant_account_use(data->account); }
static inline void pliant_held_end(pliant_data *data, pliant_account *before)
{
    data->statistics.bytes = pliant_account_bytes(data->account);
    pliant_account_use(before);
}

/* pliant_data_create, for an account, which it shares */
pliant_status pliant_data_create_for(const pliant_model *model, pliant_account *account, pliant_data **out);

#endif
