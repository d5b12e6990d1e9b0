/* How wide the cells of a grid of tetrahedra are: as asked for, wider while a box would lie in too many of them, or all
 * boxes in more than there is room for, and as asked for again after that. */
#ifndef PLIANT_CUDA_OVERLAPS_SIDE_H
#define PLIANT_CUDA_OVERLAPS_SIDE_H

#include <math.h>
#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { GPU_MOST_CELLS = 16 }; /* that a box lies in along an axis */
#define GPU_MOST_FINE_CELLS 1e18

typedef struct gpu_cells {
    double side;           /* that was asked for [m] */
    double widest, spread; /* times that, by the widest box of the last search, and by how many places boxes have taken; 1 at least */
} gpu_cells;

static inline double gpu_cells_coarser(const gpu_cells *cells) { return fmax(cells->widest, cells->spread); }

/* how many cells of the side that was asked for a box may lie in, along an axis */
static inline unsigned long long gpu_cells_most(const gpu_cells *cells)
{
    return (unsigned long long)fmin(GPU_MOST_CELLS * gpu_cells_coarser(cells), GPU_MOST_FINE_CELLS);
}

/* After a search. widest: in how many such cells the widest box lies, those in too many alone; entries: places in the
 * grid, of which there may be `most`. true: cells are wider now, and it is to be made again */
static inline bool gpu_cells_follow(gpu_cells *cells, unsigned long long widest, unsigned long long entries, unsigned long long most)
{
    const double goes_on = 2; /* times, that the box may grow in the next step */
    const double wanted = widest > GPU_MOST_CELLS ? goes_on * (double)widest / GPU_MOST_CELLS : 1;
    const bool too_wide = widest > gpu_cells_most(cells), too_many = !too_wide && entries > most;
    if (too_many) cells->spread = 2 * gpu_cells_coarser(cells);
    else if (!too_wide && cells->spread > 1 && entries <= most / 16) cells->spread = fmax(cells->spread / 2, 1); /* at most eight times as many, then */
    if (!too_many) cells->widest = wanted;
    return too_wide || too_many;
}

#ifdef __cplusplus
}
#endif
#endif
