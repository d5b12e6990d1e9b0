// GLSL 1.20, the one version that rviz's GL renderer and software rendering share.
#ifndef PLIANT_RVIZ_SHADERS_H
#define PLIANT_RVIZ_SHADERS_H

namespace pliant_rviz {

extern const char *const volume_vertex_shader;  // slices and isosurface: position in the volume's axes [m]
extern const char *const slice_fragment_shader; // one slice through the transfer function
extern const char *const surface_fragment_shader; // a ray to the isosurface; writes depth
extern const char *const mesh_vertex_shader;
extern const char *const mesh_fragment_shader;

} // namespace pliant_rviz
#endif
