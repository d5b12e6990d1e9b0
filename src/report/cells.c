#include "report/cells.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

char *cells_text(char *line) { return line + (strncmp(line, "\xEF\xBB\xBF", 3) == 0 ? 3 : 0); }

char cells_separator(const char *line)
{
    char found = ',';
    for (bool quoted = false; *line; line++) {
        if (*line == '"') quoted = !quoted;
        else if (!quoted && *line == '\t') return '\t';
        else if (!quoted && *line == ';') found = ';';
    }
    return found;
}

/* Return the end of a cell, skipping quoted text; NULL: the end of the line. */
static char *end_of_cell(char *at, char separator)
{
    char *quote = at + strspn(at, separator == '\t' ? " " : " \t");
    while (*quote == '"') {
        quote = strchr(quote + 1, '"');
        if (!quote) break;
        at = ++quote;
    }
    return strchr(at, separator);
}

/* Convert 12,5 to 12.5. A cell with two commas, or a comma and a point, is no number and stays unchanged. */
static void read_decimal_comma(char *cell)
{
    static const char digits[] = "0123456789";
    char *comma = cell + strspn(cell, "+-");
    comma += strspn(comma, digits);
    if (*comma == ',' && comma[1] && strchr(digits, comma[1]) && !strpbrk(comma + 1, ",.")) *comma = '.';
}

int cells_split(char *line, char separator, int max_cells, char **cells)
{
    static const char around[] = " \"'\r\n";
    int count = 0;
    for (char *at = cells_text(line); at && count < max_cells;) {
        char *next = end_of_cell(at, separator);
        if (next) *next++ = '\0';
        at += strspn(at, around);
        for (size_t length = strlen(at); length > 0 && strchr(around, at[length - 1]); length--) at[length - 1] = '\0';
        read_decimal_comma(at);
        cells[count++] = at;
        at = next;
    }
    return count;
}

bool cells_number(const char *text, double *out)
{
    char *end;
    *out = strtod(text, &end);
    return end != text && *end == '\0' && isfinite(*out);
}
