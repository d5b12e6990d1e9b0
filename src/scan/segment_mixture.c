/* A mixture of Gaussians on a histogram, computed with logarithms (Dempster, Laird and Rubin 1977). */
#include "scan/segment.h"

#include <math.h>
#include <string.h>

enum { TRIAL_PASSES = 30, FINAL_PASSES = 200 };

/* Voxels per independent sample. Neighbouring voxels are correlated: the scanner's resolution and the noise extend over
 * a few voxels along each axis. Without this factor BIC would always choose the largest number of classes. */
static const double voxels_a_sample = 64;

static double value_of(const segment_histogram *histogram, int bin)
{
    return histogram->low + (bin + 0.5) * histogram->width;
}

static double log_density(const pliant_segment_class *c, double value)
{
    double difference = (value - c->mean) / c->deviation;
    return log(c->weight) - log(c->deviation) - 0.91893853320467274178 /* log(2 pi) / 2 */ -
           0.5 * difference * difference;
}

/* Return the logarithm of the sum of exponentials. part: out: fraction of each. */
static double responsibilities(const pliant_segment_class *classes, int count, double value, double *part)
{
    double largest = -INFINITY, sum = 0;
    for (int k = 0; k < count; k++) {
        part[k] = classes[k].weight > 0 ? log_density(classes + k, value) : -INFINITY;
        largest = fmax(largest, part[k]);
    }
    for (int k = 0; k < count; k++) sum += part[k] = exp(part[k] - largest);
    for (int k = 0; k < count; k++) part[k] /= sum;
    return largest + log(sum);
}

/* Iterate until the mean log likelihood of a voxel is constant, and return it. */
static double maximize(const segment_histogram *histogram, pliant_segment_class *classes, int count, int passes)
{
    /* Lower limit of a class's width: the resolution of bins and noise. Otherwise a spike (padding) would have infinite
     * likelihood, and air would be split. Upper limit: the width of tissue. Otherwise one class would cover the range
     * between all others. */
    const double narrowest = fmax(1.5 * histogram->width, 0.5 * histogram->noise),
                 widest = 0.04 * SEGMENT_BINS * histogram->width;
    double likelihood = -INFINITY;
    for (int pass = 0; pass < passes; pass++) {
        double sums[PLIANT_MAX_CLASSES][3], part[PLIANT_MAX_CLASSES], now = 0;
        memset(sums, 0, sizeof sums);
        for (int bin = 0; bin < SEGMENT_BINS; bin++) {
            if (histogram->count[bin] == 0) continue;
            double value = value_of(histogram, bin);
            now += histogram->count[bin] * responsibilities(classes, count, value, part);
            for (int k = 0; k < count; k++) {
                double fraction = histogram->count[bin] * part[k], difference = value - classes[k].mean;
                sums[k][0] += fraction;
                sums[k][1] += fraction * difference;
                sums[k][2] += fraction * difference * difference;
            }
        }
        for (int k = 0; k < count; k++) {
            classes[k].weight = sums[k][0] / histogram->total;
            if (!(sums[k][0] > 0)) continue;
            double shift = sums[k][1] / sums[k][0];
            classes[k].mean += shift;
            classes[k].deviation =
                fmin(fmax(sqrt(fmax(sums[k][2] / sums[k][0] - shift * shift, 0)), narrowest), widest);
        }
        now /= histogram->total;
        if (now - likelihood < 1e-7) return now;
        likelihood = now;
    }
    return likelihood;
}

/* Split a class into two adjacent classes. */
static void split(pliant_segment_class *classes, int count, int which)
{
    pliant_segment_class *one = classes + which, *other = classes + count;
    *other = *one;
    one->weight = other->weight = 0.5 * one->weight;
    one->mean -= 0.8 * one->deviation;
    other->mean += 0.8 * other->deviation;
    one->deviation = other->deviation = 0.6 * one->deviation;
}

static double criterion_of(const segment_histogram *histogram, double likelihood, int count)
{
    double samples = fmax(histogram->total / voxels_a_sample, 2);
    return -2 * likelihood * samples + (3 * count - 1) * log(samples);
}

static void sort(pliant_segment_class *classes, int count)
{
    for (int i = 1; i < count; i++)
        for (int k = i; k > 0 && classes[k].mean < classes[k - 1].mean; k--) {
            pliant_segment_class swap = classes[k];
            classes[k] = classes[k - 1];
            classes[k - 1] = swap;
        }
}

/* Combine four bins into one of them, for trials that need not be exact: a quarter of the work. */
static void coarsen(const segment_histogram *histogram, segment_histogram *out)
{
    *out = *histogram;
    memset(out->count, 0, sizeof out->count);
    for (int bin = 0; bin < SEGMENT_BINS; bin++) out->count[bin / 4 * 4 + 1 + (bin / 4 & 1)] += histogram->count[bin];
}

/* Choose the best split on the coarse histogram, and iterate it to the end on the fine one. Return its likelihood. */
static double grow(const segment_histogram *histogram, const segment_histogram *coarse, pliant_segment_class *classes,
                   int count)
{
    pliant_segment_class best[PLIANT_MAX_CLASSES];
    double highest = -INFINITY;
    for (int which = 0; which < count; which++) {
        pliant_segment_class trial[PLIANT_MAX_CLASSES];
        memcpy(trial, classes, sizeof trial);
        split(trial, count, which);
        double likelihood = maximize(coarse, trial, count + 1, TRIAL_PASSES);
        if (likelihood <= highest) continue;
        highest = likelihood;
        memcpy(best, trial, sizeof best);
    }
    memcpy(classes, best, sizeof best);
    return maximize(histogram, classes, count + 1, FINAL_PASSES);
}

void segment_fit(const segment_histogram *histogram, int maximum, segment_fits *out)
{
    pliant_segment_class classes[PLIANT_MAX_CLASSES] = {{.weight = 1, .mean = value_of(histogram, SEGMENT_BINS / 2),
                                                         .deviation = 0.25 * SEGMENT_BINS * histogram->width}};
    segment_histogram coarse;
    coarsen(histogram, &coarse);
    for (int count = 1; count <= maximum; count++) {
        out->likelihood[count - 1] =
            count == 1 ? maximize(histogram, classes, 1, FINAL_PASSES) : grow(histogram, &coarse, classes, count - 1);
        memcpy(out->classes[count - 1], classes, sizeof classes);
    }
}

int segment_max_classes(const pliant_segment_options *options)
{
    return options->classes > 0 ? options->classes : options->max_classes;
}

int segment_choose_mixture(const segment_histogram *histogram, const pliant_segment_options *options,
                           const segment_fits *fits, pliant_segment_class *out, double *criterion)
{
    int best = 0;
    for (int count = 1; count <= segment_max_classes(options); count++) {
        double now = criterion_of(histogram, fits->likelihood[count - 1], count);
        if (best > 0 && options->classes == 0 && now >= *criterion) continue;
        *criterion = now;
        best = count;
    }
    memcpy(out, fits->classes[best - 1], sizeof fits->classes[best - 1]);
    sort(out, best);
    return best;
}

void segment_log_densities(const segment_histogram *histogram, const pliant_segment_class *classes, int count,
                           float *out)
{
    for (int bin = 0; bin < SEGMENT_BINS; bin++)
        for (int k = 0; k < PLIANT_MAX_CLASSES; k++)
            out[bin * PLIANT_MAX_CLASSES + k] =
                k < count && classes[k].weight > 0 ? (float)log_density(classes + k, value_of(histogram, bin)) : -1e30f;
}
