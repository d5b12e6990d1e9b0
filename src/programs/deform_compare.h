/* Methods beside each other ([H] figures 1 and 2, section 4.1). */
#ifndef PLIANT_TOOLS_DEFORM_COMPARE_H
#define PLIANT_TOOLS_DEFORM_COMPARE_H

#include "deform_run.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The same inputs by every method that --compare names, each into a folder of its name; then DIR/compare.csv with their errors against
 * the last one and, with --pictures, the scan and the volume of every method side by side in DIR/axial.png and so on. */
pliant_status deform_compare(const deform_arguments *arguments, const deform_inputs *inputs);

#ifdef __cplusplus
}
#endif
#endif
