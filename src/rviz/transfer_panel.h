// rviz panel to edit the points of a volume's transfer function with the mouse.
#ifndef PLIANT_RVIZ_TRANSFER_PANEL_H
#define PLIANT_RVIZ_TRANSFER_PANEL_H

#ifndef Q_MOC_RUN
#include "rviz/transfer.h"

#include <rviz/panel.h>
#endif

#include <QWidget>

class QComboBox;

namespace pliant_rviz {

class VolumeDisplay;

// Opacity over value: histogram in the background, coloured line, and a handle for each point.
class TransferCurve : public QWidget {
    Q_OBJECT
public:
    explicit TransferCurve(QWidget *parent);
    // Show a function. Changes from outside wait while the user drags a point.
    void show_function(const Preset &function, double low, double high, const std::vector<double> &histogram);
    QSize sizeHint() const override { return QSize(320, 180); }
    QSize minimumSizeHint() const override { return QSize(160, 100); }

Q_SIGNALS:
    void changed();

public:
    const std::vector<ControlPoint> &points() const { return function_.points; }

protected:
    void paintEvent(QPaintEvent *event) override;
    void mousePressEvent(QMouseEvent *event) override;
    void mouseMoveEvent(QMouseEvent *event) override;
    void mouseReleaseEvent(QMouseEvent *event) override;
    void mouseDoubleClickEvent(QMouseEvent *event) override;

private:
    QRectF field() const;
    QPointF place_of(const ControlPoint &point) const;
    int point_at(const QPointF &place) const; // -1: none
    double at_of(const QPointF &place) const;
    double opacity_of(const QPointF &place) const;
    void choose_colour(int which);

    Preset function_;
    double low_ = 0, high_ = 1;
    std::vector<double> histogram_;
    int held_ = -1;
};

class TransferPanel : public rviz::Panel {
    Q_OBJECT
public:
    explicit TransferPanel(QWidget *parent = nullptr);

private Q_SLOTS:
    void refresh();
    void apply();

private:
    VolumeDisplay *chosen() const;

    QComboBox *volumes_;
    TransferCurve *curve_;
};

} // namespace pliant_rviz
#endif
