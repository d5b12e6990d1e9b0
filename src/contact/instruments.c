/* Shapes of instruments by their names: capsules, in the tool's frame. Lengths of wrists (from the axis of pitch to that of yaw, about which the jaws turn) and
 * of shafts are those of the dVRK's tool files (github.com/jhu-dvrk/sawIntuitiveResearchKit, share/tool/NAME.json, "DH": A and D), whose names these
 * are. The tip is 9.5 mm from the axis of yaw for the large needle driver (github.com/BerkeleyAutomation/FLSpegtransferHO,
 * motion/dvrkVariables.py); the shaft of 8 mm instruments is 8.4 mm thick. Lengths of the other jaws, all their thicknesses, hook, probe and camera
 * are estimates from pictures and catalogues' nominal sizes, good to a few millimetres in length and half a millimetre in radius.
 * A tool's pose says where its jaws are: wrist and shaft are drawn straight behind them. */
#include "pliant/contact.h"

#include "base/fail.h"

#include <ctype.h>
#include <string.h>

typedef struct instrument {
    const char *name;
    double wrist, jaw;              /* lengths [m] */
    double jaw_radius, jaw_spacing; /* of a jaw, and from the closed jaws' middle to its axis [m] */
    bool cuts;                      /* its jaws do */
} instrument;

static const double shaft_radius = 0.0042, shaft_length = 0.4162, wrist_radius = 0.0035;
static const instrument with_jaws[] = {
    {"large_needle_driver", 0.0091, 0.0095, 0.0012, 0.0013, false},
    {"prograsp_forceps", 0.0107, 0.020, 0.0014, 0.0016, false},
    {"monopolar_curved_scissors", 0.0091, 0.013, 0.0008, 0.0008, true},
    {"maryland_bipolar_forceps", 0.0107, 0.020, 0.0010, 0.0011, false},
    {"fenestrated_bipolar_forceps", 0.0107, 0.021, 0.0012, 0.0013, false},
};
static const double hook_wrist = 0.0093, hook_stem = 0.016, hook_foot = 0.004, hook_radius = 0.0008;

static void add_capsule(pliant_tool_shape *shape, pliant_part_frame frame, double y, double from, double to, double radius, bool cuts)
{
    shape->part[shape->num_parts++] =
        (pliant_part){.kind = PLIANT_PART_CAPSULE, .frame = frame, .from = {0, y, from}, .to = {0, y, to}, .radius = radius, .cuts = cuts};
}

/* behind z = joint, where the wrist ends */
static void add_shaft(pliant_tool_shape *shape, double joint, double wrist)
{
    shape->joint[2] = joint;
    shape->axis[0] = 1;
    add_capsule(shape, PLIANT_FRAME_TIP, 0, joint - wrist, joint, wrist_radius, false);
    add_capsule(shape, PLIANT_FRAME_TIP, 0, joint - wrist - shaft_length, joint - wrist, shaft_radius, false);
}

static void make_jaws(const instrument *of, pliant_tool_shape *shape)
{
    /* about x, a positive angle takes z to -y */
    add_capsule(shape, PLIANT_FRAME_JAW_PLUS, -of->jaw_spacing, -of->jaw, -of->jaw_radius, of->jaw_radius, of->cuts);
    add_capsule(shape, PLIANT_FRAME_JAW_MINUS, of->jaw_spacing, -of->jaw, -of->jaw_radius, of->jaw_radius, of->cuts);
    add_shaft(shape, -of->jaw, of->wrist);
}

/* the foot as the blade of this name has it: across the instrument */
static void make_hook(pliant_tool_shape *shape)
{
    add_capsule(shape, PLIANT_FRAME_TIP, hook_foot, -hook_stem, 0, hook_radius, false);
    shape->part[shape->num_parts++] = (pliant_part){
        .kind = PLIANT_PART_CAPSULE, .frame = PLIANT_FRAME_TIP, .from = {0, hook_foot, 0}, .radius = hook_radius, .cuts = true};
    add_shaft(shape, -hook_stem, hook_wrist);
}

static void make_rod(double radius, double length, pliant_tool_shape *shape)
{
    add_capsule(shape, PLIANT_FRAME_TIP, 0, -length, -radius, radius, false);
}

/* in any case, without the number of its model: LARGE_NEEDLE_DRIVER_400006, LARGE_NEEDLE_DRIVER:400006 */
static bool is_named(const char *text, const char *name)
{
    const size_t length = strlen(name);
    for (size_t c = 0; c < length; c++)
        if (tolower((unsigned char)text[c]) != name[c]) return false;
    const char *rest = text + length;
    return !*rest || ((*rest == '_' || *rest == ':') && isdigit((unsigned char)rest[1]));
}

pliant_status pliant_tool_shape_find(const char *name, pliant_tool_shape *out)
{
    pliant_tool_shape shape = {.num_parts = 0};
    for (size_t n = 0; n < sizeof with_jaws / sizeof *with_jaws; n++)
        if (is_named(name, with_jaws[n].name)) make_jaws(with_jaws + n, &shape);
    if (is_named(name, "permanent_cautery_hook")) make_hook(&shape);
    if (is_named(name, "probe")) make_rod(0.0025, 0.3, &shape);
    if (is_named(name, "camera")) make_rod(0.006, 0.37, &shape);
    if (shape.num_parts == 0)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "there is no instrument '%.48s': large_needle_driver, prograsp_forceps, monopolar_curved_scissors, "
                           "maryland_bipolar_forceps, fenestrated_bipolar_forceps, permanent_cautery_hook, probe and camera are known", name);
    *out = shape;
    return PLIANT_OK;
}
