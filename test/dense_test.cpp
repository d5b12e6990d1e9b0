#include "algebra.h"
#include "base/dense.h"

#include <gtest/gtest.h>

namespace {

using algebra::product;
using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

TEST(Dense, CholeskySolves)
{
    for (int n : {1, 3, 12, 61}) {
        Matrix half = Matrix::Random(n, n), a = product(half, half.transpose());
        a.diagonal().array() += 1;
        Matrix factor = a, right = Matrix::Random(n, 5), x = right;
        ASSERT_TRUE(pliant_dense_cholesky(n, factor.data()));
        pliant_dense_cholesky_solve(n, factor.data(), 5, x.data());
        EXPECT_LT((product(a, x) - right).norm(), 1e-9 * right.norm());
    }
}

TEST(Dense, CholeskyRefusesTheIndefiniteAndTheSingular)
{
    Matrix a = Matrix::Identity(4, 4);
    a(2, 2) = -1;
    EXPECT_FALSE(pliant_dense_cholesky(4, a.data()));
    Matrix v = Matrix::Random(6, 3), singular = product(v, v.transpose());
    EXPECT_FALSE(pliant_dense_cholesky(6, singular.data()));
    Matrix nan = Matrix::Constant(3, 3, NAN);
    EXPECT_FALSE(pliant_dense_cholesky(3, nan.data()));
}

TEST(Dense, GaussSolvesWithPivoting)
{
    Matrix a = Matrix::Random(18, 18), right = Matrix::Random(18, 12), copy = a, x = right;
    a(0, 0) = copy(0, 0) = 0;
    ASSERT_TRUE(pliant_dense_solve(18, copy.data(), 12, x.data()));
    EXPECT_LT((product(a, x) - right).norm(), 1e-9 * right.norm());
    Matrix zero = Matrix::Zero(3, 3), b = Matrix::Ones(3, 1);
    EXPECT_FALSE(pliant_dense_solve(3, zero.data(), 1, b.data()));
}

TEST(Dense, EigenvectorsOfSymmetricMatrices)
{
    for (int n : {1, 6, 24}) {
        Matrix half = Matrix::Random(n, n), a = half + half.transpose(), copy = a, vectors(n, n);
        Eigen::VectorXd values(n);
        pliant_dense_symmetric_eigen(n, copy.data(), values.data(), vectors.data());
        EXPECT_LT((product(vectors.transpose(), vectors) - Eigen::MatrixXd::Identity(n, n)).norm(), 1e-12 * n);
        EXPECT_LT((product(a, vectors) - product(vectors, values.asDiagonal())).norm(), 1e-12 * n * a.norm());
    }
}

} // namespace
