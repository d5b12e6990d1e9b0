/* Side of the cells of a grid of tetrahedra. It is enlarged while a box covers too many cells, or while all boxes
 * cover more cells than the buffer can hold. Later it returns to its initial value. */
#ifndef PLIANT_CUDA_OVERLAPS_SIDE_H
#define PLIANT_CUDA_OVERLAPS_SIDE_H

#include <math.h>
#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { GPU_MAX_CELLS = 16 }; /* maximum number of cells that a box covers along an axis */
#define GPU_MAX_FINE_CELLS 1e18

typedef struct gpu_cells {
    double side;           /* initial side [m] */
    /* factors of the side: by the widest box of the last search, and by the number of entries; at least 1 */
    double widest, spread;
} gpu_cells;

static inline double gpu_cells_coarser(const gpu_cells *cells) { return fmax(cells->widest, cells->spread); }

/* Return the maximum number of cells of the initial side that a box may cover along an axis. */
static inline unsigned long long gpu_cells_max(const gpu_cells *cells)
{
    return (unsigned long long)fmin(GPU_MAX_CELLS * gpu_cells_coarser(cells), GPU_MAX_FINE_CELLS);
}

/* Update the side after a search. Return true if the cells were enlarged and the search must be repeated.
 * @param widest number of cells of the initial side that the widest box covers, if it covers too many
 * @param entries number of entries in the grid; @param maximum their limit */
static inline bool gpu_cells_update(gpu_cells *cells, unsigned long long widest, unsigned long long entries,
                                    unsigned long long maximum)
{
    const double goes_on = 2; /* factor by which the box may grow in the next step */
    const double wanted = widest > GPU_MAX_CELLS ? goes_on * (double)widest / GPU_MAX_CELLS : 1;
    const bool too_wide = widest > gpu_cells_max(cells), too_many = !too_wide && entries > maximum;
    /* halve the side only if eight times as many entries fit */
    if (too_many) cells->spread = 2 * gpu_cells_coarser(cells);
    else if (!too_wide && cells->spread > 1 && entries <= maximum / 16) cells->spread = fmax(cells->spread / 2, 1);
    if (!too_many) cells->widest = wanted;
    return too_wide || too_many;
}

#ifdef __cplusplus
}
#endif
#endif
