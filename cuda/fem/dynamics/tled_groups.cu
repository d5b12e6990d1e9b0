/* Groups of adjacent nodes, and the elements of each group. */
#include "cuda/base/check.h"
#include "base/fail.h"
#include "base/memory.h"
#include "cuda/fem/dynamics/tled_state.h"

#include <algorithm>

struct place { uint64_t key; int32_t node; };

struct grouping {
    place *places;             /* (num_nodes) */
    /* As in gpu_tled; group and element have capacity for one group per node. */
    int32_t *group, *order, *element, *corner_start;
    uint16_t *corner;
    int32_t *last_group;     /* (elements) 1 + last group that contains it */
    int32_t *slot;           /* (elements) its index in that group */
    int32_t count, capacity; /* number of groups; capacity of element in groups */
};

static uint64_t spread(uint64_t x) /* separates the lowest 21 bits by two zero bits each */
{
    x &= 0x1fffff;
    x = (x | x << 32) & 0x1f00000000ffffull;
    x = (x | x << 16) & 0x1f0000ff0000ffull;
    x = (x | x << 8) & 0x100f00f00f00f00full;
    x = (x | x << 4) & 0x10c30c30c30c30c3ull;
    return (x | x << 2) & 0x1249249249249249ull;
}

/* Sort the nodes along a Morton curve through the lattice. Nodes that are close on the curve are close in space. */
static void sort_nodes(const pliant_mesh *mesh, place *places)
{
    const int32_t across = mesh->cells[0] + 1, down = mesh->cells[1] + 1;
    for (int32_t n = 0; n < mesh->num_nodes; n++) {
        const int32_t at = mesh->lattice_of_node[n];
        places[n].node = n;
        places[n].key = spread((uint64_t)(at % across)) | spread((uint64_t)(at / across % down)) << 1 |
                        spread((uint64_t)(at / across / down)) << 2;
    }
    std::sort(places, places + mesh->num_nodes,
              [](const place &a, const place &b) { return a.key != b.key ? a.key < b.key : a.node < b.node; });
}

/* Return the element of a corner, by its lane (tetrahedra, then hexahedra), and the corner's number v. */
static int32_t element_of(const pliant_tled_system *system, int32_t corner, int32_t *v)
{
    const int32_t tets = 12 * LANES * system->num_blocks, numbers = corner < tets ? 12 : 24,
                  place = corner < tets ? corner : corner - tets;
    *v = place / (3 * LANES) % (numbers / 3);
    return (corner < tets ? 0 : system->num_blocks * LANES) + place / (numbers * LANES) * LANES + place % LANES;
}

static bool reserve_capacity(grouping *made)
{
    if (made->count < made->capacity) return true;
    const int32_t capacity = 2 * made->capacity + 64;
    int32_t *element = static_cast<int32_t *>(pliant_calloc((size_t)capacity, GPU_THREADS * sizeof *element));
    if (!element) return false;
    std::copy(made->element, made->element + (size_t)made->count * GPU_THREADS, element);
    pliant_free(made->element);
    made->element = element;
    made->capacity = capacity;
    return true;
}

/* Count the elements of a node that the present group does not contain. */
static int32_t new_elements(const pliant_tled_system *system, const grouping *made, int32_t node)
{
    int32_t count = 0, v;
    for (int32_t c = system->corner_start[node]; c < system->corner_start[node + 1]; c++)
        count += made->last_group[element_of(system, system->corner[c], &v)] != made->count;
    return count;
}

static void add_node(const pliant_tled_system *system, grouping *made, int32_t j, int32_t node, int32_t *elements)
{
    made->order[j] = node;
    for (int32_t c = system->corner_start[node]; c < system->corner_start[node + 1]; c++) {
        int32_t v, element = element_of(system, system->corner[c], &v);
        if (made->last_group[element] != made->count) {
            made->element[(size_t)(made->count - 1) * GPU_THREADS + (size_t)*elements] =
                2 * element + (made->last_group[element] == 0);
            made->last_group[element] = made->count;
            made->slot[element] = (*elements)++;
        }
        made->corner[made->corner_start[j + 1]++] = (uint16_t)(GPU_THREADS * v + made->slot[element]);
    }
    made->corner_start[j + 2] = made->corner_start[j + 1];
}

static pliant_status make(const pliant_tled_system *system, grouping *made)
{
    const int32_t nodes = system->mesh->num_nodes;
    int32_t elements = 0;
    sort_nodes(system->mesh, made->places);
    for (int32_t j = 0; j < nodes; j++) {
        const int32_t node = made->places[j].node, own = system->corner_start[node + 1] - system->corner_start[node];
        if (own > GPU_THREADS)
            return pliant_fail(PLIANT_ERROR_UNAVAILABLE,
                               "the GPU's tled takes nodes of at most %d elements; node %d has %d", (int)GPU_THREADS,
                               node, own);
        if (made->count == 0 || j - made->group[made->count - 1] == GPU_GROUP_NODES ||
            elements + new_elements(system, made, node) > GPU_THREADS) {
            if (!reserve_capacity(made)) return pliant_fail_memory("the groups of nodes");
            std::fill_n(made->element + (size_t)made->count * GPU_THREADS, (size_t)GPU_THREADS, -1);
            made->group[made->count++] = j;
            elements = 0;
        }
        add_node(system, made, j, node, &elements);
    }
    made->group[made->count] = nodes;
    return PLIANT_OK;
}

template <class T> static bool allocate(size_t count, T **out)
{
    return (*out = static_cast<T *>(pliant_calloc(count, sizeof **out))) != NULL;
}

template <class T> static pliant_status upload(const T *h_from, size_t count, cudaStream_t stream, const T **d_out)
{
    return pliant_cuda_upload(h_from, count * sizeof(T), "the groups of nodes", stream, d_out);
}

static pliant_status upload_all(const pliant_tled_system *system, const grouping *made, gpu_tled *tled,
                                cudaStream_t stream)
{
    const size_t nodes = (size_t)system->mesh->num_nodes, groups = (size_t)made->count;
    tled->num_groups = made->count;
    CUDA_TRY(upload(made->group, groups + 1, stream, &tled->d_group));
    CUDA_TRY(upload(made->order, nodes, stream, &tled->d_order));
    CUDA_TRY(upload(made->element, groups * GPU_THREADS, stream, &tled->d_element));
    CUDA_TRY(upload(made->corner_start, nodes + 1, stream, &tled->d_corner_start));
    return upload(made->corner, (size_t)system->corner_start[nodes], stream, &tled->d_corner);
}

pliant_status pliant_cuda_tled_groups(const pliant_tled_system *system, gpu_tled *tled, cudaStream_t stream)
{
    const size_t nodes = (size_t)system->mesh->num_nodes, elements = (size_t)pliant_tled_blocks(system) * LANES,
                 corners = (size_t)system->corner_start[nodes];
    grouping made = {};
    bool good = allocate(nodes, &made.places) && allocate(nodes + 1, &made.group) && allocate(nodes, &made.order) &&
                allocate(nodes + 2, &made.corner_start) && allocate(corners, &made.corner) &&
                allocate(elements, &made.last_group) && allocate(elements, &made.slot);
    pliant_status status = good ? make(system, &made) : pliant_fail_memory("the groups of nodes");
    if (status == PLIANT_OK) status = upload_all(system, &made, tled, stream);
    void *blocks[] = {made.places,       made.group,  made.order, made.element,
                      made.corner_start, made.corner, made.last_group, made.slot};
    for (void *block : blocks) pliant_free(block);
    return status;
}
