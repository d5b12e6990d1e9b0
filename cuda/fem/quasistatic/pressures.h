/* Pressures of nearly incompressible tissue on the GPU (src/fem/quasistatic/pressure.h). Without such tissue, nothing
 * is allocated, and pliant_cuda_pressure_step launches no kernel. Kernels of elements compute the forces of pressures
 * (cuda/fem/element). pliant_cuda_propose computes the next pressures. */
#ifndef PLIANT_CUDA_PRESSURES_H
#define PLIANT_CUDA_PRESSURES_H

#include "cuda/fem/solver_state.h"
#include "cuda/fem/system.h"

enum { PRESSURE_ARRAYS = 18 };

typedef struct gpu_pressure_memory {
    size_t bytes[PRESSURE_ARRAYS]; /* capacities */
    double *h_pressure;            /* page-locked: (count) of the last step; NULL: no such tissue */
    size_t h_bytes;                /* its capacity */
} gpu_pressure_memory;

/* Allocate and send the constant arrays, also after a cut. Errors: MEMORY, UNAVAILABLE.
 * @param grows  Cuts are possible: allocate more. */
pliant_status pliant_cuda_pressures_set(const pliant_solver *solver, bool grows, cudaStream_t stream,
                                        gpu_pressures *pressures, gpu_pressure_memory *memory);
void pliant_cuda_pressures_free(gpu_pressures *pressures, gpu_pressure_memory *memory);
/* Send the host's pressures to both iterates. */
pliant_status pliant_cuda_pressures_send(const gpu_pressures *pressures, const pliant_solver *solver,
                                         cudaStream_t stream);
/* Enqueue a copy of the present iterate's pressures to h_pressure. now: its buffer. */
pliant_status pliant_cuda_pressures_download(const gpu_pressures *pressures, const gpu_pressure_memory *memory, int now,
                                             cudaStream_t stream);

/* Return the number of blocks of pliant_cuda_pressure_step; 0: no pressures. */
int pliant_cuda_pressure_blocks(const gpu_pressures *pressures);
/* Compute the pressures' step after the step of the nodes, and its products. */
pliant_status pliant_cuda_pressure_step(const gpu_system *system, const gpu_iteration *iteration, cudaStream_t stream);

#endif
