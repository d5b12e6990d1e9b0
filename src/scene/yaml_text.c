/* Write words and numbers as YAML. */
#include "scene/yaml.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void add_char(pliant_text_out *text, char c)
{
    if (text->length + 1 < text->capacity) {
        text->out[text->length] = c;
        text->out[text->length + 1] = '\0';
    }
    ++text->length;
}

void pliant_text_add(pliant_text_out *text, const char *words)
{
    for (; *words; ++words) add_char(text, *words);
}

void pliant_text_add_real(pliant_text_out *text, double value)
{
    char digits[40];
    for (int precision = 6; precision <= 17; ++precision) {
        snprintf(digits, sizeof digits, "%.*g", precision, value);
        if (strtod(digits, NULL) == value) break; /* snprintf and strtod use the same locale */
    }
    for (char *c = digits; *c; ++c) add_char(text, strchr("+-0123456789e", *c) ? *c : '.');
}

void pliant_text_add_quoted(pliant_text_out *text, const char *words)
{
    add_char(text, '"');
    for (; *words; ++words) {
        const unsigned char c = (unsigned char)*words;
        char escaped[5];
        if (c < 0x20 || c == 0x7f) { /* not printable (YAML 1.2, 5.1 and 5.7) */
            snprintf(escaped, sizeof escaped, "\\x%02X", c);
            pliant_text_add(text, escaped);
            continue;
        }
        if (c == '"' || c == '\\') add_char(text, '\\');
        add_char(text, *words);
    }
    add_char(text, '"');
}

void pliant_text_add_reals(pliant_text_out *text, const double *values, int count)
{
    for (int i = 0; i < count; ++i) {
        pliant_text_add(text, i ? ", " : "[");
        pliant_text_add_real(text, values[i]);
    }
    pliant_text_add(text, "]");
}
