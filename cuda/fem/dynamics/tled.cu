#include "cuda/fem/dynamics/tled.h"

#include "cuda/base/check.h"
#include "cuda/base/launch.h"
#include "base/fail.h"
#include "base/memory.h"
#include "fem/dynamics/tled_cubes.h"
#include "cuda/fem/dynamics/tled_contact.h"

#include <algorithm>
#include <climits>
#include <cstring>

/* Sub-steps per graph: maximum (recording time grows with the length); interval of convergence tests in dynamic
 * relaxation; and for parts of a frame, which have any length. */
static const int32_t longest_graph = 256, relaxation_graph = 32, part_graph = 8;

/* Nodes of any tool or contact, ascending; nodes of each tool; nodes of contacts; and the capacity on host and GPU. */
struct held_nodes { int32_t *held, *node, *near; double *weight; int32_t capacity; };

/* Data sent at the start of a frame; the outcome is copied back at its end. */
struct exchange { gpu_frame frame; gpu_outcome outcome; };

struct pliant_cuda_tled {
    const pliant_tled_system *system;
    int device;
    cudaStream_t stream;
    gpu_tled gpu;
    exchange *h_exchange, *d_exchange; /* page-locked */
    held_nodes h_held;                 /* page-locked; the last sent data */
    int32_t sent_held, sent_total, sent_near; /* of h_held */
    gpu_tled_contacts sorted;
    cudaGraphExec_t graph;
    int32_t graph_steps;               /* sub-steps in the graph; 0: no graph */
    bool repeated, pulled;             /* repeated: it counts its sub-steps; pulled: it has kernels for tools */
    bool stale;                        /* the host's state must be sent */
    void *locked[6];                   /* page-locked host blocks */
};

/* ---- Creation. */

template <class T> static pliant_status allocate(pliant_cuda_tled *gpu, size_t count, T **d_out)
{
    CUDA_TRY(pliant_cuda_allocate(count * sizeof(T), "the dynamics", d_out));
    return CUDA_CALL(cudaMemsetAsync(*d_out, 0, count * sizeof(T), gpu->stream));
}

template <class T> static pliant_status upload(pliant_cuda_tled *gpu, const T *h_from, size_t count, const T **d_out)
{
    return pliant_cuda_upload(h_from, count * sizeof(T), "the dynamics", gpu->stream, d_out);
}

static pliant_status upload_elements(pliant_cuda_tled *gpu, const pliant_tled *tled)
{
    const pliant_tled_system *system = gpu->system;
    const size_t nodes = (size_t)system->mesh->num_nodes, count = (size_t)gpu->gpu.num_tets;
    gpu_tet *tets = static_cast<gpu_tet *>(pliant_calloc(count + 1, sizeof *tets)); /* all elements may be hexahedra */
    gpu_node *records = static_cast<gpu_node *>(pliant_calloc(nodes, sizeof *records));
    for (size_t t = 0; tets && t < count; t++) {
        const size_t block = t / LANES, lane = t % LANES;
        for (int v = 0; v < 4; v++) tets[t].node[v] = system->nodes[block][v][lane];
        for (int m = 0; m < 9; m++) tets[t].gradient[m] = system->gradients[block][m][lane];
        tets[t].shear = system->moduli[block][0][lane];
        tets[t].bulk = system->moduli[block][1][lane];
        tets[t].volume = system->moduli[block][2][lane];
    }
    for (size_t n = 0; records && n < nodes; n++) {
        records[n].inverse_mass = system->inverse_mass[n];
        records[n].mass = system->node_mass[n];
        records[n].limit = tled->limit[n];
    }
    const gpu_node *d_nodes = NULL;
    pliant_status status =
        tets && records ? upload(gpu, tets, count + 1, &gpu->gpu.d_tets) : pliant_fail_memory("the elements");
    if (status == PLIANT_OK) status = upload(gpu, records, nodes, &d_nodes);
    gpu->gpu.d_nodes = const_cast<gpu_node *>(d_nodes);
    pliant_free(tets);
    pliant_free(records);
    return status;
}

static pliant_status upload_cubes(pliant_cuda_tled *gpu)
{
    const pliant_tled_cubes *from = gpu->system->cubes;
    gpu_tled *it = &gpu->gpu;
    if (!from || from->num_blocks == 0) return PLIANT_OK;
    const size_t count = (size_t)from->num_blocks * LANES;
    gpu_cube *cubes = static_cast<gpu_cube *>(pliant_calloc(count, sizeof *cubes));
    if (!cubes) return pliant_fail_memory("the elements");
    for (size_t c = 0; c < count; c++) {
        const size_t block = c / LANES, lane = c % LANES;
        for (int v = 0; v < 8; v++) cubes[c].node[v] = from->nodes[block][v][lane];
        cubes[c].shear = from->moduli[block][0][lane];
        cubes[c].bulk = from->moduli[block][1][lane];
        cubes[c].contraction = from->moduli[block][2][lane];
        cubes[c].finer = from->finer[block][lane];
    }
    memcpy(it->cube_gradient, from->gradient, sizeof it->cube_gradient);
    it->cube_bending = from->bending;
    pliant_status status = upload(gpu, cubes, count, &it->d_cubes);
    pliant_free(cubes);
    return status;
}

static pliant_status allocate_state(pliant_cuda_tled *gpu)
{
    gpu_tled *it = &gpu->gpu;
    const size_t nodes = (size_t)it->num_nodes, memory = 8 * (size_t)it->num_prony * (size_t)it->num_elements;
    const size_t blocks = (size_t)std::max(it->num_groups, (it->num_nodes + GPU_THREADS - 1) / GPU_THREADS);
    for (int b = 0; b < 2; b++) {
        CUDA_TRY(allocate(gpu, 4 * nodes, &it->d_u[b]));
        if (b == 0 || it->damped) CUDA_TRY(allocate(gpu, 3 * nodes, &it->d_d[b]));
        if (it->viscous) CUDA_TRY(allocate(gpu, memory, &it->d_memory[b]));
    }
    if (!it->damped) it->d_d[1] = it->d_d[0];
    if (!it->still) CUDA_TRY(allocate(gpu, 3 * nodes, &it->d_older));
    CUDA_TRY(allocate(gpu, 3 * nodes, &it->d_acceleration));
    if (it->still) CUDA_TRY(allocate(gpu, 3 * nodes, &it->d_own));
    if (it->nodal) CUDA_TRY(allocate(gpu, nodes, &it->d_pressure));
    CUDA_TRY(allocate(gpu, blocks * PLIANT_NUM_SUMS, &it->d_sums));
    CUDA_TRY(allocate(gpu, 3 * nodes, &it->d_positions));
    CUDA_TRY(allocate(gpu, 3 * nodes, &it->d_packed_u));
    if (it->viscous)
        CUDA_TRY(allocate(gpu, (size_t)pliant_tled_blocks(gpu->system) * 6 * PLIANT_PRONY_TERMS * LANES,
                          &it->d_packed_memory));
    CUDA_TRY(allocate(gpu, 1, &gpu->d_exchange));
    it->d_frame = &gpu->d_exchange->frame;
    it->d_outcome = &gpu->d_exchange->outcome;
    return pliant_cuda_allocate_host(sizeof *gpu->h_exchange, "the dynamics", &gpu->h_exchange);
}

static void lock_pages(pliant_cuda_tled *gpu, const pliant_tled *tled)
{
    const size_t nodes = 3 * (size_t)gpu->gpu.num_nodes * sizeof(double),
                 memory = (size_t)pliant_tled_blocks(gpu->system) * sizeof *tled->memory;
    void *const blocks[6] = {tled->u, tled->d, tled->start_u, tled->start_d, tled->memory, tled->start_memory};
    for (int b = 0; b < 6; b++)
        if (blocks[b] && pliant_cuda_lock_pages(blocks[b], b < 4 ? nodes : memory)) gpu->locked[b] = blocks[b];
}

static pliant_status fill(pliant_cuda_tled *gpu, const pliant_tled *tled)
{
    const pliant_tled_system *system = gpu->system;
    gpu_tled *it = &gpu->gpu;
    const size_t nodes = (size_t)system->mesh->num_nodes;
    CUDA_TRY(CUDA_CALL(cudaSetDevice(gpu->device)));
    CUDA_TRY(CUDA_CALL(cudaStreamCreateWithFlags(&gpu->stream, cudaStreamNonBlocking)));
    it->law = system->law;
    it->viscous = system->num_prony > 0;
    it->nodal = system->nodal_pressure;
    it->still = system->quasi_static;
    it->num_nodes = system->mesh->num_nodes;
    it->num_tets = system->num_blocks * LANES;
    it->num_elements = pliant_tled_blocks(system) * LANES;
    it->damped = system->stiffness_damping > 0;
    it->num_prony = system->num_prony;
    it->num_walls = system->num_walls;
    memcpy(it->walls, system->walls, sizeof it->walls);
    it->friction = system->friction;
    it->restitution = system->restitution;
    CUDA_TRY(pliant_cuda_tled_groups(system, it, gpu->stream));
    CUDA_TRY(upload_elements(gpu, tled));
    CUDA_TRY(upload_cubes(gpu));
    CUDA_TRY(upload(gpu, system->mesh->rest, 3 * nodes, &it->d_rest));
    if (it->nodal) {
        CUDA_TRY(upload(gpu, system->node_modulus, nodes, &it->d_node_modulus));
        CUDA_TRY(upload(gpu, system->node_volume, nodes, &it->d_node_volume));
    }
    CUDA_TRY(allocate_state(gpu));
    lock_pages(gpu, tled);
    return CUDA_CALL(cudaStreamSynchronize(gpu->stream));
}

pliant_status pliant_cuda_tled_create(pliant_tled *tled, int device, pliant_cuda_tled **out)
{
    if (tled->pressure_of_groups)
        return pliant_fail(PLIANT_ERROR_UNAVAILABLE,
                           "solver/backend: with solver/kind tled, a GPU computes no tissue with a poisson_ratio above "
                           "0.49 in the material table; use cpu");
    pliant_cuda_tled *gpu = static_cast<pliant_cuda_tled *>(pliant_calloc(1, sizeof *gpu));
    if (!gpu) return pliant_fail_memory("the dynamics");
    gpu->system = tled->system;
    gpu->device = device;
    gpu->stale = true;
    pliant_status status = fill(gpu, tled);
    if (status != PLIANT_OK) {
        pliant_cuda_tled_free(gpu);
        return status;
    }
    *out = gpu;
    return PLIANT_OK;
}

static void free_held(held_nodes *held)
{
    pliant_cuda_release_host(held->held, held->node, held->near, held->weight);
    *held = {};
}

static void release_held(gpu_tled *it)
{
    pliant_cuda_release(it->d_held_node, it->d_tool_node, it->d_tool_weight, it->d_near);
    it->d_held_node = it->d_tool_node = it->d_near = NULL;
    it->d_tool_weight = NULL;
}

void pliant_cuda_tled_free(pliant_cuda_tled *gpu)
{
    if (!gpu) return;
    cudaSetDevice(gpu->device);
    if (gpu->stream) cudaStreamSynchronize(gpu->stream);
    for (void *block : gpu->locked)
        if (block) pliant_cuda_unlock_pages(block);
    gpu_tled *it = &gpu->gpu;
    pliant_cuda_release(it->d_group, it->d_order, it->d_element, it->d_corner_start, it->d_corner, it->d_tets,
                        it->d_cubes, it->d_nodes, it->d_rest, it->d_node_modulus, it->d_node_volume, it->d_pressure,
                        it->d_u[0], it->d_u[1], it->d_d[0], it->damped ? it->d_d[1] : NULL, it->d_older,
                        it->d_acceleration, it->d_own, it->d_memory[0], it->d_memory[1], it->d_sums, it->d_positions,
                        it->d_packed_u, it->d_packed_memory, gpu->d_exchange);
    release_held(it);
    free_held(&gpu->h_held);
    pliant_cuda_tled_contacts_free(&gpu->sorted, it);
    pliant_cuda_release_host(gpu->h_exchange);
    if (gpu->graph) cudaGraphExecDestroy(gpu->graph);
    if (gpu->stream) cudaStreamDestroy(gpu->stream);
    cudaGetLastError();
    pliant_free(gpu);
}

void pliant_cuda_tled_restart(pliant_cuda_tled *gpu) { gpu->stale = true; }
pliant_status pliant_cuda_tled_set_positions(pliant_cuda_tled *gpu, const double *h_positions)
{
    return pliant_cuda_send(h_positions, 3 * (size_t)gpu->gpu.num_nodes * sizeof *h_positions, gpu->gpu.d_positions,
                            gpu->stream);
}
const double *pliant_cuda_tled_positions(const pliant_cuda_tled *gpu) { return gpu->gpu.d_positions; }
cudaStream_t pliant_cuda_tled_stream(const pliant_cuda_tled *gpu) { return gpu->stream; }

/* ---- A frame. */

static pliant_status send_state(pliant_cuda_tled *gpu, const pliant_tled *tled)
{
    const gpu_tled *it = &gpu->gpu;
    const size_t bytes = 3 * (size_t)it->num_nodes * sizeof(double),
                 memory = (size_t)pliant_tled_blocks(gpu->system) * sizeof *tled->memory;
    CUDA_TRY(pliant_cuda_send(tled->u, bytes, it->d_packed_u, gpu->stream));
    CUDA_TRY(pliant_cuda_send(tled->d, bytes, it->d_d[0], gpu->stream));
    if (it->viscous) CUDA_TRY(pliant_cuda_send(tled->memory, memory, it->d_packed_memory, gpu->stream));
    if (it->still) CUDA_TRY(CUDA_CALL(cudaMemsetAsync(it->d_own, 0, bytes, gpu->stream)));
    CUDA_TRY(pliant_cuda_tled_unpack(it, gpu->stream));
    if (tled->own_inverse_mass) /* pieces may have stopped */
        CUDA_TRY(CUDA_CALL(cudaMemcpy2DAsync(&it->d_nodes->inverse_mass, sizeof *it->d_nodes, tled->inverse_mass,
                                             sizeof *tled->inverse_mass, sizeof *tled->inverse_mass,
                                             (size_t)it->num_nodes, cudaMemcpyHostToDevice, gpu->stream)));
    gpu->stale = false;
    return PLIANT_OK;
}

static pliant_status reserve_capacity(pliant_cuda_tled *gpu, int32_t count)
{
    if (count <= gpu->h_held.capacity) return PLIANT_OK;
    const int32_t capacity = count + count / 2;
    const size_t indices = (size_t)capacity * sizeof(int32_t), weights = (size_t)capacity * sizeof(double);
    held_nodes *held = &gpu->h_held;
    gpu_tled *it = &gpu->gpu;
    free_held(held);
    release_held(it);
    gpu->sent_total = gpu->sent_held = -1;
    gpu->graph_steps = 0; /* it refers to the old buffers */
    CUDA_TRY(pliant_cuda_allocate_host(indices, "the held nodes", &held->held));
    CUDA_TRY(pliant_cuda_allocate_host(indices, "the held nodes", &held->node));
    CUDA_TRY(pliant_cuda_allocate_host(indices, "the held nodes", &held->near));
    CUDA_TRY(pliant_cuda_allocate_host(weights, "the held nodes", &held->weight));
    CUDA_TRY(pliant_cuda_allocate(indices, "the held nodes", &it->d_held_node));
    CUDA_TRY(pliant_cuda_allocate(indices, "the held nodes", &it->d_tool_node));
    CUDA_TRY(pliant_cuda_allocate(indices, "the held nodes", &it->d_near));
    CUDA_TRY(pliant_cuda_allocate(weights, "the held nodes", &it->d_tool_weight));
    held->capacity = capacity;
    return PLIANT_OK;
}

static pliant_status upload_held(pliant_cuda_tled *gpu, int32_t total, int32_t near)
{
    const held_nodes *held = &gpu->h_held;
    const size_t indices = (size_t)total * sizeof *held->node, weights = (size_t)total * sizeof *held->weight;
    if (total + near == 0) return PLIANT_OK;
    CUDA_TRY(
        pliant_cuda_send(held->held, (size_t)gpu->sent_held * sizeof *held->held, gpu->gpu.d_held_node, gpu->stream));
    CUDA_TRY(pliant_cuda_send(held->node, indices, gpu->gpu.d_tool_node, gpu->stream));
    CUDA_TRY(pliant_cuda_send(held->near, (size_t)near * sizeof *held->near, gpu->gpu.d_near, gpu->stream));
    return pliant_cuda_send(held->weight, weights, gpu->gpu.d_tool_weight, gpu->stream);
}

/* Send the nodes of tools and contacts if they have changed since the last frame, and set each tool's range in the
 * frame. */
static pliant_status send_holds(pliant_cuda_tled *gpu, const pliant_tool *tools, int num_tools, gpu_frame *frame)
{
    int32_t total = 0;
    held_nodes *held = &gpu->h_held;
    const int32_t num_near = gpu->sorted.num_near;
    for (int t = 0; t < num_tools; t++) total += tools[t].holding ? tools[t].num_held : 0;
    CUDA_TRY(reserve_capacity(gpu, total + num_near));
    bool same = total == gpu->sent_total && num_near == gpu->sent_near;
    int32_t at = 0;
    for (int t = 0; t < num_tools; t++) {
        if (!tools[t].holding) continue;
        const size_t count = (size_t)tools[t].num_held;
        frame->tools[t].first = at;
        frame->tools[t].count = tools[t].num_held;
        same = same && memcmp(held->node + at, tools[t].held, count * sizeof *held->node) == 0 &&
               memcmp(held->weight + at, tools[t].weight, count * sizeof *held->weight) == 0;
        memcpy(held->node + at, tools[t].held, count * sizeof *held->node);
        memcpy(held->weight + at, tools[t].weight, count * sizeof *held->weight);
        at += tools[t].num_held;
    }
    same =
        same && (num_near == 0 || memcmp(held->near, gpu->sorted.near, (size_t)num_near * sizeof *held->near) == 0);
    if (!same) {
        std::copy(held->node, held->node + total, held->held);
        std::copy(gpu->sorted.near, gpu->sorted.near + num_near, held->held + total);
        std::copy(gpu->sorted.near, gpu->sorted.near + num_near, held->near);
        std::sort(held->held, held->held + total + num_near);
        gpu->sent_held = (int32_t)(std::unique(held->held, held->held + total + num_near) - held->held);
        gpu->sent_total = -1; /* invalid until the upload has succeeded */
        CUDA_TRY(upload_held(gpu, total, num_near));
        CUDA_TRY(pliant_cuda_tled_hold(&gpu->gpu, gpu->sent_held, gpu->stream));
        gpu->sent_total = total;
        gpu->sent_near = num_near;
    }
    frame->num_held = gpu->sent_held;
    return PLIANT_OK;
}

/* Send the contacts of this frame. */
static pliant_status send_touching(pliant_cuda_tled *gpu, pliant_tled *tled, gpu_frame *frame)
{
    bool moved = false;
    CUDA_TRY(pliant_tled_contacts_begin(tled));
    const pliant_status status = pliant_cuda_tled_contacts_sort(tled, &gpu->sorted, &gpu->gpu, &moved);
    if (moved || status != PLIANT_OK) gpu->graph_steps = 0; /* it refers to the old buffers */
    CUDA_TRY(status);
    frame->num_points = gpu->sorted.num_points;
    frame->num_levels = gpu->sorted.num_levels;
    frame->num_near = gpu->sorted.num_near;
    return pliant_cuda_tled_contacts_send(&gpu->sorted, &gpu->gpu, gpu->stream);
}

static void set_tools(const pliant_tled *tled, const pliant_tool *tools, int num_tools, gpu_frame *frame)
{
    frame->num_tools = num_tools;
    for (int t = 0; t < num_tools; t++) {
        const pliant_tool *tool = tools + t;
        gpu_hold *hold = frame->tools + t;
        if (!tool->holding) continue;
        hold->active = 1;
        hold->substeps_after_part = tled->substeps_after_part[t];
        hold->drive = pliant_tool_drive(tool);
        for (int d = 0; d < 3; d++) hold->goal[d] = pliant_tool_target(tool, d);
        memcpy(hold->driving_force, tool->driving_force, sizeof hold->driving_force);
        hold->stiffness = pliant_tool_stiffness(tool);
        hold->damping = pliant_tool_damping(tool);
        for (int s = 0; s <= t; s++)
            if (tools[s].holding) frame->answer[t][s] = pliant_tled_tool_compliance(tled, tool, tools + s);
        hold->load_share = frame->answer[t][t];
    }
}

static void set_frame(const pliant_tled *tled, gpu_frame *frame)
{
    const pliant_tled_system *system = tled->system;
    const pliant_tled_scheme rule = pliant_tled_scheme_of(tled->time_step, system->damping);
    memcpy(frame->gravity, tled->gravity, sizeof frame->gravity);
    frame->time_step = tled->time_step;
    frame->reach = tled->reach;
    frame->factor = rule.factor;
    frame->kept = rule.kept;
    frame->damping = (float)system->stiffness_damping / (float)tled->time_step;
    frame->tolerance = tled->tolerance;
    frame->smallest_load = tled->smallest_load;
    frame->substeps = pliant_tled_part_substeps(tled);
    frame->substeps_done = tled->substeps_done;
    frame->whole = tled->substeps;
    for (int term = 0; term < system->num_prony; term++) {
        const float dt = (float)tled->time_step;
        frame->prony_relaxed_fraction[term] = dt / ((float)system->prony_time[term] + dt);
        frame->prony_share[term] = (float)system->prony_share[term];
    }
}

static pliant_status enqueue_substeps(const pliant_cuda_tled *gpu, int32_t count, bool repeated, bool pulled)
{
    for (int32_t number = 0; number < count; number++)
        CUDA_TRY(pliant_cuda_tled_substep(&gpu->gpu, number, pulled, gpu->stream));
    return repeated ? pliant_cuda_tled_advance_base(&gpu->gpu, count, gpu->stream) : PLIANT_OK;
}

/* Record `count` sub-steps as a graph, which needs only one launch. */
static pliant_status record(pliant_cuda_tled *gpu, int32_t count, bool repeated)
{
    const bool pulled = gpu->sent_held > 0;
    if (count == gpu->graph_steps && repeated == gpu->repeated && pulled == gpu->pulled) return PLIANT_OK;
    gpu->graph_steps = 0;
    CUDA_TRY(
        pliant_cuda_record(gpu->stream, &gpu->graph, [&] { return enqueue_substeps(gpu, count, repeated, pulled); }));
    gpu->graph_steps = count;
    gpu->repeated = repeated;
    gpu->pulled = pulled;
    return PLIANT_OK;
}

static pliant_status download_outcome(pliant_cuda_tled *gpu)
{
    return CUDA_CALL(cudaMemcpyAsync(&gpu->h_exchange->outcome, gpu->gpu.d_outcome, sizeof gpu->h_exchange->outcome,
                                     cudaMemcpyDeviceToHost, gpu->stream));
}

/* Enqueue the frame's graphs. The displacement arrays are exchanged in every sub-step, so repeated graphs have an even
 * number of sub-steps. */
static pliant_status enqueue_frame(pliant_cuda_tled *gpu, const pliant_tled *tled)
{
    const int32_t steps = pliant_tled_part_substeps(tled),
                  maximum = steps < tled->substeps ? part_graph : longest_graph;
    const int32_t repeats = (steps + maximum - 1) / maximum,
                  length = maximum == part_graph ? maximum : (steps + repeats - 1) / repeats;
    const bool repeated = repeats > 1 || maximum == part_graph;
    CUDA_TRY(record(gpu, repeated ? length + length % 2 : length, repeated));
    for (int32_t r = 0; r < repeats; r++) CUDA_TRY(CUDA_CALL(cudaGraphLaunch(gpu->graph, gpu->stream)));
    return PLIANT_OK;
}

static pliant_status relax(pliant_cuda_tled *gpu, const pliant_tled *tled)
{
    const gpu_outcome *outcome = &gpu->h_exchange->outcome;
    CUDA_TRY(record(gpu, relaxation_graph, true));
    for (int32_t done = 0; done < tled->substeps; done += relaxation_graph) {
        CUDA_TRY(CUDA_CALL(cudaGraphLaunch(gpu->graph, gpu->stream)));
        CUDA_TRY(download_outcome(gpu));
        CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(gpu->stream)));
        if (outcome->settled || outcome->first_unstable_step < INT32_MAX) break;
    }
    return PLIANT_OK;
}

/* Copy the results to the host. They replace the old state only if they are complete and valid. */
static pliant_status download(pliant_cuda_tled *gpu, pliant_tled *tled)
{
    const gpu_tled *it = &gpu->gpu;
    const size_t bytes = 3 * (size_t)it->num_nodes * sizeof(double),
                 memory = (size_t)pliant_tled_blocks(gpu->system) * sizeof *tled->memory;
    CUDA_TRY(pliant_cuda_tled_finish(it, gpu->stream));
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(tled->start_u, it->d_packed_u, bytes, cudaMemcpyDeviceToHost, gpu->stream)));
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(tled->start_d, it->d_d[0], bytes, cudaMemcpyDeviceToHost, gpu->stream)));
    if (it->viscous)
        CUDA_TRY(CUDA_CALL(
            cudaMemcpyAsync(tled->start_memory, it->d_packed_memory, memory, cudaMemcpyDeviceToHost, gpu->stream)));
    CUDA_TRY(pliant_cuda_tled_contacts_download(&gpu->sorted, it, gpu->stream));
    CUDA_TRY(download_outcome(gpu));
    return CUDA_CALL(cudaStreamSynchronize(gpu->stream));
}

static void take(const gpu_outcome *outcome, pliant_tled *tled, pliant_tool *tools, int num_tools)
{
    std::swap(tled->u, tled->start_u);
    std::swap(tled->d, tled->start_d);
    std::swap(tled->memory, tled->start_memory);
    memcpy(tled->target, outcome->target, sizeof tled->target);
    memcpy(tled->previous_point, outcome->previous_point, sizeof tled->previous_point);
    memcpy(tled->previous_target, outcome->previous_target, sizeof tled->previous_target);
    tled->previous_time_step = outcome->previous_time_step;
    memcpy(tled->quotient, outcome->quotient, sizeof tled->quotient);
    for (int t = 0; t < num_tools; t++)
        for (int d = 0; d < 3; d++) tools[t].force[d] += outcome->force[t][d];
}

pliant_status pliant_cuda_tled_run(void *with, pliant_tled *tled, pliant_tool *tools, int num_tools,
                                   pliant_tled_frame *out)
{
    pliant_cuda_tled *gpu = static_cast<pliant_cuda_tled *>(with);
    gpu_frame *frame = &gpu->h_exchange->frame;
    gpu_outcome *outcome = &gpu->h_exchange->outcome;
    const bool still = gpu->gpu.still;
    for (int t = 0; t < num_tools; t++)
        if (tools[t].holding && tools[t].mass > 0)
            return pliant_fail(PLIANT_ERROR_UNAVAILABLE,
                               "tool %s has a mass: explicit dynamics supports tool mass only on the CPU",
                               tools[t].name);
    if (tled->overlap_damping.tissue)
        return pliant_fail(PLIANT_ERROR_UNAVAILABLE,
                           "contact/delay is false: collision detection in every sub-step runs only on the CPU");
    CUDA_TRY(CUDA_CALL(cudaSetDevice(gpu->device)));
    if (gpu->stale) CUDA_TRY(send_state(gpu, tled));
    gpu->stale = true; /* until this frame is complete and valid */
    memset(gpu->h_exchange, 0, sizeof *gpu->h_exchange);
    memcpy(outcome->target, tled->target, sizeof outcome->target);
    memcpy(outcome->previous_point, tled->previous_point, sizeof outcome->previous_point);
    memcpy(outcome->previous_target, tled->previous_target, sizeof outcome->previous_target);
    outcome->previous_time_step = tled->previous_time_step;
    memcpy(outcome->quotient, tled->quotient, sizeof outcome->quotient);
    outcome->first_unstable_step = INT32_MAX;
    set_frame(tled, frame);
    set_tools(tled, tools, num_tools, frame);
    CUDA_TRY(send_touching(gpu, tled, frame));
    CUDA_TRY(send_holds(gpu, tools, num_tools, frame));
    CUDA_TRY(pliant_cuda_send(gpu->h_exchange, sizeof *gpu->h_exchange, gpu->d_exchange, gpu->stream));
    CUDA_TRY(still ? relax(gpu, tled) : enqueue_frame(gpu, tled));
    CUDA_TRY(download(gpu, tled));
    out->is_stable = outcome->first_unstable_step == INT32_MAX;
    out->steps = still ? outcome->steps : pliant_tled_part_substeps(tled);
    if (!out->is_stable) {
        out->steps = outcome->first_unstable_step + 1;
        return PLIANT_OK;
    }
    out->settled = outcome->settled != 0;
    out->residual = still ? outcome->residual
                          : pliant_tled_relative(tled, outcome->sums[PLIANT_SUM_RESIDUAL],
                                                 outcome->sums[PLIANT_SUM_LOAD] + outcome->tool_load);
    if (!still)
        out->error =
            pliant_tled_frame_error(tled, outcome->sums[PLIANT_SUM_ERROR_BEFORE], outcome->sums[PLIANT_SUM_ERROR]);
    take(outcome, tled, tools, num_tools);
    pliant_cuda_tled_contacts_take(&gpu->sorted, tled);
    gpu->stale = false;
    return PLIANT_OK;
}
