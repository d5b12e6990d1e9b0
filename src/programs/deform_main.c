/* pliant_deform: deform a scan along a tool path; write deformed volumes, node positions and timings. */
#define _POSIX_C_SOURCE 200809L
#include "command_line.h"
#include "console.h"
#include "deform_arguments.h"
#include "deform_compare.h"
#include "deform_run.h"

int main(int argc, char **argv)
{
    deform_arguments arguments;
    int exit_code;
    if (!deform_arguments_read(argc, argv, &arguments, &exit_code)) return exit_code;
    console_start(arguments.quiet ? PLIANT_LOG_WARNING : PLIANT_LOG_INFO);

    deform_inputs inputs = {.path = {.tools = NULL}};
    pliant_status status = command_line_folder(arguments.folder);
    if (status >= 0) status = deform_inputs_read(&arguments, &inputs);
    if (status >= 0 && arguments.num_compared > 0) {
        status = deform_compare(&arguments, &inputs);
    } else if (status >= 0) {
        deform_run run = {
            .arguments = &arguments, .inputs = &inputs, .scene = arguments.scene, .folder = arguments.folder};
        status = deform_run_execute(&run);
        deform_run_free(&run);
    }
    deform_inputs_free(&inputs);
    if (console_stop_requested()) return EXIT_STOPPED;
    return status < 0 ? EXIT_FAILED : EXIT_OK;
}
