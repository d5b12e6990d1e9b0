/* The pictures of a report, drawn by Python where it and matplotlib are there. */
#ifndef PLIANT_TOOLS_REPORT_PLOT_H
#define PLIANT_TOOLS_REPORT_PLOT_H

#include "pliant/status.h"

#ifdef __cplusplus
extern "C" {
#endif

extern const unsigned char report_plot_script[]; /* src/report/plot.py */
extern const unsigned long report_plot_script_size;

/* Writes folder/plot.py and runs it for one setup. *drawn: false when Python or matplotlib is missing, or the script
 * failed; why it did is in the log. Errors: FILE (the script cannot be written). */
pliant_status report_plot(const char *folder, const char *setup, bool *drawn);

#ifdef __cplusplus
}
#endif
#endif
