/* Choose a scene's settings in a program, and write the tables and the picture to a folder. */
#ifndef PLIANT_TOOLS_CHOICE_OUTPUT_H
#define PLIANT_TOOLS_CHOICE_OUTPUT_H

#include "pliant/report.h"

/* Run pliant_choose with progress on the console, and write the tried settings to FOLDER/choice. If the scene does not
 * request a choice, nothing is written. Errors: as for pliant_choose, FILE. */
pliant_status choice_output(const pliant_report_input *input, const char *folder, bool pictures, pliant_choice *out);

#endif
