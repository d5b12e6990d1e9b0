#include "rviz/material.h"

#include <GL/gl.h>
#include <OgreHighLevelGpuProgram.h>
#include <OgreHighLevelGpuProgramManager.h>
#include <OgreMaterialManager.h>
#include <OgrePass.h>
#include <OgreTechnique.h>
#include <OgreTextureManager.h>
#include <OgreTextureUnitState.h>

#include <atomic>

#ifndef GL_MAX_3D_TEXTURE_SIZE
#define GL_MAX_3D_TEXTURE_SIZE 0x8073
#endif

namespace pliant_rviz {

// this group always exists in Ogre
const char *const RESOURCE_GROUP = "General";

std::string unique_name(const std::string &stem)
{
    static std::atomic<unsigned> count(0);
    return "pliant/" + stem + std::to_string(count++);
}

static void make_program(const std::string &name, const char *source, Ogre::GpuProgramType type)
{
    Ogre::HighLevelGpuProgramPtr program =
        Ogre::HighLevelGpuProgramManager::getSingleton().createProgram(name, RESOURCE_GROUP, "glsl", type);
    program->setSource(source);
    program->load();
}

Ogre::MaterialPtr make_material(const std::string &name, const char *vertex_shader, const char *fragment_shader,
                                bool in_depth_image)
{
    make_program(name + "/vertex", vertex_shader, Ogre::GPT_VERTEX_PROGRAM);
    make_program(name + "/fragment", fragment_shader, Ogre::GPT_FRAGMENT_PROGRAM);
    Ogre::MaterialPtr material = Ogre::MaterialManager::getSingleton().create(name, RESOURCE_GROUP);
    material->setReceiveShadows(false);
    Ogre::Pass *pass = pass_of(material);
    pass->setLightingEnabled(false);
    pass->setVertexProgram(name + "/vertex");
    pass->setFragmentProgram(name + "/fragment");
    for (const char *scheme : {"Pick", "Pick1", "Depth"}) {
        if (in_depth_image && std::string(scheme) == "Depth") continue;
        Ogre::Technique *technique = material->createTechnique();
        technique->setSchemeName(scheme);
        Ogre::Pass *nothing = technique->createPass();
        nothing->setLightingEnabled(false);
        nothing->setColourWriteEnabled(false);
        nothing->setDepthWriteEnabled(false);
        nothing->setDepthFunction(Ogre::CMPF_ALWAYS_FAIL);
    }
    material->load();
    return material;
}

Ogre::Pass *pass_of(const Ogre::MaterialPtr &material) { return material->getTechnique(0)->getPass(0); }

void remove_material(const Ogre::MaterialPtr &material)
{
    if (!material.get()) return;
    std::string name = material->getName();
    Ogre::MaterialManager::getSingleton().remove(name);
    Ogre::HighLevelGpuProgramManager::getSingleton().remove(name + "/vertex");
    Ogre::HighLevelGpuProgramManager::getSingleton().remove(name + "/fragment");
}

Ogre::TexturePtr make_texture(const std::string &name, uint32_t width, uint32_t height, uint32_t depth,
                              Ogre::PixelFormat format)
{
    return Ogre::TextureManager::getSingleton().createManual(name, RESOURCE_GROUP, Ogre::TEX_TYPE_3D, width, height,
                                                             depth, 0, format, Ogre::TU_DYNAMIC_WRITE_ONLY);
}

void remove_texture(const Ogre::TexturePtr &texture)
{
    if (texture.get()) Ogre::TextureManager::getSingleton().remove(texture->getName());
}

void bind_texture(Ogre::Pass *pass, const Ogre::TexturePtr &texture, const char *sampler, bool interpolated)
{
    Ogre::TextureUnitState *unit = pass->createTextureUnitState();
    unit->setTextureName(texture->getName(), Ogre::TEX_TYPE_3D);
    Ogre::FilterOptions filter = interpolated ? Ogre::FO_LINEAR : Ogre::FO_POINT;
    unit->setTextureFiltering(filter, filter, Ogre::FO_NONE);
    unit->setTextureAddressingMode(Ogre::TextureUnitState::TAM_CLAMP);
    pass->getFragmentProgramParameters()->setNamedConstant(sampler, int(pass->getNumTextureUnitStates()) - 1);
}

uint32_t longest_texture_edge()
{
    GLint edge = 0;
    glGetIntegerv(GL_MAX_3D_TEXTURE_SIZE, &edge);
    return edge > 0 ? uint32_t(edge) : 256;
}

} // namespace pliant_rviz
