/* Shapes of instruments by their names or codes: capsules, in the tool's frame. Lengths of wrists (from the axis of pitch to that of yaw, about which the jaws turn) and
 * of shafts are those of the dVRK's tool files (github.com/jhu-dvrk/sawIntuitiveResearchKit, share/tool/NAME.json, "DH": A and D), whose names and
 * codes these are (share/tool/index.json; DeBakey, Resano and tenaculum forceps have the wrist of the others of their kind). Of those with 8 mm shafts none is
 * missing but the clip applier 420327's own length; 5 mm instruments, whose wrists are chains, the bowel and thoracic graspers and the stapler are not here. The tip is 9.5 mm from the axis of yaw for the large needle driver (github.com/BerkeleyAutomation/FLSpegtransferHO,
 * motion/dvrkVariables.py); the shaft of 8 mm instruments is 8.4 mm thick. Lengths of the other jaws, all their thicknesses, hook, probe and camera
 * are estimates from pictures and catalogues' nominal sizes, good to a few millimetres in length and half a millimetre in radius.
 * A tool's pose says where its jaws are: wrist and shaft are drawn straight behind them. */
#include "pliant/contact.h"

#include "base/fail.h"

#include <ctype.h>
#include <stdlib.h>
#include <string.h>

typedef struct instrument {
    const char *names[2];           /* the second: Nullable */
    int code;                       /* last three digits of its model */
    double wrist, jaw;              /* lengths [m] */
    double jaw_radius, jaw_spacing; /* of a jaw, and from the closed jaws' middle to its axis [m] */
    bool cuts;                      /* its jaws do */
} instrument;

static const double shaft_radius = 0.0042, shaft_length = 0.4162, wrist_radius = 0.0035;
static const instrument with_jaws[] = {
    {{"potts_scissors", NULL}, 1, 0.0091, 0.012, 0.0006, 0.0006, true},
    {{"large_needle_driver", NULL}, 6, 0.0091, 0.0095, 0.0012, 0.0013, false},
    {{"round_tip_scissors", NULL}, 7, 0.0091, 0.013, 0.0010, 0.0010, true},
    {{"micro_forceps", "black_diamond_micro_forceps"}, 33, 0.0091, 0.010, 0.0006, 0.0007, false},
    {{"round_tooth_forceps", NULL}, 35, 0.0091, 0.017, 0.0012, 0.0013, false},
    {{"debakey_forceps", NULL}, 36, 0.0091, 0.018, 0.0010, 0.0011, false},
    {{"long_tip_forceps", NULL}, 48, 0.0091, 0.024, 0.0008, 0.0009, false},
    {{"cadiere_forceps", NULL}, 49, 0.0091, 0.020, 0.0014, 0.0016, false},
    {{"prograsp_forceps", NULL}, 93, 0.0107, 0.020, 0.0014, 0.0016, false},
    {{"maryland_bipolar_forceps", "bipolar_maryland_forceps"}, 172, 0.0107, 0.020, 0.0010, 0.0011, false},
    {{"curved_scissors", NULL}, 178, 0.0091, 0.013, 0.0008, 0.0008, true},
    {{"monopolar_curved_scissors", "monopolar_curved_scissor"}, 179, 0.0091, 0.013, 0.0008, 0.0008, true},
    {{"resano_forceps", NULL}, 181, 0.0091, 0.014, 0.0010, 0.0011, false},
    {{"double_fenestrated_grasper", NULL}, 189, 0.0107, 0.033, 0.0014, 0.0016, false},
    {{"mega_needle_driver", NULL}, 194, 0.0112, 0.012, 0.0015, 0.0016, false},
    {{"fenestrated_bipolar_forceps", NULL}, 205, 0.0107, 0.021, 0.0012, 0.0013, false},
    {{"tenaculum_forceps", NULL}, 207, 0.0091, 0.022, 0.0010, 0.0011, false},
    {{"large_clip_applier", NULL}, 230, 0.0107, 0.020, 0.0012, 0.0013, false},
    {{"lrg_suturecut_needle_driver", "large_suturecut_needledriver"}, 296, 0.0091, 0.0095, 0.0012, 0.0013, false},
    {{"mega_suturecut_needle_driver", NULL}, 309, 0.0100, 0.012, 0.0015, 0.0016, false},
    {{"medium-large_clip_applier", NULL}, 327, 0.0107, 0.016, 0.0012, 0.0013, false},
};
enum { HOOK_CODE = 183, SPATULA_CODE = 184 };
static const double hook_wrist = 0.0093, hook_stem = 0.016, hook_foot = 0.004, hook_radius = 0.0008, spatula_radius = 0.0012;

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

/* a flat blade, seen as a rod of its half width */
static void make_spatula(pliant_tool_shape *shape)
{
    shape->part[shape->num_parts++] = (pliant_part){
        .kind = PLIANT_PART_CAPSULE, .frame = PLIANT_FRAME_TIP, .from = {0, 0, -hook_stem}, .to = {0, 0, -spatula_radius}, .radius = spatula_radius, .cuts = true};
    add_shaft(shape, -hook_stem, hook_wrist);
}

static void make_rod(double radius, double length, pliant_tool_shape *shape)
{
    add_capsule(shape, PLIANT_FRAME_TIP, 0, -length, -radius, radius, false);
}

/* in any case, without the number of its model: LARGE_NEEDLE_DRIVER_400006, LARGE_NEEDLE_DRIVER:400006 */
static bool is_named(const char *text, const char *name)
{
    const size_t length = name ? strlen(name) : 0;
    for (size_t c = 0; c < length; c++)
        if (tolower((unsigned char)text[c]) != name[c]) return false;
    const char *rest = text + length;
    return name && (!*rest || ((*rest == '_' || *rest == ':') && isdigit((unsigned char)rest[1])));
}

/* the number of a model alone, 400006 (classic) or 420006 (S and Si); of another kind of text -1 */
static int code_of(const char *text)
{
    const bool known = !strncmp(text, "400", 3) || !strncmp(text, "420", 3);
    if (!known || strlen(text) != 6 || strspn(text, "0123456789") != 6) return -1;
    return atoi(text + 3);
}

pliant_status pliant_tool_shape_find(const char *name, pliant_tool_shape *out)
{
    pliant_tool_shape shape = {.num_parts = 0};
    const int code = code_of(name);
    for (size_t n = 0; n < sizeof with_jaws / sizeof *with_jaws; n++) {
        const instrument *of = with_jaws + n;
        if (code == of->code || is_named(name, of->names[0]) || is_named(name, of->names[1])) make_jaws(of, &shape);
    }
    if (code == HOOK_CODE || is_named(name, "permanent_cautery_hook")) make_hook(&shape);
    if (code == SPATULA_CODE || is_named(name, "permanent_cautery_spatula")) make_spatula(&shape);
    if (is_named(name, "probe")) make_rod(0.0025, 0.3, &shape);
    if (is_named(name, "camera")) make_rod(0.006, 0.37, &shape);
    if (shape.num_parts == 0)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "there is no instrument '%.48s': those of the dVRK with 8 mm shafts are known, by name or code (large_needle_driver, "
                           "LARGE_NEEDLE_DRIVER:400006, 400006), and probe and camera", name);
    *out = shape;
    return PLIANT_OK;
}
