/* Plans made ready for tracking: references, feed-forward, gains and norms at the control steps; see
moe_policy/control/following.py.

Before this file stand the functions rate(x, u, s) -> [dx/dt], [L] and linearisation(x, u, s, h) -> [A B] of CasADi, the
macros NX, NU, NC, RATE_W and LINEARISATION_W, moe_policy/control/step.c and moe_policy/control/riccati.c. */

/* Bounds of the states, (NX), and weights of the tracking cost, (NX) and (NU); numbers are those of the enumeration. */
typedef struct {
  boxes boxes;
  const double *state_lower, *state_upper, *weight_state, *weight_control, *numbers;
} regulation;
enum { CONTROL_PERIOD, MARGIN, COUNT_TOLERANCE, AUTHORITY };

/* Of each row the bounds of the duration, (2), the goal's state and control, the gain and the norm there, and the weight
at the end of a plan. */
typedef struct {
  const double *durations, *states, *controls, *gains, *norms, *terminal;
} goals;

/* States (knots, NX), and controls (knots - 1, NU) between them. */
typedef struct {
  long long knots;
  const double *states, *controls;
  double duration;
} trajectory;

static int all_finite(const double *values, long long count) {
  int finite = 1;
  for (long long i = 0; i < count; ++i) finite &= isfinite(values[i]) != 0;
  return finite;
}

/* The knots and the control of an interval in their boxes, and the slopes at the knots under that control. */
typedef struct {
  double left[NX], right[NX], control[NU], left_slope[NX], right_slope[NX];
} interval;

static void slope_at(const double *x, const double *u, const double *context, double *slope) {
  double work[RATE_W + 1];
  const double *arguments[] = {x, u, context};
  double *results[] = {slope, 0};
  rate(arguments, results, 0, work, 0);
}

static void clipped_control(const regulation *g, const double *u, double *inside) {
  for (int j = 0; j < NU; ++j) inside[j] = clip(u[j], g->boxes.lower[j], g->boxes.upper[j]);
}

static void prepare(const regulation *g, const trajectory *plan, long long number, const double *context, interval *i) {
  const double *x = plan->states + number * NX;
  for (int j = 0; j < NX; ++j) {
    i->left[j] = clip(x[j], g->state_lower[j], g->state_upper[j]);
    i->right[j] = clip(x[NX + j], g->state_lower[j], g->state_upper[j]);
  }
  clipped_control(g, plan->controls + number * NU, i->control);
  slope_at(i->left, i->control, context, i->left_slope);
  slope_at(i->right, i->control, context, i->right_slope);
}

/* States at the control steps, by cubic Hermite polynomials whose slopes use the interval's own control. */
static void resample(const regulation *g, const trajectory *plan, const double *context, long long steps,
                     double *references) {
  const long long last = plan->knots - 2;
  const double knot_step = plan->duration / (double)(last + 1);
  long long known = -1;
  interval i;
  for (long long k = 0; k < steps; ++k) {
    const double position = clip(g->numbers[CONTROL_PERIOD] * (double)k / knot_step, 0.0, (double)(last + 1));
    const long long number = position < (double)last ? (long long)position : last;
    const double s = position - (double)number, r = 1 - s;
    if (number != known) prepare(g, plan, number, context, &i);
    known = number;
    for (int j = 0; j < NX; ++j) {
      const double x = (1 + 2 * s) * (r * r) * i.left[j] + s * (r * r) * (i.left_slope[j] * knot_step) +
                       s * s * (3 - 2 * s) * i.right[j] + s * s * (s - 1) * (i.right_slope[j] * knot_step);
      references[k * NX + j] = clip(x, g->state_lower[j], g->state_upper[j]);
    }
  }
}

/* Time averages of the plan's control over the control steps, with that of the goal after its end. */
static void average(const regulation *g, const trajectory *plan, const double *after, long long steps,
                    double *means) {
  const long long intervals = plan->knots - 1;
  const double dt = g->numbers[CONTROL_PERIOD], knot_step = plan->duration / (double)intervals;
  double integral[NU] = {0}, before[NU] = {0}, u[NU];
  long long done = 0;
  for (long long k = 1; k <= steps; ++k) {
    const double time = dt * (double)k;
    const long long number = time / knot_step < (double)intervals ? (long long)(time / knot_step) : intervals;
    for (; done < number; ++done) {
      clipped_control(g, plan->controls + done * NU, u);
      for (int j = 0; j < NU; ++j) integral[j] += u[j] * knot_step;
    }
    if (number < intervals) clipped_control(g, plan->controls + number * NU, u);
    for (int j = 0; j < NU; ++j) {
      const double held = number < intervals ? u[j] : after[j];
      const double now = integral[j] + (time - (double)number * knot_step) * held;
      means[(k - 1) * NU + j] = (now - before[j]) / dt;
      before[j] = now;
    }
  }
}

/* Diagonal of R at the feed-forward control u; see moe_policy/control/weights.py. */
static void weigh(const regulation *g, const double *u, double *weights) {
  for (int j = 0; j < NU; ++j) {
    const double lower = g->boxes.lower[j], upper = g->boxes.upper[j];
    const double authority = 2 * fmin(u[j] - lower, upper - u[j]) / (upper - lower);
    const double most = fmax(authority, g->numbers[AUTHORITY]);
    weights[j] = g->weight_control[j] / (most * most);
  }
}

/* Gains and norms along so many control steps, from the last to the first. */
static void regulate(const regulation *g, const double *terminal, const tracked *t, const double *context,
                     long long steps) {
  state_matrix p;
  double weights[NU], columns[NX * (NX + NU)], work[LINEARISATION_W + 1];
  for (int i = 0; i < NX * NX; ++i) (&p[0][0])[i] = terminal[i];
  for (long long k = steps - 1; k >= 0; --k) {
    const double *u = t->controls + k * NU;
    const double *arguments[] = {t->references + k * NX, u, context, g->numbers + CONTROL_PERIOD};
    double *results[] = {columns};
    linearisation(arguments, results, 0, work, 0);
    weigh(g, u, weights);
    backwards(columns, g->weight_state, weights, p, (double(*)[NX])(t->gains + k * NU * NX),
              (double(*)[NU])(t->norms + k * NU * NU));
  }
}

/* Terminal regulation from a control step on. */
static void hold(const goals *goal, const tracked *t, long long step, long long length) {
  for (long long k = step; k < length; ++k) {
    for (int j = 0; j < NX; ++j) t->references[k * NX + j] = goal->states[j];
    for (int j = 0; j < NU; ++j) t->controls[k * NU + j] = goal->controls[j];
    for (int j = 0; j < NU * NX; ++j) t->gains[k * NU * NX + j] = goal->gains[j];
    for (int j = 0; j < NU * NU; ++j) t->norms[k * NU * NU + j] = goal->norms[j];
  }
}

/* Make one plan ready, in arrays of length control steps; the control steps of the plan, 0 where it is rejected. */
static long long follow_one(const regulation *g, const goals *goal, trajectory plan, const double *context,
                            const tracked *t, long long length, long long *clipped, long long *rejected) {
  const double seconds = plan.duration, shortest = goal->durations[0], longest = goal->durations[1];
  int accepted = all_finite(plan.states, plan.knots * NX) && all_finite(plan.controls, (plan.knots - 1) * NU) &&
                 isfinite(seconds);
  long long steps = 0;
  *clipped = accepted && (seconds < shortest - g->numbers[MARGIN] || seconds > longest + g->numbers[MARGIN]);
  if (accepted) {
    plan.duration = clip(seconds, shortest, longest);
    steps = (long long)ceil(plan.duration / g->numbers[CONTROL_PERIOD] - g->numbers[COUNT_TOLERANCE]);
    if (steps > length - 1) steps = length - 1;
    resample(g, &plan, context, steps, t->references);
    average(g, &plan, goal->controls, steps, t->controls);
    regulate(g, goal->terminal, t, context, steps);
    accepted = all_finite(t->gains, steps * NU * NX);
  }
  *rejected = !accepted;
  *clipped = *clipped && accepted;
  steps = accepted ? steps : 0;
  hold(goal, t, steps, length);
  return steps;
}

/* Make plans ready: states (rows, knots, NX), controls (rows, knots - 1, NU), durations (rows) and contexts (rows, NC)
into tracking arrays of length control steps; steps, clipped and rejected (rows). */
LOCAL void follow(long long rows, long long length, long long knots, const regulation *g, const goals *goal,
                  const double *states, const double *controls, const double *durations, const double *contexts,
                  const tracked *t, long long *steps, long long *clipped, long long *rejected) {
  for (long long row = 0; row < rows; ++row) {
    const trajectory plan = {knots, states + row * knots * NX, controls + row * (knots - 1) * NU, durations[row]};
    const goals there = {goal->durations + row * 2,        goal->states + row * NX,
                         goal->controls + row * NU,        goal->gains + row * NU * NX,
                         goal->norms + row * NU * NU,      goal->terminal + row * NX * NX};
    const tracked own = {t->references + row * length * NX, t->controls + row * length * NU,
                         t->gains + row * length * NU * NX, t->norms + row * length * NU * NU};
    steps[row] = follow_one(g, &there, plan, contexts + row * NC, &own, length, clipped + row, rejected + row);
  }
}
