/* A step of the Riccati recursion of moe_policy/control/lqr.py, backwards in time.

Before this file stand the macros NX and NU. Matrices of this file are stored by rows. */

#include <math.h>

typedef double state_matrix[NX][NX];

/* Solve h y = y in place for NX right-hand sides, h being NU x NU, by elimination with partial pivoting. */
static void solve(double h[NU][NU], double y[NU][NX]) {
  for (int c = 0; c < NU; ++c) {
    int pivot = c;
    for (int i = c + 1; i < NU; ++i)
      if (fabs(h[i][c]) > fabs(h[pivot][c])) pivot = i;
    if (pivot != c) {
      for (int j = 0; j < NU; ++j) { double t = h[c][j]; h[c][j] = h[pivot][j]; h[pivot][j] = t; }
      for (int j = 0; j < NX; ++j) { double t = y[c][j]; y[c][j] = y[pivot][j]; y[pivot][j] = t; }
    }
    for (int i = c + 1; i < NU; ++i) {
      double factor = h[i][c] / h[c][c];
      for (int j = c; j < NU; ++j) h[i][j] -= factor * h[c][j];
      for (int j = 0; j < NX; ++j) y[i][j] -= factor * y[c][j];
    }
  }
  for (int i = NU - 1; i >= 0; --i) {
    for (int k = i + 1; k < NU; ++k)
      for (int j = 0; j < NX; ++j) y[i][j] -= h[i][k] * y[k][j];
    for (int j = 0; j < NX; ++j) y[i][j] /= h[i][i];
  }
}

/* The step K, H <- P and P <- Q + A'P(A - BK), with columns = [A B]. */
static void backwards(const double *columns, const double *q, const double *r, state_matrix p,
                      double gain[NU][NX], double norm[NU][NU]) {
  double a[NX][NX], b[NX][NU], bp[NU][NX] = {{0}}, h[NU][NU], m[NX][NX] = {{0}}, f[NX][NX] = {{0}};
  for (int i = 0; i < NX; ++i) {
    for (int j = 0; j < NX; ++j) a[i][j] = columns[j * NX + i];
    for (int j = 0; j < NU; ++j) b[i][j] = columns[(NX + j) * NX + i];
  }
  for (int k = 0; k < NX; ++k)
    for (int i = 0; i < NU; ++i)
      for (int j = 0; j < NX; ++j) bp[i][j] += b[k][i] * p[k][j];
  for (int i = 0; i < NU; ++i)
    for (int j = 0; j < NU; ++j) {
      double sum = i == j ? r[i] : 0.0;
      for (int k = 0; k < NX; ++k) sum += bp[i][k] * b[k][j];
      norm[i][j] = h[i][j] = sum;
    }
  for (int i = 0; i < NU; ++i) {
    for (int j = 0; j < NX; ++j) gain[i][j] = 0.0;
    for (int k = 0; k < NX; ++k)
      for (int j = 0; j < NX; ++j) gain[i][j] += bp[i][k] * a[k][j];
  }
  solve(h, gain);
  double closed[NX][NX];
  for (int i = 0; i < NX; ++i) {
    for (int j = 0; j < NX; ++j) closed[i][j] = a[i][j];
    for (int k = 0; k < NU; ++k)
      for (int j = 0; j < NX; ++j) closed[i][j] -= b[i][k] * gain[k][j];
  }
  for (int i = 0; i < NX; ++i)
    for (int k = 0; k < NX; ++k)
      for (int j = 0; j < NX; ++j) m[i][j] += p[i][k] * closed[k][j];
  for (int k = 0; k < NX; ++k)
    for (int i = 0; i < NX; ++i)
      for (int j = 0; j < NX; ++j) f[i][j] += a[k][i] * m[k][j];
  for (int i = 0; i < NX; ++i) {
    for (int j = 0; j < NX; ++j) p[i][j] = (f[i][j] + f[j][i]) / 2;
    p[i][i] += q[i];
  }
}
