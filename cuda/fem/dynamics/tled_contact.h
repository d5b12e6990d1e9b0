/* Contacts of explicit dynamics on the GPU. The host detects the points at the start of a frame
 * (src/sim/step/contact.c). One block corrects them in every sub-step (tled_contact.cuh). Their forces are copied back
 * at the end of the frame. */
#ifndef PLIANT_CUDA_TLED_CONTACT_H
#define PLIANT_CUDA_TLED_CONTACT_H

#include "cuda/fem/dynamics/tled_state.h"

/* The points of a frame, sorted by levels. A point is on a later level than all earlier points with a common node.
 * Points of one level can be corrected at the same time, with the same result as one after the other. */
typedef struct gpu_tled_contacts {
    int32_t num_points, num_levels, num_near;
    int32_t point_capacity, near_capacity;
    pliant_contact_point *h_point; /* (num_points) page-locked, as the next ones; their nodes are indices in `near` */
    pliant_tled_contact *h_touch;
    int32_t *h_level;          /* (num_levels + 1) first point of each level */
    int32_t *order;            /* (num_points) index of the host's point */
    int32_t *level_of;         /* (num_points) level of the host's point */
    int32_t *near;             /* (num_near) nodes of points */
    int32_t *place, *last;     /* (nodes) index in `near`, or -1; level of the last point with this node */
} gpu_tled_contacts;

void pliant_cuda_tled_contacts_free(gpu_tled_contacts *sorted, gpu_tled *tled);
/* Sort the points of a frame after pliant_tled_contacts_begin. moved: out: buffers were reallocated, so recorded graphs
 * are invalid. Errors: MEMORY. */
pliant_status pliant_cuda_tled_contacts_sort(const pliant_tled *tled, gpu_tled_contacts *sorted, gpu_tled *gpu,
                                             bool *moved);
pliant_status pliant_cuda_tled_contacts_send(const gpu_tled_contacts *sorted, const gpu_tled *gpu, cudaStream_t stream);
/* Enqueue the download (download), and copy the results to the host's points after it (take). */
pliant_status pliant_cuda_tled_contacts_download(const gpu_tled_contacts *sorted, const gpu_tled *gpu,
                                                 cudaStream_t stream);
void pliant_cuda_tled_contacts_take(const gpu_tled_contacts *sorted, pliant_tled *tled);

#endif
