/* A primal-dual interior-point method with a line search on an exact penalty (Nocedal & Wright, Numerical Optimization,
2006, chapter 19; Waechter & Biegler, Mathematical Programming 106, 2006, for its details).

The barrier parameter begins in proportion to the guess's violation of the constraints and to its cost, so that good
guesses keep their solution family, and is reduced where the violation is smaller. While constraints are violated the step of h is damped:
a short motion violates them least, and the method would end there. */

#define LEAST_BARRIER 1e-3
#define MOST_BARRIER 1.0
#define OF_GUESS 2e-3
#define DAMPING 30.0
/* Guesses are moved inside by this part of a bound, or of the distance between bounds where that is less. */
#define PUSH 1e-2
#define MOST_SHIFTS 30
#define LEAST_STEP 1e-9
/* Multipliers of bounds are kept within this factor of those on the central path. */
#define NEIGHBOURHOOD 1e10

/* How a solve ended, as ocp_envs/solvers/interior.py has it, or that it goes on. */
enum { CONVERGED, STUCK, NOT_FINITE, MOVED };

typedef struct {
  double tolerance;
  long long iterations;
} limits;

void workspace(long long *bytes) { *bytes = sizeof(state); }

/* Factorise, with the least shift that makes the second derivatives positive definite; 0 where none does. */
static int factorise_shifted(state *w) {
  if (factorise(w, 0)) return 1;
  double shift = w->shift == 0 ? 1e-4 : larger(1e-20, w->shift / 3), growth = w->shift == 0 ? 100 : 8;
  for (int tries = 0; tries < MOST_SHIFTS; tries++, shift *= growth)
    if (factorise(w, shift)) {
      w->shift = shift;
      return 1;
    }
  return 0;
}

/* Raise the penalty such that the step reduces the merit, cost + penalty x violation; returns by how much, to first
   order. */
static double descent(state *w) {
  double along = slope(w);
  if (w->violation > 1e-12) {
    double needed = (along + curvature(w, along) / 2) / (0.7 * w->violation);
    if (needed > w->penalty) w->penalty = needed + 1e-6;
  }
  return w->penalty * w->violation - along;
}

/* Halve the `step` until it reduces the merit; 0 where it becomes too short. The trial point is the new one. */
static double search(state *w, double step, double reduction) {
  static const double rounding = 2e-15, part = 1e-4;
  double before = w->objective - barrier(w, w->now.z, w->now.s), largest;
  of_dynamics defect;
  of_constraints residual;
  for (; step >= LEAST_STEP; step /= 2) {
    EACH_VARIABLE w->trial[k][i] = w->now.z[k][i] + step * w->step.z[k][i];
    EACH_INEQUALITY w->trial_s[c] = w->now.s[c] + step * w->step.s[c];
    evaluate_trial(w);
    double sum = violation(w->trial, w->trial_s, &w->at_trial, defect, residual, &largest);
    double after = total_cost(&w->at_trial) - barrier(w, w->trial, w->trial_s);
    double change = after - before + w->penalty * (sum - w->violation);
    if (change <= rounding * fabs(before) - part * step * reduction) return step; /* false where it is not finite */
  }
  return 0;
}

/* A multiplier in the neighbourhood of the central path, for a distance from the bound. */
static double kept_central(const state *w, double multiplier, double distance) {
  double central = w->mu / distance;
  return larger(smaller(multiplier, NEIGHBOURHOOD * central), central / NEIGHBOURHOOD);
}

static void move(state *w, double step, double dual_step) {
  point *now = &w->now;
  memcpy(now->z, w->trial, sizeof now->z);
  EACH_INEQUALITY {
    now->s[c] = w->trial_s[c];
    now->y[c] = kept_central(w, now->y[c] + dual_step * w->step.y[c], now->s[c] - w->least[c]);
  }
  EACH_EQUALITY now->y[c] += step * w->step.y[c];
  for (int k = 1; k <= K; k++)
    for (int i = 0; i < NX; i++) now->lambda[k][i] += step * w->step.lambda[k][i];
  EACH_VARIABLE {
    double a = now->z[k][i] - w->lower[k][i], b = w->upper[k][i] - now->z[k][i];
    now->below[k][i] = kept_central(w, now->below[k][i] + dual_step * w->step.below[k][i], a);
    now->above[k][i] = kept_central(w, now->above[k][i] + dual_step * w->step.above[k][i], b);
  }
}

static void central_multipliers(state *w) {
  point *now = &w->now;
  EACH_VARIABLE {
    now->below[k][i] = w->mu / (now->z[k][i] - w->lower[k][i]);
    now->above[k][i] = w->mu / (w->upper[k][i] - now->z[k][i]);
  }
  EACH_INEQUALITY now->y[c] = w->mu / (now->s[c] - w->least[c]);
}

/* Bounds without those of what is no variable; 0 where a variable has no room between them. */
static int set_bounds(state *w) {
  EACH_VARIABLE {
    int absent = k == 0 ? i < H : k == K && i >= NX;
    if (absent || !(w->lower[k][i] > -FAR)) w->lower[k][i] = -FAR;
    if (absent || !(w->upper[k][i] < FAR)) w->upper[k][i] = FAR;
  }
  w->fixed_step = w->lower[0][H] == w->upper[0][H];
  EACH_STAGE if (w->fixed_step) {
    w->now.z[k][H] = w->lower[0][H];
    if (k) w->lower[k][H] = -FAR, w->upper[k][H] = FAR;
  }
  if (w->fixed_step) w->lower[0][H] = -FAR, w->upper[0][H] = FAR;
  EACH_VARIABLE if (!(w->lower[k][i] < w->upper[k][i])) return 0;
  return 1;
}

/* What is not finite stays so. */
static void put_inside(state *w) {
  EACH_VARIABLE {
    double l = w->lower[k][i], u = w->upper[k][i], room = PUSH * (u - l), *z = &w->now.z[k][i];
    double low = l + smaller(PUSH * larger(1, fabs(l)), room), high = u - smaller(PUSH * larger(1, fabs(u)), room);
    if (l > -FAR && *z < low) *z = low;
    if (u < FAR && *z > high) *z = high;
  }
}

/* The first point from the guess in now.z, and the barrier parameter; 0 where a value is not finite. */
static int begin(state *w) {
  put_inside(w);
  memset(w->now.lambda, 0, sizeof w->now.lambda);
  memset(w->now.y, 0, sizeof w->now.y);
  memcpy(w->trial, w->now.z, sizeof w->trial);
  evaluate_trial(w);
  EACH_INEQUALITY w->now.s[c] = larger(w->at_trial.c[c], w->least[c] + PUSH * larger(1, fabs(w->least[c])));
  double sum = violation(w->now.z, w->now.s, &w->at_trial, w->defect, w->residual, &w->largest);
  w->mu = smaller(MOST_BARRIER, larger(LEAST_BARRIER, OF_GUESS * sum * fabs(total_cost(&w->at_trial))));
  w->shift = 0;
  w->penalty = 1e-6;
  central_multipliers(w);
  update(w);
  return isfinite(w->violation) && isfinite(w->objective);
}

/* Whether the point is a solution or none; where it is neither, the barrier parameter is reduced if its problem is
   solved well enough. */
static int ended_at(state *w, const limits *limit) {
  const double last = limit->tolerance / 11;
  double dual_scale, scale, dual = stationarity(w);
  scales(w, &dual_scale, &scale);
  dual /= dual_scale;
  if (!isfinite(dual)) return NOT_FINITE;
  double error = larger(dual, w->largest);
  if (w->mu <= 3 * last && larger(error, complementarity(w, 0) / scale) <= limit->tolerance) return CONVERGED;
  if (w->mu > last && w->largest <= 0.1 * w->mu &&
      larger(dual, complementarity(w, w->mu) / scale) <= 10 * w->mu) {
    w->mu = larger(last, smaller(0.1 * w->mu, pow(w->mu, 1.7)));
    w->penalty = 1e-6;
  }
  return MOVED;
}

static int derivatives_finite(const state *w) {
  double sum = 0;
  EACH_STAGE for (int i = 0; i < NZ; i++) for (int j = 0; j < NZ; j++) sum += 0 * w->hessian[k][i][j];
  return isfinite(sum);
}

/* One iteration. */
static int iterate(state *w) {
  right_hand_side(w);
  if (!factorise_shifted(w)) return derivatives_finite(w) ? STUCK : NOT_FINITE;
  w->damping = DAMPING * w->violation;
  backwards(w);
  forwards(w);
  step_of_the_others(w);
  double most = larger(0.99, 1 - w->mu), longest = longest_step(w, most), dual_step = longest_dual_step(w, most);
  double reduction = descent(w), step = isfinite(reduction) ? search(w, longest, reduction) : 0;
  if (step == 0) return STUCK;
  move(w, step, dual_step);
  update(w);
  return MOVED;
}

/* Solve the program in the workspace w from the guess z (K + 1, NZ), the initial state being that of its first row, for
   bounds (K + 1, NZ) and least values of constraints: z becomes the last point, y receives the multipliers of the
   constraints, f the cost, and ended how it ended and the number of iterations. */
void solve(state *w, const limits *limit, double *z, const double *lower, const double *upper, const double *least,
           const double *context, double *y, double *f, long long *ended) {
  memcpy(w->now.z, z, sizeof w->now.z);
  memcpy(w->lower, lower, sizeof w->lower);
  memcpy(w->upper, upper, sizeof w->upper);
  memcpy(w->least, least, CONSTRAINTS * sizeof(double));
  for (int k = 0; k < K; k++) memcpy(w->context[k], context, NS * sizeof(double));
  long long count = 0, outcome = STUCK;
  if (set_bounds(w)) {
    outcome = begin(w) ? MOVED : NOT_FINITE;
    for (; outcome == MOVED; count++) {
      outcome = ended_at(w, limit);
      if (outcome == MOVED) outcome = count < limit->iterations ? iterate(w) : STUCK;
      if (outcome != MOVED) break;
    }
  }
  memcpy(z, w->now.z, sizeof w->now.z);
  memcpy(y, w->now.y, CONSTRAINTS * sizeof(double));
  *f = w->objective;
  ended[0] = outcome;
  ended[1] = count;
}
