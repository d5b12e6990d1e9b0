#define _POSIX_C_SOURCE 200809L
#include "command_line.h"

#include "base/fail.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

bool command_line_set(pliant_scene *scene, const char *text)
{
    char name[128];
    const char *equals = strchr(text, '=');
    if (!equals || (size_t)(equals - text) >= sizeof name) {
        fprintf(stderr, "--set %s: expected OPTION=VALUE\n", text);
        return false;
    }
    memcpy(name, text, (size_t)(equals - text));
    name[equals - text] = '\0';
    if (pliant_scene_set(scene, name, equals + 1) < 0) {
        fprintf(stderr, "--set %s: %s\n", text, pliant_last_error());
        return false;
    }
    return true;
}

bool command_line_scene(int argc, char **argv, const struct option *options, int set, pliant_scene *scene,
                        int *exit_code)
{
    *exit_code = EXIT_USAGE;
    if (argc - optind > 1) {
        fprintf(stderr, "%s: give one scene file only\n", argv[optind + 1]);
        return false;
    }
    if (argc - optind == 1 && pliant_scene_read(argv[optind], scene) < 0) {
        fprintf(stderr, "%s\n", pliant_last_error());
        *exit_code = EXIT_FAILED;
        return false;
    }
    optind = 1;
    for (int code; (code = getopt_long(argc, argv, "", options, NULL)) != -1;)
        if (code == set && !command_line_set(scene, optarg)) return false;
    if (pliant_scene_check(scene) >= 0) return true;
    fprintf(stderr, "%s\n", pliant_last_error());
    return false;
}

bool command_line_point(const char *option, const char *text, double out[3])
{
    char rest;
    if (sscanf(text, "%lf,%lf,%lf%c", &out[0], &out[1], &out[2], &rest) == 3 && isfinite(out[0] + out[1] + out[2]))
        return true;
    fprintf(stderr, "%s %s: expected X,Y,Z in metres, such as 0.01,-0.1,0.05\n", option, text);
    return false;
}

pliant_status command_line_folder(const char *folder)
{
    char path[4096];
    size_t length = strlen(folder);
    if (length >= sizeof path) return pliant_fail(PLIANT_ERROR_FILE, "%s: the name is too long", folder);
    memcpy(path, folder, length + 1);
    for (size_t n = 1; n <= length; ++n) {
        if (path[n] != '/' && path[n] != '\0') continue;
        char kept = path[n];
        path[n] = '\0';
        if (mkdir(path, 0777) != 0 && errno != EEXIST)
            return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
        path[n] = kept;
    }
    return PLIANT_OK;
}
