/* Writes materials as YAML that table.c reads. */
#include "scene/yaml.h"
#include "material/material.h"

static void add_number(pliant_text_out *text, const char *name, double value)
{
    pliant_text_add(text, name);
    pliant_text_add_real(text, value);
}

static void add_material(pliant_text_out *text, const pliant_material *material)
{
    pliant_text_add(text, "  - {name: ");
    pliant_text_add_quoted(text, material->name);
    add_number(text, ", young_modulus: ", material->young_modulus);
    add_number(text, ", poisson_ratio: ", material->poisson_ratio);
    add_number(text, ", density: ", material->density);
    add_number(text, ", toughness: ", material->toughness);
    pliant_text_add(text, material->fixed ? ", fixed: true" : ", fixed: false");
    pliant_text_add(text, material->empty ? ", empty: true" : ", empty: false");
    if (material->num_range > 0) {
        pliant_text_add(text, ", range: ");
        pliant_text_add_reals(text, material->range, 2);
    }
    if (material->num_labels > 0) {
        pliant_text_add(text, ", labels: ");
        for (uint32_t l = 0; l < material->num_labels; ++l) add_number(text, l ? ", " : "[", material->labels[l]);
        pliant_text_add(text, "]");
    }
    for (uint32_t s = 0; s < material->num_segments; ++s) {
        pliant_text_add(text, s ? ", " : ", segments: [");
        pliant_text_add_quoted(text, material->segments[s]);
    }
    pliant_text_add(text, material->num_segments > 0 ? "]}\n" : "}\n");
}

size_t pliant_material_table_text(const pliant_material_table *table, size_t capacity, char *out)
{
    pliant_text_out text = {out, capacity, 0};
    if (capacity > 0) out[0] = '\0';
    pliant_text_add(&text, "materials:\n");
    for (uint32_t m = 0; m < table->num_materials; ++m) add_material(&text, table->materials + m);
    return text.length;
}
