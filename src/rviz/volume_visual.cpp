#include "rviz/volume_visual.h"

#include "rviz/material.h"
#include "rviz/visible_depth.h"
#include "rviz/shaders.h"

#include <OgreCamera.h>
#include <OgreException.h>
#include <OgreHardwarePixelBuffer.h>
#include <OgreManualObject.h>
#include <OgrePass.h>
#include <OgreSceneManager.h>
#include <OgreSceneNode.h>
#include <OgreTextureUnitState.h>
#include <OgreViewport.h>

#include <algorithm>
#include <cmath>

namespace pliant_rviz {

static Vector vector_of(const Ogre::Vector3 &v) { return {{v.x, v.y, v.z}}; }

VolumeVisual::VolumeVisual(Ogre::SceneManager *manager, Ogre::SceneNode *parent)
    : manager_(manager), node_(parent->createChildSceneNode())
{
    std::string name = unique_name("volume");
    object_ = manager_->createManualObject(name);
    object_->setDynamic(true);
    node_->attachObject(object_);
    node_->setVisible(false);
    appearance_.transfer = presets().front();
    manager_->addListener(this);

    table_ = make_texture(name + "/table", TABLE_SIZE, 1, 1, Ogre::PF_SHORT_RGBA);
    slice_material_ = make_material(name + "/slices", volume_vertex_shader, slice_fragment_shader, false);
    Ogre::Pass *pass = pass_of(slice_material_);
    pass->setSceneBlending(Ogre::SBF_ONE, Ogre::SBF_ONE_MINUS_SOURCE_ALPHA);
    pass->setDepthWriteEnabled(false);
    pass->setCullingMode(Ogre::CULL_NONE);
    surface_material_ = make_material(name + "/surface", volume_vertex_shader, surface_fragment_shader, false);
    // draw the far sides of the box, so that the viewer may be inside it
    pass_of(surface_material_)->setCullingMode(Ogre::CULL_ANTICLOCKWISE);
    for (Ogre::Pass *each : {pass_of(slice_material_), pass_of(surface_material_)})
        each->getVertexProgramParameters()->setNamedAutoConstant("worldviewproj",
                                                                 Ogre::GpuProgramParameters::ACT_WORLDVIEWPROJ_MATRIX);
    pass_of(surface_material_)
        ->getFragmentProgramParameters()
        ->setNamedAutoConstant("worldviewproj", Ogre::GpuProgramParameters::ACT_WORLDVIEWPROJ_MATRIX);
}

VolumeVisual::~VolumeVisual()
{
    manager_->removeListener(this);
    clear();
    manager_->destroyManualObject(object_);
    manager_->destroySceneNode(node_);
    remove_material(slice_material_);
    remove_material(surface_material_);
    remove_texture(table_);
}

void VolumeVisual::clear()
{
    set_visible(false);
    for (Ogre::Pass *pass : {pass_of(slice_material_), pass_of(surface_material_)}) pass->removeAllTextureUnitStates();
    remove_texture(texture_);
    texture_ = Ogre::TexturePtr();
}

std::string VolumeVisual::start(const VolumeImage &image)
{
    clear();
    size_ = image.size();
    full_size_ = image.full_size();
    stride_ = image.stride();
    try {
        texture_ = make_texture(unique_name("texture"), size_[0], size_[1], size_[2],
                                image.bits() == 8 ? Ogre::PF_L8 : Ogre::PF_L16);
        // check the actual texture: a driver without the format creates a different one
        if (texture_->getWidth() != size_[0] || texture_->getHeight() != size_[1] || texture_->getDepth() != size_[2] ||
            texture_->getBuffer()->getSizeInBytes() == 0) {
            clear();
            return "the graphics card made a texture of another size";
        }
        for (Ogre::Pass *pass : {pass_of(slice_material_), pass_of(surface_material_)}) {
            bind_texture(pass, texture_, "volume", true);
            bind_texture(pass, table_, "table", false);
        }
    } catch (const Ogre::Exception &error) {
        clear();
        return error.getDescription();
    }
    make_table();
    return "";
}

void VolumeVisual::upload(const VolumeImage &image, const Box &box)
{
    // packed, because Ogre's GL renderer handles the pitch of a layer incorrectly
    image.copy(box, staging_);
    Ogre::PixelFormat format = image.bits() == 8 ? Ogre::PF_L8 : Ogre::PF_L16;
    Ogre::PixelBox pixels(box.size[0], box.size[1], box.size[2], format, staging_.data());
    Ogre::Box to(box.offset[0], box.offset[1], box.offset[2], box.offset[0] + box.size[0], box.offset[1] + box.size[1],
                 box.offset[2] + box.size[2]);
    texture_->getBuffer()->blitFromMemory(pixels, to);
}

void VolumeVisual::set_grid(const std::array<double, 3> &spacing, bool flipped)
{
    spacing_ = spacing;
    sign_[2] = flipped ? -1 : 1;
}

void VolumeVisual::set_pose(const Ogre::Vector3 &position, const Ogre::Quaternion &orientation)
{
    node_->setPosition(position);
    node_->setOrientation(orientation);
}

void VolumeVisual::set_appearance(const VolumeAppearance &appearance)
{
    appearance_ = appearance;
    make_table();
}

void VolumeVisual::set_visible(bool visible)
{
    drawn_ = visible;
    node_->setVisible(visible);
}

void VolumeVisual::make_table()
{
    // opacities refer to 1/256 of the diagonal
    Table table =
        pliant_rviz::make_table(appearance_.transfer, appearance_.opacity, 256.0 / std::max(appearance_.slices, 1u));
    Ogre::PixelBox pixels(TABLE_SIZE, 1, 1, Ogre::PF_SHORT_RGBA, table.data());
    table_->getBuffer()->blitFromMemory(pixels);
}

void VolumeVisual::find_visible(const VolumeImage &image)
{
    value_scale_ = image.value_scale();
    value_offset_ = image.value_offset();
    double at_0 = value_offset_, at_1 = value_offset_ + value_scale_;
    if (appearance_.isosurface) {
        std::vector<bool> drawn(4096);
        double step = std::fabs(value_scale_) / 4095;
        for (size_t n = 0; n < drawn.size(); n++)
            drawn[n] = at_0 + value_scale_ * double(n) / 4095 + step >= appearance_.surface;
        visible_ = image.visible_box(drawn);
    } else {
        visible_ = image.visible_box(drawn_values(appearance_.transfer, appearance_.low, appearance_.high, at_0, at_1));
    }
}

double VolumeVisual::diagonal() const
{
    double sum = 0;
    for (int d = 0; d < 3; d++) sum += std::pow(full_size_[d] * spacing_[d], 2);
    return std::sqrt(sum);
}

Ogre::Vector3 VolumeVisual::middle() const
{
    Ogre::Vector3 half;
    for (int d = 0; d < 3; d++) half[d] = float(0.5 * sign_[d] * spacing_[d] * (full_size_[d] - 1.0));
    return node_->_getDerivedPosition() + node_->_getDerivedOrientation() * half;
}

std::vector<Ogre::Vector3> VolumeVisual::corners(double beyond) const
{
    std::vector<Ogre::Vector3> out;
    if (!draws()) return out;
    Bounds box = clipped();
    double diagonal = 0;
    for (size_t d = 0; d < 3; d++) diagonal += std::pow(box.high[d] - box.low[d], 2);
    for (size_t d = 0; d < 3; d++) {
        box.low[d] -= beyond * std::sqrt(diagonal);
        box.high[d] += beyond * std::sqrt(diagonal);
    }
    for (int corner = 0; corner < 8; corner++) {
        Ogre::Vector3 at;
        for (int d = 0; d < 3; d++) at[d] = float((corner >> d & 1 ? box.high : box.low)[d]);
        out.push_back(node_->_getDerivedPosition() + node_->_getDerivedOrientation() * at);
    }
    return out;
}

// Bounds in the volume's axes. An outermost texel extends to the edge of its voxel, an inner one to its centre.
Bounds VolumeVisual::bounds_of(const Box &texels) const
{
    Bounds bounds;
    for (int d = 0; d < 3; d++) {
        double first = texels.offset[d] == 0 ? -0.5 : double(texels.offset[d]) * stride_;
        uint32_t end = texels.offset[d] + texels.size[d];
        double last = end == size_[d] ? full_size_[d] - 0.5 : double(end - 1) * stride_;
        double a = sign_[d] * spacing_[d] * first, b = sign_[d] * spacing_[d] * last;
        bounds.low[d] = std::min(a, b);
        bounds.high[d] = std::max(a, b);
    }
    return bounds;
}

// from fractions along i, j, k
Bounds VolumeVisual::between(const std::array<double, 3> &low, const std::array<double, 3> &high) const
{
    Bounds bounds;
    for (size_t d = 0; d < 3; d++) {
        double first = sign_[d] * spacing_[d] * (low[d] * full_size_[d] - 0.5),
               last = sign_[d] * spacing_[d] * (high[d] * full_size_[d] - 0.5);
        bounds.low[d] = std::min(first, last);
        bounds.high[d] = std::max(first, last);
    }
    return bounds;
}

Bounds VolumeVisual::clipped() const
{
    Bounds bounds = bounds_of(visible_), kept = between(appearance_.clip_low, appearance_.clip_high);
    for (size_t d = 0; d < 3; d++) {
        bounds.low[d] = std::max(bounds.low[d], kept.low[d]);
        bounds.high[d] = std::min(bounds.high[d], kept.high[d]);
    }
    return bounds;
}

void VolumeVisual::draw(const Ogre::Camera *camera)
{
    slices_drawn_ = 0;
    if (!draws()) {
        set_visible(false);
        return;
    }
    Ogre::Vector3 direction = node_->_getDerivedOrientation().Inverse() * camera->getDerivedDirection();
    direction.normalise();
    set_numbers(pass_of(appearance_.isosurface ? surface_material_ : slice_material_), camera);
    if (appearance_.isosurface) draw_hull();
    else draw_slices(vector_of(direction));
}

void VolumeVisual::preFindVisibleObjects(Ogre::SceneManager *, Ogre::SceneManager::IlluminationRenderStage,
                                         Ogre::Viewport *view)
{
    const Ogre::Camera *camera = view ? view->getCamera() : nullptr;
    if (!drawn_ || !camera) return;
    Ogre::Vector3 direction = node_->_getDerivedOrientation().Inverse() * camera->getDerivedDirection();
    direction.normalise();
    set_numbers(pass_of(appearance_.isosurface ? surface_material_ : slice_material_), camera);
    if (!appearance_.isosurface && vector_of(direction) != facing_) draw_slices(vector_of(direction));
}

void VolumeVisual::draw_slices(const Vector &direction)
{
    facing_ = direction;
    double spacing = diagonal() / std::max(appearance_.slices, 1u);
    Slices slices = make_slices(clipped(), appearance_.planes, direction, spacing, appearance_.slices + 2);
    slices_drawn_ = slices.count;
    if (slices.count == 0) {
        set_visible(false);
        return;
    }
    object_->clear();
    object_->estimateVertexCount(slices.vertices.size() / 3);
    object_->estimateIndexCount(slices.triangles.size());
    object_->begin(slice_material_->getName(), Ogre::RenderOperation::OT_TRIANGLE_LIST, RESOURCE_GROUP);
    for (size_t n = 0; n + 2 < slices.vertices.size(); n += 3)
        object_->position(slices.vertices[n], slices.vertices[n + 1], slices.vertices[n + 2]);
    for (uint32_t index : slices.triangles) object_->index(index);
    object_->end();
    /* bounds of everything that may be drawn, because rviz culls views before slices are computed */
    const Bounds box = clipped();
    object_->setBoundingBox(Ogre::AxisAlignedBox(float(box.low[0]), float(box.low[1]), float(box.low[2]),
                                                 float(box.high[0]), float(box.high[1]), float(box.high[2])));
    set_visible(true);
}

void VolumeVisual::draw_hull()
{
    static const uint32_t faces[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                                         {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
    Bounds box = clipped();
    object_->clear();
    object_->begin(surface_material_->getName(), Ogre::RenderOperation::OT_TRIANGLE_LIST, RESOURCE_GROUP);
    for (int corner = 0; corner < 8; corner++)
        object_->position(float(corner & 1 ? box.high[0] : box.low[0]), float(corner & 2 ? box.high[1] : box.low[1]),
                          float(corner & 4 ? box.high[2] : box.low[2]));
    for (const uint32_t *face : faces) object_->quad(face[0], face[1], face[2], face[3]);
    object_->end();
    set_visible(true);
}

void VolumeVisual::set_numbers(Ogre::Pass *pass, const Ogre::Camera *camera)
{
    Ogre::Vector3 scale, offset, step, spacing;
    for (int d = 0; d < 3; d++) {
        double texel = spacing_[d] * stride_ * sign_[d];
        scale[d] = float(1 / (texel * size_[d]));
        offset[d] = float(0.5 / size_[d]);
        step[d] = float(1.0 / size_[d]);
        spacing[d] = float(texel);
    }
    Ogre::Quaternion turn = node_->_getDerivedOrientation().Inverse();
    bool perspective = camera->getProjectionType() == Ogre::PT_PERSPECTIVE;
    Ogre::Vector3 eye = perspective ? turn * (camera->getDerivedPosition() - node_->_getDerivedPosition())
                                    : turn * camera->getDerivedDirection();
    double width = std::max(appearance_.high - appearance_.low, 1e-9);
    Ogre::GpuProgramParametersSharedPtr numbers = pass->getFragmentProgramParameters();
    numbers->setNamedConstant("scale", scale);
    numbers->setNamedConstant("offset", offset);
    numbers->setNamedConstant("spacing", spacing);
    numbers->setNamedConstant("window", Ogre::Vector4(float(value_scale_ / width),
                                                      float((value_offset_ - appearance_.low) / width),
                                                      float(transparent_up_to(appearance_.transfer)), 0));
    numbers->setNamedConstant("eye", Ogre::Vector4(eye.x, eye.y, eye.z, perspective ? 1.0f : 0.0f));
    Bounds away = between(appearance_.away_low, appearance_.away_high);
    numbers->setNamedConstant("away_low", Ogre::Vector3(float(away.low[0]), float(away.low[1]), float(away.low[2])));
    numbers->setNamedConstant("away_high",
                              Ogre::Vector3(float(away.high[0]), float(away.high[1]), float(away.high[2])));
    if (!appearance_.isosurface) {
        numbers->setNamedConstant("step_i", step);
        numbers->setNamedConstant("shading", float(appearance_.shading));
        numbers->setNamedConstant("slice_spacing", float(diagonal() / std::max(appearance_.slices, 1u)));
        return;
    }
    Bounds box = clipped();
    double stride = diagonal() / std::max(appearance_.slices, 1u);
    Ogre::Vector4 plane(0, 0, 0, -1);
    if (!appearance_.planes.empty()) {
        const Plane &first = appearance_.planes.front();
        plane =
            Ogre::Vector4(float(first.normal[0]), float(first.normal[1]), float(first.normal[2]), float(first.offset));
    }
    numbers->setNamedConstant("low", Ogre::Vector3(float(box.low[0]), float(box.low[1]), float(box.low[2])));
    numbers->setNamedConstant("high", Ogre::Vector3(float(box.high[0]), float(box.high[1]), float(box.high[2])));
    numbers->setNamedConstant("plane", plane);
    numbers->setNamedConstant("colour", appearance_.surface_colour);
    numbers->setNamedConstant("threshold", float((appearance_.surface - value_offset_) / value_scale_));
    numbers->setNamedConstant("direction_of_values", value_scale_ < 0 ? -1.0f : 1.0f);
    numbers->setNamedConstant("stride", float(stride));
    numbers->setNamedConstant("steps", float(appearance_.slices + 2));
    numbers->setNamedConstant("nearest", float(camera->getNearClipDistance()));
}

bool VolumeVisual::find_visible_point(const VolumeImage &image, const Ogre::Vector3 &origin,
                                      const Ogre::Vector3 &direction, double *distance, double *value) const
{
    if (!draws() || image.empty()) return false;
    Ogre::Quaternion turn = node_->_getDerivedOrientation().Inverse();
    const Vector from = vector_of(turn * (origin - node_->_getDerivedPosition())), along = vector_of(turn * direction);
    Part part;
    if (!clip_ray(clipped(), appearance_.planes, from, along, &part.near, &part.far)) return false;
    const std::vector<Part> parts = outside(between(appearance_.away_low, appearance_.away_high), from, along, part);
    auto value_at = [&](double t) {
        std::array<double, 3> texel;
        for (size_t d = 0; d < 3; d++) texel[d] = (from[d] + t * along[d]) / (sign_[d] * spacing_[d] * stride_);
        return image.value(texel);
    };
    // four steps per 1/256 of the diagonal, the unit of opacities
    const double step = diagonal() / 1024;
    const bool found =
        appearance_.isosurface
            ? find_surface(
                  parts, step, [&](double t) { return value_at(t) - appearance_.surface; }, distance)
            : find_visible_depth(
                  parts, step,
                  [&](double t) {
                      const double place =
                          (value_at(t) - appearance_.low) / std::max(appearance_.high - appearance_.low, 1e-9);
                      return opacity_over(appearance_.opacity * colour_at(appearance_.transfer, place).a, 0.25);
                  },
                  distance);
    if (found) *value = value_at(*distance);
    return found;
}

} // namespace pliant_rviz
