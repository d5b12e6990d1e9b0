#include "options_table.h"

#include "pliant/scene.h"

/* escape bars, which would end the cell */
static void print_cell(FILE *file, const char *text)
{
    for (; *text; ++text) {
        if (*text == '|') fputc('\\', file);
        fputc(*text, file);
    }
}

void options_table_print(FILE *file)
{
    size_t count;
    const pliant_option_info *options = pliant_scene_options(&count);
    fputs("| option | default | range | unit | what it does |\n|---|---|---|---|---|\n", file);
    for (size_t n = 0; n < count; ++n) {
        const char *cells[] = {options[n].default_value, options[n].range, options[n].unit, options[n].text};
        fprintf(file, "| `%s/%s` |", options[n].group, options[n].name);
        for (size_t cell = 0; cell < sizeof cells / sizeof *cells; ++cell) {
            fputc(' ', file);
            print_cell(file, cells[cell]);
            fputs(*cells[cell] ? " |" : "|", file);
        }
        fputc('\n', file);
    }
}
