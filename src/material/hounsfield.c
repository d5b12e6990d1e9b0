/* Checks whether a scan's values are Hounsfield units, as the built-in material table requires. */
#include "base/fail.h"
#include "material/material.h"
#include "scan/volume.h"

enum { PERCENTILES = 101 };

/* Return the threshold between air and tissue: it divides the percentiles into the two groups with the maximum
 * distance, weighted by their sizes (N. Otsu, A threshold selection method from gray-level histograms, 1979). */
static double air_threshold(const double value[PERCENTILES])
{
    double all = 0, below = 0, best = -1, threshold = value[0];
    for (int n = 0; n < PERCENTILES; n++) all += value[n];
    for (int n = 1; n < PERCENTILES; n++) {
        below += value[n - 1];
        double difference = (all - below) / (PERCENTILES - n) - below / n,
               variance = (double)n * (PERCENTILES - n) * difference * difference;
        if (!(variance > best)) continue;
        best = variance;
        threshold = 0.5 * (value[n - 1] + value[n]);
    }
    return threshold;
}

/* Fat, lung and the air around a body are below this value [HU], in the built-in table as in every CT. */
static const double darkest_soft_tissue = -20;
/* Tissue and metal are below this value [HU]. Unsigned or converted padding has values such as 32767 and 64511. */
static const double brightest_metal = 31000;
static const double min_fraction = 1e-3;

static pliant_status fail_without_table(const pliant_volume *scan, const char *reason)
{
    double percent[PERCENTILES], value[PERCENTILES];
    for (int n = 0; n < PERCENTILES; n++) percent[n] = n;
    pliant_status status = pliant_volume_percentiles(scan, PERCENTILES, percent, value);
    if (status != PLIANT_OK) return status;
    double air = air_threshold(value);
    return pliant_fail(
        PLIANT_ERROR_MATERIAL,
        "%s: %s; the built-in materials are ranges of Hounsfield units (CT). Name a table for it: material: {file: "
        "mine.yaml}, with ranges of its intensities (1st to 99th percentile: %.4g to %.4g), such as\n"
        "materials:\n"
        "  - {name: air, young_modulus: 10, poisson_ratio: 0, density: 1.2, empty: true, range: [-1e9, %.4g]}\n"
        "  - {name: tissue, young_modulus: 5000, poisson_ratio: 0.45, density: 1050, range: [%.4g, 1e9]}\n"
        "or with the labels of a label map (material/labels). Use fixed regions of the scene instead of bone (fixed: "
        "boxes, planes). pliant_segment shows the intensities of the tissues. If these are Hounsfield units "
        "nevertheless, name launch/materials/abdomen_ct.yaml",
        scan->id[0] ? scan->id : "the scan", reason, value[1], value[PERCENTILES - 2], air, air);
}

pliant_status pliant_material_default_check(const pliant_volume *scan)
{
    const bool says_ct = scan->modality == PLIANT_MODALITY_CT;
    if (scan->modality == PLIANT_MODALITY_MR) return fail_without_table(scan, "its header says MR");
    if (scan->modality == PLIANT_MODALITY_OTHER)
        return fail_without_table(scan, "its header names another modality than CT");
    ptrdiff_t voxels = (ptrdiff_t)pliant_geometry_voxels(&scan->geometry), dark = 0, bright = 0;
#pragma omp parallel for schedule(static) reduction(+ : dark, bright)
    for (ptrdiff_t v = 0; v < voxels; v++) {
        dark += pliant_volume_value(scan, (size_t)v) < darkest_soft_tissue;
        bright += pliant_volume_value(scan, (size_t)v) > brightest_metal;
    }
    if ((double)bright >= min_fraction * (double)voxels)
        return fail_without_table(scan,
                                  "one voxel in a thousand or more is above 31000, which is padding outside the image "
                                  "and would become bone: give "
                                  "these voxels the value of air (-1024), or name them by PixelPaddingValue");
    if ((double)dark >= min_fraction * (double)voxels) return PLIANT_OK;
    return fail_without_table(
        scan,
        says_ct
            ? "its header says CT, but fewer than one voxel in a thousand is below -20, as air and fat are: "
              "RescaleIntercept or "
              "RescaleSlope may be missing (add them as the scanner wrote them, -1024 and 1 as a rule)"
            : "its header does not say CT, and fewer than one voxel in a thousand is below -20, as air and fat are");
}
