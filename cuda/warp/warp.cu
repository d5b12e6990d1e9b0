#include "cuda/base/check.h"
#include "base/fail.h"
#include "cuda/base/device.h"
#include "cuda/warp/fit.h"
#include "cuda/warp/pick.h"
#include "base/memory.h"
#include "cuda/warp/rasterize.h"
#include "cuda/warp/render.h"
#include "cuda/base/send_changes.h"
#include "cuda/warp/warp.h"
#include "scan/volume.h"

#include <cstring>
#include <utility>

enum { BEGUN, CULLED, DRAWN, NUM_MARKS };

/* Arrays that depend on the body, and their capacities. */
enum { TETS, REST, FIXED, SETUP, CARRY, ELEMENTS, BOXES, LABELS, HAS_PARTS, POSITIONS, BODY_ARRAYS };
struct body_capacity { bool grows; size_t bytes[BODY_ARRAYS]; };

struct cuda_next;

struct pliant_cuda_warp {
    pliant_warp_parts parts;
    int device;
    cudaStream_t stream;       /* for updates from the host and copies to it */
    gpu_raster raster;
    body_capacity capacity;
    cuda_next *spare;          /* Nullable: arrays of the previous body, for reuse by the next one */
    pliant_cuda_fit *fit;      /* NULL: rasterize */
    double *d_positions;       /* (num_nodes x 3) positions of updates from the host */
    cudaEvent_t marks[NUM_MARKS];
    uint8_t *h_changed;        /* (num_bricks), page-locked */
    int32_t *h_longest;        /* page-locked */
    march_crossing *d_crossing, *h_crossing; /* result of a pick; h_crossing is page-locked */
    gpu_pictures pictures;
    uint8_t *stale;            /* (slabs of bricks along k) whether the host copy is outdated */
    bool drawn;
    bool crowded;              /* a brick needs the kernel for many candidates */
    bool page_locked;          /* the host's volume is page-locked */
    size_t volume_bytes;
};

/* 32 bits index voxels of the scan with a margin for sums; 24 bits of an owner's key index tetrahedra */
static const int max_voxels = 1 << 30, max_tets = 1 << 24;
/* initial candidates per brick; only very crowded bricks have more */
static const int32_t first_capacity = 192;

template <class T> static pliant_status allocate(size_t count, T **d_out)
{
    return pliant_cuda_allocate(count * sizeof(T), "the deformed volume", d_out);
}

template <class T> static pliant_status capacity_for(size_t count, int array, body_capacity *capacity, T **d_out)
{
    return pliant_cuda_ensure(count * sizeof(T), capacity->grows, "the mesh to draw", d_out, capacity->bytes + array);
}

template <class T>
static pliant_status send(const T *h_from, size_t count, int array, cudaStream_t stream, body_capacity *capacity,
                          const T **d_out)
{
    CUDA_TRY(capacity_for(count, array, capacity, d_out));
    return pliant_cuda_send(h_from, count * sizeof(T), const_cast<T *>(*d_out), stream);
}

static pliant_status upload_source(pliant_cuda_warp *gpu)
{
    const raster_source *source = gpu->parts.source;
    void *d_voxels = nullptr, *d_source = nullptr;
    const size_t bytes = (size_t)source->count * pliant_cuda_source_bytes(source->encoding);
    if (source->count >= max_voxels)
        return pliant_fail(PLIANT_ERROR_MEMORY,
                           "%lld voxels are too many for the deformed volume on the GPU: it must have fewer than %d",
                           (long long)source->count, max_voxels);
    CUDA_TRY(pliant_cuda_allocate(bytes, "the scan", &d_source));
    gpu->raster.d_source = d_source;
    CUDA_TRY(pliant_cuda_upload(source->voxels, (size_t)source->count * pliant_encoding_size(source->encoding),
                                "the scan", gpu->stream, &d_voxels));
    pliant_status status = pliant_cuda_prepare_source(&gpu->raster, d_voxels, d_source, source->count, gpu->stream);
    if (status == PLIANT_OK) status = CUDA_CALL(cudaStreamSynchronize(gpu->stream));
    pliant_cuda_release(d_voxels);
    return status;
}

/* Previous body on the device, its host data, and the differences. */
struct known_body {
    const gpu_raster *raster;
    const pliant_warp_parts *parts;
    const pliant_warp_changes *changes;
};

/* Send an array whose first elements are on the device: the changed elements and the additional ones.
 * h_before: NULL: no element has changed */
template <class T>
static pliant_status send_next(const T *h_from, size_t count, const T *d_before, const T *h_before, size_t before,
                               int array, cudaStream_t stream, body_capacity *capacity, const T **d_out)
{
    const size_t same = before < count ? before : count;
    CUDA_TRY(capacity_for(count, array, capacity, d_out));
    T *d_to = const_cast<T *>(*d_out);
    if (same > 0)
        CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(d_to, d_before, same * sizeof(T), cudaMemcpyDeviceToDevice, stream)));
    if (h_before)
        return pliant_cuda_send_differences(h_from, count * sizeof(T), h_before, before * sizeof(T), d_to, stream);
    return same == count ? PLIANT_OK : pliant_cuda_send(h_from + same, (count - same) * sizeof(T), d_to + same, stream);
}

/* Send the corners of elements. For elements of both bodies, only the changed ones are sent. */
static pliant_status send_tets(const pliant_mesh *mesh, const known_body *known, cudaStream_t stream,
                               body_capacity *capacity, const int32_t **d_out)
{
    enum { NEAR = 256 }; /* changed ranges with a smaller gap are sent together */
    const size_t count = 4 * (size_t)mesh->num_tets;
    if (!known) return send(mesh->tets, count, TETS, stream, capacity, d_out);
    const pliant_warp_changes *changes = known->changes;
    CUDA_TRY(send_next<int32_t>(mesh->tets, count, known->raster->d_tets, nullptr, 4 * (size_t)changes->common, TETS,
                                stream, capacity, d_out));
    int32_t *d_to = const_cast<int32_t *>(*d_out);
    for (int32_t first = 0, last; first < changes->num_rebuilt; first = last) {
        for (last = first + 1;
             last < changes->num_rebuilt && changes->rebuilt[last] - changes->rebuilt[last - 1] < NEAR;)
            last++;
        const size_t from = 4 * (size_t)changes->rebuilt[first], to = 4 * ((size_t)changes->rebuilt[last - 1] + 1);
        CUDA_TRY(pliant_cuda_send(mesh->tets + from, (to - from) * sizeof *d_to, d_to + from, stream));
    }
    return PLIANT_OK;
}

/* Send everything that depends on the body.
 * known: Nullable */
static pliant_status fill_body(const pliant_warp_parts *parts, const known_body *known, cudaStream_t stream,
                               gpu_raster *raster, body_capacity *capacity)
{
    const gpu_raster *here = known ? known->raster : raster;
    const pliant_parts *cut_here = known && here->parts.elements ? known->parts->parts : nullptr;
    const size_t tets = (size_t)parts->mesh->num_tets, nodes = (size_t)parts->mesh->num_nodes,
                 bricks = (size_t)raster->num_bricks;
    const pliant_parts *cut = parts->parts;
    const size_t carried_tets = cut ? (size_t)cut->num_carried_tets : 0, elements = tets + carried_tets;
    if (elements >= (size_t)max_tets)
        return pliant_fail(
            PLIANT_ERROR_MEMORY,
            "%zu tetrahedra are too many for the deformed volume on the GPU: the mesh must have fewer than %d",
            elements, max_tets);
    raster->num_tets = (int32_t)tets;
    raster->num_elements = (int32_t)elements;
    uint8_t *d_setup = static_cast<uint8_t *>(raster->d_setup);
    CUDA_TRY(send_tets(parts->mesh, known, stream, capacity, &raster->d_tets));
    CUDA_TRY(send_next<double>(parts->rest, 3 * nodes, here->d_rest, nullptr,
                               known ? 3 * (size_t)parts->num_same_rest : 0, REST, stream, capacity, &raster->d_rest));
    CUDA_TRY(capacity_for(12 * elements, FIXED, capacity, &raster->d_fixed));
    CUDA_TRY(capacity_for(elements * pliant_cuda_setup_bytes(), SETUP, capacity, &d_setup));
    raster->d_setup = d_setup;
    /* elements that are not drawn are carried over, too */
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(raster->d_setup, 0, elements * pliant_cuda_setup_bytes(), stream)));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(raster->d_fixed, 0, 12 * elements * sizeof *raster->d_fixed, stream)));
    if (!cut) {
        raster->parts.num_elements = 0;
        /* the pointer also shows whether there is a cut */
        pliant_cuda_release(raster->parts.elements);
        raster->parts.elements = nullptr;
        return PLIANT_OK;
    }
    memcpy(raster->parts.scan_size, cut->view.scan_size, sizeof raster->parts.scan_size);
    raster->parts.num_elements = cut->view.num_elements;
    if (carried_tets > 0) CUDA_TRY(send(cut->carried_tets, carried_tets, CARRY, stream, capacity, &raster->d_carried));
    CUDA_TRY(send_next(cut->view.elements, elements, here->parts.elements, cut_here ? cut_here->view.elements : nullptr,
                       cut_here ? (size_t)cut_here->view.num_elements : 0, ELEMENTS, stream, capacity,
                       &raster->parts.elements));
    if (cut->num_boxes > 0)
        CUDA_TRY(send(cut->view.boxes, (size_t)cut->num_boxes, BOXES, stream, capacity, &raster->parts.boxes));
    /* of the same pool, in which later labels follow the earlier ones */
    const size_t labels_here = cut_here && cut_here->pool == cut->pool ? (size_t)cut_here->num_labels : 0;
    if (cut->num_labels > 0)
        CUDA_TRY(send_next<uint16_t>(cut->view.labels, (size_t)cut->num_labels, here->parts.labels, nullptr,
                                     labels_here, LABELS, stream, capacity, &raster->parts.labels));
    CUDA_TRY(capacity_for(bricks, HAS_PARTS, capacity, &raster->d_has_parts));
    return CUDA_CALL(cudaMemsetAsync(raster->d_has_parts, 0, bricks, stream));
}

static void release_body(const gpu_raster *raster)
{
    pliant_cuda_release(raster->d_tets, raster->d_rest, raster->d_fixed, raster->d_setup, raster->d_carried,
                        raster->parts.elements, raster->parts.boxes, raster->parts.labels, raster->d_has_parts);
}

/* Build the initial lists of elements per brick. */
static pliant_status fill_lists(pliant_cuda_warp *gpu)
{
    gpu_raster *raster = &gpu->raster;
    const size_t bricks = (size_t)raster->num_bricks;
    if (raster->d_list) return PLIANT_OK;
    if (!raster->d_count) CUDA_TRY(allocate(bricks, &raster->d_count));
    if (!raster->d_dirty) CUDA_TRY(allocate(bricks, &raster->d_dirty));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(raster->d_dirty, 0, bricks * sizeof *raster->d_dirty, gpu->stream)));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(raster->d_count, 0, bricks * sizeof *raster->d_count, gpu->stream)));
    int32_t *d_list;
    CUDA_TRY(allocate(bricks * (size_t)raster->capacity, &d_list));
    raster->d_list = d_list;
    return CUDA_CALL(
        cudaMemsetAsync(raster->d_list, 0, bricks * (size_t)raster->capacity * sizeof *raster->d_list, gpu->stream));
}

/* Send what the elements' own maps need: everything without a fit, otherwise the parts near a cut. */
static pliant_status fill_raster(pliant_cuda_warp *gpu)
{
    if (!gpu->parts.fit) CUDA_TRY(upload_source(gpu));
    CUDA_TRY(fill_body(&gpu->parts, nullptr, gpu->stream, &gpu->raster, &gpu->capacity));
    return fill_lists(gpu);
}

static pliant_status fill(pliant_cuda_warp *gpu)
{
    const pliant_warp_parts *parts = &gpu->parts;
    gpu_raster *raster = &gpu->raster;
    const size_t nodes = (size_t)parts->mesh->num_nodes, bricks = (size_t)raster->num_bricks;
    CUDA_TRY(CUDA_CALL(cudaSetDevice(gpu->device)));
    int lowest = 0, highest = 0;
    CUDA_TRY(CUDA_CALL(cudaDeviceGetStreamPriorityRange(&lowest, &highest)));
    CUDA_TRY(CUDA_CALL(cudaStreamCreateWithPriority(&gpu->stream, cudaStreamNonBlocking, highest)));
    for (cudaEvent_t &mark : gpu->marks) CUDA_TRY(CUDA_CALL(cudaEventCreate(&mark)));
    if (parts->fit) CUDA_TRY(pliant_cuda_fit_create(parts->fit, parts->rest, parts->source, gpu->stream, &gpu->fit));
    if (!parts->fit || parts->parts) CUDA_TRY(fill_raster(gpu));
    CUDA_TRY(pliant_cuda_allocate(gpu->volume_bytes, "the deformed volume", &raster->d_volume));
    CUDA_TRY(allocate(bricks, &raster->d_changed));
    CUDA_TRY(allocate(1, &raster->d_longest));
    CUDA_TRY(capacity_for(3 * nodes, POSITIONS, &gpu->capacity, &gpu->d_positions));
    CUDA_TRY(allocate(1, &gpu->d_crossing));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(raster->d_longest, 0, sizeof *raster->d_longest, gpu->stream)));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(gpu->d_crossing, 0, sizeof *gpu->d_crossing, gpu->stream)));
    CUDA_TRY(pliant_cuda_clear_volume(raster, gpu->stream));
    CUDA_TRY(pliant_cuda_allocate_host(bricks, "the deformed volume", &gpu->h_changed));
    CUDA_TRY(pliant_cuda_allocate_host(sizeof *gpu->h_longest, "the deformed volume", &gpu->h_longest));
    CUDA_TRY(pliant_cuda_allocate_host(sizeof *gpu->h_crossing, "the pick", &gpu->h_crossing));
    gpu->page_locked = pliant_cuda_lock_pages(parts->volume->voxels, gpu->volume_bytes);
    return CUDA_CALL(cudaStreamSynchronize(gpu->stream));
}

static void free_warp(void *object);

static pliant_status create(const pliant_warp_parts *parts, void **object)
{
    int device;
    CUDA_TRY(pliant_cuda_current_device(&device));
    pliant_cuda_warp *gpu = static_cast<pliant_cuda_warp *>(pliant_calloc(1, sizeof *gpu));
    if (!gpu) return pliant_fail_memory("the warp");
    gpu->parts = *parts;
    gpu->device = device;
    gpu->volume_bytes = pliant_geometry_voxels(&parts->grid->target) * pliant_encoding_size(parts->source->encoding);
    gpu_raster *raster = &gpu->raster;
    raster->grid = *parts->grid;
    raster->encoding = parts->source->encoding;
    raster->background = *parts->source;
    raster->capacity = first_capacity;
    raster->num_bricks = parts->grid->bricks[0] * parts->grid->bricks[1] * parts->grid->bricks[2];
    for (int d = 0; d < 3; d++) {
        raster->source_size[d] = parts->source->size[d];
        raster->source_step[d] = (int32_t)parts->source->step[d];
        raster->reciprocal[d] = 1 / parts->grid->target.spacing[d];
    }
    gpu->stale = static_cast<uint8_t *>(pliant_calloc((size_t)parts->grid->bricks[2], 1));
    pliant_status status = gpu->stale ? fill(gpu) : pliant_fail_memory("the warp");
    if (status != PLIANT_OK) {
        free_warp(gpu);
        return status;
    }
    *object = gpu;
    return PLIANT_OK;
}

static void free_next(cuda_next *next);

static void free_warp(void *object)
{
    pliant_cuda_warp *gpu = static_cast<pliant_cuda_warp *>(object);
    if (!gpu) return;
    if (gpu->stream) cudaStreamSynchronize(gpu->stream);
    if (gpu->page_locked) pliant_cuda_unlock_pages(gpu->parts.volume->voxels);
    for (cudaEvent_t mark : gpu->marks)
        if (mark) cudaEventDestroy(mark);
    gpu_raster *raster = &gpu->raster;
    pliant_cuda_release(raster->d_source, raster->d_volume, raster->d_count, raster->d_list, raster->d_dirty,
                        raster->d_changed, raster->d_longest, gpu->d_positions, gpu->d_crossing);
    release_body(raster);
    free_next(gpu->spare);
    pliant_cuda_fit_free(gpu->fit);
    pliant_cuda_release_host(gpu->h_changed, gpu->h_longest, gpu->h_crossing);
    pliant_cuda_pictures_free(&gpu->pictures);
    if (gpu->stream) cudaStreamDestroy(gpu->stream);
    cudaGetLastError();
    pliant_free(gpu->stale);
    pliant_free(gpu);
}

static pliant_status draw(pliant_cuda_warp *gpu, const double *d_positions, bool all, cudaStream_t stream)
{
    gpu_raster *raster = &gpu->raster;
    raster->d_zone = gpu->fit ? pliant_cuda_fit_zone(gpu->fit) : nullptr;
    CUDA_TRY(CUDA_CALL(cudaEventRecord(gpu->marks[BEGUN], stream)));
    if (gpu->fit) CUDA_TRY(pliant_cuda_fit_map(gpu->fit, d_positions, stream));
    if (!gpu->fit || raster->d_zone) CUDA_TRY(pliant_cuda_cull(raster, d_positions, all || gpu->fit, stream));
    CUDA_TRY(CUDA_CALL(cudaEventRecord(gpu->marks[CULLED], stream)));
    if (raster->d_zone) CUDA_TRY(pliant_cuda_fit_own(gpu->fit, raster, stream));
    CUDA_TRY(gpu->fit ? pliant_cuda_fit_draw(gpu->fit, raster, stream)
                      : pliant_cuda_rasterize(raster, gpu->crowded, stream));
    CUDA_TRY(CUDA_CALL(cudaEventRecord(gpu->marks[DRAWN], stream)));
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(gpu->h_changed, raster->d_changed, (size_t)raster->num_bricks,
                                       cudaMemcpyDeviceToHost, stream)));
    return CUDA_CALL(
        cudaMemcpyAsync(gpu->h_longest, raster->d_longest, sizeof *gpu->h_longest, cudaMemcpyDeviceToHost, stream));
}

pliant_status pliant_cuda_warp_enqueue(pliant_cuda_warp *gpu, const double *d_positions, cudaStream_t stream)
{
    CUDA_TRY(draw(gpu, d_positions, !gpu->drawn, stream));
    gpu->drawn = true;
    return PLIANT_OK;
}

static pliant_status grow_lists(gpu_raster *raster, int32_t longest, cudaStream_t stream)
{
    const int32_t capacity = longest + longest / 4;
    const size_t count = (size_t)raster->num_bricks * (size_t)capacity;
    int32_t *d_list;
    CUDA_TRY(allocate(count, &d_list));
    pliant_cuda_release(raster->d_list);
    raster->d_list = d_list;
    raster->capacity = capacity;
    return CUDA_CALL(cudaMemsetAsync(d_list, 0, count * sizeof *d_list, stream));
}

/* Repeat the update for the bricks whose lists overflowed, or which the usual kernel cannot draw. */
static pliant_status draw_again(pliant_cuda_warp *gpu, const double *d_positions, cudaStream_t stream)
{
    gpu->drawn = false; /* after a failure the next update draws everything */
    gpu->crowded = *gpu->h_longest > pliant_cuda_longest_usual();
    if (*gpu->h_longest > gpu->raster.capacity) CUDA_TRY(grow_lists(&gpu->raster, *gpu->h_longest, stream));
    CUDA_TRY(pliant_cuda_warp_enqueue(gpu, d_positions, stream));
    CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(stream)));
    /* the first pass may have changed bricks that the second one did not */
    memset(gpu->h_changed, 1, (size_t)gpu->raster.num_bricks);
    return PLIANT_OK;
}

pliant_status pliant_cuda_warp_finish(pliant_cuda_warp *gpu, const double *d_positions, cudaStream_t stream)
{
    const int32_t *bricks = gpu->raster.grid.bricks;
    if (*gpu->h_longest > gpu->raster.capacity || (!gpu->crowded && *gpu->h_longest > pliant_cuda_longest_usual()))
        CUDA_TRY(draw_again(gpu, d_positions, stream));
    float cull = 0, rasterize = 0;
    CUDA_TRY(CUDA_CALL(cudaEventElapsedTime(&cull, gpu->marks[BEGUN], gpu->marks[CULLED])));
    CUDA_TRY(CUDA_CALL(cudaEventElapsedTime(&rasterize, gpu->marks[CULLED], gpu->marks[DRAWN])));
    gpu->parts.seconds[0] = 1e-3 * cull;
    gpu->parts.seconds[1] = 1e-3 * rasterize;
    memcpy(gpu->parts.changed, gpu->h_changed, (size_t)gpu->raster.num_bricks);
    const size_t slab = (size_t)bricks[0] * (size_t)bricks[1];
    for (int32_t k = 0; k < bricks[2]; k++)
        gpu->stale[k] |= memchr(gpu->h_changed + slab * (size_t)k, 1, slab) != nullptr;
    return PLIANT_OK;
}

static pliant_status update(void *object, const double *positions)
{
    pliant_cuda_warp *gpu = static_cast<pliant_cuda_warp *>(object);
    CUDA_TRY(CUDA_CALL(cudaSetDevice(gpu->device)));
    const size_t bytes = 3 * (size_t)gpu->parts.mesh->num_nodes * sizeof *positions;
    CUDA_TRY(pliant_cuda_send(positions, bytes, gpu->d_positions, gpu->stream));
    CUDA_TRY(pliant_cuda_warp_enqueue(gpu, gpu->d_positions, gpu->stream));
    CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(gpu->stream)));
    return pliant_cuda_warp_finish(gpu, gpu->d_positions, gpu->stream);
}

/* Copy the volume to the host. Slabs of bricks along k are contiguous in memory, so each run of outdated slabs is one
 * copy. */
static pliant_status fetch(void *object)
{
    pliant_cuda_warp *gpu = static_cast<pliant_cuda_warp *>(object);
    const raster_grid *grid = &gpu->raster.grid;
    const int32_t slabs = grid->bricks[2];
    const size_t slice = gpu->volume_bytes / (size_t)grid->target.size[2];
    bool any = false;
    CUDA_TRY(CUDA_CALL(cudaSetDevice(gpu->device)));
    for (int32_t first = 0, end; first < slabs; first = end + 1) {
        while (first < slabs && !gpu->stale[first]) first++;
        for (end = first; end < slabs && gpu->stale[end];) end++;
        if (first == slabs) break;
        size_t begin = slice * (size_t)first * BRICK, stop = slice * (size_t)end * BRICK;
        stop = stop < gpu->volume_bytes ? stop : gpu->volume_bytes;
        CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(static_cast<char *>(gpu->parts.volume->voxels) + begin,
                                           static_cast<char *>(gpu->raster.d_volume) + begin, stop - begin,
                                           cudaMemcpyDeviceToHost, gpu->stream)));
        any = true;
    }
    if (!any) return PLIANT_OK;
    CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(gpu->stream)));
    memset(gpu->stale, 0, (size_t)slabs);
    return PLIANT_OK;
}

static pliant_status cross(void *object, const march_ray *ray, int64_t first, march_crossing *out)
{
    pliant_cuda_warp *gpu = static_cast<pliant_cuda_warp *>(object);
    const pliant_volume *volume = gpu->parts.volume;
    const march_voxels voxels = {gpu->raster.d_volume, volume->encoding, volume->slope, volume->intercept};
    CUDA_TRY(CUDA_CALL(cudaSetDevice(gpu->device)));
    CUDA_TRY(pliant_cuda_cross(&voxels, ray, first, gpu->d_crossing, gpu->stream));
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(gpu->h_crossing, gpu->d_crossing, sizeof *gpu->h_crossing,
                                       cudaMemcpyDeviceToHost, gpu->stream)));
    CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(gpu->stream)));
    *out = *gpu->h_crossing;
    return PLIANT_OK;
}

/* labels: drawn on a separate stream, whose update is complete */
static pliant_status draw_image(void *object, void *labels, const render_scene *given, const render_output *out)
{
    pliant_cuda_warp *gpu = static_cast<pliant_cuda_warp *>(object);
    render_scene scene = *given;
    scene.voxels = gpu->raster.d_volume;
    scene.labels =
        labels ? static_cast<const uint8_t *>(static_cast<pliant_cuda_warp *>(labels)->raster.d_volume) : nullptr;
    CUDA_TRY(CUDA_CALL(cudaSetDevice(gpu->device)));
    return pliant_cuda_render(&gpu->pictures, &scene, out, gpu->stream);
}

/* ---- change to another body */

struct cuda_next {
    pliant_cuda_warp *of;
    pliant_warp_parts parts;
    gpu_raster raster;         /* data that depends on the body */
    body_capacity capacity;
    double *d_positions;
    pliant_cuda_fit *fit;
    int32_t *d_removed, *d_from, *d_rebuilt;
    size_t removed_capacity, from_capacity, rebuilt_capacity;
    int32_t num_removed;
};

static void free_next(cuda_next *next)
{
    if (!next) return;
    release_body(&next->raster);
    pliant_cuda_release(next->d_positions, next->d_removed, next->d_from, next->d_rebuilt);
    pliant_free(next);
}

/* Release a prepared body. Its arrays become the spare for the following one. */
static void drop_next(void *object)
{
    cuda_next *next = static_cast<cuda_next *>(object);
    if (!next) return;
    pliant_cuda_fit_free(next->fit);
    next->fit = nullptr;
    if (next->of->spare) free_next(next);
    else next->of->spare = next;
}

static pliant_status send_list(const int32_t *h_from, int32_t count, cudaStream_t stream, int32_t **d_out,
                               size_t *capacity)
{
    CUDA_TRY(pliant_cuda_ensure(((size_t)count + 1) * sizeof *h_from, true, "the mesh to draw", d_out, capacity));
    return count == 0 ? PLIANT_OK : pliant_cuda_send(h_from, (size_t)count * sizeof *h_from, *d_out, stream);
}

/* Carry the elements over to the next body with their drawn state. The previous state is only read. */
static pliant_status carry(pliant_cuda_warp *gpu, const pliant_warp_changes *changes, cuda_next *next)
{
    const known_body known = {&gpu->raster, &gpu->parts, changes};
    CUDA_TRY(fill_body(&next->parts, &known, gpu->stream, &next->raster, &next->capacity));
    CUDA_TRY(send_list(changes->removed, changes->num_removed, gpu->stream, &next->d_removed, &next->removed_capacity));
    CUDA_TRY(
        send_list(changes->from, changes->now - changes->common, gpu->stream, &next->d_from, &next->from_capacity));
    CUDA_TRY(send_list(changes->rebuilt, changes->num_rebuilt, gpu->stream, &next->d_rebuilt, &next->rebuilt_capacity));
    next->num_removed = changes->num_removed;
    CUDA_TRY(pliant_cuda_carry_elements(&gpu->raster, &next->raster, changes->common, next->d_from,
                                        changes->num_rebuilt, next->d_rebuilt, gpu->stream));
    return CUDA_CALL(cudaStreamSynchronize(gpu->stream));
}

static pliant_status fill_next(pliant_cuda_warp *gpu, const pliant_warp_changes *changes, cuda_next *next)
{
    const pliant_warp_parts *parts = &next->parts;
    CUDA_TRY(capacity_for(3 * (size_t)parts->mesh->num_nodes, POSITIONS, &next->capacity, &next->d_positions));
    if (!parts->fit) return carry(gpu, changes, next);
    CUDA_TRY(pliant_cuda_fit_create(parts->fit, parts->rest, parts->source, gpu->stream, &next->fit));
    if (!parts->parts) return PLIANT_OK;
    CUDA_TRY(fill_lists(gpu));
    /* every update sets up all elements */
    CUDA_TRY(fill_body(parts, nullptr, gpu->stream, &next->raster, &next->capacity));
    return CUDA_CALL(cudaStreamSynchronize(gpu->stream));
}

static pliant_status prepare_next(void *object, const pliant_warp_parts *parts, const pliant_warp_changes *changes,
                                  void **out)
{
    pliant_cuda_warp *gpu = static_cast<pliant_cuda_warp *>(object);
    CUDA_TRY(CUDA_CALL(cudaSetDevice(gpu->device)));
    cuda_next *next = gpu->spare ? gpu->spare : static_cast<cuda_next *>(pliant_calloc(1, sizeof *next));
    if (!next) return pliant_fail_memory("the warp");
    gpu->spare = nullptr;
    next->of = gpu;
    next->parts = *parts;
    next->capacity.grows = true;
    next->raster.num_bricks = gpu->raster.num_bricks;
    pliant_status status = fill_next(gpu, changes, next);
    if (status != PLIANT_OK) {
        drop_next(next);
        return status;
    }
    next->parts.rest = NULL; /* already uploaded, and freed by the caller */
    *out = next;
    return PLIANT_OK;
}

/* Switch to the next body. If a kernel cannot be started any more, the next update draws everything or fails. */
static void take_next(void *object, void *prepared)
{
    pliant_cuda_warp *gpu = static_cast<pliant_cuda_warp *>(object);
    cuda_next *next = static_cast<cuda_next *>(prepared);
    gpu_raster *old = &gpu->raster, *now = &next->raster;
    if (gpu->drawn && !gpu->fit &&
        (pliant_cuda_mark_removed(old, next->num_removed, next->d_removed, gpu->stream) != PLIANT_OK ||
         CUDA_CALL(cudaStreamSynchronize(gpu->stream)) != PLIANT_OK))
        gpu->drawn = false;
    gpu->parts = next->parts;
    std::swap(old->num_tets, now->num_tets);
    std::swap(old->num_elements, now->num_elements);
    std::swap(old->d_tets, now->d_tets);
    std::swap(old->d_rest, now->d_rest);
    std::swap(old->d_fixed, now->d_fixed);
    std::swap(old->d_setup, now->d_setup);
    std::swap(old->d_carried, now->d_carried);
    std::swap(old->d_has_parts, now->d_has_parts);
    std::swap(old->parts, now->parts);
    std::swap(gpu->capacity, next->capacity);
    std::swap(gpu->d_positions, next->d_positions);
    std::swap(gpu->fit, next->fit);
}

/* ---- function table */

/* assigned by name, because C++14 has no designated initializers */
static constexpr pliant_warp_device table()
{
    pliant_warp_device made{};
    made.probe = pliant_cuda_text;
    made.create = create;
    made.free = free_warp;
    made.update = update;
    made.fetch = fetch;
    made.cross = cross;
    made.draw_image = draw_image;
    made.prepare = prepare_next;
    made.take = take_next;
    made.drop = drop_next;
    return made;
}
const pliant_warp_device pliant_cuda_warp_device = table();
