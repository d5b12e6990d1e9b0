#include "cuda/base/check.h"
#include "cuda/base/launch.h"
#include "base/fail.h"
#include "base/memory.h"
#include "cuda/fem/linear/preconditioner.h"

#include <cstring>

enum { THREADS = 128 };

/* Numbers of free nodes: maximum for which the dense inverse is faster than a V-cycle; maximum of a V-cycle's dense
 * level; maximum of an explicitly requested inverse. Creating an inverse in double precision takes at least 9 bytes x
 * unknowns^2. */
enum { LARGEST_DENSE = 2000, COARSEST = 1600, LARGEST_REQUESTED = 16000 };

/* Use the exact tangent if it is positive definite, as it is near a stable state. */
static pliant_status create_inverse(const pliant_system *system, const double *h_x, cudaStream_t stream,
                                    gpu_preconditioner *out)
{
    double *h_values = static_cast<double *>(pliant_calloc((size_t)system->pattern.num_values, sizeof(double)));
    pliant_tangent *h_tangents =
        static_cast<pliant_tangent *>(pliant_calloc((size_t)system->num_blocks, sizeof(pliant_tangent)));
    pliant_status status = h_values && h_tangents ? PLIANT_OK : pliant_fail_memory("the stiffness matrix");
    for (int twist = PLIANT_TWIST_EXACT; h_values && h_tangents && twist <= PLIANT_TWIST_POSITIVE; twist++) {
        pliant_system_tangents(system, h_x, (pliant_twist)twist, h_tangents);
        pliant_system_assemble(system, h_tangents, h_values);
        status = pliant_cuda_inverse_create(&system->pattern, h_values, false, stream, &out->inverse);
        if (status != PLIANT_ERROR_NUMERIC) break;
    }
    pliant_cuda_inverse_memory(3 * system->num_free, &out->bytes);
    pliant_free(h_values);
    pliant_free(h_tangents);
    return status;
}

static pliant_status create_multigrid(const pliant_system *system, const double *h_x, cudaStream_t stream,
                                      gpu_preconditioner *out)
{
    CUDA_TRY(pliant_cuda_multigrid_create(system, h_x, COARSEST, stream, &out->multigrid));
    if (out->multigrid) out->bytes = pliant_cuda_multigrid_bytes(out->multigrid);
    return PLIANT_OK;
}

static pliant_status create(const pliant_system *system, const double *h_x, pliant_preconditioner_choice choice,
                            cudaStream_t stream, gpu_preconditioner *out)
{
    CUDA_TRY(pliant_carried_layout_create(system, &out->layout));
    const bool layered =
        choice == PLIANT_MULTIGRID || (choice == PLIANT_PRECONDITIONER_AUTO && system->num_free > LARGEST_DENSE);
    /* An octree and macro-elements across cubes have no coarser lattice. */
    const bool nested = system->mesh->lattice_of_tet && (!system->macros || system->macros->cell);
    if (layered && nested) {
        CUDA_TRY(create_multigrid(system, h_x, stream, out));
        if (out->multigrid) return PLIANT_OK;
        if (h_x == system->mesh->rest)
            pliant_log(PLIANT_LOG_INFO,
                       "this lattice cannot be coarsened enough for multigrid on the GPU; its matrix is inverted");
    }
    if (system->num_free > LARGEST_REQUESTED) {
        size_t kept, maximum = pliant_cuda_inverse_memory(3 * system->num_free, &kept);
        return pliant_fail(
            PLIANT_ERROR_MEMORY,
            "a dense inverse for %d nodes would take %.1f GB of the GPU while it is made; at most %d nodes, or cells "
            "that can be halved for multigrid",
            system->num_free, 1e-9 * (double)maximum, LARGEST_REQUESTED);
    }
    return create_inverse(system, h_x, stream, out);
}

pliant_status pliant_cuda_preconditioner_create(const pliant_system *system, const double *h_x,
                                                pliant_preconditioner_choice choice, cudaStream_t stream,
                                                gpu_preconditioner *out)
{
    memset(out, 0, sizeof *out);
    const pliant_status status = create(system, h_x, choice, stream, out);
    if (status != PLIANT_OK) pliant_cuda_preconditioner_free(out);
    return status;
}

void pliant_cuda_preconditioner_free(gpu_preconditioner *preconditioner)
{
    pliant_cuda_inverse_free(&preconditioner->inverse);
    pliant_cuda_multigrid_free(preconditioner->multigrid);
    pliant_cuda_carried_free(&preconditioner->carried, &preconditioner->capacity);
    pliant_carried_layout_free(&preconditioner->layout);
    memset(preconditioner, 0, sizeof *preconditioner);
}

/* ---- In a step. */

static pliant_status apply_base(const gpu_preconditioner *preconditioner, const int32_t *d_skip, const float *d_right,
                                float *d_left, cudaStream_t stream)
{
    if (!preconditioner->multigrid)
        return pliant_cuda_inverse_apply(&preconditioner->inverse, d_skip, d_right, d_left, stream);
    return pliant_cuda_multigrid_apply(preconditioner->multigrid, d_skip, d_right, d_left, stream);
}

static pliant_status apply(const gpu_preconditioner *preconditioner, const int32_t *d_skip,
                           const gpu_iteration *iteration, cudaStream_t stream)
{
    const gpu_carried *carried = &preconditioner->carried;
    if (carried->base_free == 0)
        return apply_base(preconditioner, d_skip, iteration->d_right, iteration->d_left, stream);
    CUDA_TRY(pliant_cuda_carried_restrict(carried, d_skip, iteration->d_right, stream));
    CUDA_TRY(apply_base(preconditioner, d_skip, carried->d_right, carried->d_left, stream));
    return pliant_cuda_carried_extend(carried, d_skip, iteration->d_left, stream);
}

pliant_status pliant_cuda_precondition(const gpu_preconditioner *preconditioner, const gpu_iteration *iteration,
                                       cudaStream_t stream)
{
    return apply(preconditioner, &iteration->d_state->skips, iteration, stream);
}

/* Compute right = T' W' e_d, on a vector of zeros. */
static __global__ void __launch_bounds__(THREADS) hold_kernel(gpu_iteration iteration, gpu_tool tool, int d)
{
    const int h = (int)(blockIdx.x * THREADS + threadIdx.x);
    if (h >= tool.count) return;
    const int node = tool.d_unknown[h];
    const double *turn = iteration.d_axes + 9 * (size_t)node, *block = tool.d_block + 9 * (size_t)h + 3 * d;
    for (int c = 0; c < 3; c++)
        iteration.d_right[3 * (size_t)node + c] =
            (float)(turn[c] * block[0] + turn[3 + c] * block[1] + turn[6 + c] * block[2]);
}

static __global__ void __launch_bounds__(THREADS) turn_left_kernel(gpu_iteration iteration, double *d_out)
{
    const int node = (int)(blockIdx.x * THREADS + threadIdx.x);
    if (node >= iteration.num_free) return;
    const double *turn = iteration.d_axes + 9 * (size_t)node;
    const float *left = iteration.d_left + 3 * (size_t)node;
    for (int r = 0; r < 3; r++)
        d_out[3 * (size_t)node + r] = turn[3 * r] * left[0] + turn[3 * r + 1] * left[1] + turn[3 * r + 2] * left[2];
}

pliant_status pliant_cuda_respond(const gpu_preconditioner *preconditioner, const gpu_iteration *iteration,
                                  const gpu_tool *tool, double *d_response, cudaStream_t stream)
{
    if (!preconditioner->multigrid && preconditioner->carried.base_free == 0)
        return pliant_cuda_inverse_response(&preconditioner->inverse, iteration, tool, d_response, stream);
    const size_t n = 3 * (size_t)iteration->num_free;
    for (int d = 0; d < 3; d++) {
        CUDA_TRY(CUDA_CALL(cudaMemsetAsync(iteration->d_right, 0, n * sizeof(float), stream)));
        hold_kernel<<<blocks_for(tool->count, THREADS), THREADS, 0, stream>>>(*iteration, *tool, d);
        CUDA_TRY(CUDA_LAUNCHED("hold_kernel"));
        CUDA_TRY(apply(preconditioner, NULL, iteration, stream));
        turn_left_kernel<<<blocks_for(iteration->num_free, THREADS), THREADS, 0, stream>>>(*iteration,
                                                                                           d_response + n * (size_t)d);
        CUDA_TRY(CUDA_LAUNCHED("turn_left_kernel"));
    }
    return PLIANT_OK;
}

static __global__ void unit_kernel(float *d_right, int clear, int set)
{
    if (clear >= 0) d_right[clear] = 0;
    d_right[set] = 1;
}

pliant_status pliant_cuda_columns(const gpu_preconditioner *preconditioner, const gpu_iteration *iteration,
                                  int32_t count, const int32_t *h_which, const int32_t *d_which, size_t stride,
                                  float *d_column, cudaStream_t stream)
{
    if (!preconditioner->multigrid && preconditioner->carried.base_free == 0)
        return pliant_cuda_inverse_columns(&preconditioner->inverse, count, d_which, stride, d_column, stream);
    if (preconditioner->carried.base_free == 0)
        return pliant_cuda_multigrid_columns(preconditioner->multigrid, count, d_which, stride, d_column, stream);
    CUDA_TRY(
        CUDA_CALL(cudaMemsetAsync(iteration->d_right, 0, 3 * (size_t)iteration->num_free * sizeof(float), stream)));
    for (int32_t n = 0, before = -1; n < 3 * count; n++) {
        gpu_iteration to = *iteration;
        const int32_t unknown = 3 * h_which[2 * (n / 3)] + n % 3;
        to.d_left = d_column + stride * (size_t)(h_which[2 * (n / 3) + 1] + n % 3);
        unit_kernel<<<1, 1, 0, stream>>>(iteration->d_right, before, unknown);
        CUDA_TRY(CUDA_LAUNCHED("unit_kernel"));
        CUDA_TRY(apply(preconditioner, NULL, &to, stream));
        before = unknown;
    }
    return PLIANT_OK;
}
