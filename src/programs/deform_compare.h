/* Compare several methods ([H] figures 1 and 2, section 4.1). */
#ifndef PLIANT_TOOLS_DEFORM_COMPARE_H
#define PLIANT_TOOLS_DEFORM_COMPARE_H

#include "deform_run.h"

/* Run the same inputs with every method that --compare names, each with its own folder. Then write DIR/compare.csv with
 * the errors relative to the last method. With --pictures, also write DIR/axial.png and so on, with the scan and the
 * volumes of all methods side by side. */
pliant_status deform_compare(const deform_arguments *arguments, const deform_inputs *inputs);

#endif
