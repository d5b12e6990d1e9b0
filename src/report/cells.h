/* Split the lines of tables written by spreadsheets. */
#ifndef PLIANT_REPORT_CELLS_H
#define PLIANT_REPORT_CELLS_H

#include <stdbool.h>

/* Skip the byte order mark that some spreadsheets write at the beginning of a file. */
char *cells_text(char *line);

/* Return the separator of a header line, which the lines below it use too: a tab, otherwise a semicolon, otherwise a
 * comma. */
char cells_separator(const char *line);

/* Split a line in place into at most `max_cells` cells, without surrounding blanks and quotes. A decimal comma becomes
 * a point. Return the number of cells. */
int cells_split(char *line, char separator, int max_cells, char **cells);

/* Read a cell that contains one finite number and nothing else. */
bool cells_number(const char *text, double *out);

#endif
