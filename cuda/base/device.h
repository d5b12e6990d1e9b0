/* Is there a GPU that works, and what is it called? */
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

/* The device with the most free memory that runs a kernel of this build; after that the same one, as long as it does.
 * Says nothing itself: false, and the reason (no driver, no device, no code for it), when there is none. */
bool pliant_cuda_probe(pliant_cuda_device *out, char *reason, size_t reason_size);

/* The same as a backend's probe, with what it is in text. */
bool pliant_cuda_text(char *text, size_t size);
/* Its index. Errors: UNAVAILABLE. */
pliant_status pliant_cuda_current_device(int *out);

/* Sections of a profile (NVTX); names are those of the stages. */
void pliant_cuda_section_begin(const char *name);
void pliant_cuda_section_end(void);

#ifdef __cplusplus
}
#endif
#endif
