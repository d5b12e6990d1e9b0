/* Choosing a scene's settings in a program: its tables and its picture go to a folder. */
#ifndef PLIANT_TOOLS_CHOICE_OUTPUT_H
#define PLIANT_TOOLS_CHOICE_OUTPUT_H

#include "pliant/report.h"

#ifdef __cplusplus
extern "C" {
#endif

/* pliant_choose, with progress on the console; what was tried is written to FOLDER/choice. A scene that does not ask for it
 * writes nothing. Errors: as of pliant_choose, FILE. */
pliant_status choice_output(const pliant_report_input *input, const char *folder, bool pictures, pliant_choice *out);

#ifdef __cplusplus
}
#endif
#endif
