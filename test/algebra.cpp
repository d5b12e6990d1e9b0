#include "algebra.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/SparseCholesky>

namespace algebra {

using Eigen::MatrixXd;
using Eigen::VectorXd;

Eigen::Matrix3d rotation(double angle, const Eigen::Vector3d &axis)
{
    return Eigen::AngleAxisd(angle, axis.normalized()).toRotationMatrix();
}

VectorXd eigenvalues(const MatrixXd &a)
{
    return Eigen::SelfAdjointEigenSolver<MatrixXd>(a, Eigen::EigenvaluesOnly).eigenvalues();
}

MatrixXd product(const MatrixXd &a, const MatrixXd &b) { return a * b; }

MatrixXd solve(const MatrixXd &a, const MatrixXd &b) { return a.ldlt().solve(b); }

VectorXd remainder(const MatrixXd &columns, const VectorXd &b)
{
    const MatrixXd across = columns.transpose();
    return b - product(columns, solve(product(across, columns), product(across, b)));
}

MatrixXd dense(const Sparse &a)
{
    MatrixXd out = MatrixXd::Zero(a.size, a.size);
    for (const Entry &entry : a.entries) out(entry.row, entry.column) += entry.value;
    return out;
}

VectorXd product(const Sparse &a, const VectorXd &b)
{
    VectorXd out = VectorXd::Zero(a.size);
    for (const Entry &entry : a.entries) out[entry.row] += entry.value * b[entry.column];
    return out;
}

MatrixXd solve(const Sparse &a, const MatrixXd &b)
{
    std::vector<Eigen::Triplet<double>> entries;
    for (const Entry &entry : a.entries) entries.emplace_back(entry.row, entry.column, entry.value);
    Eigen::SparseMatrix<double> matrix(a.size, a.size);
    matrix.setFromTriplets(entries.begin(), entries.end());
    return Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>(matrix).solve(b);
}

} // namespace algebra
