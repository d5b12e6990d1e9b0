#include "scene/gpu_choice.h"

#include "base/fail.h"

#include <stdio.h>

pliant_status pliant_gpu_choose(pliant_backend_choice choice, pliant_probe probe, char text[PLIANT_BACKEND_TEXT],
                                bool *use)
{
    snprintf(text, PLIANT_BACKEND_TEXT, "this build has no CUDA backend");
    *use = choice != PLIANT_CPU && probe && probe(text, PLIANT_BACKEND_TEXT);
    if (!*use && choice == PLIANT_CUDA)
        return pliant_fail(PLIANT_ERROR_UNAVAILABLE,
                           "solver/backend: cuda cannot be used: %s; auto or cpu would run on the CPU", text);
    return PLIANT_OK;
}
