/* Shapes of instruments by their names or codes: capsules in the tool's frame. Names and codes come from the dVRK's
 * list of tools, share/tool/index.json of github.com/jhu-dvrk/sawIntuitiveResearchKit.
 *
 * Published values, from share/tool/NAME.json there ("DH": A and D of each joint):
 * - Length of the wrist, from the pitch axis to the yaw axis. The jaws turn about the yaw axis. DeBakey, Resano and
 *   tenaculum forceps have no file; they get the wrist of similar instruments.
 * - Length of the shaft, of generation Classic if there is one. Shafts of generation S are 50.8 mm longer.
 * - The two instruments with 5 mm shafts have wrists of vertebrae. The chain is 3 x 3.4 mm long. From its last
 *   joint to the tip it is 17.1 mm (needle driver) or 26.9 mm (Maryland dissector; both "tooltip-offset").
 * The large needle driver's tip is 9.5 mm from its yaw axis (github.com/BerkeleyAutomation/FLSpegtransferHO,
 * motion/dvrkVariables.py). The shaft of 8 mm instruments is 8.4 mm thick.
 *
 * Estimates, from pictures and nominal sizes in catalogues. Their error is a few millimeters in length and half a
 * millimeter in radius:
 * - Length of all other jaws. With 5 mm shafts the jaws' axis is assumed 7.1 mm beyond the chain's last joint.
 * - Thickness of all jaws and wrists, and of 5 mm shafts (5.2 mm).
 * - Bowel graspers, thoracic graspers and the small clip applier are assumed to have 8 mm shafts and the wrists and
 *   lengths of such instruments.
 * - The stapler, except for its shaft's length: it is 12 mm thick, with jaws of 60 mm for staple lines of 45 mm.
 *   They turn 15 mm in front of its wrist, whose two axes meet. In reality one jaw moves; here each moves by half
 *   the angle.
 * - Hook, spatula, probe and camera.
 *
 * A tool's pose is the pose of its jaws: wrist and shaft are straight behind them. */
#include "pliant/contact.h"

#include "base/fail.h"

#include <ctype.h>
#include <stdlib.h>
#include <string.h>

typedef struct instrument_shaft {
    double radius, length, wrist_radius; /* [m] */
} instrument_shaft;
static const instrument_shaft shaft_8mm = {0.0042, 0.4162, 0.0035}, long_shaft_8mm = {0.0042, 0.4670, 0.0035};
static const instrument_shaft shaft_5mm = {0.0026, 0.4024, 0.0025}, stapler_shaft = {0.0060, 0.4670, 0.0055};

typedef struct instrument {
    const char *names[2];           /* the second: Nullable */
    int code;                       /* number of its model, as code_of returns it */
    const instrument_shaft *shaft;  /* with the wrist's thickness */
    double wrist, jaw;              /* lengths [m] */
    double jaw_radius, jaw_spacing; /* radius of a jaw; distance from the closed jaws' middle to its axis [m] */
    bool cuts;                      /* its jaws cut */
} instrument;

static const instrument with_jaws[] = {
    {{"potts_scissors", NULL}, 1, &shaft_8mm, 0.0091, 0.012, 0.0006, 0.0006, true},
    {{"small_clip_applier", NULL}, 3, &shaft_8mm, 0.0091, 0.014, 0.0010, 0.0011, false},
    {{"large_needle_driver", NULL}, 6, &shaft_8mm, 0.0091, 0.0095, 0.0012, 0.0013, false},
    {{"round_tip_scissors", NULL}, 7, &shaft_8mm, 0.0091, 0.013, 0.0010, 0.0010, true},
    {{"micro_forceps", "black_diamond_micro_forceps"}, 33, &shaft_8mm, 0.0091, 0.010, 0.0006, 0.0007, false},
    {{"round_tooth_forceps", NULL}, 35, &shaft_8mm, 0.0091, 0.017, 0.0012, 0.0013, false},
    {{"debakey_forceps", NULL}, 36, &shaft_8mm, 0.0091, 0.018, 0.0010, 0.0011, false},
    {{"long_tip_forceps", NULL}, 48, &shaft_8mm, 0.0091, 0.024, 0.0008, 0.0009, false},
    {{"cadiere_forceps", NULL}, 49, &shaft_8mm, 0.0091, 0.020, 0.0014, 0.0016, false},
    {{"prograsp_forceps", NULL}, 93, &shaft_8mm, 0.0107, 0.020, 0.0014, 0.0016, false},
    {{"needle_driver", "5mm_needle_driver"}, 117, &shaft_5mm, 0.0173, 0.0100, 0.0010, 0.0011, false},
    {{"bowel_grasper", NULL}, 127, &shaft_8mm, 0.0107, 0.030, 0.0014, 0.0016, false},
    {{"maryland_dissector", "5mm_maryland_dissector"}, 143, &shaft_5mm, 0.0173, 0.0198, 0.0008, 0.0009, false},
    {{"maryland_bipolar_forceps", "bipolar_maryland_forceps"}, 172, &shaft_8mm, 0.0107, 0.020, 0.0010, 0.0011, false},
    {{"curved_scissors", NULL}, 178, &shaft_8mm, 0.0091, 0.013, 0.0008, 0.0008, true},
    {{"monopolar_curved_scissors", "monopolar_curved_scissor"}, 179, &shaft_8mm, 0.0091, 0.013, 0.0008, 0.0008, true},
    {{"resano_forceps", NULL}, 181, &shaft_8mm, 0.0091, 0.014, 0.0010, 0.0011, false},
    {{"double_fenestrated_grasper", NULL}, 189, &shaft_8mm, 0.0107, 0.033, 0.0014, 0.0016, false},
    {{"mega_needle_driver", NULL}, 194, &shaft_8mm, 0.0112, 0.012, 0.0015, 0.0016, false},
    {{"fenestrated_bipolar_forceps", NULL}, 205, &shaft_8mm, 0.0107, 0.021, 0.0012, 0.0013, false},
    {{"tenaculum_forceps", NULL}, 207, &shaft_8mm, 0.0091, 0.022, 0.0010, 0.0011, false},
    {{"thoracic_grasper", NULL}, 208, &shaft_8mm, 0.0107, 0.030, 0.0014, 0.0016, false},
    {{"large_clip_applier", NULL}, 230, &shaft_8mm, 0.0107, 0.020, 0.0012, 0.0013, false},
    {{"lrg_suturecut_needle_driver", "large_suturecut_needledriver"},
     296,
     &shaft_8mm,
     0.0091,
     0.0095,
     0.0012,
     0.0013,
     false},
    {{"mega_suturecut_needle_driver", NULL}, 309, &shaft_8mm, 0.0100, 0.012, 0.0015, 0.0016, false},
    {{"medium-large_clip_applier", NULL}, 327, &long_shaft_8mm, 0.0107, 0.016, 0.0012, 0.0013, false},
    {{"stapler_45", NULL}, 10298, &stapler_shaft, 0.015, 0.060, 0.0030, 0.0030, false},
};
enum { HOOK_CODE = 183, SPATULA_CODE = 184 };
static const double hook_wrist = 0.0093, hook_stem = 0.016, hook_foot = 0.004, hook_radius = 0.0008,
                    spatula_radius = 0.0012;
static const double probe_radius = 0.0025, probe_length = 0.3, camera_radius = 0.006, camera_length = 0.37;

static void add_capsule(pliant_tool_shape *shape, pliant_part_frame frame, double y, double from, double to,
                        double radius, bool cuts)
{
    shape->part[shape->num_parts++] = (pliant_part){.kind = PLIANT_PART_CAPSULE,
                                                    .frame = frame,
                                                    .from = {0, y, from},
                                                    .to = {0, y, to},
                                                    .radius = radius,
                                                    .cuts = cuts};
}

/* The shaft is behind z = joint, where the wrist ends. */
static void add_shaft(pliant_tool_shape *shape, double joint, double wrist, const instrument_shaft *shaft)
{
    shape->joint[2] = joint;
    shape->axis[0] = 1;
    add_capsule(shape, PLIANT_FRAME_TIP, 0, joint - wrist, joint, shaft->wrist_radius, false);
    add_capsule(shape, PLIANT_FRAME_TIP, 0, joint - wrist - shaft->length, joint - wrist, shaft->radius, false);
}

static void make_jaws(const instrument *of, pliant_tool_shape *shape)
{
    /* a positive angle about x turns z towards -y */
    add_capsule(shape, PLIANT_FRAME_JAW_PLUS, -of->jaw_spacing, -of->jaw, -of->jaw_radius, of->jaw_radius, of->cuts);
    add_capsule(shape, PLIANT_FRAME_JAW_MINUS, of->jaw_spacing, -of->jaw, -of->jaw_radius, of->jaw_radius, of->cuts);
    add_shaft(shape, -of->jaw, of->wrist, of->shaft);
}

/* The foot lies across the instrument, as in the blade of the same name. */
static void make_hook(pliant_tool_shape *shape)
{
    add_capsule(shape, PLIANT_FRAME_TIP, hook_foot, -hook_stem, 0, hook_radius, false);
    shape->part[shape->num_parts++] = (pliant_part){.kind = PLIANT_PART_CAPSULE,
                                                    .frame = PLIANT_FRAME_TIP,
                                                    .from = {0, hook_foot, 0},
                                                    .radius = hook_radius,
                                                    .cuts = true};
    add_shaft(shape, -hook_stem, hook_wrist, &shaft_8mm);
}

/* A flat blade, approximated by a rod with its half width as radius. */
static void make_spatula(pliant_tool_shape *shape)
{
    shape->part[shape->num_parts++] = (pliant_part){
        .kind = PLIANT_PART_CAPSULE, .frame = PLIANT_FRAME_TIP, .from = {0, 0, -hook_stem},
        .to = {0, 0, -spatula_radius}, .radius = spatula_radius, .cuts = true};
    add_shaft(shape, -hook_stem, hook_wrist, &shaft_8mm);
}

static void make_rod(double radius, double length, pliant_tool_shape *shape)
{
    add_capsule(shape, PLIANT_FRAME_TIP, 0, -length, -radius, radius, false);
}

/* Compare names without regard to case. A model number may follow: LARGE_NEEDLE_DRIVER_400006,
 * LARGE_NEEDLE_DRIVER:400006. */
static bool is_named(const char *text, const char *name)
{
    const size_t length = name ? strlen(name) : 0;
    for (size_t c = 0; c < length; c++)
        if (tolower((unsigned char)text[c]) != name[c]) return false;
    const char *rest = text + length;
    return name && (!*rest || ((*rest == '_' || *rest == ':') && isdigit((unsigned char)rest[1])));
}

/* Return a model number minus 400000, or minus 420000 for models of generation S: 400006 and 420006 give 6, and
 * 410298 gives 10298. Return -1 for other text. */
static int code_of(const char *text)
{
    if (strlen(text) != 6 || strspn(text, "0123456789") != 6) return -1;
    const int code = atoi(text) - 400000;
    return code / 1000 == 20 ? code - 20000 : code;
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
    if (is_named(name, "probe")) make_rod(probe_radius, probe_length, &shape);
    if (is_named(name, "camera")) make_rod(camera_radius, camera_length, &shape);
    if (shape.num_parts == 0)
        return pliant_fail(PLIANT_ERROR_ARGUMENT,
                           "there is no instrument '%.48s': use probe, camera, or a dVRK instrument by name or code "
                           "(large_needle_driver, LARGE_NEEDLE_DRIVER:400006, 400006)",
                           name);
    *out = shape;
    return PLIANT_OK;
}
