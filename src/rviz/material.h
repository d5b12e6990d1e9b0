// Ogre materials with the display's own shaders. Works with Ogre 1.9 and 1.12.
#ifndef PLIANT_RVIZ_MATERIAL_H
#define PLIANT_RVIZ_MATERIAL_H

#include <OgreMaterial.h>
#include <OgreTexture.h>

#include <string>

namespace pliant_rviz {

// A name that no other resource has.
std::string unique_name(const std::string &stem);

// A material of one pass with these GLSL programs. Mouse picks of rviz go through it: what it draws hides no interactive marker.
// @param in_depth_image  the "Depth" scheme, by which tools find 3-D points, sees it as an opaque object
Ogre::MaterialPtr make_material(const std::string &name, const char *vertex_shader, const char *fragment_shader, bool in_depth_image);
Ogre::Pass *pass_of(const Ogre::MaterialPtr &material);

void remove_material(const Ogre::MaterialPtr &material);

// A 3-D texture. Tables are 3-D too: samplers of another type beside a sampler3D make the GLSL linker complain.
Ogre::TexturePtr make_texture(const std::string &name, uint32_t width, uint32_t height, uint32_t depth, Ogre::PixelFormat format);
void remove_texture(const Ogre::TexturePtr &texture);
// Its values go on beyond its edges.
void bind_texture(Ogre::Pass *pass, const Ogre::TexturePtr &texture, const char *sampler, bool interpolated);

// Ogre's resource group of all of these: one that is always there.
extern const char *const RESOURCE_GROUP;

// Longest edge of a 3-D texture here [texels]; needs a current GL context.
uint32_t longest_texture_edge();

} // namespace pliant_rviz
#endif
