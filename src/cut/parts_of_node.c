/* The groups of tetrahedra around a node that a cut separates. */
#include "topology/sorted_numbers.h"
#include "cut/subdivide.h"

bool pliant_split_has_severed(const cut_splitting *work)
{
    for (int32_t i = 0; i < work->num_around; i++)
        for (int c = 0; c < 4; c++)
            if (c != work->around[i] % 4 && work->severed[work->around[i] / 4 * 4 + c]) return true;
    return false;
}

int32_t pliant_split_find_parts(const cut_splitting *work, int32_t *part, int32_t *whole)
{
    const int32_t count = work->num_around;
    for (int32_t i = 0; i < count; i++) part[i] = whole[i] = i;
    for (int32_t i = 0; i < count; i++)
        for (int32_t j = i + 1; j < count; j++) {
            const int32_t s = work->around[i] / 4, t = work->around[j] / 4;
            const int32_t *corners = work->corners + 4 * (size_t)s, *others = work->corners + 4 * (size_t)t;
            for (int c = 0; c < 4; c++) {
                /* across a severed face the node numbers may already differ */
                const int32_t severed = work->severed[4 * (size_t)s + (size_t)c] - 1;
                if (c == work->around[i] % 4) continue;
                if (severed >= 0 ? severed / 4 == t : pliant_split_opposite(corners, c, others) >= 0) {
                    pliant_set_join(whole, i, j);
                    if (severed < 0) pliant_set_join(part, i, j);
                }
            }
        }
    int32_t parts = 0;
    for (int32_t i = 0; i < count; i++)
        if (whole[i] == i) pliant_set_join(part, 0, i);
    for (int32_t i = 0; i < count; i++) parts += part[i] == i;
    return parts;
}
