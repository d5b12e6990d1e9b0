// Linear algebra for tests, as a reference for the library's own. Templates of Eigen take seconds to compile, so that
// they are compiled once, in algebra.cpp.
#ifndef PLIANT_TEST_ALGEBRA_H
#define PLIANT_TEST_ALGEBRA_H

#include <Eigen/Core>

#include <vector>

namespace algebra {

// Return the rotation by an angle [rad] about an axis of any length.
Eigen::Matrix3d rotation(double angle, const Eigen::Vector3d &axis);

// Return the eigenvalues of a symmetric matrix, in ascending order.
Eigen::VectorXd eigenvalues(const Eigen::MatrixXd &a);

Eigen::MatrixXd product(const Eigen::MatrixXd &a, const Eigen::MatrixXd &b);

// Solve a x = b for a symmetric matrix a.
Eigen::MatrixXd solve(const Eigen::MatrixXd &a, const Eigen::MatrixXd &b);

// Return a vector minus its projection onto the space that the columns of a matrix span.
Eigen::VectorXd remainder(const Eigen::MatrixXd &columns, const Eigen::VectorXd &b);

// A square matrix as the sum of its entries.
struct Entry {
    int row, column;
    double value;
};
struct Sparse {
    int size;
    std::vector<Entry> entries;
};
Eigen::MatrixXd dense(const Sparse &a);
Eigen::VectorXd product(const Sparse &a, const Eigen::VectorXd &b);
// Solve a x = b for a symmetric matrix a.
Eigen::MatrixXd solve(const Sparse &a, const Eigen::MatrixXd &b);

} // namespace algebra

#endif
