// Render a volume in rviz with a 3-D texture, as slices or as an isosurface.
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

// Appearance; values in the unit of the volume (CT: Hounsfield units).
struct VolumeAppearance {
    bool isosurface = false;
    Preset transfer;
    double low = 0, high = 1; // limits of the window
    double opacity = 1;
    double shading = 1;       // 0: none, 1: full
    double surface = 0;       // value of the isosurface
    Ogre::ColourValue surface_colour;
    unsigned slices = 256;    // number of slices over the volume's diagonal
    std::array<double, 3> clip_low{{0, 0, 0}}, clip_high{{1, 1, 1}}; // fractions along i, j, k
    std::vector<Plane> planes; // at most one clip plane; in the volume's axes, relative to its voxel 0, 0, 0 [m]
    // box that is hidden, in the same fractions; empty: none
    std::array<double, 3> away_low{{0, 0, 0}}, away_high{{0, 0, 0}};
};

class VolumeVisual : private Ogre::SceneManager::Listener {
public:
    VolumeVisual(Ogre::SceneManager *manager, Ogre::SceneNode *parent);
    ~VolumeVisual();
    VolumeVisual(const VolumeVisual &) = delete;
    VolumeVisual &operator=(const VolumeVisual &) = delete;

    // Create an empty texture for the image. Return "" or an error message.
    std::string start(const VolumeImage &image);
    void clear();
    bool has_texture() const { return bool(texture_.get()); }
    // Upload one box of the image to the texture.
    void upload(const VolumeImage &image, const Box &box);

    void set_grid(const std::array<double, 3> &spacing, bool flipped);
    void set_pose(const Ogre::Vector3 &position, const Ogre::Quaternion &orientation);
    void set_appearance(const VolumeAppearance &appearance);
    const VolumeAppearance &appearance() const { return appearance_; }
    // Find the texels outside which nothing is visible; call after the image's content or the look has changed.
    void find_visible(const VolumeImage &image);
    void set_visible(bool visible);

    // Create the geometry and shader parameters for this camera. Until the visual is hidden, they
    // are also updated for the camera of each view when it is drawn. Slices for one camera are wrong for another.
    void draw(const Ogre::Camera *camera);

    // Find where a ray in the fixed frame meets the visible part [m], and the value there; false: nothing visible.
    // direction: unit vector
    bool find_visible_point(const VolumeImage &image, const Ogre::Vector3 &origin, const Ogre::Vector3 &direction,
                            double *distance, double *value) const;

    size_t slices_drawn() const { return slices_drawn_; }
    double diagonal() const; // of the whole volume [m]
    Ogre::Vector3 middle() const; // centre of the volume in the fixed frame
    // Return the corners of the visible part in the fixed frame; empty: nothing is visible.
    // beyond: extension on each side, as a fraction of its diagonal
    std::vector<Ogre::Vector3> corners(double beyond) const;
    const Ogre::SceneNode &node() const { return *node_; } // node with the volume's axes
    Bounds clipped() const;                     // visible part, in these axes [m]
    bool draws() const { return has_texture() && visible_.voxels() > 0 && !clipped().empty(); }

private:
    void preFindVisibleObjects(Ogre::SceneManager *source, Ogre::SceneManager::IlluminationRenderStage stage,
                               Ogre::Viewport *view) override;
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
    VolumeAppearance appearance_;
    size_t slices_drawn_ = 0;
    bool drawn_ = false;   // whether something is visible
    Vector facing_{{0, 0, 0}}; // view direction for which the slices were computed
};

} // namespace pliant_rviz
#endif
