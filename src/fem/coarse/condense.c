/* Condensation of a submesh on some of its nodes, [H] 1 to 7: the corners of a coarse tetrahedron or cube. */
#include "fem/coarse/submesh.h"
#include "base/dense.h"

#include <string.h>

bool pliant_submesh_condense(pliant_submesh *submesh, int corners, const int32_t *corner, double *out, double *shape)
{
    const int32_t size = 3 * submesh->num_nodes, n = 3 * corners;
    const size_t of_node = 3 * (size_t)n;
    int32_t inner = 0, *slot = submesh->slot; /* index among the inner nodes, or -1 */
    double *kff = submesh->square, *kfc = submesh->work;
    for (int32_t node = 0; node < submesh->num_nodes; node++) slot[node] = submesh->fixed[submesh->node[node]] ? -1 : 0;
    for (int v = 0; v < corners; v++) {
        if (corner[v] < 0) return false;
        slot[corner[v]] = -1;
    }
    for (int32_t node = 0; node < submesh->num_nodes; node++)
        if (slot[node] == 0) slot[node] = inner++;
    const int32_t m = 3 * inner;
    for (int32_t i = 0; i < size; i++) {
        if (slot[i / 3] < 0) continue;
        const int32_t row = 3 * slot[i / 3] + i % 3;
        for (int32_t j = 0; j < size; j++)
            if (slot[j / 3] >= 0)
                kff[(size_t)row * (size_t)m + (size_t)(3 * slot[j / 3] + j % 3)] =
                    submesh->stiffness[(size_t)i * (size_t)size + (size_t)j];
        for (int c = 0; c < n; c++)
            kfc[n * row + c] = -submesh->stiffness[(size_t)i * (size_t)size + (size_t)(3 * corner[c / 3] + c % 3)];
    }
    bool good = pliant_dense_cholesky(m, kff);
    if (good) pliant_dense_cholesky_solve(m, kff, n, kfc); /* N = -Kff^-1 Kfc */
    memset(shape, 0, of_node * (size_t)submesh->num_nodes * sizeof *shape);
    for (int32_t node = 0; node < submesh->num_nodes; node++)
        if (slot[node] >= 0)
            memcpy(shape + of_node * (size_t)node, kfc + of_node * (size_t)slot[node], of_node * sizeof *shape);
    for (int v = 0; v < corners; v++)
        for (int d = 0; d < 3; d++)
            shape[of_node * (size_t)corner[v] + (size_t)(n * d + 3 * v + d)] =
                !submesh->fixed[submesh->node[corner[v]]];
    /* K = Kcc + Kcf N */
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            const double *row = submesh->stiffness + (size_t)(3 * corner[i / 3] + i % 3) * (size_t)size;
            double sum = row[3 * corner[j / 3] + j % 3];
            for (int32_t f = 0; f < size; f++)
                if (slot[f / 3] >= 0) sum += row[f] * shape[of_node * (size_t)(f / 3) + (size_t)(n * (f % 3) + j)];
            out[n * i + j] = sum;
        }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) out[n * i + j] = out[n * j + i] = 0.5 * (out[n * i + j] + out[n * j + i]);
    return good;
}
