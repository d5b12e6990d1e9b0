// A legend over the 3-D view: a colour bar with values next to it.
#ifndef PLIANT_RVIZ_COLOUR_BAR_H
#define PLIANT_RVIZ_COLOUR_BAR_H

#include <OgreMaterial.h>
#include <OgreTexture.h>

#include <QColor>
#include <QString>

#include <functional>

namespace Ogre {
class Overlay;
class PanelOverlayElement;
}

namespace pliant_rviz {

class ColourBar {
public:
    enum Side { LEFT, RIGHT };
    explicit ColourBar(Side side);
    ~ColourBar();
    ColourBar(const ColourBar &) = delete;
    ColourBar &operator=(const ColourBar &) = delete;

    // colour: maps t from 0 (low) to 1 (high) to a colour
    void set(const QString &title, double low, double high, const std::function<QColor(double)> &colour);
    void set_visible(bool visible);

private:
    Ogre::TexturePtr texture_;
    Ogre::MaterialPtr material_;
    Ogre::Overlay *overlay_;
    Ogre::PanelOverlayElement *panel_;
};

} // namespace pliant_rviz
#endif
