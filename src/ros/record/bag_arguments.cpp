#include "ros/record/bag_arguments.h"

#include "programs/command_line.h"
#include "pliant/status.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <getopt.h>

namespace pliant_ros {

namespace {

const char help[] =
    "Usage: pliant_bag BAG [--scene FILE] --scan PATH --at TIMES | --every SECONDS --out DIR [options]\n"
    "       pliant_bag BAG [--scene FILE] --scan PATH --simulate [options]\n"
    "       pliant_bag BAG --steps FILE --cuts FILE\n"
    "       pliant_bag BAG --export numpy|lerobot --out DIR\n"
    "\n"
    "Writes the deformed volume at chosen times of a bag that record.launch made, to the bit what was shown live; "
    "makes its steps\n"
    "again and compares them with what was recorded; writes tables of it, and arrays to learn from.\n"
    "\n"
    "  BAG                the recording; of a session in several bags, any of them\n"
    "  --scan PATH        the scan of the recording: DICOM folder, NIfTI, NRRD or MetaImage file; phantom or\n"
    "                     phantom:IxJxK for the built-in scan\n"
    "  --scene FILE       scene file (YAML) of the recording, where the bag does not say itself what it was made from "
    "(it does by its\n"
    "                     topic session, every load of it); without one every option has its default\n"
    "  --set OPTION=VALUE the same of a scene option, e.g. --set material/labels=labels.nii.gz; may be repeated\n"
    "  --at TIMES         seconds since the start of the bag, as rosbag play --start counts: 1.0 or 1.0,2.5\n"
    "  --every SECONDS    from the first state of the bag to its end\n"
    "  --out DIR          folder for the volumes; made if it is missing\n"
    "  --surfaces         with every volume the surface and its cut faces too, DIR/surface_SSSS.SSS.ply\n"
    "  --simulate         make every step again from what the tools did, from the first load or reset in the bag on; "
    "volumes come from\n"
    "                     there. Fails where positions differ bitwise from the recording\n"
    "  --steps FILE       table (CSV) of every step: time, seconds by stage, "
    "what was put to use of work in the background\n"
    "  --cuts FILE        table (CSV) of what blades and the services cut: time, tool, stroke, severed area, revision, "
    "pieces, where\n"
    "  --export numpy     arrays (.npy): poses, jaws, wrenches and recorded pictures, the next poses as actions; "
    "every load and reset\n"
    "                     begins an episode. DIR/columns.json names their columns\n"
    "  --export lerobot   the same in LeRobot's layout, version 2.1, and the arrays in DIR/numpy. "
    "Python with numpy and pyarrow writes it;\n"
    "                     pictures become mp4 where ffmpeg is installed, png where not\n"
    "  --rate HZ          rows of that a second (default: 30)\n"
    "  --task TEXT        description of the task for LeRobot (default: tissue)\n"
    "  --ns NAME          namespace that was recorded (default: tissue)\n"
    "  --quiet            no progress, warnings and errors only\n"
    "  --help             print this and end\n"
    "\n"
    "Every volume is that of the newest state recorded by its time: DIR/deformed_SSSS.SSS.nii.gz, named by that time.\n"
    "\n"
    "Exit codes: 0 done, 1 failed, 2 wrong usage, 130 stopped by Ctrl-C (written files are kept).\n";

enum { SCAN = 256, SCENE, SET, AT, EVERY, OUT, SURFACES, SIMULATE, STEPS, CUTS, EXPORT, RATE, TASK, NAME, QUIET, HELP };

const struct option options[] = {
    {"scan", required_argument, nullptr, SCAN},   {"scene", required_argument, nullptr, SCENE},
    {"set", required_argument, nullptr, SET},     {"at", required_argument, nullptr, AT},
    {"every", required_argument, nullptr, EVERY}, {"out", required_argument, nullptr, OUT},
    {"surfaces", no_argument, nullptr, SURFACES}, {"simulate", no_argument, nullptr, SIMULATE},
    {"steps", required_argument, nullptr, STEPS}, {"cuts", required_argument, nullptr, CUTS},
    {"export", required_argument, nullptr, EXPORT}, {"rate", required_argument, nullptr, RATE},
    {"task", required_argument, nullptr, TASK},   {"ns", required_argument, nullptr, NAME},
    {"quiet", no_argument, nullptr, QUIET},       {"help", no_argument, nullptr, HELP},
    {nullptr, 0, nullptr, 0},
};

bool refuse(const std::string &message)
{
    std::fprintf(stderr, "%s; see pliant_bag --help\n", message.c_str());
    return false;
}

bool read_times(const std::string &text, std::vector<double> *out)
{
    const char *rest = text.c_str();
    do {
        char *end;
        double time = std::strtod(rest, &end);
        if (end == rest || !std::isfinite(time) || time < 0 || (*end != ',' && *end != '\0')) return false;
        out->push_back(time);
        rest = *end ? end + 1 : end;
    } while (*rest);
    std::sort(out->begin(), out->end());
    return text.back() != ',';
}

bool read_rate(const std::string &text, int *out)
{
    char *end;
    const long rate = std::strtol(text.c_str(), &end, 10);
    if (text.empty() || *end || rate < 1 || rate > 1000)
        return refuse("--rate " + text + ": expected a whole number from 1 to 1000");
    *out = static_cast<int>(rate);
    return true;
}

/* Read the scene file first, then apply --set, in any order on the command line. */
bool read_scene(const std::string &file, const std::vector<std::string> &sets, pliant_scene *out, int *exit_code)
{
    pliant_scene_defaults(out);
    if (!file.empty() && pliant_scene_read(file.c_str(), out) < 0) {
        std::fprintf(stderr, "%s\n", pliant_last_error());
        *exit_code = EXIT_FAILED;
        return false;
    }
    for (const std::string &set : sets)
        if (!command_line_set(out, set.c_str())) return false;
    return pliant_scene_check(out) >= 0 || refuse(pliant_last_error());
}

bool is_complete(const BagArguments &arguments)
{
    const bool volumes = !arguments.times.empty() || arguments.every > 0 || !arguments.folder.empty();
    if (arguments.bag.empty()) return refuse("the name of a bag is missing");
    if (!arguments.exported.empty()) {
        if (arguments.exported != "numpy" && arguments.exported != "lerobot")
            return refuse("--export " + arguments.exported + ": expected numpy or lerobot");
        if (arguments.folder.empty()) return refuse("--out DIR is missing");
        if (!arguments.times.empty() || arguments.every > 0 || arguments.simulate)
            return refuse("--export excludes --at, --every and --simulate");
        return true;
    }
    if (!volumes && !arguments.simulate && !(arguments.steps.empty() && arguments.cuts.empty())) return true;
    if (arguments.scan.empty()) return refuse("--scan PATH is missing: a bag holds no voxels");
    if (!volumes && arguments.simulate) return true;
    if (arguments.folder.empty()) return refuse("--out DIR is missing");
    if (arguments.times.empty() == (arguments.every == 0)) return refuse("give either --at or --every");
    return true;
}

} // namespace

bool read_bag_arguments(int argc, char **argv, BagArguments *out, int *exit_code)
{
    BagArguments read;
    std::string scene;
    std::vector<std::string> sets;
    *exit_code = EXIT_USAGE;
    for (int code; (code = getopt_long(argc, argv, "", options, nullptr)) != -1;)
        switch (code) {
        case SCAN: read.scan = optarg; break;
        case SCENE: scene = optarg; break;
        case SET: sets.push_back(optarg); break;
        case AT:
            if (!read_times(optarg, &read.times))
                return refuse(std::string("--at ") + optarg + ": expected seconds, such as 1.0,2.5");
            break;
        case EVERY:
            if (!read_times(optarg, &read.times) || read.times.size() != 1 || !(read.times[0] > 0))
                return refuse(std::string("--every ") + optarg + ": expected seconds above 0, and no --at");
            read.every = read.times[0];
            read.times.clear();
            break;
        case OUT: read.folder = optarg; break;
        case SURFACES: read.surfaces = true; break;
        case SIMULATE: read.simulate = true; break;
        case STEPS: read.steps = optarg; break;
        case CUTS: read.cuts = optarg; break;
        case EXPORT: read.exported = optarg; break;
        case RATE:
            if (!read_rate(optarg, &read.rate)) return false;
            break;
        case TASK: read.task = optarg; break;
        case NAME: read.name = optarg; break;
        case QUIET: read.quiet = true; break;
        case HELP:
            std::fputs(help, stdout);
            *exit_code = EXIT_OK;
            return false;
        default: std::fputs("see pliant_bag --help\n", stderr); return false;
        }
    if (argc - optind > 1) return refuse(std::string(argv[optind + 1]) + ": give one bag only");
    if (optind < argc) read.bag = argv[optind];
    read.described = scene.empty() && sets.empty();
    if (!is_complete(read) || !read_scene(scene, sets, &read.scene, exit_code)) return false;
    *out = read;
    return true;
}

} // namespace pliant_ros
