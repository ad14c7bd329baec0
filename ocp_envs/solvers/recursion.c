/* A program of stages, its functions, and its Newton steps by the Riccati recursion of the interior-point method.

Before this file stand the functions of the stages (ocp_envs/solvers/fused.py) and the macros of the sizes: of a state
with the step h, NX, and of a control, NU; the number of intervals, K; the sizes of the context, NS, of the clearances,
NC, of the inequalities and equalities in an interval, NI and NE, and at the end, FI and FE. Matrices are stored by
rows; NZ is the size of the variables z = (x, h, u) of a stage, of which the first x and the last u are no variables. */

#include <math.h>
#include <string.h>

#define NZ (NX + NU)
#define H (NX - 1)
#define NG (NC + NI + NE)
#define CONSTRAINTS (K * NG + NC + FI + FE)
#define SOME(n) ((n) > 0 ? (n) : 1)

/* Constraints of stage k: the inequalities begin at FIRST(k), the equalities at EQUAL(k); LAST(k) is past the end.
   Clearances of the given state at stage 0 are no constraints. */
#define FIRST(k) ((k) * NG + ((k) == 0 ? NC : 0))
#define EQUAL(k) ((k) * NG + NC + ((k) < K ? NI : FI))
#define LAST(k) ((k) < K ? ((k) + 1) * NG : CONSTRAINTS)
#define EACH_STAGE for (int k = 0; k <= K; k++)
#define EACH_VARIABLE EACH_STAGE for (int i = 0; i < NZ; i++)
#define EACH_INEQUALITY EACH_STAGE for (int c = FIRST(k); c < EQUAL(k); c++)
#define EACH_EQUALITY EACH_STAGE for (int c = EQUAL(k); c < LAST(k); c++)

/* Equalities e = 0 are kept by the augmented Lagrangian -y e + e^2 / 2 SOFT, whose multipliers y every step renews. */
#define SOFT 1e-8
/* Pivots below this are not positive. */
#define LEAST_PIVOT 1e-12

typedef double of_variables[K + 1][NZ];
typedef double of_dynamics[K + 1][NX]; /* that of the interval that ends at a stage; none at stage 0 */
typedef double of_constraints[SOME(CONSTRAINTS)];

/* Variables z, slacks s of inequalities; multipliers lambda of dynamics, y of constraints, below and above of bounds.
   The Lagrangian is f + lambda'(F - x) - y'(c - s) - below'(z - lower) - above'(upper - z). */
typedef struct {
  of_variables z, below, above;
  of_constraints s, y;
  of_dynamics lambda;
} point;

typedef struct {
  of_dynamics next; /* F of the interval that ends at a stage */
  double cost[K + 1];
  of_constraints c;
} stage_values;

typedef struct {
  point now, step;
  of_variables trial, lower, upper;
  of_constraints trial_s, least;
  double context[K][SOME(NS)];
  stage_values at, at_trial;
  of_variables gradient, lagrangian; /* of the cost, and of f + lambda'F - y'c */
  double dynamics[K][NX][NZ], constraint[SOME(CONSTRAINTS)][NZ], hessian[K + 1][NZ][NZ];
  of_dynamics defect;
  of_constraints residual;
  /* of the recursion */
  of_variables sigma, rhs;
  double value[K + 1][NX][NX], linear[K + 1][NX], gain[K][NU][NX], feed[K][NU], factor[K][NU][NU];
  double mu, shift, penalty, damping, violation, largest, objective, merit;
  int fixed_step;
} state;

static void evaluate(state *w) {
  const double *in[] = {w->now.z[0], w->context[0], w->now.lambda[1], w->now.y};
  double *out[] = {w->at.next[1], w->at.cost, w->at.c, w->gradient[0], w->lagrangian[0],
                   w->dynamics[0][0], w->constraint[0], w->hessian[0][0]};
  rows_stage(K, in, out);
  const double *in_end[] = {w->now.z[K], w->context[0], w->now.y + K * NG};
  double *out_end[] = {w->at.cost + K, w->at.c + K * NG, w->gradient[K], w->lagrangian[K],
                       w->constraint[K * NG], w->hessian[K][0]};
  rows_end(1, in_end, out_end);
}

static void evaluate_trial(state *w) {
  const double *in[] = {w->trial[0], w->context[0]}, *in_end[] = {w->trial[K], w->context[0]};
  double *out[] = {w->at_trial.next[1], w->at_trial.cost, w->at_trial.c};
  double *out_end[] = {w->at_trial.cost + K, w->at_trial.c + K * NG};
  rows_stage_values(K, in, out);
  rows_end_values(1, in_end, out_end);
}

/* Second derivatives of the barrier problem of stage k, with `shift` on the diagonal. */
static void second_derivatives(const state *w, int k, double shift, double q[NZ][NZ]) {
  memcpy(q, w->hessian[k], sizeof w->hessian[k]);
  for (int i = 0; i < NZ; i++) q[i][i] += w->sigma[k][i] + shift;
  for (int c = FIRST(k); c < LAST(k); c++) {
    double weight = c < EQUAL(k) ? w->now.y[c] / (w->now.s[c] - w->least[c]) : 1 / SOFT;
    for (int i = 0; i < NZ; i++) {
      double factor = weight * w->constraint[c][i];
      for (int j = 0; j < NZ; j++) q[i][j] += factor * w->constraint[c][j];
    }
  }
}

/* q += M'PM */
static void add_value(const double p[NX][NX], const double m[NX][NZ], double q[NZ][NZ]) {
  double pm[NX][NZ];
  for (int i = 0; i < NX; i++) {
    double row[NZ] = {0};
    for (int r = 0; r < NX; r++)
      for (int j = 0; j < NZ; j++) row[j] += p[i][r] * m[r][j];
    memcpy(pm[i], row, sizeof row);
  }
  for (int i = 0; i < NZ; i++) {
    double row[NZ];
    memcpy(row, q[i], sizeof row);
    for (int r = 0; r < NX; r++)
      for (int j = 0; j < NZ; j++) row[j] += m[r][i] * pm[r][j];
    memcpy(q[i], row, sizeof row);
  }
}

/* Eliminate the controls from q: their Cholesky factor l, the gain and the value of the states, in q; 0 where the block
   of the controls is not positive definite. */
static int eliminate(double q[NZ][NZ], double l[NU][NU], double gain[NU][NX]) {
  double y[NU][NX];
  for (int i = 0; i < NU; i++) {
    for (int j = 0; j <= i; j++) {
      double sum = q[NX + i][NX + j];
      for (int r = 0; r < j; r++) sum -= l[i][r] * l[j][r];
      if (i == j && !(sum > LEAST_PIVOT)) return 0;
      l[i][j] = i == j ? sqrt(sum) : sum / l[j][j];
    }
    double inverse = 1 / l[i][i];
    for (int j = 0; j < NX; j++) y[i][j] = q[NX + i][j];
    for (int r = 0; r < i; r++)
      for (int j = 0; j < NX; j++) y[i][j] -= l[i][r] * y[r][j];
    for (int j = 0; j < NX; j++) y[i][j] *= inverse;
  }
  for (int i = 0; i < NX; i++)
    for (int r = 0; r < NU; r++)
      for (int j = 0; j < NX; j++) q[i][j] -= y[r][i] * y[r][j];
  for (int i = NU - 1; i >= 0; i--) {
    double inverse = -1 / l[i][i];
    for (int r = i + 1; r < NU; r++)
      for (int j = 0; j < NX; j++) y[i][j] += l[r][i] * gain[r][j];
    for (int j = 0; j < NX; j++) gain[i][j] = inverse * y[i][j];
  }
  return 1;
}

/* The matrices of the recursion with `shift` on the diagonal of the second derivatives; 0 where they are not positive
   definite in the directions that keep the linearised dynamics. */
static int factorise(state *w, double shift) {
  for (int k = K; k >= 0; k--) {
    double q[NZ][NZ];
    second_derivatives(w, k, shift, q);
    if (k < K) {
      add_value(w->value[k + 1], w->dynamics[k], q);
      if (!eliminate(q, w->factor[k], w->gain[k])) return 0;
    }
    for (int i = 0; i < NX; i++)
      for (int j = 0; j < NX; j++) w->value[k][i][j] = (q[i][j] + q[j][i]) / 2;
  }
  return w->fixed_step || w->value[0][H][H] > LEAST_PIVOT;
}

static void solve_factor(const double l[NU][NU], double *x) {
  for (int i = 0; i < NU; i++) {
    for (int r = 0; r < i; r++) x[i] -= l[i][r] * x[r];
    x[i] /= l[i][i];
  }
  for (int i = NU - 1; i >= 0; i--) {
    for (int r = i + 1; r < NU; r++) x[i] -= l[r][i] * x[r];
    x[i] /= l[i][i];
  }
}

/* The linear terms of the recursion, backwards, for the right-hand side and the defects. */
static void backwards(state *w) {
  memcpy(w->linear[K], w->rhs[K], sizeof w->linear[K]);
  for (int k = K - 1; k >= 0; k--) {
    double v[NX], q[NZ];
    for (int i = 0; i < NX; i++) {
      v[i] = w->linear[k + 1][i];
      for (int r = 0; r < NX; r++) v[i] += w->value[k + 1][i][r] * w->defect[k + 1][r];
    }
    memcpy(q, w->rhs[k], sizeof q);
    for (int r = 0; r < NX; r++)
      for (int i = 0; i < NZ; i++) q[i] += w->dynamics[k][r][i] * v[r];
    for (int i = 0; i < NU; i++) w->feed[k][i] = -q[NX + i];
    solve_factor(w->factor[k], w->feed[k]);
    memcpy(w->linear[k], q, sizeof w->linear[k]);
    for (int r = 0; r < NU; r++)
      for (int i = 0; i < NX; i++) w->linear[k][i] += w->gain[k][r][i] * q[NX + r];
  }
}

/* Steps of the variables, and of the multipliers of the dynamics, forwards. The step of h is damped. */
static void forwards(state *w) {
  memset(w->step.z[0], 0, sizeof w->step.z[0]);
  if (!w->fixed_step) w->step.z[0][H] = -w->linear[0][H] / (w->value[0][H][H] + w->damping);
  for (int k = 0; k < K; k++) {
    double *z = w->step.z[k], *x = w->step.z[k + 1];
    for (int i = 0; i < NU; i++) {
      double sum = w->feed[k][i];
      for (int j = 0; j < NX; j++) sum += w->gain[k][i][j] * z[j];
      z[NX + i] = sum;
    }
    for (int i = 0; i < NX; i++) {
      double sum = w->defect[k + 1][i];
      for (int j = 0; j < NZ; j++) sum += w->dynamics[k][i][j] * z[j];
      x[i] = sum;
    }
    for (int i = 0; i < NX; i++) {
      double sum = w->linear[k + 1][i] - w->now.lambda[k + 1][i];
      for (int j = 0; j < NX; j++) sum += w->value[k + 1][i][j] * x[j];
      w->step.lambda[k + 1][i] = sum;
    }
  }
  memset(w->step.z[K] + NX, 0, NU * sizeof(double));
}
