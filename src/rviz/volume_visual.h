// What rviz shows of a volume: a 3-D texture, and either slices through it or its isosurface.
#ifndef PLIANT_RVIZ_VOLUME_VISUAL_H
#define PLIANT_RVIZ_VOLUME_VISUAL_H

#include "rviz/slices.h"
#include "rviz/transfer.h"
#include "rviz/volume_image.h"

#include <OgreColourValue.h>
#include <OgreMaterial.h>
#include <OgreQuaternion.h>
#include <OgreSceneManager.h>
#include <OgreTexture.h>

#include <array>
#include <string>
#include <vector>

#if __has_include(<rviz/ogre_helpers/ogre_vector.h>)
#include <rviz/ogre_helpers/ogre_vector.h>
#else
#include <OgreVector3.h>
#endif

namespace Ogre {
class Camera;
class ManualObject;
class SceneNode;
}

namespace pliant_rviz {

// How it looks; values in the unit of the volume (CT: Hounsfield).
struct Look {
    bool isosurface = false;
    Preset transfer;
    double low = 0, high = 1; // window
    double opacity = 1;
    double shading = 1;       // 0: none, 1: full
    double surface = 0;       // value of the isosurface
    Ogre::ColourValue surface_colour;
    unsigned slices = 256;    // over the volume's diagonal
    std::array<double, 3> clip_low{{0, 0, 0}}, clip_high{{1, 1, 1}}; // fractions along i, j, k
    std::vector<Plane> planes; // at most one; in the volume's axes, from its voxel 0, 0, 0 [m]
    std::array<double, 3> away_low{{0, 0, 0}}, away_high{{0, 0, 0}}; // a box that is not seen, in the same fractions; empty: there is none
};

class VolumeVisual : private Ogre::SceneManager::Listener {
public:
    VolumeVisual(Ogre::SceneManager *manager, Ogre::SceneNode *parent);
    ~VolumeVisual();
    VolumeVisual(const VolumeVisual &) = delete;
    VolumeVisual &operator=(const VolumeVisual &) = delete;

    // A new, empty texture for the image. "" or why the graphics card has none.
    std::string start(const VolumeImage &image);
    void clear();
    bool has_texture() const { return bool(texture_.get()); }
    // One box of the image to the texture.
    void upload(const VolumeImage &image, const Box &box);

    void set_grid(const std::array<double, 3> &spacing, bool flipped);
    void set_pose(const Ogre::Vector3 &position, const Ogre::Quaternion &orientation);
    void set_look(const Look &look);
    const Look &look() const { return look_; }
    // Texels outside of which nothing is visible; asks the image, after its content or the look changed.
    void find_visible(const VolumeImage &image);
    void set_visible(bool visible);

    // Geometry and shader numbers for this camera; from then on, until it is made invisible, for the camera of each view as it is drawn:
    // slices that face one of them lie edge on, or the wrong way round, for another.
    void draw(const Ogre::Camera *camera);

    // Where a ray in the fixed frame meets what is seen [m], and the value there; false: nowhere. Unit direction.
    bool see(const VolumeImage &image, const Ogre::Vector3 &origin, const Ogre::Vector3 &direction, double *distance, double *value) const;

    size_t slices_drawn() const { return slices_drawn_; }
    double diagonal() const; // of the whole volume [m]
    Ogre::Vector3 middle() const; // of it, in the fixed frame
    // Of the part that may be drawn, in the fixed frame; none: nothing is. beyond: so much larger on each side, as part of its diagonal.
    std::vector<Ogre::Vector3> corners(double beyond) const;
    const Ogre::SceneNode &node() const { return *node_; } // of the volume's own axes
    Bounds clipped() const;                     // what may be drawn, in these [m]
    bool draws() const { return has_texture() && visible_.voxels() > 0 && !clipped().empty(); }

private:
    void preFindVisibleObjects(Ogre::SceneManager *source, Ogre::SceneManager::IlluminationRenderStage stage, Ogre::Viewport *view) override;
    void make_table();
    void set_numbers(Ogre::Pass *pass, const Ogre::Camera *camera);
    void draw_slices(const Vector &direction);
    void draw_hull();
    Bounds bounds_of(const Box &texels) const;
    Bounds between(const std::array<double, 3> &low, const std::array<double, 3> &high) const;

    Ogre::SceneManager *manager_;
    Ogre::SceneNode *node_;
    Ogre::ManualObject *object_;
    Ogre::MaterialPtr slice_material_, surface_material_;
    Ogre::TexturePtr texture_, table_;
    std::vector<uint8_t> staging_;

    Size size_{{0, 0, 0}}, full_size_{{0, 0, 0}};
    uint32_t stride_ = 1;
    double value_scale_ = 1, value_offset_ = 0;
    std::array<double, 3> spacing_{{1, 1, 1}};
    double sign_[3] = {1, 1, 1};
    Box visible_;
    Look look_;
    size_t slices_drawn_ = 0;
    bool drawn_ = false;   // there is something to be seen
    Vector facing_{{0, 0, 0}}; // direction that the slices were made for
};

} // namespace pliant_rviz
#endif
