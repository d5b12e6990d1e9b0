/* Label the voxels around one tetrahedron at a cut. */
#include "base/fail.h"
#include "base/memory.h"
#include "warp/parts_maker.h"

#include <math.h>

/* A voxel of another tetrahedron belongs to a carrier within this number of links, the distance between two corners of
 * a cell. */
enum { STEPS = 3 };
enum { NO_LABEL = -1, IN_QUEUE = -2 };
/* number of cells along i that are processed together */
enum { MAX_ROW = 64 };

static int32_t scan_voxel(const part_maker *work, int32_t local)
{
    int32_t at[3];
    part_place_of(work->box.size, local, at);
    for (int d = 0; d < 3; d++) at[d] += work->box.low[d];
    return part_index_of(work->voxels->geometry.size, at);
}

static bool in_box(const part_box *box, const int32_t scan[3], int32_t *local)
{
    int32_t at[3];
    for (int d = 0; d < 3; d++) {
        at[d] = scan[d] - box->low[d];
        if (at[d] < 0 || at[d] >= box->size[d]) return false;
    }
    *local = part_index_of(box->size, at);
    return true;
}

/* ---- severed links */

/* Mark the severed links in the box. Return whether there are any. */
static bool find_severed(part_maker *work)
{
    const part_box *box = &work->box;
    const int32_t *size = work->voxels->geometry.size;
    bool any = false;
    memset(work->severed, 0, (size_t)work->count);
    for (int32_t k = 0; k < box->size[2]; k++) {
        const int32_t slice = size[0] * (box->low[1] + size[1] * (box->low[2] + k));
        const uint32_t *link = work->cuts->link,
                       *from = link + pliant_lower_bound(link, work->cuts->num_links, 4 * (uint32_t)slice);
        const uint32_t *end =
            link + pliant_lower_bound(link, work->cuts->num_links, 4 * (uint32_t)(slice + size[0] * box->size[1]));
        for (int32_t j = 0; j < box->size[1] && from < end; j++) {
            const uint32_t row = (uint32_t)(slice + size[0] * j + box->low[0]);
            from += pliant_lower_bound(from, (int32_t)(end - from), 4 * row);
            for (; from < end && *from / 4 < row + (uint32_t)box->size[0]; from++) {
                work->severed[(int32_t)(*from / 4 - row) + box->size[0] * (j + box->size[1] * k)] |=
                    (uint8_t)(1 << *from % 4);
                any = true;
            }
        }
    }
    return any;
}

/* ---- carriers */

static int32_t carrier_of(const part_maker *work, int32_t voxel)
{
    const int32_t tet = work->voxels->owner[voxel], cut = work->cut_of[tet];
    return cut < 0
               ? tet
               : work->cuts->voxel_fragment[work->cuts->voxel_start[cut] + pliant_voxel_in(work->voxels, tet, voxel)];
}

/* Return the label of a carrier in the box; -1: out of memory. */
static int32_t label_of(part_maker *work, int32_t carrier)
{
    const int32_t *all = (const int32_t *)work->carriers.at + work->first_carrier;
    for (int32_t n = 0; n < work->num_carriers; n++)
        if (all[n] == carrier) return n;
    int32_t *added = pliant_parts_grow(&work->carriers, 1);
    if (!added) return -1;
    *added = carrier;
    return work->num_carriers++;
}

static bool list_fragments(part_maker *work)
{
    const int32_t cut = work->cut_of[work->tet];
    work->first_carrier = (int32_t)work->carriers.count;
    work->num_carriers = 0;
    if (cut < 0 && label_of(work, work->tet) < 0) return false;
    for (int32_t f = cut < 0 ? 0 : work->cuts->start[cut]; cut >= 0 && f < work->cuts->start[cut + 1]; f++)
        if (label_of(work, work->cuts->fragment[f]) < 0) return false;
    work->num_fragments = work->num_carriers;
    return true;
}

/* ---- labels */

/* Upper bounds of the barycentric coordinates in the cells of a row. The order of the sums is the same as in
 * pliant_parts_touches. */
typedef struct cell_planes {
    const part_shape *at;
    double maximum[4][MAX_ROW]; /* along a row */
} cell_planes;

static void begin_rows(const part_shape *at, int32_t low, int32_t count, cell_planes *out)
{
    out->at = at;
    for (int v = 0; v < 4; v++)
        for (int32_t i = 0; i < count; i++)
            out->maximum[v][i] = at->value[v] + part_max_on_interval(at->slope[v][0], low + i, 1);
}

/* Find the cells of a row that the tetrahedron touches, bitwise identical to pliant_parts_touches for each cell. The
 * bound of a coordinate is monotonic along a row, also after rounding, so these cells are contiguous. Return the end;
 * *begin is the first one. */
static int32_t touch_row(const cell_planes *planes, const int32_t low[3], int32_t count, int32_t *begin)
{
    int32_t first = 0, end = count;
    for (int v = 0; v < 4 && first < end; v++) {
        const double *maximum = planes->maximum[v], along = part_max_on_interval(planes->at->slope[v][1], low[1], 1),
                     down = part_max_on_interval(planes->at->slope[v][2], low[2], 1);
        while (first < end && maximum[first] + along + down < -PART_GROWTH) first++;
        while (first < end && maximum[end - 1] + along + down < -PART_GROWTH) end--;
    }
    *begin = first;
    return end;
}

/* Mark the corners of the cells that the tetrahedron touches. */
static void find_touched(part_maker *work)
{
    const int32_t *size = work->box.size;
    const int32_t cells[3] = {size[0] > 1 ? size[0] - 1 : 1, size[1] > 1 ? size[1] - 1 : 1,
                              size[2] > 1 ? size[2] - 1 : 1};
    cell_planes planes;
    memset(work->touched, 0, (size_t)work->count);
    for (int32_t from = 0; from < cells[0]; from += MAX_ROW) {
        const int32_t count = cells[0] - from < MAX_ROW ? cells[0] - from : MAX_ROW;
        begin_rows(&work->at, work->box.low[0] + from, count, &planes);
        for (int32_t k = 0; k < cells[2]; k++)
            for (int32_t j = 0; j < cells[1]; j++) {
                const int32_t low[3] = {work->box.low[0] + from, work->box.low[1] + j, work->box.low[2] + k};
                int32_t begin;
                const int32_t end = touch_row(&planes, low, count, &begin);
                if (begin == end) continue;
                for (int c = 0; c < 4; c++) {
                    const int32_t row[3] = {from + begin, j + (c & 1), k + (c >> 1)};
                    if (row[1] < size[1] && row[2] < size[2])
                        memset(work->touched + part_index_of(size, row), 1, (size_t)(end - begin + (size[0] > 1)));
                }
            }
    }
}

/* Return whether the tetrahedron touches a cell with the link from a voxel along an axis. */
static bool touches_around(const part_maker *work, const int32_t at[3], int axis)
{
    const double one[3] = {1, 1, 1};
    const int32_t *size = work->box.size;
    for (int c = 0; c < 4; c++) {
        double low[3];
        bool there = true;
        for (int d = 0; d < 3; d++) {
            const int32_t cell = at[d] - (d == axis ? 0 : d == (axis + 1) % 3 ? c & 1 : c >> 1);
            there = there && cell >= 0 && cell < (size[d] > 1 ? size[d] - 1 : 1);
            low[d] = work->box.low[d] + cell;
        }
        if (there && pliant_parts_touches(&work->at, low, one)) return true;
    }
    return false;
}

/* Return whether the tetrahedron touches a cell with a severed link. */
static bool touches_severed(const part_maker *work)
{
    for (int32_t n = 0; n < work->count; n++) {
        int32_t at[3];
        if (!work->severed[n]) continue;
        part_place_of(work->box.size, n, at);
        for (int axis = 0; axis < 3; axis++)
            if (work->severed[n] >> axis & 1 && touches_around(work, at, axis)) return true;
    }
    return false;
}

static bool label_own(part_maker *work, int32_t *queued)
{
    const pliant_voxels *voxels = work->voxels;
    const int32_t first = voxels->start[work->tet], cut = work->cut_of[work->tet];
    const int32_t *carrier = cut < 0 ? NULL : work->cuts->voxel_fragment + work->cuts->voxel_start[cut];
    int32_t at[3] = {0}, last = -2;
    for (int32_t n = first; n < voxels->start[work->tet + 1]; n++) {
        int32_t local;
        pliant_place_after(voxels, voxels->voxel[n], &last, at);
        if (!in_box(&work->box, at, &local)) continue;
        if ((work->label[local] = label_of(work, carrier ? carrier[n - first] : work->tet)) < 0) return false;
        work->step[local] = 0;
        work->queue[(*queued)++] = local;
    }
    return true;
}

static void find_walls(part_maker *work)
{
    const int32_t *size = work->box.size;
    for (int32_t k = 0; k < size[2]; k++)
        for (int32_t j = 0; j < size[1]; j++) {
            uint8_t *row = work->wall + size[0] * (j + size[1] * k);
            memset(row, (j == 0) << 2 | (j + 1 == size[1]) << 3 | (k == 0) << 4 | (k + 1 == size[2]) << 5,
                   (size_t)size[0]);
            row[0] |= 1;
            row[size[0] - 1] |= 2;
        }
}

/* Propagate labels from the queued voxels along links to voxels without a label. If several carriers are equally near,
 * the lowest label wins. */
static void spread(part_maker *work, int32_t queued, int steps)
{
    const int32_t *size = work->box.size, stride[3] = {1, size[0], size[0] * size[1]};
    for (int32_t head = 0; head < queued; head++) {
        const int32_t from = work->queue[head];
        if (work->step[from] >= steps) continue;
        for (int d = 0; d < 3; d++)
            for (int direction = -1; direction <= 1; direction += 2) {
                if (work->wall[from] >> (2 * d + (direction > 0)) & 1) continue;
                const int32_t to = from + direction * stride[d];
                if (work->severed[direction > 0 ? from : to] >> d & 1) continue;
                if (work->label[to] < 0) {
                    work->label[to] = work->label[from];
                    work->step[to] = (uint8_t)(work->step[from] + 1);
                    work->queue[queued++] = to;
                } else if (work->step[to] == work->step[from] + 1 && work->label[from] < work->label[to]) {
                    work->label[to] = work->label[from];
                }
            }
    }
}

/* Return a label for a voxel that no link reaches, at a sharp corner of the tetrahedron. Its carrier may share the node
 * at that corner with a fragment. Return NO_LABEL otherwise. */
static int32_t label_by_node(const part_maker *work, int32_t local)
{
    const int32_t *tets = work->body->fine.tets, voxel = scan_voxel(work, local), by = carrier_of(work, voxel);
    int32_t at[3], corner = 0;
    double maximum = -INFINITY;
    pliant_place_of(work->voxels, voxel, at);
    for (int v = 0; v < 4; v++) {
        double weight = work->at.value[v];
        for (int d = 0; d < 3; d++) weight += work->at.slope[v][d] * at[d];
        if (weight > maximum) corner = v;
        maximum = fmax(maximum, weight);
    }
    const int32_t *fragment = (const int32_t *)work->carriers.at + work->first_carrier;
    for (int32_t label = 0; label < work->num_fragments; label++)
        for (int v = 0; v < 4; v++)
            if (tets[4 * (size_t)by + v] == tets[4 * (size_t)fragment[label] + corner]) return label;
    return NO_LABEL;
}

/* Queue the voxels without a label that are connected to a first one. Return their number. */
static int32_t queue_connected_voxels(part_maker *work, int32_t first)
{
    const int32_t *size = work->box.size, stride[3] = {1, size[0], size[0] * size[1]};
    int32_t queued = 0;
    work->label[first] = IN_QUEUE;
    work->queue[queued++] = first;
    for (int32_t head = 0; head < queued; head++) {
        const int32_t from = work->queue[head];
        for (int d = 0; d < 3; d++)
            for (int direction = -1; direction <= 1; direction += 2) {
                const int32_t to = from + direction * stride[d];
                if (work->wall[from] >> (2 * d + (direction > 0)) & 1) continue;
                if (work->severed[direction > 0 ? from : to] >> d & 1 || work->label[to] != NO_LABEL ||
                    !work->wanted[to])
                    continue;
                work->label[to] = IN_QUEUE;
                work->queue[queued++] = to;
            }
    }
    return queued;
}

/* Return the carrier of the majority of the queued voxels; the lowest one at a tie. */
static int32_t majority_carrier(const part_maker *work, int32_t queued)
{
    int32_t best = -1, maximum = 0;
    for (int32_t n = 0; n < queued; n++) work->carried[n] = carrier_of(work, scan_voxel(work, work->queue[n]));
    for (int32_t n = 0; n < queued; n++) {
        const int32_t carrier = work->carried[n];
        int32_t same = 0;
        if (carrier < 0) continue;
        for (int32_t m = n; m < queued; m++) {
            if (work->carried[m] != carrier) continue;
            same++;
            work->carried[m] = -1; /* counted */
        }
        if (same > maximum || (same == maximum && carrier < best)) {
            best = carrier;
            maximum = same;
        }
    }
    return best;
}

/* Give every needed voxel a label. Connected voxels that neither links nor nodes determine get the carrier of their
 * majority. Voxels of air get the label of an adjacent voxel. */
static bool label_others(part_maker *work)
{
    const int32_t *size = work->box.size;
    int32_t queued = 0;
    for (int32_t row = 0; row < size[1] * size[2]; row++) {
        const int32_t *owner = work->voxels->owner + scan_voxel(work, size[0] * row);
        const int32_t *label = work->label + size[0] * row;
        const uint8_t *touched = work->touched + size[0] * row;
        uint8_t *wanted = work->wanted + size[0] * row;
        for (int32_t i = 0; i < size[0]; i++) wanted[i] = (label[i] < 0) & (owner[i] >= 0) & touched[i];
    }
    for (const uint8_t *end = work->wanted + work->count, *at = work->wanted; (at = memchr(at, 1, (size_t)(end - at)));
         at++) {
        const int32_t n = (int32_t)(at - work->wanted);
        work->label[n] = label_by_node(work, n);
        work->by_node = true;
    }
    for (const uint8_t *end = work->wanted + work->count, *at = work->wanted; (at = memchr(at, 1, (size_t)(end - at)));
         at++) {
        const int32_t n = (int32_t)(at - work->wanted);
        if (work->label[n] >= 0) continue;
        const int32_t together = queue_connected_voxels(work, n),
                      label = label_of(work, majority_carrier(work, together));
        if (label < 0) return false;
        for (int32_t m = 0; m < together; m++) work->label[work->queue[m]] = label;
    }
    int32_t air = 0;
    for (int32_t n = 0; n < work->count; n++) air |= (work->label[n] < 0) & work->touched[n];
    for (int32_t n = 0; air && n < work->count; n++) {
        if (work->label[n] < 0) continue;
        work->step[n] = 0;
        work->queue[queued++] = n;
    }
    if (air) spread(work, queued, UINT8_MAX - 1);
    for (int32_t n = 0; n < work->count; n++)
        if (work->label[n] < 0) work->label[n] = 0;
    return true;
}

/* ---- a tetrahedron */

static bool reserve_capacity(part_maker *work)
{
    work->count = work->box.size[0] * work->box.size[1] * work->box.size[2];
    if (work->count <= work->capacity) return true;
    void **blocks[] = {(void **)&work->label,   (void **)&work->queue,   (void **)&work->carried, (void **)&work->step,
                       (void **)&work->severed, (void **)&work->touched, (void **)&work->wanted,  (void **)&work->wall};
    const size_t sizes[] = {sizeof *work->label, sizeof *work->queue, sizeof *work->carried, 1, 1, 1, 1, 1};
    work->capacity = 0;
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) {
        pliant_free(*blocks[b]);
        if (!(*blocks[b] = pliant_calloc((size_t)work->count, sizes[b]))) return false;
    }
    work->capacity = work->count;
    return true;
}

static void write_labels(const part_maker *work, uint16_t *labels)
{
    const int32_t *size = work->box.size,
                  step[3] = {size[0] > 1, size[1] > 1 ? size[0] : 0, size[2] > 1 ? size[0] * size[1] : 0};
    const int32_t cells = size[0] > 1 ? size[0] - 1 : size[0];
    for (int32_t k = 0; k < size[2]; k++)
        for (int32_t j = 0; j < size[1]; j++) {
            const int32_t row = size[0] * (j + size[1] * k);
            const int32_t *label = work->label + row;
            const bool last = (size[1] > 1 && j + 1 == size[1]) || (size[2] > 1 && k + 1 == size[2]);
            for (int32_t i = 0; i < size[0]; i++) labels[row + i] = (uint16_t)label[i];
            for (int32_t i = 0; i < cells && !last; i++) {
                int32_t others = 0;
                for (int c = 1; c < 8; c++)
                    others |=
                        label[i + (c & 1 ? step[0] : 0) + (c & 2 ? step[1] : 0) + (c & 4 ? step[2] : 0)] ^ label[i];
                labels[row + i] |= others == 0 ? PART_UNIFORM : 0;
            }
        }
}

pliant_status pliant_parts_make_box(part_maker *work, int32_t tet, const part_box *box, int32_t maker, part_made *out)
{
    int32_t queued = 0;
    work->tet = tet;
    work->by_node = false;
    work->box = *box;
    if (!reserve_capacity(work)) return pliant_parts_no_memory();
    const bool severed = find_severed(work);
    if (!severed && work->cut_of[tet] < 0) return PLIANT_OK;
    pliant_parts_shape(work, tet, &work->at);
    if (work->cut_of[tet] < 0 && !touches_severed(work)) return PLIANT_OK;
    find_touched(work);
    for (int32_t n = 0; n < work->count; n++) work->label[n] = NO_LABEL;
    *out = (part_made){.carriers = (int32_t)work->carriers.count,
                       .carried_tets = (int32_t)work->carried_tets.count,
                       .labels = work->labels.count,
                       .num_labels = work->count,
                       .maker = -1};
    if (!list_fragments(work) || !label_own(work, &queued)) return pliant_parts_no_memory();
    find_walls(work);
    spread(work, queued, STEPS);
    if (!label_others(work)) return pliant_parts_no_memory();
    if (work->num_carriers > PART_MAX_LABELS)
        return pliant_fail(PLIANT_ERROR_MEMORY, "more than %d fragments meet in one tetrahedron", PART_MAX_LABELS);
    uint16_t *labels = pliant_parts_grow(&work->labels, (size_t)work->count);
    if (!labels) return pliant_parts_no_memory();
    write_labels(work, labels);
    const pliant_status status = pliant_parts_add_carried_tets(work);
    out->maker = maker;
    out->by_node = work->by_node;
    out->num_carriers = work->num_carriers;
    out->num_carried_tets = (int32_t)work->carried_tets.count - out->carried_tets;
    return status;
}
