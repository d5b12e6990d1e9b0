// rviz that also writes the screen positions of its panels' rows, so that tests can click a row by its name.
// rviz_rows FILE [rviz's own arguments]
// A line of FILE: path of the row, x, y of its value's centre [screen pixels], its value; separated by tabs.
#include <QApplication>
#include <QSaveFile>
#include <QTextStream>
#include <QTimer>
#include <QTreeView>

#include <rviz/visualizer_app.h>

namespace {

void write_rows(const QTreeView &tree, const QModelIndex &parent, const QString &path, QTextStream *out)
{
    const QAbstractItemModel &model = *tree.model();
    for (int row = 0; row < model.rowCount(parent); row++) {
        const QModelIndex name = model.index(row, 0, parent), value = model.index(row, 1, parent);
        const QString here = path + name.data().toString();
        const QPoint middle = tree.visualRect(value).center();
        const QPoint at = tree.viewport()->mapToGlobal(middle);
        if (tree.viewport()->rect().contains(middle))
            *out << here << '\t' << at.x() << '\t' << at.y() << '\t' << value.data().toString() << '\n';
        if (tree.isExpanded(name)) write_rows(tree, name, here + "/", out);
    }
}

void write_all(const QString &path)
{
    QSaveFile file(path);
    if (!file.open(QIODevice::WriteOnly)) qFatal("%s cannot be written", qPrintable(path));
    QTextStream out(&file);
    for (QWidget *widget : QApplication::allWidgets())
        if (QTreeView *tree = qobject_cast<QTreeView *>(widget))
            if (tree->isVisible() && tree->model()) write_rows(*tree, QModelIndex(), "", &out);
    out.flush();
    file.commit();
}

} // namespace

int main(int argc, char **argv)
{
    if (argc < 2) qFatal("rviz_rows FILE [rviz's own arguments]");
    const QString path = argv[1];
    argv[1] = argv[0];
    argc--;
    QApplication application(argc, argv + 1);
    rviz::VisualizerApp rviz;
    rviz.setApp(&application);
    if (!rviz.init(argc, argv + 1)) return 1;
    QTimer timer;
    QObject::connect(&timer, &QTimer::timeout, [&] { write_all(path); });
    timer.start(100);
    return application.exec();
}
