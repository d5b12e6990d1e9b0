#include "cuda/fem/quasistatic/contact.h"

#include "cuda/fem/quasistatic/anderson.h"
#include "base/fail.h"
#include "cuda/base/check.h"
#include "contact/solve/cone_rules.h"
#include "base/memory.h"
#include "cuda/fem/quasistatic/solver.h"
#include "cuda/fem/quasistatic/contact_kernels.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>

void pliant_cuda_contacts_free(gpu_contacts *contacts)
{
    pliant_cuda_compliance_free(&contacts->blocks);
    for (int b = 0; b < CONTACT_BLOCKS; b++) {
        pliant_cuda_release(contacts->d_block[b]);
        pliant_cuda_release_host(contacts->h_block[b]);
    }
    pliant_free(contacts->place);
    pliant_free(contacts->moved_unknowns);
    memset(contacts, 0, sizeof *contacts);
}

static pliant_status make_block(gpu_contacts *contacts, int b, size_t d_bytes, size_t h_bytes)
{
    CUDA_TRY(pliant_cuda_ensure(d_bytes, true, "contacts", contacts->d_block + b, contacts->d_capacity + b));
    if (h_bytes <= contacts->h_capacity[b]) return PLIANT_OK;
    pliant_cuda_release_host(contacts->h_block[b]);
    contacts->h_block[b] = NULL;
    contacts->h_capacity[b] = 0;
    CUDA_TRY(pliant_cuda_allocate_host(h_bytes + h_bytes / 2, "contacts", contacts->h_block + b));
    contacts->h_capacity[b] = h_bytes + h_bytes / 2;
    return PLIANT_OK;
}

static pliant_status set_size(gpu_contacts *contacts, int32_t num_free)
{
    if (contacts->place && contacts->num_free == num_free) return PLIANT_OK;
    pliant_free(contacts->place);
    pliant_free(contacts->moved_unknowns);
    contacts->place = static_cast<int32_t *>(pliant_calloc((size_t)num_free, sizeof *contacts->place));
    contacts->moved_unknowns =
        static_cast<int32_t *>(pliant_calloc((size_t)num_free, sizeof *contacts->moved_unknowns));
    contacts->num_free = num_free;
    if (contacts->place && contacts->moved_unknowns)
        std::fill(contacts->place, contacts->place + num_free, -1);
    else
        contacts->num_free = 0;
    return contacts->num_free == num_free ? PLIANT_OK : pliant_fail_memory("contact");
}

/* List the unknowns of the points, in the order of their first use. */
static int32_t find_moved_unknowns(const pliant_contact_problem *from, gpu_contacts *contacts)
{
    int32_t count = 0;
    for (int32_t w = 0; w < from->num_weights; w++) {
        if (contacts->place[from->unknown[w]] >= 0) continue;
        contacts->place[from->unknown[w]] = count;
        contacts->moved_unknowns[count++] = from->unknown[w];
    }
    return count;
}

/* A block that is filled on the host and read on the device: arrays one after the other. */
struct packing {
    char *h, *d;
};

template <class T> static T *pack(packing *at, size_t count, T **d_out)
{
    T *here = reinterpret_cast<T *>(at->h);
    *d_out = reinterpret_cast<T *>(at->d);
    at->h += count * sizeof(T);
    at->d += count * sizeof(T);
    return here;
}

template <class T> static void pack(packing *at, const T *from, size_t count, const T **d_out)
{
    T *d_there, *here = pack(at, count, &d_there);
    if (count > 0) memcpy(here, from, count * sizeof(T));
    *d_out = d_there;
}

/* Return the size of the pieces' data, and pack it. */
static size_t bytes_of_pieces(const pliant_contact_problem *from)
{
    const size_t points = (size_t)from->count, moving = (size_t)from->num_moving, limits = (size_t)from->num_couplings;
    return moving == 0 ? 0
                       : (size_t)from->num_arms * sizeof *from->arm + moving * sizeof(pliant_contact_body) +
                             points * sizeof(double) + (points + 1) * sizeof(int32_t) +
                             limits * (sizeof(pliant_coupling) + 9 * points * sizeof(double));
}

static void pack_pieces(packing *at, const pliant_contact_problem *from, gpu_contacts *contacts)
{
    gpu_contact_view *view = &contacts->view;
    double *d_own_compliance;
    pliant_contact_body *d_piece;
    view->num_moving = from->num_moving;
    view->num_couplings = from->num_couplings;
    if (from->num_moving == 0) return;
    double *piece_compliance = pack(at, (size_t)from->count, &d_own_compliance);
    contacts->h_piece = pack(at, (size_t)from->num_moving, &d_piece);
    for (int32_t c = 0; c < from->count; c++) piece_compliance[c] = pliant_contact_problem_compliance(from, c);
    for (int32_t m = 0; m < from->num_moving; m++) contacts->h_piece[m] = *pliant_contact_problem_body(from, m);
    contacts->h_coupling = pack(at, (size_t)from->num_couplings, &view->d_coupling);
    std::copy(from->coupling, from->coupling + from->num_couplings, contacts->h_coupling);
    pack(at, from->columns, 9 * (size_t)from->num_couplings * (size_t)from->count, &view->d_coupling_columns);
    pack(at, from->arm, (size_t)from->num_arms, &view->d_arm);
    view->d_own_compliance = d_own_compliance;
    view->d_piece = d_piece;
}

/* Pack the weights sorted by slots. */
static void pack_slots(packing *at, const pliant_contact_problem *from, gpu_contacts *contacts, int32_t slots)
{
    gpu_contact_view *view = &contacts->view;
    int32_t *d_place, *d_point, *d_first, *d_start, *d_weight;
    const size_t weights = (size_t)from->num_weights, count = (size_t)slots;
    int32_t *place = pack(at, weights, &d_place), *point = pack(at, weights, &d_point),
            *first = pack(at, count, &d_first);
    int32_t *start = pack(at, count + 1, &d_start), *weight = pack(at, weights, &d_weight);
    for (int32_t c = 0; c < from->count; c++)
        for (int32_t w = from->start[c]; w < from->start[c + 1]; w++) point[w] = c;
    std::fill(start, start + slots + 1, 0);
    for (int32_t w = 0; w < from->num_weights; w++) start[(place[w] = contacts->place[from->unknown[w]])]++;
    for (int32_t s = 0; s < slots; s++) start[s + 1] += start[s];
    for (int32_t w = from->num_weights - 1; w >= 0; w--) weight[--start[place[w]]] = w;
    for (int32_t s = 0; s < slots; s++) first[s] = 3 * contacts->blocks.slot[contacts->moved_unknowns[s]];
    view->d_place = d_place;
    view->d_point = d_point;
    view->d_first = d_first;
    view->d_weight_start = d_start;
    view->d_weight = d_weight;
}

/* Send the points of the step to the GPU. */
static pliant_status send_points(pliant_cuda_solver *gpu, const pliant_contact_problem *from, int32_t slots)
{
    gpu_contacts *contacts = &gpu->contacts;
    gpu_contact_view *view = &contacts->view;
    const size_t points = (size_t)from->count, weights = (size_t)from->num_weights, count = (size_t)slots;
    const size_t bytes = (18 * points + 9 * weights + points + (size_t)view->num_springs) * sizeof(double) +
                         (points + 1 + 4 * weights + 3 * count + 1) * sizeof(int32_t) + bytes_of_pieces(from);
    CUDA_TRY(make_block(contacts, CONTACT_PERSISTENT, bytes, bytes));
    packing at = {static_cast<char *>(contacts->h_block[CONTACT_PERSISTENT]),
                  static_cast<char *>(contacts->d_block[CONTACT_PERSISTENT])};
    /* These two are copied back together. */
    memcpy(pack(&at, 3 * points, &view->d_force), from->taken.force, 3 * points * sizeof(double));
    memcpy(pack(&at, 3 * points, &view->d_taken_motion), from->taken.motion, 3 * points * sizeof(double));
    pack(&at, from->friction, points + (size_t)view->num_springs, &view->d_friction);
    pack(&at, from->frame, 9 * points, &view->d_frame);
    pack(&at, from->goal, 3 * points, &view->d_goal);
    pack(&at, from->block, 9 * weights, &view->d_block);
    pack_pieces(&at, from, contacts);
    pack(&at, from->start, points + 1, &view->d_start);
    if (from->num_moving > 0) pack(&at, from->arm_start, points + 1, &view->d_arm_start);
    pack(&at, from->unknown, weights, &view->d_unknown);
    pack(&at, contacts->moved_unknowns, count, &view->d_moved_unknowns);
    pack_slots(&at, from, contacts, slots);
    return pliant_cuda_send(contacts->h_block[CONTACT_PERSISTENT], bytes, contacts->d_block[CONTACT_PERSISTENT],
                            gpu->stream);
}

/* Allocate work arrays, and the arrays that are copied back: motions, then A. */
static pliant_status make_work(gpu_contacts *contacts, int32_t slots, int32_t pieces)
{
    gpu_contact_view *view = &contacts->view;
    const size_t points = 3 * (size_t)view->count, rows = points + 3 * (size_t)view->num_springs,
                 back = (rows + rows * rows) * sizeof(double);
    const size_t blocks = contacts->uses_all_blocks ? (size_t)contacts->limits.num_blocks : 1;
    const size_t work = (9 * (size_t)view->num_weights + 3 * (size_t)slots + 6 * (size_t)pieces + blocks * rows +
                         pliant_cone_numbers(rows) + 1) *
                        sizeof(double);
    CUDA_TRY(make_block(contacts, CONTACT_RESULTS, work + back, back));
    CUDA_TRY(
        make_block(contacts, CONTACT_EVALUATION_RESULTS, 3 * points * sizeof(double), 2 * points * sizeof(double)));
    view->d_motion = static_cast<double *>(contacts->d_block[CONTACT_RESULTS]);
    view->d_matrix = view->d_motion + rows;
    view->d_turned = view->d_matrix + rows * rows;
    view->d_pull = view->d_turned + 9 * (size_t)view->num_weights;
    view->d_piece_moved = view->d_pull + 3 * (size_t)slots;
    view->d_before = view->d_piece_moved + 6 * (size_t)pieces;
    view->d_equations = view->d_before + blocks * rows;
    view->d_arrivals = reinterpret_cast<unsigned *>(view->d_equations + pliant_cone_numbers(rows));
    view->d_change = static_cast<double *>(contacts->d_block[CONTACT_EVALUATION_RESULTS]);
    view->d_found = view->d_change + points;
    view->d_found_motion = view->d_found + points;
    return PLIANT_OK;
}

static pliant_status send_view(gpu_contacts *contacts, cudaStream_t stream)
{
    /* At a fixed address, since a graph refers to it. */
    CUDA_TRY(make_block(contacts, CONTACT_VIEW, sizeof contacts->view, sizeof contacts->view));
    memcpy(contacts->h_block[CONTACT_VIEW], &contacts->view, sizeof contacts->view);
    return pliant_cuda_send(contacts->h_block[CONTACT_VIEW], sizeof contacts->view, contacts->d_block[CONTACT_VIEW],
                            stream);
}

/* Choose what computes the forces, as if the points pressed that press at the start of the leg. */
static void choose_blocks(gpu_contacts *contacts, const pliant_contact_problem *from)
{
    const int32_t springs = contacts->view.num_springs, points = from->count + springs;
    int32_t rows = 3 * springs;
    for (int32_t c = 0; c < from->count; c++) {
        const double *force = from->taken.force + 3 * (size_t)c;
        const bool presses = force[0] != 0 || force[1] != 0 || force[2] != 0;
        rows += !presses ? 0 : from->friction[c] != 0 ? 3 : 1;
    }
    const bool fits_block = points <= CONTACT_BLOCK_POINTS && rows <= PLIANT_CONE_FEW_ROWS;
    contacts->fits_gpu = points <= contacts->limits.max_points && rows <= PLIANT_CONE_MAX_ROWS;
    contacts->uses_all_blocks = contacts->fits_gpu && !fits_block && contacts->limits.num_blocks > 1;
}

static pliant_status prepare(pliant_cuda_solver *gpu, pliant_solver *solver)
{
    gpu_contacts *contacts = &gpu->contacts;
    gpu_contact_view *view = &contacts->view;
    pliant_contact_problem *from = solver->contacts;
    bool made = false;
    pliant_contact_problem_begin_couplings(from);
    CUDA_TRY(set_size(contacts, gpu->system.num_free));
    if (contacts->limits.shared_bytes == 0) CUDA_TRY(pliant_cuda_contact_cone_limits(&contacts->limits));
    const int32_t slots = find_moved_unknowns(from, contacts);
    pliant_status status = pliant_cuda_compliance_compute(&contacts->blocks, &gpu->preconditioner, &gpu->iteration,
                                                          slots, contacts->moved_unknowns, gpu->stream, &made);
    int spring[PLIANT_MAX_TOOLS];
    view->count = from->count;
    view->num_weights = from->num_weights;
    view->num_slots = slots;
    view->num_springs = pliant_solver_list_springs(solver, spring);
    for (int32_t s = 0; s < view->num_springs; s++) view->spring[s] = spring[s];
    choose_blocks(contacts, from);
    view->d_column = contacts->blocks.d_column;
    view->stride = contacts->blocks.stride;
    if (status == PLIANT_OK) status = pliant_contact_problem_size_matrix(from, view->num_springs);
    if (status == PLIANT_OK) status = make_work(contacts, slots, from->num_moving);
    if (status == PLIANT_OK) status = send_points(gpu, from, slots);
    if (status == PLIANT_OK) status = send_view(contacts, gpu->stream);
    for (int32_t s = 0; s < slots; s++) contacts->place[contacts->moved_unknowns[s]] = -1;
    return status;
}

/* Compute the forces from the measured motions on the host: cones.h. For an invalid state the forces stay unchanged. */
static pliant_status find_forces(pliant_cuda_solver *gpu, pliant_contact_problem *from)
{
    gpu_contacts *contacts = &gpu->contacts;
    const gpu_contact_view *view = &contacts->view;
    const size_t points = 3 * (size_t)view->count, rows = points + 3 * (size_t)view->num_springs;
    const double *h_motion = static_cast<const double *>(contacts->h_block[CONTACT_RESULTS]);
    double *h_change = static_cast<double *>(contacts->h_block[CONTACT_EVALUATION_RESULTS]),
           *h_found = h_change + points;
    bool sensible = true;
    for (size_t i = 0; i < rows; i++) sensible = sensible && std::isfinite(h_motion[i]);
    memcpy(from->motion, h_motion, rows * sizeof *h_motion);
    const bool changed = sensible && pliant_contact_problem_solve(from, view->num_springs);
    if (!sensible) {
        memcpy(from->found.force, from->taken.force, points * sizeof *h_found);
        memcpy(from->found.motion, from->taken.motion, points * sizeof *h_found);
        for (int32_t n = 0; n < from->num_couplings; n++) from->coupling[n].found = from->coupling[n].taken;
    }
    memcpy(h_found, from->found.force, points * sizeof *h_found);
    if (changed)
        memcpy(h_change, from->change, points * sizeof *h_change);
    else
        memset(h_change, 0, points * sizeof *h_change);
    CUDA_TRY(pliant_cuda_send(h_change, 2 * points * sizeof *h_change, contacts->d_block[CONTACT_EVALUATION_RESULTS],
                              gpu->stream));
    if (!changed) return PLIANT_OK;
    CUDA_TRY(pliant_cuda_contact_pull(view, &gpu->iteration, gpu->stream));
    return pliant_cuda_contact_push(static_cast<const gpu_contact_view *>(contacts->d_block[CONTACT_VIEW]),
                                    &gpu->iteration, gpu->stream);
}

static pliant_status download_state(const pliant_cuda_solver *gpu)
{
    return CUDA_CALL(cudaMemcpyAsync(gpu->h_state, gpu->iteration.d_state, offsetof(gpu_state, rows),
                                     cudaMemcpyDeviceToHost, gpu->stream));
}

/* Send the couplings and the compliances of their bodies, which depend on their loads. */
static pliant_status send_bodies(const pliant_cuda_solver *gpu, const pliant_contact_problem *from)
{
    const gpu_contacts *contacts = &gpu->contacts;
    if (from->num_moving == 0) return PLIANT_OK;
    for (int32_t m = 0; m < from->num_moving; m++) contacts->h_piece[m] = *pliant_contact_problem_body(from, m);
    std::copy(from->coupling, from->coupling + from->num_couplings, contacts->h_coupling);
    CUDA_TRY(pliant_cuda_send(contacts->h_coupling, (size_t)from->num_couplings * sizeof *contacts->h_coupling,
                              contacts->view.d_coupling, gpu->stream));
    return pliant_cuda_send(contacts->h_piece, (size_t)from->num_moving * sizeof *contacts->h_piece,
                            contacts->view.d_piece, gpu->stream);
}

/* Compute the free step and the motion of the points; copy the motion back, or the first `numbers` of motion and A. */
static pliant_status measure(pliant_cuda_solver *gpu, const pliant_contact_problem *from, size_t numbers)
{
    gpu_contacts *contacts = &gpu->contacts;
    const gpu_contact_view *d_view = static_cast<const gpu_contact_view *>(contacts->d_block[CONTACT_VIEW]);
    CUDA_TRY(send_bodies(gpu, from));
    CUDA_TRY(pliant_cuda_contact_load(d_view, &gpu->iteration, gpu->stream));
    CUDA_TRY(pliant_cuda_solver_free_step(gpu));
    CUDA_TRY(pliant_cuda_contact_measure(d_view, contacts->view.count, &gpu->iteration, gpu->stream));
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(contacts->h_block[CONTACT_RESULTS], contacts->view.d_motion,
                                       numbers * sizeof(double), cudaMemcpyDeviceToHost, gpu->stream)));
    CUDA_TRY(download_state(gpu));
    return CUDA_CALL(cudaStreamSynchronize(gpu->stream));
}

/* Run evaluations while the host computes the contact forces and the GPU waits. The GPU decides whether a state is
 * accepted; the host reads that with the next measurement. */
static pliant_status run_with_host(pliant_cuda_solver *gpu, pliant_solver *solver, int32_t maximum)
{
    pliant_contact_problem *from = solver->contacts;
    const size_t rows = 3 * (size_t)(gpu->contacts.view.count + gpu->contacts.view.num_springs);
    const double *h_matrix = static_cast<const double *>(gpu->contacts.h_block[CONTACT_RESULTS]) + rows;
    for (int32_t made = 0; made <= maximum; made++) {
        CUDA_TRY(measure(gpu, from, made == 0 ? rows + rows * rows : rows));
        if (made == 0) memcpy(from->matrix, h_matrix, rows * rows * sizeof *h_matrix);
        if (gpu->h_state->was_accepted) pliant_contact_problem_accept(from);
        if (gpu->h_state->done) {
            pliant_contact_problem_restore_couplings(from);
            return gpu->h_state->was_accepted ? PLIANT_OK : measure(gpu, from, rows);
        }
        CUDA_TRY(find_forces(gpu, from));
        CUDA_TRY(pliant_cuda_solver_evaluate_rest(gpu));
    }
    return pliant_fail(PLIANT_ERROR_UNAVAILABLE, "the GPU failed: the solver did not finish");
}

/* Copy back forces and motions of the step's final state. */
static pliant_status download(pliant_cuda_solver *gpu)
{
    gpu_contacts *contacts = &gpu->contacts;
    const gpu_contact_view *view = &contacts->view;
    const gpu_contact_view *d_view = static_cast<const gpu_contact_view *>(contacts->d_block[CONTACT_VIEW]);
    const size_t bytes = 3 * (size_t)view->count * sizeof(double);
    CUDA_TRY(pliant_cuda_contact_load(d_view, &gpu->iteration, gpu->stream)); /* applies the last evaluation */
    CUDA_TRY(pliant_cuda_contact_measure(d_view, view->count, &gpu->iteration, gpu->stream));
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(contacts->h_block[CONTACT_RESULTS], view->d_motion, bytes,
                                       cudaMemcpyDeviceToHost, gpu->stream)));
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(contacts->h_block[CONTACT_EVALUATION_RESULTS], view->d_force, 2 * bytes,
                                       cudaMemcpyDeviceToHost, gpu->stream)));
    if (view->num_couplings > 0)
        CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(contacts->h_coupling, view->d_coupling,
                                           (size_t)view->num_couplings * sizeof *contacts->h_coupling,
                                           cudaMemcpyDeviceToHost, gpu->stream)));
    return download_state(gpu);
}

/* Let the host continue from the last accepted state, with the evaluation that the GPU could not end. */
static pliant_status hand_over(pliant_cuda_solver *gpu, pliant_solver *solver, int32_t left)
{
    pliant_contact_forces *taken = &solver->contacts->taken, *found = &solver->contacts->found;
    const size_t bytes = 3 * (size_t)gpu->contacts.view.count * sizeof(double);
    gpu_state *d_state = gpu->iteration.d_state;
    memcpy(found->force, taken->force, bytes); /* if the state was accepted, they change places */
    memcpy(found->motion, taken->motion, bytes);
    pliant_contact_problem_set_couplings(solver->contacts);
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(&d_state->done, 0, sizeof d_state->done, gpu->stream)));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(&d_state->needs_host, 0, sizeof d_state->needs_host, gpu->stream)));
    return run_with_host(gpu, solver, left);
}

/* Run evaluations on the GPU alone. A step needs about as many as the last one; superfluous launches do nothing. */
static pliant_status run_on_gpu(pliant_cuda_solver *gpu, pliant_solver *solver, int32_t maximum)
{
    const size_t numbers = 3 * (size_t)gpu->contacts.view.count;
    for (int32_t spent = 0, ahead = gpu->last_launches; spent < maximum; ahead = 2) {
        for (int32_t n = 0; n < ahead && spent < maximum; n++, spent++)
            CUDA_TRY(pliant_cuda_solver_evaluate_contacts(gpu));
        CUDA_TRY(download(gpu));
        CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(gpu->stream)));
        if (!gpu->h_state->done) continue;
        const double *h_taken = static_cast<const double *>(gpu->contacts.h_block[CONTACT_EVALUATION_RESULTS]);
        memcpy(solver->contacts->taken.force, h_taken, numbers * sizeof *h_taken);
        memcpy(solver->contacts->taken.motion, h_taken + numbers, numbers * sizeof *h_taken);
        std::copy(gpu->contacts.h_coupling, gpu->contacts.h_coupling + gpu->contacts.view.num_couplings,
                  solver->contacts->coupling);
        if (gpu->h_state->needs_host) return hand_over(gpu, solver, maximum);
        pliant_contact_problem_restore_couplings(solver->contacts);
        return PLIANT_OK;
    }
    return pliant_fail(PLIANT_ERROR_UNAVAILABLE, "the GPU failed: the solver did not finish");
}

pliant_status pliant_cuda_contacts_run(pliant_cuda_solver *gpu, pliant_solver *solver, const gpu_step *step)
{
    const gpu_contact_view *view = &gpu->contacts.view;
    const int32_t maximum = step->max_evaluations + 4; /* as in a step without contact */
    CUDA_TRY(prepare(gpu, solver));
    CUDA_TRY(pliant_cuda_begin(&gpu->iteration, step, gpu->stream));
    CUDA_TRY(pliant_cuda_contact_begin(view, &gpu->iteration, gpu->stream));
    return gpu->contacts.fits_gpu ? run_on_gpu(gpu, solver, maximum) : run_with_host(gpu, solver, maximum);
}

const double *pliant_cuda_contacts_motion(const gpu_contacts *contacts)
{
    return static_cast<const double *>(contacts->h_block[CONTACT_RESULTS]);
}
