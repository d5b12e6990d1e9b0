#include "material/names.h"
#include "material/material.h"

#include <ctype.h>
#include <stdio.h>
#include <string.h>

enum { LONGEST = 64, MAX_WORDS = 32 };

/* A name as lower-case words without separators. */
typedef struct words {
    char text[LONGEST];
    const char *word[MAX_WORDS]; /* in text, in alphabetical order */
    size_t length[MAX_WORDS];
    int count;
} words;

static bool is_letter(char c) { return isalnum((unsigned char)c) || (unsigned char)c >= 0x80; }

static int compare_words(const words *w, int a, const char *other, size_t length)
{
    const size_t common = w->length[a] < length ? w->length[a] : length;
    const int order = memcmp(w->word[a], other, common);
    return order ? order : (w->length[a] > length) - (w->length[a] < length);
}

static void split(const char *name, words *out)
{
    size_t used = 0;
    memset(out, 0, sizeof *out);
    while (*name && used + 1 < LONGEST) {
        if (!is_letter(*name)) {
            ++name;
            continue;
        }
        const char *word = out->text + used;
        for (; is_letter(*name) && used + 1 < LONGEST; ++name) out->text[used++] = (char)tolower((unsigned char)*name);
        const size_t length = (size_t)(out->text + used - word);
        if (out->count == MAX_WORDS) continue;
        int at = out->count++;
        for (; at > 0 && compare_words(out, at - 1, word, length) > 0; --at) {
            out->word[at] = out->word[at - 1];
            out->length[at] = out->length[at - 1];
        }
        out->word[at] = word;
        out->length[at] = length;
    }
}

static bool same_words(const words *a, const words *b)
{
    bool same = a->count == b->count;
    for (int n = 0; same && n < a->count; ++n) same = compare_words(a, n, b->word[n], b->length[n]) == 0;
    return a->count > 0 && (same || strcmp(a->text, b->text) == 0);
}

bool pliant_same_name(const char *a, const char *b)
{
    words first, second;
    split(a, &first);
    split(b, &second);
    return same_words(&first, &second);
}

/* Find a material by name. An exact match has priority. */
int pliant_material_named(const pliant_material_table *table, const char *name)
{
    words wanted;
    if (!name[0]) return -1;
    for (uint32_t m = 0; m < table->num_materials; ++m) {
        const pliant_material *material = table->materials + m;
        if (strcmp(material->name, name) == 0) return (int)m;
        for (uint32_t s = 0; s < material->num_segments; ++s)
            if (strcmp(material->segments[s], name) == 0) return (int)m;
    }
    split(name, &wanted);
    for (int own = 1; own >= 0; --own)
        for (uint32_t m = 0; m < table->num_materials; ++m) {
            const pliant_material *material = table->materials + m;
            for (uint32_t s = 0; s < (own ? 1 : material->num_segments); ++s) {
                words there;
                split(own ? material->name : material->segments[s], &there);
                if (same_words(&wanted, &there)) return (int)m;
            }
        }
    return -1;
}

static int find_label(const pliant_material_table *table, uint32_t label)
{
    for (uint32_t m = 0; m < table->num_materials; ++m)
        for (uint32_t l = 0; l < table->materials[m].num_labels; ++l)
            if (table->materials[m].labels[l] == label) return (int)m;
    return -1;
}

/* Return whether a name is a default name of a program: "Segment_3", "Label 3", "". */
static bool is_numbered(const char *name)
{
    words w;
    split(name, &w);
    const char *rest = strncmp(w.text, "segment", 7) == 0 ? w.text + 7
                       : strncmp(w.text, "label", 5) == 0 ? w.text + 5
                                                          : NULL;
    return w.count == 0 || (rest && rest[strspn(rest, "0123456789")] == '\0');
}

int pliant_segment_match_of(const pliant_material_table *table, const pliant_label_segment *segment,
                            pliant_segment_match *match)
{
    const struct {
        const char *name;
        pliant_segment_match match;
    } tries[] = {{segment->name, PLIANT_SEGMENT_BY_NAME},
                 {segment->identifier, PLIANT_SEGMENT_BY_IDENTIFIER},
                 {segment->terminology, PLIANT_SEGMENT_BY_TERMINOLOGY}};
    int found = -1;
    pliant_segment_match how = PLIANT_SEGMENT_UNKNOWN;
    for (size_t n = 0; !segment->is_class && found < 0 && n < sizeof tries / sizeof *tries; ++n) {
        found = pliant_material_named(table, tries[n].name);
        how = tries[n].match;
    }
    if (segment->is_class || (found < 0 && is_numbered(segment->name) && segment->value == segment->label)) {
        found = find_label(table, segment->value);
        how = PLIANT_SEGMENT_BY_VALUE;
    }
    *match = found < 0 ? PLIANT_SEGMENT_UNKNOWN : how;
    return found;
}

int pliant_material_of_segment(const pliant_material_table *table, const pliant_label_segment *segment)
{
    pliant_segment_match match;
    return pliant_segment_match_of(table, segment, &match);
}

/* Return the edit distance of two names (V. Levenshtein, Soviet Physics Doklady 10:707, 1966); 1 if one contains the
 * other. */
static int distance(const char *a, const char *b)
{
    int row[LONGEST + 1];
    const int length = (int)strlen(b);
    if (*a && *b && (strstr(a, b) || strstr(b, a))) return 1;
    for (int n = 0; n <= length; ++n) row[n] = n;
    for (int i = 0; a[i]; ++i) {
        int diagonal = row[0];
        row[0] = i + 1;
        for (int n = 0; n < length; ++n) {
            const int replaced = diagonal + (a[i] != b[n]), edited = (row[n] < row[n + 1] ? row[n] : row[n + 1]) + 1;
            diagonal = row[n + 1];
            row[n + 1] = replaced < edited ? replaced : edited;
        }
    }
    return row[length];
}

void pliant_nearest_names(const pliant_material_table *table, const char *name, char *out, size_t size)
{
    enum { SHOWN = 3 };
    const char *nearest[SHOWN] = {NULL};
    int away[SHOWN];
    words wanted, there;
    size_t used = 0;
    split(name, &wanted);
    for (uint32_t m = 0; m < table->num_materials; ++m)
        for (uint32_t s = 0; s <= table->materials[m].num_segments; ++s) {
            const char *next = s == 0 ? table->materials[m].name : table->materials[m].segments[s - 1];
            split(next, &there);
            const int far = distance(wanted.text, there.text);
            int at = SHOWN;
            for (; at > 0 && (!nearest[at - 1] || far < away[at - 1]); --at)
                if (at < SHOWN) {
                    nearest[at] = nearest[at - 1];
                    away[at] = away[at - 1];
                }
            if (at == SHOWN) continue;
            nearest[at] = next;
            away[at] = far;
        }
    if (size > 0) out[0] = '\0';
    for (int n = 0; n < SHOWN && nearest[n] && used < size; ++n)
        used += (size_t)snprintf(out + used, size - used, "%s%s", n ? ", " : "", nearest[n]);
}
