#include "rviz/transfer_panel.h"

#include "rviz/picker.h"
#include "rviz/volume_display.h"

#include <QColorDialog>
#include <QComboBox>
#include <QMouseEvent>
#include <QPainter>
#include <QTimer>
#include <QVBoxLayout>

#include <pluginlib/class_list_macros.hpp>
#include <rviz/visualization_manager.h>

#include <algorithm>
#include <cmath>

namespace pliant_rviz {

// sizes in pixels
static const double MARGIN = 10, BELOW = 18, HANDLE = 5, REACH = 9;
static const size_t BINS = 256;

TransferCurve::TransferCurve(QWidget *parent) : QWidget(parent)
{
    setToolTip("Drag a point. Double click: a new point, or a point's colour. Right button: take a point away.");
}

void TransferCurve::show_function(const Preset &function, double low, double high, const std::vector<double> &histogram)
{
    if (held_ >= 0) return;
    function_ = function;
    low_ = low;
    high_ = high;
    histogram_ = histogram;
    update();
}

QRectF TransferCurve::field() const
{
    return QRectF(MARGIN, MARGIN, width() - 2 * MARGIN, height() - 2 * MARGIN - BELOW);
}

// small opacities matter, so the height is the square root of the opacity
QPointF TransferCurve::place_of(const ControlPoint &point) const
{
    const QRectF in = field();
    return QPointF(in.left() + point.at * in.width(), in.bottom() - std::sqrt(point.colour.a) * in.height());
}

double TransferCurve::at_of(const QPointF &place) const
{
    return std::min(std::max((place.x() - field().left()) / field().width(), 0.0), 1.0);
}

double TransferCurve::opacity_of(const QPointF &place) const
{
    const double height = std::min(std::max((field().bottom() - place.y()) / field().height(), 0.0), 1.0);
    return height * height;
}

int TransferCurve::point_at(const QPointF &place) const
{
    int nearest = -1;
    double minimum = REACH;
    for (size_t n = 0; n < function_.points.size(); n++) {
        const QPointF from = place_of(function_.points[n]) - place;
        const double distance = std::hypot(from.x(), from.y());
        if (distance < minimum) {
            minimum = distance;
            nearest = int(n);
        }
    }
    return nearest;
}

static QColor colour_of(const Colour &colour) { return QColor::fromRgbF(colour.r, colour.g, colour.b); }

void TransferCurve::paintEvent(QPaintEvent *)
{
    QPainter painter(this);
    painter.setRenderHint(QPainter::Antialiasing);
    painter.fillRect(rect(), QColor(32, 32, 36));
    if (function_.points.empty()) return;
    const QRectF in = field();
    painter.setPen(Qt::NoPen);
    painter.setBrush(QColor(80, 80, 88));
    for (size_t n = 0; n < histogram_.size(); n++) {
        const double step = in.width() / double(histogram_.size());
        painter.drawRect(QRectF(in.left() + double(n) * step, in.bottom() - histogram_[n] * in.height(), step,
                                histogram_[n] * in.height()));
    }
    /* draw the line in its colours; between two points it is the square root of a straight line */
    for (int x = int(in.left()); x < int(in.right()); x++) {
        ControlPoint a{(x - in.left()) / in.width(), {}}, b{(x + 1 - in.left()) / in.width(), {}};
        a.colour = colour_at(function_, a.at);
        b.colour = colour_at(function_, b.at);
        painter.setPen(QPen(colour_of(a.colour), 2));
        painter.drawLine(place_of(a), place_of(b));
    }
    for (const ControlPoint &point : function_.points) {
        painter.setPen(QPen(Qt::white, 1.5));
        painter.setBrush(colour_of(point.colour));
        painter.drawEllipse(place_of(point), HANDLE, HANDLE);
    }
    painter.setPen(Qt::lightGray);
    const QRectF line(in.left(), in.bottom(), in.width(), MARGIN + BELOW);
    const QString unit = function_.unit.empty() ? "" : " " + QString::fromStdString(function_.unit);
    painter.drawText(line, Qt::AlignLeft | Qt::AlignBottom, QString::number(low_, 'f', 0) + unit);
    painter.drawText(line, Qt::AlignRight | Qt::AlignBottom, QString::number(high_, 'f', 0) + unit);
    if (held_ < 0) return;
    const ControlPoint &held = function_.points[size_t(held_)];
    painter.drawText(line, Qt::AlignHCenter | Qt::AlignBottom,
                     QString("%1%2, opacity %3")
                         .arg(low_ + held.at * (high_ - low_), 0, 'f', 0)
                         .arg(unit)
                         .arg(held.colour.a, 0, 'g', 2));
}

void TransferCurve::mousePressEvent(QMouseEvent *event)
{
    const int which = point_at(event->localPos());
    if (event->button() == Qt::RightButton && held_ < 0 && which >= 0 && remove_point(&function_.points, size_t(which)))
        Q_EMIT changed();
    if (event->button() == Qt::LeftButton) held_ = which;
    update();
}

void TransferCurve::mouseMoveEvent(QMouseEvent *event)
{
    if (held_ < 0) return;
    move_point(&function_.points, size_t(held_), at_of(event->localPos()), opacity_of(event->localPos()));
    update();
    Q_EMIT changed();
}

void TransferCurve::mouseReleaseEvent(QMouseEvent *)
{
    held_ = -1;
    update();
}

void TransferCurve::mouseDoubleClickEvent(QMouseEvent *event)
{
    if (event->button() != Qt::LeftButton || function_.points.empty()) return;
    const int which = point_at(event->localPos());
    if (which >= 0) {
        choose_colour(which);
        return;
    }
    held_ = add_point(&function_.points, at_of(event->localPos()));
    if (held_ < 0) return;
    move_point(&function_.points, size_t(held_), at_of(event->localPos()), opacity_of(event->localPos()));
    update();
    Q_EMIT changed();
}

void TransferCurve::choose_colour(int which)
{
    const QColor chosen =
        QColorDialog::getColor(colour_of(function_.points[size_t(which)].colour), this, "Colour of the point");
    held_ = -1;
    // the points may have changed in the meantime
    if (!chosen.isValid() || size_t(which) >= function_.points.size()) return;
    Colour &colour = function_.points[size_t(which)].colour;
    colour = {chosen.redF(), chosen.greenF(), chosen.blueF(), colour.a};
    update();
    Q_EMIT changed();
}

TransferPanel::TransferPanel(QWidget *parent)
    : rviz::Panel(parent), volumes_(new QComboBox(this)), curve_(new TransferCurve(this))
{
    QVBoxLayout *layout = new QVBoxLayout(this);
    layout->setContentsMargins(2, 2, 2, 2);
    layout->addWidget(volumes_);
    layout->addWidget(curve_, 1);
    connect(volumes_, SIGNAL(activated(int)), this, SLOT(refresh()));
    connect(curve_, SIGNAL(changed()), this, SLOT(apply()));
    QTimer *timer = new QTimer(this);
    connect(timer, SIGNAL(timeout()), this, SLOT(refresh()));
    timer->start(300);
}

VolumeDisplay *TransferPanel::chosen() const
{
    const std::vector<VolumeDisplay *> all = volume_displays(vis_manager_);
    const size_t which = size_t(std::max(volumes_->currentIndex(), 0));
    return which < all.size() ? all[which] : nullptr;
}

void TransferPanel::refresh()
{
    if (!vis_manager_ || !isVisible()) return;
    const std::vector<VolumeDisplay *> all = volume_displays(vis_manager_);
    while (volumes_->count() > int(all.size())) volumes_->removeItem(volumes_->count() - 1);
    for (int n = 0; n < int(all.size()); n++)
        if (n >= volumes_->count()) volumes_->addItem(all[size_t(n)]->getName());
        else if (volumes_->itemText(n) != all[size_t(n)]->getName())
            volumes_->setItemText(n, all[size_t(n)]->getName());
    volumes_->setVisible(all.size() > 1);
    if (VolumeDisplay *volume = chosen())
        curve_->show_function(volume->transfer(), volume->low(), volume->high(), volume->histogram(BINS));
}

void TransferPanel::apply()
{
    if (VolumeDisplay *volume = chosen()) volume->set_points(curve_->points());
}

} // namespace pliant_rviz

PLUGINLIB_EXPORT_CLASS(pliant_rviz::TransferPanel, rviz::Panel)
#include "moc_transfer_panel.cpp" // made by Qt, compiled with this file
