#include "model_data/discretization.h"

#include <stdatomic.h>

const pliant_discretization *pliant_discretization_retain(const pliant_discretization *discretization)
{
    atomic_fetch_add_explicit(&discretization->holders->count, 1, memory_order_relaxed);
    return discretization;
}

void pliant_discretization_release(const pliant_discretization *discretization)
{
    if (discretization && atomic_fetch_sub_explicit(&discretization->holders->count, 1, memory_order_acq_rel) == 1)
        discretization->holders->free((pliant_discretization *)discretization);
}
