/* probes.csv: positions of tissue points after every step. */
#ifndef PLIANT_TOOLS_DEFORM_PROBES_H
#define PLIANT_TOOLS_DEFORM_PROBES_H

#include "tool/path.h"
#include "report/report.h"

#include <stdio.h>

typedef struct deform_probes {
    FILE *file;            /* NULL: the path has no probes */
    pliant_points points;  /* in the mesh of the body with this revision */
    uint64_t revision;
} deform_probes;

/* Create folder/probes.csv with its first rows at time 0. Errors: FILE, MEMORY, ARGUMENT (a point lies outside the
 * tissue). */
pliant_status deform_probes_start(const char *folder, const pliant_path *path, const pliant_data *data,
                                  deform_probes *out);
/* Append a row for every probe. Errors: MEMORY. */
pliant_status deform_probes_add(deform_probes *probes, const pliant_path *path, const pliant_data *data, double time);
/* Close the file. Errors: FILE if the rows could not be written. */
pliant_status deform_probes_end(deform_probes *probes);

#endif
