/* Draw the pictures of a report with Python and matplotlib, if installed. */
#ifndef PLIANT_TOOLS_REPORT_PLOT_H
#define PLIANT_TOOLS_REPORT_PLOT_H

#include "pliant/status.h"

extern const unsigned char report_plot_script[]; /* contents of src/report/plot.py */
extern const unsigned long report_plot_script_size;

/* Write folder/plot.py and run it for one setup. *drawn is false if Python or matplotlib is missing or the script
 * failed, which is logged. Errors: FILE (the script cannot be written). */
pliant_status report_plot(const char *folder, const char *setup, bool *drawn);

#endif
