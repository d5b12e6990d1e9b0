// Shaders in GLSL 1.20, the only version that both rviz's GL renderer and software rendering support.
#ifndef PLIANT_RVIZ_SHADERS_H
#define PLIANT_RVIZ_SHADERS_H

namespace pliant_rviz {

extern const char *const volume_vertex_shader;  // slices and isosurface: position in the volume's axes [m]
extern const char *const slice_fragment_shader; // one slice with the transfer function
extern const char *const surface_fragment_shader; // ray to the isosurface; writes depth
extern const char *const mesh_vertex_shader;
extern const char *const mesh_fragment_shader;

} // namespace pliant_rviz
#endif
