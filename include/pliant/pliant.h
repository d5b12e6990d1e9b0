/** @file pliant.h
 *  Pliant: deformable tissue from a CT or MRI scan. This header includes all others and states their conventions.
 *
 *      scan -> material -> mesh -> homogenize -> MODEL (constant)
 *                                                  |
 *      tool poses -> cut -> contact -> solve -> upsample -> DATA (mutable) -> warp -> deformed volume
 *
 *  Conventions
 *  - Units are SI: metres, kilograms, seconds, newtons, pascals. Files of scans are in millimetres; CT values are
 *    Hounsfield units.
 *  - Frames are right-handed. World is the patient's LPS axes (x left, y posterior, z superior) in metres.
 *  - Volumes are flat, i fastest. Meshes are flat arrays with three or four numbers per row. Matrices are row-major.
 *  - Parameters are in the order constant input, in/out, output. "out" names a result that the call writes.
 *  - Pointers must not be NULL unless the documentation says Nullable.
 *  - An object that a function creates belongs to the caller, who frees it. "Borrowed" names an object that must
 *    outlive its user.
 *  - Functions return pliant_status (status.h): 0 is success, negative is an error, positive is success with a warning.
 *    After an error, outputs and states are unchanged. Documentation writes MEMORY for PLIANT_ERROR_MEMORY, and so on.
 *  - Factorized matrices are double. Large streamed arrays are float.
 *  - The same input, backend and number of threads give the same bits.
 *  - Threads may share a model. A simulation belongs to one thread at a time.
 *  - Papers: [H] Torres, Espadero, Calvo, Otaduy, "Interactive Deformation of Heterogeneous Volume Data", ISBMS 2014.
 *    [C] "Interactive Volumetric Image Manipulation for Patient-specific Soft Tissue Deformation and Cutting".
 *
 *  Functions by task. A name that begins with _ continues the name before it: pliant_scene_set, _check is
 *  pliant_scene_check.
 *
 *  - Errors, log, version (status.h, version.h): pliant_last_error, pliant_status_text, pliant_set_log, pliant_version.
 *  - Restrict readable files (open.h): pliant_set_open_check.
 *  - Choose options (scene.h): pliant_scene_defaults, _read, _parse, _set, _check, _options, _for_shapes.
 *  - Read all inputs (model.h): pliant_inputs_read.
 *  - Read, make, write a scan (scan.h): pliant_volume_read, _create, _value, _write, _free; pliant_phantom;
 *    pliant_geometry_voxels, _to_world, _to_index.
 *  - Read, make, write labels (scan.h): pliant_labels_read, _create, _write, _free.
 *  - Segment a scan (segment.h): pliant_segment, pliant_segment_options_from, pliant_segmentation_free.
 *  - Materials (material.h): pliant_material_table_read, _parse, _default, _free; pliant_material_classify.
 *  - Build a model, read it (model.h): pliant_model_build, _free, _get_scene, _get_scan, _get_materials, _get_body,
 *    _get_statistics, _material_at.
 *  - Meshes and topology (mesh.h, body.h): pliant_body_retain, _release.
 *  - Simulate (data.h): pliant_data_create, _free, _reset, _copy; pliant_step.
 *  - Set loads and limits (data.h): pliant_data_set_gravity, _get_gravity, _set_limits, _set_positions.
 *  - Results of a step (data.h): pliant_data_get_positions, _get_body, _get_statistics, _get_scalar, _get_inverted,
 *    _get_backend; pliant_step_end_text.
 *  - Tools and grasps (data.h): pliant_tool_add, _get, _set_pose, _remove_pose, _grasp, _release, _set_drive,
 *    _set_spring, _set_radius, _set_mass, _clearance; pliant_data_get_num_tools.
 *  - Cuts (data.h, cut.h): pliant_tool_set_blade, _set_cutting; pliant_blade_find; pliant_data_cut, _undo_cut.
 *  - Contact of instruments (contact.h): pliant_tool_shape_find, _read, _move, _free; pliant_tool_set_shape, _set_jaw;
 *    pliant_data_get_contacts, _get_contact_forces.
 *  - Solids of triangles (solid.h): pliant_solid_read, _create, _release.
 *  - Deformed volume (data.h, warp.h): pliant_data_set_warp, _get_warp; pliant_warp_target, _create, _set_body,
 *    _backend, _update, _volume, _bricks, _free.
 *  - Displacement field (displacement.h): pliant_displacement_create, _write, _free.
 *  - Mesh files (save.h): pliant_mesh_save.
 *  - Pictures and radiographs (render.h): pliant_camera_of_view, _look_at; pliant_c_arm_camera; pliant_style_defaults;
 *    pliant_view_create, _set, _render, _radiograph, _free.
 *  - Pick a point (pick.h): pliant_pick_tissue.
 *  - Snapshots (state.h): pliant_state_create, _save, _restore, _write, _read, _free.
 *  - Accuracy and run time (report.h): pliant_report_open, _setup, _json, _close; pliant_pull_points;
 *    pliant_sweep_defaults, _run; pliant_truth_run; pliant_choose.
 *
 *  Example: pull a point of the built-in scan by 1 cm, then write the deformed volume.
 *
 *  @code
 *  #include <pliant/pliant.h>
 *  #include <stdio.h>
 *
 *  int main(void)
 *  {
 *      const double point[3] = {0.05, -0.09, 0.06}, moved[3] = {0.05, -0.10, 0.06};
 *      pliant_scene scene;
 *      pliant_volume scan = {0};
 *      pliant_labels labels = {0};
 *      pliant_material_table materials = {0};
 *      pliant_model *model = NULL;
 *      pliant_data *data = NULL;
 *      pliant_geometry grid;
 *      int tool = 0;
 *      pliant_scene_defaults(&scene);
 *      pliant_status status = pliant_inputs_read(&scene, "phantom:80x58x60", &scan, &labels, &materials);
 *      if (status >= 0) status = pliant_model_build(&scene, &scan, &labels, &materials, (pliant_progress){0}, &model);
 *      if (status >= 0) status = pliant_data_create(model, &data);
 *      if (status >= 0) status = pliant_warp_target(&scan.geometry, NULL, 0, 0, SIZE_MAX, &grid);
 *      if (status >= 0) status = pliant_data_set_warp(model, data, &grid);
 *      if (status >= 0) status = pliant_tool_add(model, data, "forceps", &tool);
 *      if (status >= 0) status = pliant_tool_set_pose(data, tool, point, NULL);
 *      if (status >= 0) status = pliant_tool_grasp(model, data, tool, point);
 *      if (status >= 0) status = pliant_tool_set_pose(data, tool, moved, NULL);
 *      for (int step = 0; step < 10 && status >= 0; step++) status = pliant_step(model, data);
 *      const pliant_warp *warp = status < 0 ? NULL : pliant_data_get_warp(data);
 *      if (status >= 0) status = pliant_volume_write("deformed.nii.gz", pliant_warp_volume(warp));
 *      if (status < 0) fprintf(stderr, "%s\n", pliant_last_error());
 *      pliant_data_free(data);
 *      pliant_model_free(model);
 *      pliant_material_table_free(&materials);
 *      pliant_labels_free(&labels);
 *      pliant_volume_free(&scan);
 *      return status < 0;
 *  }
 *  @endcode
 */
#ifndef PLIANT_PLIANT_H
#define PLIANT_PLIANT_H

#include "pliant/version.h"
#include "pliant/status.h"
#include "pliant/open.h"
#include "pliant/scan.h"
#include "pliant/segment.h"
#include "pliant/material.h"
#include "pliant/mesh.h"
#include "pliant/body.h"
#include "pliant/cut.h"
#include "pliant/scene.h"
#include "pliant/model.h"
#include "pliant/warp.h"
#include "pliant/displacement.h"
#include "pliant/save.h"
#include "pliant/data.h"
#include "pliant/state.h"
#include "pliant/render.h"
#include "pliant/solid.h"
#include "pliant/contact.h"
#include "pliant/pick.h"
#include "pliant/report.h"

#endif
