/* Detection of a working GPU. */
#ifndef PLIANT_CUDA_DEVICE_H
#define PLIANT_CUDA_DEVICE_H

#include "pliant/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_cuda_device {
    int index;
    char name[128];
    size_t free_bytes, total_bytes;
    int major, minor;         /* compute capability */
    int multiprocessors;
} pliant_cuda_device;

/* Find the device with the most free memory that runs a kernel of this build. Later calls return the same device while
 * it works. Return false with the reason (no driver, no device, no code for it) if there is no such device. The
 * function logs nothing. */
bool pliant_cuda_probe(pliant_cuda_device *out, char *reason, size_t reason_size);

/* Probe as a backend, and describe the device in text. */
bool pliant_cuda_text(char *text, size_t size);
/* Return its index. Errors: UNAVAILABLE. */
pliant_status pliant_cuda_current_device(int *out);

/* Begin and end a section of a profile (NVTX), named like the stage. */
void pliant_cuda_section_begin(const char *name);
void pliant_cuda_section_end(void);

#ifdef __cplusplus
}
#endif
#endif
