/* Fields and sizes of public structs, for bindings of other languages. */
#include "pliant/contact.h"
#include "pliant/data.h"
#include "pliant/displacement.h"
#include "sim/build/struct_layout.h"
#include "pliant/render.h"

#include <string.h>

#define FIELD(of, name, kind, type) {#of, #name, kind, offsetof(of, name), sizeof ((of *)0)->name / sizeof(type)}
#define REALS(of, name) FIELD(of, name, 'd', double)
#define INTS(of, name) FIELD(of, name, 'i', int32_t)
#define COUNTS(of, name) FIELD(of, name, 'Q', uint64_t)
#define FLAG(of, name) FIELD(of, name, '?', bool)
#define POINTER(of, name) FIELD(of, name, 'P', void *)
#define TEXT(of, name) FIELD(of, name, 's', char)

static const pliant_field_layout fields[] = {
    INTS(pliant_geometry, size),
    REALS(pliant_geometry, origin),
    REALS(pliant_geometry, spacing),
    REALS(pliant_geometry, direction),

    INTS(pliant_volume, geometry.size),
    REALS(pliant_volume, geometry.origin),
    REALS(pliant_volume, geometry.spacing),
    REALS(pliant_volume, geometry.direction),
    INTS(pliant_volume, encoding),
    FIELD(pliant_volume, slope, 'f', float),
    FIELD(pliant_volume, intercept, 'f', float),
    FIELD(pliant_volume, background, 'f', float),
    POINTER(pliant_volume, voxels),
    TEXT(pliant_volume, id),
    POINTER(pliant_labels, voxels),

    INTS(pliant_displacement, geometry.size),
    REALS(pliant_displacement, geometry.origin),
    REALS(pliant_displacement, geometry.spacing),
    REALS(pliant_displacement, geometry.direction),
    POINTER(pliant_displacement, vectors),
    POINTER(pliant_displacement, mask),

    TEXT(pliant_material, name),
    REALS(pliant_material, young_modulus),
    REALS(pliant_material, poisson_ratio),
    REALS(pliant_material, density),
    REALS(pliant_material, toughness),
    FLAG(pliant_material, fixed),
    FLAG(pliant_material, empty),
    POINTER(pliant_material_table, materials),
    FIELD(pliant_material_table, num_materials, 'I', uint32_t),
    REALS(pliant_tet_material, lambda),
    REALS(pliant_tet_material, mu),
    REALS(pliant_tet_material, density),
    FIELD(pliant_tet_material, material, 'H', uint16_t),

    COUNTS(pliant_body, revision),
    FIELD(pliant_body, fine, 'x', char),
    INTS(pliant_body, fine.num_nodes),
    INTS(pliant_body, fine.num_tets),
    POINTER(pliant_body, fine.rest),
    POINTER(pliant_body, fine.tets),
    POINTER(pliant_body, node_parent),
    POINTER(pliant_body, tet_parent),
    INTS(pliant_body, num_triangles),
    POINTER(pliant_body, triangles),
    POINTER(pliant_body, fine_material),
    POINTER(pliant_body, node_mass),
    POINTER(pliant_body, fine_fixed),

    COUNTS(pliant_statistics, step),
    REALS(pliant_statistics, seconds),
    INTS(pliant_statistics, iterations),
    INTS(pliant_statistics, legs),
    REALS(pliant_statistics, advanced),
    REALS(pliant_statistics, proxy_error),
    INTS(pliant_statistics, ended),
    REALS(pliant_statistics, residual),
    REALS(pliant_statistics, error),
    REALS(pliant_statistics, residual_force),
    INTS(pliant_statistics, rigid_pieces),
    INTS(pliant_statistics, contacts),
    REALS(pliant_statistics, penetration),
    COUNTS(pliant_statistics, not_converged),
    COUNTS(pliant_statistics, failed),
    FIELD(pliant_statistics, bytes, 'N', size_t),

    TEXT(pliant_tool_state, name),
    FLAG(pliant_tool_state, present),
    REALS(pliant_tool_state, tip),
    REALS(pliant_tool_state, rotation),
    INTS(pliant_tool_state, drive),
    REALS(pliant_tool_state, stiffness),
    REALS(pliant_tool_state, damping),
    REALS(pliant_tool_state, radius),
    FLAG(pliant_tool_state, holding),
    COUNTS(pliant_tool_state, hold),
    INTS(pliant_tool_state, num_held),
    REALS(pliant_tool_state, held_point),
    REALS(pliant_tool_state, force),
    REALS(pliant_tool_state, contact_force),
    REALS(pliant_tool_state, contact_torque),
    REALS(pliant_tool_state, contact_force_error),
    FLAG(pliant_tool_state, cutting),
    FLAG(pliant_tool_state, engaged),
    REALS(pliant_tool_state, engaged_length),
    REALS(pliant_tool_state, severed_area),
    COUNTS(pliant_tool_state, stroke),
    INTS(pliant_tool_state, pieces),
    REALS(pliant_tool_state, jaw),
    FLAG(pliant_tool_state, has_proxy),
    REALS(pliant_tool_state, proxy_tip),
    REALS(pliant_tool_state, proxy_rotation),
    REALS(pliant_tool_state, proxy_jaw),
    REALS(pliant_tool_state, proxy_error),
    REALS(pliant_tool_state, jaw_error),
    FLAG(pliant_tool_state, saturated),
    REALS(pliant_tool_state, advanced),

    INTS(pliant_contact, tool),
    INTS(pliant_contact, part),
    FLAG(pliant_contact, tissue),
    REALS(pliant_contact, place),
    REALS(pliant_contact, normal),
    REALS(pliant_contact, force),
    REALS(pliant_contact, area),
    REALS(pliant_contact, depth),

    INTS(pliant_cut_report, num_links),
    INTS(pliant_cut_report, num_bridges),
    INTS(pliant_cut_report, touched),
    REALS(pliant_cut_report, area),
    INTS(pliant_cut_report, pieces),

    INTS(pliant_camera, width),
    INTS(pliant_camera, height),
    REALS(pliant_camera, fx),
    REALS(pliant_camera, fy),
    REALS(pliant_camera, cx),
    REALS(pliant_camera, cy),
    REALS(pliant_camera, pose),
    REALS(pliant_camera, near),
    REALS(pliant_camera, far),
    REALS(pliant_c_arm, isocentre),
    REALS(pliant_c_arm, source_to_isocentre),
    REALS(pliant_c_arm, source_to_detector),
    REALS(pliant_c_arm, primary_angle),
    REALS(pliant_c_arm, secondary_angle),
    INTS(pliant_c_arm, width),
    INTS(pliant_c_arm, height),
    REALS(pliant_c_arm, pixel),
    FLAG(pliant_style, by_label),
    FIELD(pliant_style, threshold, 'f', float),
    FIELD(pliant_style, shown, 'B', uint8_t),
    INTS(pliant_style, num_colours),
    {"pliant_style", "colours", 'f', offsetof(pliant_style, colours), 4 * PLIANT_MAX_COLOURS},
    FIELD(pliant_style, beneath, 'f', float),
    FIELD(pliant_style, ambient, 'f', float),
    FIELD(pliant_style, diffuse, 'f', float),
    FIELD(pliant_style, specular, 'f', float),
    FIELD(pliant_style, background, 'f', float),
    POINTER(pliant_image, rgb),
    POINTER(pliant_image, depth),
    POINTER(pliant_image, label),

    INTS(pliant_scene, solver.threads),
    REALS(pliant_scene, solver.step),
};

const pliant_field_layout *pliant_layout_fields(size_t *count)
{
    *count = sizeof fields / sizeof *fields;
    return fields;
}

size_t pliant_layout_size(const char *of)
{
#define SIZE(name) {#name, sizeof(name)}
    static const struct { const char *name; size_t bytes;
    } sizes[] = {
        SIZE(pliant_geometry),   SIZE(pliant_volume),         SIZE(pliant_labels),       SIZE(pliant_displacement),
        SIZE(pliant_material),   SIZE(pliant_material_table), SIZE(pliant_tet_material), SIZE(pliant_body),
        SIZE(pliant_statistics), SIZE(pliant_tool_state),     SIZE(pliant_tool_shape),   SIZE(pliant_contact),
        SIZE(pliant_cut_report), SIZE(pliant_scene),          SIZE(pliant_camera),       SIZE(pliant_c_arm),
        SIZE(pliant_style),      SIZE(pliant_image),
    };
#undef SIZE
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++)
        if (strcmp(sizes[s].name, of) == 0) return sizes[s].bytes;
    return 0;
}
