/* Detection of a working GPU. */
#ifndef PLIANT_CUDA_DEVICE_H
#define PLIANT_CUDA_DEVICE_H

#include "pliant/status.h"

/* Describe the device that a backend uses, or the reason why no device can be used. Return whether one can be used. */
bool pliant_cuda_text(char *text, size_t size);
/* Return its index. Later calls return the same device while it works. Errors: UNAVAILABLE. */
pliant_status pliant_cuda_current_device(int *out);

/* Begin and end a section of a profile (NVTX), named like the stage. */
void pliant_cuda_section_begin(const char *name);
void pliant_cuda_section_end(void);

#endif
