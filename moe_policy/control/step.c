/* The control step of tracking; see moe_policy/control/tracking.py and moe_policy/control/projection.py.

Before this file stand the macros NX, NU and NC. Matrices are stored by rows. */

#include <math.h>
#ifndef LOCAL
#define LOCAL /* static where other files need not see the functions */
#endif

#define SWEEPS 100
#define SETTLED 1e-9

/* Periods of the state, (NX), 0 for a coordinate without one, and bounds of the controls, (NU). */
typedef struct { const double *period, *lower, *upper; } boxes;
/* References (rows, length, NX), feed-forward (rows, length, NU), gains (rows, length, NU, NX) and norms (rows, length,
NU, NU); the last of length control steps is that of terminal regulation. */
typedef struct { double *references, *controls, *gains, *norms; } tracked;

static double difference(double x, double y, double period) {
  const double d = x - y;
  return period > 0 ? d - period * floor(d / period + 0.5) : d;
}

static double clip(double value, double lower, double upper) {
  return value < lower ? lower : value > upper ? upper : value;
}

/* The point of the box nearest to u in the norm h, by coordinate descent. */
static void project(const boxes *b, const double *h, double *u) {
  double target[NU];
  int inside = 1;
  for (int i = 0; i < NU; ++i) {
    target[i] = u[i];
    u[i] = clip(u[i], b->lower[i], b->upper[i]);
    inside &= u[i] == target[i];
  }
  if (inside || NU == 1) return;
  for (int sweep = 0; sweep < SWEEPS; ++sweep) {
    int settled = 1;
    for (int i = 0; i < NU; ++i) {
      const double before = u[i];
      double slope = 0;
      for (int j = 0; j < NU; ++j) slope += h[i * NU + j] * (u[j] - target[j]);
      u[i] = clip(u[i] - slope / h[i * NU + i], b->lower[i], b->upper[i]);
      settled &= fabs(u[i] - before) <= SETTLED * (b->upper[i] - b->lower[i]);
    }
    if (settled) break;
  }
}

/* The control u at the state x, with the tracking arrays at the index at. */
static void control_at(const boxes *b, const tracked *t, long long at, const double *x, double *u) {
  const double *gain = t->gains + at * NU * NX;
  double error[NX];
  for (int i = 0; i < NX; ++i) error[i] = difference(x[i], t->references[at * NX + i], b->period[i]);
  for (int i = 0; i < NU; ++i) {
    double feedback = 0;
    for (int j = 0; j < NX; ++j) feedback += gain[i * NX + j] * error[j];
    u[i] = t->controls[at * NU + i] - feedback;
  }
  project(b, t->norms + at * NU * NU, u);
}

/* Controls (rows, NU) at observations (rows, NX + NC), each row at the control step that its clock shows. */
LOCAL void act(long long rows, long long length, const long long *clock, const double *observations, const boxes *b,
         const tracked *t, double *controls) {
  for (long long row = 0; row < rows; ++row) {
    const long long step = clock[row] < length ? clock[row] : length - 1;
    control_at(b, t, row * length + step, observations + row * (NX + NC), controls + row * NU);
  }
}
