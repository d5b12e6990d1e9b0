// Create Ogre materials with the displays' own shaders. Works with Ogre 1.9 and 1.12.
#ifndef PLIANT_RVIZ_MATERIAL_H
#define PLIANT_RVIZ_MATERIAL_H

#include <OgreMaterial.h>
#include <OgreTexture.h>

#include <string>

namespace pliant_rviz {

// Return a unique resource name.
std::string unique_name(const std::string &stem);

// Create a material of one pass with these GLSL programs. rviz's mouse picking ignores it, so it hides no interactive
// marker.
// @param in_depth_image whether the "Depth" scheme, by which tools find 3-D points, renders it as an opaque object
Ogre::MaterialPtr make_material(const std::string &name, const char *vertex_shader, const char *fragment_shader,
                                bool in_depth_image);
Ogre::Pass *pass_of(const Ogre::MaterialPtr &material);

void remove_material(const Ogre::MaterialPtr &material);

// Create a 3-D texture. Tables are 3-D textures too, because the GLSL linker rejects other sampler types together with
// a sampler3D.
Ogre::TexturePtr make_texture(const std::string &name, uint32_t width, uint32_t height, uint32_t depth,
                              Ogre::PixelFormat format);
void remove_texture(const Ogre::TexturePtr &texture);
// Bind a texture; coordinates are clamped to its edges.
void bind_texture(Ogre::Pass *pass, const Ogre::TexturePtr &texture, const char *sampler, bool interpolated);

// Ogre resource group of all these resources, which always exists.
extern const char *const RESOURCE_GROUP;

// Return the maximum edge of a 3-D texture [texels]; needs a current GL context.
uint32_t longest_texture_edge();

} // namespace pliant_rviz
#endif
