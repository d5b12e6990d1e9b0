#include "cuda/fem/quasistatic/pressures.h"

#include "base/fail.h"
#include "base/memory.h"
#include "cuda/base/check.h"
#include "cuda/base/launch.h"
#include "cuda/base/warp_sum.cuh"
#include "cuda/fem/element/volume.cuh"
#include "cuda/fem/quasistatic/axes.cuh"
#include "fem/quasistatic/solver.h"

#include <cstring>

/* One warp handles a product of a block's pressures. */
enum { LANES_PER_PRESSURE = 8, PRESSURES = 32, THREADS = LANES_PER_PRESSURE * PRESSURES };

/* ---- Arrays. */

struct sized_block { void **d_block; size_t bytes; };

template <class T> static sized_block block_of(T **d_block, size_t count)
{
    return {reinterpret_cast<void **>(d_block), count * sizeof(T)};
}

int pliant_cuda_pressure_blocks(const gpu_pressures *pressures)
{
    return (pressures->count + PRESSURES - 1) / PRESSURES;
}

static pliant_status allocate(const pliant_solver *solver, bool grows, gpu_pressures *of, gpu_pressure_memory *memory)
{
    const size_t count = (size_t)of->count, elements = (size_t)of->elements,
                 corners = (size_t)pliant_element_begin(solver->system, of->elements),
                 secants = count * (size_t)(solver->rules.capacity > 0 ? solver->rules.capacity : 1);
    const sized_block blocks[] = {
        block_of(&of->d_of_element, elements),
        block_of(&of->d_element_volume, elements),
        block_of(&of->d_unknown, corners),
        block_of(&of->d_group_start, count + 1),
        block_of(&of->d_group, elements),
        block_of(&of->d_volume, count),
        block_of(&of->d_compliance, count),
        block_of(&of->d_gain, count),
        block_of(&of->d_pressure[0], count),
        block_of(&of->d_pressure[1], count),
        block_of(&of->d_step[0], count),
        block_of(&of->d_step[1], count),
        block_of(&of->d_past_step, count),
        block_of(&of->d_secant_pressure, secants),
        block_of(&of->d_secant_step, secants),
        block_of(&of->d_change, elements),
        block_of(&of->d_derivative, 9 * elements),
        block_of(&of->d_sums, PRESSURE_SUMS * (size_t)pliant_cuda_pressure_blocks(of)),
    };
    static_assert(sizeof blocks / sizeof *blocks == PRESSURE_ARRAYS, "a capacity for each");
    for (int b = 0; b < PRESSURE_ARRAYS; b++)
        CUDA_TRY(pliant_cuda_ensure(blocks[b].bytes, grows, "the pressures", blocks[b].d_block, memory->bytes + b));
    if (memory->h_bytes >= count * sizeof(double)) return PLIANT_OK;
    pliant_cuda_release_host(memory->h_pressure);
    memory->h_pressure = nullptr;
    memory->h_bytes = 0;
    const size_t bytes = (grows ? count + count / 4 : count) * sizeof(double);
    CUDA_TRY(pliant_cuda_allocate_host(bytes, "the pressures", &memory->h_pressure));
    memory->h_bytes = bytes;
    return PLIANT_OK;
}

/* List the elements of each pressure. start: (count + 1), zeroed. */
static void list_groups(const pliant_pressures *from, int32_t elements, int32_t *start, int32_t *group)
{
    for (int32_t e = 0; e < elements; e++)
        if (from->of_element[e] >= 0) start[from->of_element[e]]++;
    for (int32_t p = 0; p < from->count; p++) start[p + 1] += start[p];
    for (int32_t e = elements - 1; e >= 0; e--)
        if (from->of_element[e] >= 0) group[--start[from->of_element[e]]] = e;
}

/* Send the lists, which only the GPU has. Errors: MEMORY, UNAVAILABLE. */
static pliant_status send_lists(const pliant_solver *solver, cudaStream_t stream, gpu_pressures *out)
{
    const pliant_system *system = solver->system;
    const int32_t corners = pliant_element_begin(system, out->elements), *node = pliant_element_nodes(system);
    const size_t starts = (size_t)out->count + 1, elements = (size_t)out->elements;
    int32_t *h_unknown = static_cast<int32_t *>(pliant_calloc((size_t)corners, sizeof *h_unknown)),
            *h_start = static_cast<int32_t *>(pliant_calloc(starts, sizeof *h_start)),
            *h_group = static_cast<int32_t *>(pliant_calloc(elements, sizeof *h_group));
    pliant_status status = h_unknown && h_start && h_group ? PLIANT_OK : pliant_fail_memory("the pressures");
    if (status == PLIANT_OK) {
        for (int32_t c = 0; c < corners; c++) h_unknown[c] = system->free_of_node[node[c]];
        list_groups(solver->pressures, out->elements, h_start, h_group);
        status = pliant_cuda_send(h_unknown, (size_t)corners * sizeof *h_unknown, out->d_unknown, stream);
    }
    if (status == PLIANT_OK) status = pliant_cuda_send(h_start, starts * sizeof *h_start, out->d_group_start, stream);
    if (status == PLIANT_OK) status = pliant_cuda_send(h_group, elements * sizeof *h_group, out->d_group, stream);
    if (status == PLIANT_OK) status = CUDA_CALL(cudaStreamSynchronize(stream));
    pliant_free(h_unknown);
    pliant_free(h_start);
    pliant_free(h_group);
    return status;
}

pliant_status pliant_cuda_pressures_set(const pliant_solver *solver, bool grows, cudaStream_t stream,
                                        gpu_pressures *pressures, gpu_pressure_memory *memory)
{
    const pliant_pressures *from = solver->pressures;
    pressures->count = from ? from->count : 0;
    if (pressures->count == 0) return PLIANT_OK;
    pressures->elements = pliant_element_count(solver->system);
    const size_t count = (size_t)from->count * sizeof(double), elements = (size_t)pressures->elements;
    CUDA_TRY(allocate(solver, grows, pressures, memory));
    CUDA_TRY(pliant_cuda_send(from->of_element, elements * sizeof(int32_t), pressures->d_of_element, stream));
    CUDA_TRY(pliant_cuda_send(from->element_volume, elements * sizeof(double), pressures->d_element_volume, stream));
    CUDA_TRY(pliant_cuda_send(from->volume, count, pressures->d_volume, stream));
    CUDA_TRY(pliant_cuda_send(from->compliance, count, pressures->d_compliance, stream));
    CUDA_TRY(pliant_cuda_send(from->gain, count, pressures->d_gain, stream));
    return send_lists(solver, stream, pressures);
}

void pliant_cuda_pressures_free(gpu_pressures *pressures, gpu_pressure_memory *memory)
{
    pliant_cuda_release(pressures->d_of_element, pressures->d_element_volume, pressures->d_unknown,
                        pressures->d_group_start, pressures->d_group, pressures->d_volume, pressures->d_compliance,
                        pressures->d_gain, pressures->d_pressure[0], pressures->d_pressure[1], pressures->d_step[0],
                        pressures->d_step[1], pressures->d_past_step, pressures->d_secant_pressure,
                        pressures->d_secant_step, pressures->d_change, pressures->d_derivative, pressures->d_sums);
    pliant_cuda_release_host(memory->h_pressure);
    memset(pressures, 0, sizeof *pressures);
    memset(memory, 0, sizeof *memory);
}

pliant_status pliant_cuda_pressures_send(const gpu_pressures *pressures, const pliant_solver *solver,
                                         cudaStream_t stream)
{
    const size_t bytes = (size_t)pressures->count * sizeof(double);
    if (bytes == 0) return PLIANT_OK;
    CUDA_TRY(pliant_cuda_send(solver->now.pressure, bytes, pressures->d_pressure[0], stream));
    return CUDA_CALL(cudaMemcpyAsync(pressures->d_pressure[1], pressures->d_pressure[0], bytes,
                                     cudaMemcpyDeviceToDevice, stream));
}

pliant_status pliant_cuda_pressures_download(const gpu_pressures *pressures, const gpu_pressure_memory *memory, int now,
                                             cudaStream_t stream)
{
    const size_t bytes = (size_t)pressures->count * sizeof(double);
    return bytes == 0 ? PLIANT_OK
                      : CUDA_CALL(cudaMemcpyAsync(memory->h_pressure, pressures->d_pressure[now], bytes,
                                                  cudaMemcpyDeviceToHost, stream));
}

/* ---- The step: some lanes per pressure, then one warp per product. */

/* Corners of an element, and their gradients: number m of corner v is first[(3 v + m) stride]. */
struct element_corners { int begin, count; const double *d_first; size_t stride; };

static __device__ __forceinline__ element_corners corners_of(const gpu_system &system, int e)
{
    const gpu_macros &macros = system.macros;
    if (macros.count == 0) return {4 * e, 4, system.d_gradients + e, (size_t)system.tet_stride};
    return {macros.d_start[e], macros.d_start[e + 1] - macros.d_start[e], macros.d_gradient + 24 * (size_t)e, 1};
}

/* Return the change of volume of one corner, after the step of its node: V_e R g_v . dx. */
static __device__ __forceinline__ double change_of_corner(const gpu_iteration &iteration, int target, int e,
                                                          const element_corners &at, int v)
{
    const gpu_pressures &pressures = iteration.pressures;
    const int node = pressures.d_unknown[at.begin + v];
    double derivative[9], gradient[3], row[3];
    if (node < 0) return 0;
    const double *from = iteration.d_step[target] + 3 * (size_t)node;
    double step[3] = {from[0], from[1], from[2]};
    for (int d = 0; d < 3; d++) gradient[d] = at.d_first[(size_t)(3 * v + d) * at.stride];
    load_derivative(pressures, e, derivative);
    turn_out(iteration, (size_t)node, step);
    pliant_volume_row(derivative, pressures.d_element_volume[e], gradient, row);
    return row[0] * step[0] + row[1] * step[1] + row[2] * step[2];
}

/* Return this lane's part of the change of volume of a pressure's elements, after the step of the nodes. */
static __device__ double part_of_change(const gpu_system &system, const gpu_iteration &iteration, int target, int p,
                                        int lane)
{
    const gpu_pressures &pressures = iteration.pressures;
    const int first = pressures.d_group_start[p], count = pressures.d_group_start[p + 1] - first,
              corners = corners_of(system, pressures.d_group[first]).count;
    double sum = 0;
#pragma unroll 3
    for (int k = lane; k < count * corners; k += LANES_PER_PRESSURE) {
        const int e = pressures.d_group[first + k / corners], v = k % corners;
        if (v == 0) sum += pressures.d_element_volume[e] * pressures.d_change[e];
        sum += change_of_corner(iteration, target, e, corners_of(system, e), v);
    }
    return sum;
}

/* Steps of the pressures of a block, and their weights in products (pliant_pressure_energy). */
struct block_steps { double weight[PRESSURES], step[PRESSURES], now[PRESSURES], past[PRESSURES]; };

/* Compute the step of a pressure, with one lane. change: of its elements. finds: out of date, otherwise kept. */
static __device__ void keep_step(const gpu_iteration &iteration, const gpu_state &state, int p, double change,
                                 bool finds, int place, block_steps &out)
{
    const gpu_pressures &pressures = iteration.pressures;
    const int target = gpu_target(&state);
    double *step = pressures.d_step[target] + p;
    if (gpu_looks_back(&state)) pressures.d_past_step[p] = *step;
    if (finds)
        *step = pliant_pressure_increment(pressures.d_gain[p], change / pressures.d_volume[p],
                                          pressures.d_compliance[p], pressures.d_pressure[target][p]);
    out.weight[place] = pliant_pressure_weight(pressures.d_volume[p], pressures.d_gain[p]);
    out.step[place] = *step;
    out.now[place] = state.now != target ? pressures.d_step[state.now][p] : 0;
    out.past[place] = state.start_is_evaluated ? pressures.d_past_step[p] : 0;
}

/* Return one lane's part of product s. */
static __device__ double product_of(const gpu_iteration &iteration, const gpu_state &state, const block_steps &of,
                                    int s, int place, int p)
{
    const gpu_pressures &pressures = iteration.pressures;
    if (p >= pressures.count) return 0;
    const double step = of.weight[place] * of.step[place];
    if (s < PRESSURE_SECANTS) return step * (s == PRESSURE_OWN ? of.step : s == PRESSURE_NOW ? of.now : of.past)[place];
    const int secant = s - PRESSURE_SECANTS, h = secant % iteration.capacity;
    if (state.rules.number[h] == 0) return 0;
    return (secant == h ? step : of.weight[place] * of.past[place]) *
           pressures.d_secant_step[(size_t)pressures.count * h + p];
}

/* Compute dp (pliant_pressure_step) and its products. A first state that equals the final state of the previous step
 * keeps its dp, as on the CPU. */
static __global__ void __launch_bounds__(THREADS) pressure_step_kernel(gpu_system system, gpu_iteration iteration)
{
    __shared__ block_steps steps;
    const gpu_state &state = *iteration.d_state;
    if (state.done) return;
    const int thread = (int)threadIdx.x, first = (int)blockIdx.x * PRESSURES, place = thread / LANES_PER_PRESSURE,
              p = first + place, lane = thread % LANES_PER_PRESSURE, count = iteration.pressures.count;
    const bool finds = state.iterations > 0 || state.step.known != PLIANT_KNOWN_STEP;
    double change = finds && p < count ? part_of_change(system, iteration, gpu_target(&state), p, lane) : 0;
    for (int half = LANES_PER_PRESSURE / 2; half > 0; half /= 2) change += __shfl_xor_sync(0xffffffff, change, half);
    if (lane == 0 && p < count) keep_step(iteration, state, p, change, finds, place, steps);
    __syncthreads();
    const int products = PRESSURE_SECANTS + (gpu_looks_back(&state) ? 2 : 1) * iteration.capacity;
    for (int s = thread / 32; s < products; s += THREADS / 32) {
        const double sum = warp_sum(product_of(iteration, state, steps, s, thread % 32, first + thread % 32));
        if (thread % 32 == 0) iteration.pressures.d_sums[(size_t)gridDim.x * s + blockIdx.x] = sum;
    }
}

/* ---- Kernel launches. */

pliant_status pliant_cuda_pressure_step(const gpu_system *system, const gpu_iteration *iteration, cudaStream_t stream)
{
    const unsigned blocks = (unsigned)pliant_cuda_pressure_blocks(&iteration->pressures);
    if (blocks == 0) return PLIANT_OK;
    pressure_step_kernel<<<blocks, THREADS, 0, stream>>>(*system, *iteration);
    return CUDA_LAUNCHED("pressure_step_kernel");
}
