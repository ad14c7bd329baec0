/* Tracked episodes, with terminal regulation where the plan succeeds, as TrackingPolicy and the simulator run them, one
after another.

Before this file stand moe_policy/control/step.c, the functions control_step(x, u, s) -> [next x], [cost, violation,
reached, left the box] and, if NH > 0, clearances(x, s) -> [h] of CasADi, and the macros NX, NU, NC, NH and the sizes of
the work vectors. */

typedef struct {
  double dt, radius, knots; /* control period, radius of the goal, number of knots */
  const double *goal;       /* (NX) */
  boxes boxes;
} setting;

static double error_of(const setting *s, const double *x) {
  double sum = 0;
  for (int i = 0; i < NX; ++i) {
    const double d = difference(x[i], s->goal[i], s->boxes.period[i]);
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

/* The value in single precision. Volatile, because GCC 12 drops both conversions where it makes them of whole vectors. */
static double single(double value) {
  volatile float rounded = (float)value;
  return rounded;
}

/* One control step of a row from state, which the policy sees in single precision, with the tracking arrays at the index
at; next becomes the following state. */
static void advance(const setting *s, const tracked *t, long long at, const double *state, const double *context,
                    double *next, double *summary) {
  double seen[NX], u[NU], work[CONTROL_STEP_W + 1];
  for (int i = 0; i < NX; ++i) seen[i] = single(state[i]);
  control_at(&s->boxes, t, at, seen, u);
  const double *arguments[] = {state, u, context};
  double *results[] = {next, summary};
  control_step(arguments, results, 0, work, 0);
}

/* Episodes from x (rows, NX), which end there; of each row cost, error at the plan's end, smallest clearance, left the
box, stayed at the goal, and cost up to the plan's end, (rows, 6). Tracking arrays have length control steps. Terminal regulation is run up to the
step evaluations where the plan ends at the goal, and is clear. */
void run(long long rows, long long length, const long long *steps, const long long *evaluations, double dt,
         double radius, double knots, const double *goal, const boxes *b, double *x, const double *contexts,
         const tracked *t, const double *knot_step, double *out) {
  const setting s = {dt, radius, knots, goal, *b};
  for (long long row = 0; row < rows; ++row) {
    double *state = x + row * NX, *result = out + 6 * row, cost = 0, total = 0, left = 0, next[NX], summary[4];
    const double *context = contexts + row * NC;
    double error = error_of(&s, state), clear = clearance_of(state, context);
    int entered = error < radius;
    for (long long step = 1; step <= steps[row] && !left; ++step) {
      const long long at = row * length + step - 1;
      advance(&s, t, at, state, context, next, summary);
      clear = fmin(clear, clearance_of(next, context));
      const double knot = floor(step * dt / knot_step[row] + 1e-9);
      const double fraction = knot * knot_step[row] / dt - (step - 1);
      if (NH > 0 && fraction > 0 && knot < knots) {
        double between[NX];
        for (int i = 0; i < NX; ++i) between[i] = state[i] + fraction * (next[i] - state[i]);
        clear = fmin(clear, clearance_of(between, context));
      }
      if (!entered) cost += summary[0];
      total += summary[0];
      left = summary[3];
      error = error_of(&s, next);
      entered |= error < radius && !left;
      for (int i = 0; i < NX; ++i) state[i] = next[i];
    }
    result[0] = cost; result[1] = error; result[5] = total;
    for (long long step = steps[row]; step < evaluations[row] && !left && result[1] < radius && clear > 0; ++step) {
      advance(&s, t, (row + 1) * length - 1, state, context, next, summary);
      clear = fmin(clear, clearance_of(next, context));
      left = summary[3];
      error = error_of(&s, next);
      for (int i = 0; i < NX; ++i) state[i] = next[i];
    }
    result[2] = clear; result[3] = left; result[4] = error < radius;
  }
}
