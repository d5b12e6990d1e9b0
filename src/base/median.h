/* Points with numbers, and their split at a median, for trees of boxes. */
#ifndef PLIANT_BASE_MEDIAN_H
#define PLIANT_BASE_MEDIAN_H

#include <stdbool.h>
#include <stdint.h>

typedef struct pliant_numbered_point {
    double at[3];
    int32_t number;
} pliant_numbered_point;

static inline bool pliant_comes_before(const pliant_numbered_point *a, const pliant_numbered_point *b, int axis)
{
    return a->at[axis] != b->at[axis] ? a->at[axis] < b->at[axis] : a->number < b->number;
}

/* Reorder the points [first, last] so that all points before the index `middle` are below its point (Hoare). */
static inline void pliant_split_at_median(pliant_numbered_point *of, int32_t first, int32_t last, int32_t middle,
                                          int axis)
{
    while (first < last) {
        const pliant_numbered_point pivot = of[first + (last - first) / 2];
        int32_t i = first, j = last;
        while (i <= j) {
            while (pliant_comes_before(of + i, &pivot, axis)) i++;
            while (pliant_comes_before(&pivot, of + j, axis)) j--;
            if (i > j) break;
            const pliant_numbered_point other = of[i];
            of[i++] = of[j];
            of[j--] = other;
        }
        if (middle <= j) last = j;
        else if (middle >= i) first = i;
        else return;
    }
}

#endif
