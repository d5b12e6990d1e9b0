/* Evaluations: their kernels, and graphs of them, which need only one launch. */
#include "cuda/fem/quasistatic/anderson.h"
#include "cuda/base/check.h"
#include "cuda/base/launch.h"
#include "cuda/fem/element/forces.h"
#include "cuda/fem/quasistatic/solver.h"
#include "cuda/fem/quasistatic/contact_kernels.h"
#include "cuda/fem/quasistatic/pressures.h"

static pliant_status enqueue_look(pliant_cuda_solver *gpu)
{
    const gpu_iteration *it = &gpu->iteration;
    CUDA_TRY(pliant_cuda_forces(&gpu->system, it, gpu->stream));
    CUDA_TRY(pliant_cuda_gather(&gpu->system, it, gpu->stream));
    return pliant_cuda_precondition(&gpu->preconditioner, it, gpu->stream);
}

static pliant_status enqueue_judge(const pliant_cuda_solver *gpu, bool known)
{
    const gpu_iteration *it = &gpu->iteration;
    CUDA_TRY(pliant_cuda_complete(it, known, gpu->gather_blocks, gpu->stream));
    CUDA_TRY(pliant_cuda_pressure_step(&gpu->system, it, gpu->stream));
    CUDA_TRY(pliant_cuda_decide(it, gpu->gather_blocks, gpu->stream));
    return pliant_cuda_propose(it, gpu->stream);
}

static pliant_status enqueue(pliant_cuda_solver *gpu, bool known)
{
    if (!known) CUDA_TRY(enqueue_look(gpu));
    return enqueue_judge(gpu, known);
}

pliant_status pliant_cuda_solver_evaluate_rest(const pliant_cuda_solver *gpu) { return enqueue_judge(gpu, false); }

static pliant_status enqueue_touching(pliant_cuda_solver *gpu)
{
    const gpu_contact_view *d_view = static_cast<const gpu_contact_view *>(gpu->contacts.d_block[CONTACT_VIEW]);
    CUDA_TRY(pliant_cuda_contact_load(d_view, &gpu->iteration, gpu->stream));
    CUDA_TRY(enqueue_look(gpu));
    CUDA_TRY(pliant_cuda_contact_measure(d_view, CONTACT_BLOCK_POINTS, &gpu->iteration, gpu->stream));
    CUDA_TRY(pliant_cuda_contact_cones(d_view, &gpu->iteration, gpu->contacts.limits.shared_bytes, gpu->stream));
    CUDA_TRY(pliant_cuda_contact_push(d_view, &gpu->iteration, gpu->stream));
    return enqueue_judge(gpu, false);
}

/* Launch a part of an evaluation as a graph, which is recorded at the first use. */
static pliant_status launch(pliant_cuda_solver *gpu, pliant_status (*enqueue_part)(pliant_cuda_solver *),
                            cudaGraphExec_t *part)
{
    if (!*part) CUDA_TRY(pliant_cuda_record(gpu->stream, part, [&] { return enqueue_part(gpu); }));
    return CUDA_CALL(cudaGraphLaunch(*part, gpu->stream));
}

pliant_status pliant_cuda_solver_free_step(pliant_cuda_solver *gpu)
{
    return gpu->preconditioner.multigrid ? launch(gpu, enqueue_look, &gpu->free_step_graph) : enqueue_look(gpu);
}

/* Evaluate with forces by all blocks. They take far longer than a launch, so there is no graph. */
static pliant_status evaluate_with_all_blocks(pliant_cuda_solver *gpu)
{
    const gpu_contacts *contacts = &gpu->contacts;
    const gpu_contact_view *d_view = static_cast<const gpu_contact_view *>(contacts->d_block[CONTACT_VIEW]);
    CUDA_TRY(pliant_cuda_contact_load(d_view, &gpu->iteration, gpu->stream));
    CUDA_TRY(pliant_cuda_solver_free_step(gpu));
    CUDA_TRY(pliant_cuda_contact_measure(d_view, contacts->view.count, &gpu->iteration, gpu->stream));
    CUDA_TRY(pliant_cuda_contact_cones_with_all_blocks(&contacts->view, d_view, &gpu->iteration, &contacts->limits,
                                                       gpu->stream));
    CUDA_TRY(pliant_cuda_contact_push(d_view, &gpu->iteration, gpu->stream));
    return enqueue_judge(gpu, false);
}

pliant_status pliant_cuda_solver_evaluate_contacts(pliant_cuda_solver *gpu)
{
    if (gpu->contacts.uses_all_blocks) return evaluate_with_all_blocks(gpu);
    return launch(gpu, enqueue_touching, &gpu->contact_graph);
}

pliant_status pliant_cuda_solver_evaluate_first(pliant_cuda_solver *gpu, bool known)
{
    if (known || !gpu->preconditioner.multigrid) return enqueue(gpu, known);
    return CUDA_CALL(cudaGraphLaunch(gpu->evaluation, gpu->stream));
}

/* Return an identifier for the kernel sequence of an evaluation. Graphs with equal identifiers and equal size have the
 * same kernels. */
static int kind_of(const gpu_preconditioner *preconditioner)
{
    const gpu_carried *carried = &preconditioner->carried;
    return (preconditioner->multigrid ? 4 : 0) + (carried->base_free == 0 ? 0 : carried->inner == 0 ? 1 : 2);
}

/* Update the parameters of a graph, which is much faster than instantiating it. Return false if it must be
 * instantiated. */
static bool update(cudaGraphExec_t evaluation, cudaGraph_t graph)
{
#if CUDART_VERSION >= 12000
    cudaGraphExecUpdateResultInfo result;
    const bool updated = cudaGraphExecUpdate(evaluation, graph, &result) == cudaSuccess;
#else
    cudaGraphNode_t node;
    cudaGraphExecUpdateResult result;
    const bool updated = cudaGraphExecUpdate(evaluation, graph, &node, &result) == cudaSuccess;
#endif
    if (!updated) cudaGetLastError();
    return updated;
}

pliant_status pliant_cuda_solver_record(pliant_cuda_solver *gpu)
{
    cudaGraph_t graph = nullptr;
    if (gpu->free_step_graph) cudaGraphExecDestroy(gpu->free_step_graph);
    if (gpu->contact_graph) cudaGraphExecDestroy(gpu->contact_graph);
    gpu->free_step_graph = gpu->contact_graph = nullptr;
    pliant_status status = pliant_cuda_capture(gpu->stream, &graph, [&] { return enqueue(gpu, false); });
    size_t kernels = 0;
    const int kind = kind_of(&gpu->preconditioner);
    if (status == PLIANT_OK) status = CUDA_CALL(cudaGraphGetNodes(graph, nullptr, &kernels));
    const bool same = gpu->evaluation && kernels == gpu->kernels && kind == gpu->kind;
    gpu->kernels = kernels;
    gpu->kind = kind;
    if (status == PLIANT_OK && !(same && update(gpu->evaluation, graph))) {
        if (gpu->evaluation) cudaGraphExecDestroy(gpu->evaluation);
        gpu->evaluation = nullptr;
        status = CUDA_CALL(cudaGraphInstantiateWithFlags(&gpu->evaluation, graph, 0));
    }
    if (graph) cudaGraphDestroy(graph);
    return status;
}
