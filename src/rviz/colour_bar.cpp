#include "rviz/colour_bar.h"

#include "rviz/material.h"

#include <OgreHardwarePixelBuffer.h>
#include <OgreMaterialManager.h>
#include <OgrePass.h>
#include <OgreTechnique.h>
#include <OgreTextureManager.h>
#include <OgreTextureUnitState.h>
#include <Overlay/OgreOverlay.h>
#include <Overlay/OgreOverlayManager.h>
#include <Overlay/OgrePanelOverlayElement.h>

#include <QImage>
#include <QPainter>

#include <cmath>

namespace pliant_rviz {

enum { WIDTH = 128, HEIGHT = 256, MARGIN = 8, BAR = 18, TITLE = 20 };

ColourBar::ColourBar(Side side)
{
    std::string name = unique_name("colour_bar");
    texture_ =
        Ogre::TextureManager::getSingleton().createManual(name + "/texture", RESOURCE_GROUP, Ogre::TEX_TYPE_2D, WIDTH,
                                                          HEIGHT, 0, Ogre::PF_A8R8G8B8, Ogre::TU_DYNAMIC_WRITE_ONLY);
    material_ = Ogre::MaterialManager::getSingleton().create(name + "/material", RESOURCE_GROUP);
    Ogre::Pass *pass = pass_of(material_);
    pass->setLightingEnabled(false);
    pass->setDepthCheckEnabled(false);
    pass->setDepthWriteEnabled(false);
    pass->setSceneBlending(Ogre::SBT_TRANSPARENT_ALPHA);
    pass->createTextureUnitState(texture_->getName())->setTextureFiltering(Ogre::TFO_NONE);

    Ogre::OverlayManager &manager = Ogre::OverlayManager::getSingleton();
    overlay_ = manager.create(name);
    panel_ = static_cast<Ogre::PanelOverlayElement *>(manager.createOverlayElement("Panel", name + "/panel"));
    panel_->setMetricsMode(Ogre::GMM_PIXELS);
    panel_->setHorizontalAlignment(side == LEFT ? Ogre::GHA_LEFT : Ogre::GHA_RIGHT);
    panel_->setVerticalAlignment(Ogre::GVA_BOTTOM);
    panel_->setPosition(side == LEFT ? float(MARGIN) : -float(WIDTH + MARGIN), -float(HEIGHT + MARGIN));
    panel_->setDimensions(WIDTH, HEIGHT);
    panel_->setMaterialName(material_->getName());
    overlay_->add2D(panel_);
    overlay_->hide();
}

ColourBar::~ColourBar()
{
    Ogre::OverlayManager &manager = Ogre::OverlayManager::getSingleton();
    overlay_->remove2D(panel_);
    manager.destroyOverlayElement(panel_);
    manager.destroy(overlay_);
    Ogre::MaterialManager::getSingleton().remove(material_->getName());
    Ogre::TextureManager::getSingleton().remove(texture_->getName());
}

static QString number(double value, double range)
{
    double size = std::max(std::fabs(value), range);
    if (value != 0 && (size >= 1e5 || size < 1e-2)) return QString::number(value, 'g', 3);
    return QString::number(value, 'f', range >= 20 ? 0 : range >= 2 ? 1 : 3);
}

void ColourBar::set(const QString &title, double low, double high, const std::function<QColor(double)> &colour)
{
    QImage image(WIDTH, HEIGHT, QImage::Format_ARGB32);
    image.fill(QColor(0, 0, 0, 110));
    QPainter painter(&image);
    QFont font = painter.font();
    font.setPixelSize(12);
    painter.setFont(font);
    painter.setPen(Qt::white);
    painter.drawText(QRect(0, 0, WIDTH, TITLE), Qt::AlignCenter,
                     painter.fontMetrics().elidedText(title, Qt::ElideRight, WIDTH - 6));
    int top = TITLE + 8, bottom = HEIGHT - 12, left = MARGIN;
    for (int y = top; y <= bottom; y++) {
        QColor here = colour(double(bottom - y) / (bottom - top));
        painter.setPen(here);
        painter.drawLine(left, y, left + BAR - 1, y);
    }
    painter.setPen(Qt::white);
    painter.drawRect(left - 1, top - 1, BAR + 1, bottom - top + 2);
    for (int n = 0; n <= 4; n++) {
        int y = bottom - n * (bottom - top) / 4;
        painter.drawLine(left + BAR, y, left + BAR + 4, y);
        painter.drawText(QRect(left + BAR + 8, y - 10, WIDTH - left - BAR - 8, 20), Qt::AlignLeft | Qt::AlignVCenter,
                         number(low + n * (high - low) / 4, std::fabs(high - low)));
    }
    painter.end();
    texture_->getBuffer()->blitFromMemory(Ogre::PixelBox(WIDTH, HEIGHT, 1, Ogre::PF_A8R8G8B8, image.bits()));
}

void ColourBar::set_visible(bool visible)
{
    if (visible) overlay_->show();
    else overlay_->hide();
}

} // namespace pliant_rviz
