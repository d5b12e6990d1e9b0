/* One image of a DICOM series: what its header says. */
#ifndef PLIANT_SCAN_READ_DICOM_H
#define PLIANT_SCAN_READ_DICOM_H

#include "scan/read.h"

namespace pliant_read {

struct dicom_slice {
    std::string path, name;               /* name: of the file, for messages */
    std::string series, description, instance; /* UIDs of series and image, SeriesDescription */
    int rows = 0, columns = 0, frames = 1;
    std::vector<double> position;         /* 3, LPS [mm]; empty when missing */
    std::vector<double> orientation;      /* 6: direction of rows, of columns */
    std::vector<double> spacing;          /* 2: between rows, between columns [mm] */
    std::string storage;                  /* bits, sign and rescale: slices that agree decode to the same type */
    bool integer_rescale = true;          /* slope and intercept are whole numbers */
    std::string problem;                  /* why it cannot be read; matters only if its series is chosen */
    double along = 0.0;                   /* position along the normal [mm] */
};

/* The images of one series, in any order, as one regular grid. */
std::unique_ptr<image_source> open_series(const std::string &folder, std::vector<dicom_slice> slices);

} // namespace pliant_read

#endif
