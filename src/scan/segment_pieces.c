/* Connected pieces of one class, and absorption of small pieces. */
#include "base/fail.h"
#include "base/memory.h"
#include "base/union_find.h"
#include "scan/segment.h"

pliant_status segment_connect(const int32_t size[3], const uint8_t *class_of_voxel, int32_t *piece, int32_t *count)
{
    const int32_t row = size[0], slice = size[0] * size[1], voxels = slice * size[2];
    int32_t pieces = 0;
    for (int32_t k = 0, v = 0; k < size[2]; k++)
        for (int32_t j = 0; j < size[1]; j++)
            for (int32_t i = 0; i < size[0]; i++, v++) {
                uint8_t c = class_of_voxel[v];
                bool along = i > 0 && class_of_voxel[v - 1] == c;
                piece[v] = along ? piece[v - 1] : v;
                /* If the previous voxel and its neighbour are of the same class, they have been joined already. */
                if (j > 0 && class_of_voxel[v - row] == c && !(along && class_of_voxel[v - row - 1] == c))
                    pliant_set_join(piece, v, v - row);
                if (k > 0 && class_of_voxel[v - slice] == c && !(along && class_of_voxel[v - slice - 1] == c))
                    pliant_set_join(piece, v, v - slice);
            }
    /* Roots come before their members. Number n is stored as -1 - n until all are set. */
    for (int32_t v = 0; v < voxels; v++) {
        int32_t parent = piece[v];
        if (parent == v) piece[v] = -1 - pieces++;
        else piece[v] = piece[parent];
    }
    for (int32_t v = 0; v < voxels; v++) piece[v] = -1 - piece[v];
    *count = pieces;
    return PLIANT_OK;
}

pliant_status segment_absorb(const int32_t size[3], const int32_t *piece, int32_t count, double minimum,
                             uint8_t *class_of_voxel)
{
    const int32_t step[3] = {1, size[0], size[0] * size[1]}, voxels = size[0] * size[1] * size[2];
    int32_t *members = pliant_calloc((size_t)count, sizeof *members),
            *queue = pliant_calloc((size_t)voxels, sizeof *queue);
    uint8_t *waits = pliant_calloc((size_t)voxels, 1);
    pliant_status status = members && queue && waits ? PLIANT_OK : pliant_fail_memory("the specks");
    if (status != PLIANT_OK) goto done;
    int32_t waiting = 0, end = 0;
    for (int32_t v = 0; v < voxels; v++) members[piece[v]]++;
    for (int32_t v = 0; v < voxels; v++) waiting += waits[v] = members[piece[v]] < minimum;
    if (waiting == 0 || waiting == voxels) goto done;
    /* First absorb voxels adjacent to remaining pieces, then voxels adjacent to those, and so on. */
    for (int32_t next = -1; next < end; next++)
        for (int32_t v = next < 0 ? 0 : queue[next], last = next < 0 ? voxels : v + 1; v < last; v++) {
            if (next < 0 && waits[v]) continue;
            const int32_t at[3] = {v % size[0], v / size[0] % size[1], v / step[2]};
            for (int side = 0; side < 6; side++) {
                int d = side / 2;
                if (side & 1 ? at[d] + 1 >= size[d] : at[d] == 0) continue;
                int32_t neighbour = side & 1 ? v + step[d] : v - step[d];
                if (waits[neighbour] != 1) continue;
                waits[neighbour] = 2; /* in the queue */
                class_of_voxel[neighbour] = class_of_voxel[v];
                queue[end++] = neighbour;
            }
        }
done:
    PLIANT_FREE(members, queue, waits);
    return status;
}
