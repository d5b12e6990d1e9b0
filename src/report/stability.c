/* Run all stability cases, and return the worst verdict. */
#include "base/fail.h"
#include "report/stability_cases.h"

#include <string.h>

static const struct {
    const char *name;
    pliant_status (*run)(stability_context *context);
} cases[] = {
#define CASE_ENTRY(name) {#name, stability_##name},
    STABILITY_CASE_LIST(CASE_ENTRY)
#undef CASE_ENTRY
};
enum { NUM_CASES = sizeof cases / sizeof *cases };

const char *pliant_stability_case(int index) { return index >= 0 && index < NUM_CASES ? cases[index].name : NULL; }

#define METHOD_BIT(name, yaml) | 1u << name
enum { METHOD_BITS = 0 PLIANT_METHOD_LIST(METHOD_BIT) };
#undef METHOD_BIT

void pliant_stability_defaults(pliant_stability *out)
{
    *out = (pliant_stability){.methods = METHOD_BITS, .long_steps = 20000, .settle_steps = 400};
}

static pliant_verdict find_worst(const pliant_results *table, const char *setup)
{
    int column = pliant_results_column(table, "verdict"), worst = 0;
    for (size_t row = 0; row < pliant_results_rows(table); row++)
        for (int v = 0; v <= PLIANT_VERDICT_BROKEN; v++)
            if (strcmp(pliant_results_cell(table, row, 0), setup) == 0 && v > worst &&
                strcmp(pliant_results_cell(table, row, column), pliant_verdict_name((pliant_verdict)v)) == 0)
                worst = v;
    return (pliant_verdict)worst;
}

pliant_status pliant_stability_run(const pliant_report_input *input, const pliant_stability *options,
                                   pliant_report_tables *tables, pliant_progress progress, pliant_verdict *worst)
{
    stability_context context = {
        .input = input, .options = options, .tables = tables, .progress = progress, .count = NUM_CASES};
    block_body block = {0};
    pliant_status status = PLIANT_OK;
    bool any = false;
    if (!input) {
        status = block_create_default(&block);
        context.input = &block.input;
    }
    if (status >= 0 && !input) trial_use_requested_tled(&context, &block.scene); /* a different setup */
    if (status >= 0) pliant_report_setup(context.input, NULL, context.setup);
    for (int c = 0; status >= 0 && c < NUM_CASES; c++) {
        if (options->only && strcmp(options->only, cases[c].name) != 0) continue;
        context.name = cases[c].name;
        context.index = c;
        any = true;
        status = cases[c].run(&context);
    }
    if (status >= 0 && !any)
        status = pliant_fail(PLIANT_ERROR_ARGUMENT, "there is no stability case %s", options->only);
    if (status >= 0) *worst = find_worst(tables->stability, context.setup);
    if (!input) block_free(&block);
    return status;
}
