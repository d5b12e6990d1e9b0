/* Cells of a table's line, as spreadsheets write them. */
#ifndef PLIANT_REPORT_CELLS_H
#define PLIANT_REPORT_CELLS_H

#include <stdbool.h>

/* Skip the byte order mark that some spreadsheets write at the beginning of a file. */
char *cells_text(char *line);

/* Return what separates the cells of a header's line and of the lines below it: a tab, else a semicolon, else a comma. */
char cells_separator(const char *line);

/* Split a line in place into at most `max_cells` cells, without the blanks and quotes around them. Return their number.
 * A decimal comma becomes a point. */
int cells_split(char *line, char separator, int max_cells, char **cells);

/* Read a cell that is one finite number and nothing else. */
bool cells_number(const char *text, double *out);

#endif
