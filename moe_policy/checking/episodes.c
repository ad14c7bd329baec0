/* Tracked episodes, with terminal regulation where the plan succeeds, as TrackingPolicy and the simulator run them, one after another.

Before this file stand the functions control_step(x, u, s) -> [next x], [cost, violation, reached, left the box] and, if
NH > 0, clearances(x, s) -> [h] of CasADi, and the macros NX, NU, NC, NH and the sizes of the work vectors. */

#include <math.h>

#define SWEEPS 100
#define SETTLED 1e-9

typedef struct {
  double dt, radius, knots;           /* control period, radius of the goal, number of knots */
  const double *goal, *period;        /* (NX); 0 for a coordinate without a period */
  const double *lower, *upper;        /* bounds of the controls, (NU) */
} setting;

static double difference(const double *x, const double *y, int i, const double *period) {
  const double d = x[i] - y[i];
  return period[i] > 0 ? d - period[i] * floor(d / period[i] + 0.5) : d;
}

static double error_of(const setting *s, const double *x) {
  double sum = 0;
  for (int i = 0; i < NX; ++i) {
    const double d = difference(x, s->goal, i, s->period);
    sum += d * d;
  }
  return sqrt(sum);
}

static double clearance_of(const double *x, const double *context) {
#if NH > 0
  double h[NH], work[CLEARANCES_W + 1], least = INFINITY;
  const double *arguments[] = {x, context};
  double *results[] = {h};
  clearances(arguments, results, 0, work, 0);
  for (int i = 0; i < NH; ++i)
    if (!(h[i] >= least)) least = h[i];
  return least;
#else
  return INFINITY;
#endif
}

static double clip(double value, double lower, double upper) {
  return value < lower ? lower : value > upper ? upper : value;
}

/* The point of the box nearest to u in the norm h, by coordinate descent; see moe_policy/control/projection.py. */
static void project(const setting *s, const double *h, double *u) {
  double target[NU];
  int inside = 1;
  for (int i = 0; i < NU; ++i) {
    target[i] = u[i];
    u[i] = clip(u[i], s->lower[i], s->upper[i]);
    inside &= u[i] == target[i];
  }
  if (inside || NU == 1) return;
  for (int sweep = 0; sweep < SWEEPS; ++sweep) {
    int settled = 1;
    for (int i = 0; i < NU; ++i) {
      const double before = u[i];
      double slope = 0;
      for (int j = 0; j < NU; ++j) slope += h[i * NU + j] * (u[j] - target[j]);
      u[i] = clip(u[i] - slope / h[i * NU + i], s->lower[i], s->upper[i]);
      settled &= fabs(u[i] - before) <= SETTLED * (s->upper[i] - s->lower[i]);
    }
    if (settled) break;
  }
}

/* The control at the state x, which the policy sees in single precision. */
static void control_at(const setting *s, const double *x, const double *reference, const double *forward,
                       const double *gain, const double *norm, double *u) {
  double error[NX], seen[NX];
  for (int i = 0; i < NX; ++i) seen[i] = (double)(float)x[i];
  for (int i = 0; i < NX; ++i) error[i] = difference(seen, reference, i, s->period);
  for (int i = 0; i < NU; ++i) {
    double feedback = 0;
    for (int j = 0; j < NX; ++j) feedback += gain[i * NX + j] * error[j];
    u[i] = forward[i] - feedback;
  }
  project(s, norm, u);
}

/* One control step of a row from state, with the tracking arrays at the index at; next becomes the following state. */
static void advance(const setting *s, const double *state, const double *context, const double *references,
                    const double *controls, const double *gains, const double *norms, long long at, double *next,
                    double *summary) {
  double u[NU], work[CONTROL_STEP_W + 1];
  control_at(s, state, references + at * NX, controls + at * NU, gains + at * NU * NX, norms + at * NU * NU, u);
  const double *arguments[] = {state, u, context};
  double *results[] = {next, summary};
  control_step(arguments, results, 0, work, 0);
}

/* Episodes from x (rows, NX), which end there; of each row cost, error at the plan's end, smallest clearance, left the
box, and stayed at the goal, (rows, 5). References, controls, gains and norms have length control steps, the last of them
being that of terminal regulation. That is run up to the step evaluations where the plan ends at the goal, and is clear. */
void run(long long rows, long long length, const long long *steps, const long long *evaluations, double dt, double radius, double knots,
         const double *goal, const double *period, const double *lower, const double *upper, double *x,
         const double *contexts, const double *references, const double *controls, const double *gains,
         const double *norms, const double *knot_step, double *out) {
  const setting s = {dt, radius, knots, goal, period, lower, upper};
  for (long long row = 0; row < rows; ++row) {
    double *state = x + row * NX, *result = out + 5 * row, cost = 0, left = 0, next[NX], summary[4];
    const double *context = contexts + row * NC;
    double error = error_of(&s, state), clear = clearance_of(state, context);
    int entered = error < radius;
    for (long long step = 1; step <= steps[row] && !left; ++step) {
      const long long at = row * length + step - 1;
      advance(&s, state, context, references, controls, gains, norms, at, next, summary);
      clear = fmin(clear, clearance_of(next, context));
      const double knot = floor(step * dt / knot_step[row] + 1e-9);
      const double fraction = knot * knot_step[row] / dt - (step - 1);
      if (NH > 0 && fraction > 0 && knot < knots) {
        double between[NX];
        for (int i = 0; i < NX; ++i) between[i] = state[i] + fraction * (next[i] - state[i]);
        clear = fmin(clear, clearance_of(between, context));
      }
      if (!entered) cost += summary[0];
      left = summary[3];
      error = error_of(&s, next);
      entered |= error < radius && !left;
      for (int i = 0; i < NX; ++i) state[i] = next[i];
    }
    result[0] = cost; result[1] = error;
    for (long long step = steps[row]; step < evaluations[row] && !left && result[1] < radius && clear > 0; ++step) {
      advance(&s, state, context, references, controls, gains, norms, (row + 1) * length - 1, next, summary);
      clear = fmin(clear, clearance_of(next, context));
      left = summary[3];
      error = error_of(&s, next);
      for (int i = 0; i < NX; ++i) state[i] = next[i];
    }
    result[2] = clear; result[3] = left; result[4] = error < radius;
  }
}
